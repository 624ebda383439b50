"""The locks on a rig's devices: they name the device, and what somebody planted in their place is left alone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign import machine_resources as locks
from rig.campaign.machine_resources import device_names, locked
from rig.errors import Refused

BENCH = Path(__file__).parents[3] / "examples" / "demo-bench.toml"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for locks that no campaign of this machine uses."""
    place = tmp_path / "lock"
    place.mkdir()
    place.chmod(0o1777)
    monkeypatch.setattr(locks, "LOCK_FOLDERS", (place, tmp_path))
    return place


HERE = "modbus-tcp://127.0.0.1:1502"


def bench(*, actuator: str = HERE, load_cell: str = "/dev/one", lvdt: str = "/dev/two") -> Bench:
    given = Bench.load(BENCH)
    return given.model_copy(
        update={
            "actuator": replace(given.actuator, url=actuator),
            "load_cell": replace(given.load_cell, url=load_cell),
            "lvdt": replace(given.lvdt, url=lvdt),
        }
    )


@pytest.mark.parametrize(
    "address",
    ["modbus-tcp://localhost:1502", "modbus-tcp://LOCALHOST:1502", "modbus-tcp://127.0.0.1:01502",
     "modbus-tcp://[::1]:1502", "modbus-tcp://127.1.2.3:1502", "modbus-tcp://[::ffff:127.0.0.1]:1502",
     f"modbus-tcp://{socket.gethostname()}:1502", "modbus-rtu:socket://localhost:1502"],
)  # fmt: skip
def test_this_machine_is_one_place_however_it_is_written(address: str) -> None:
    assert device_names(address) == device_names("modbus-tcp://127.0.0.1:1502")
    with locked(bench()), pytest.raises(Refused) as caught, locked(bench(actuator=address, load_cell="/a", lvdt="/b")):
        pytest.fail("the second lock was given")
    assert caught.value.slug == "two-instances"


def test_another_port_or_another_machine_is_another_device() -> None:
    here = device_names("modbus-tcp://127.0.0.1:1502")
    assert device_names("modbus-tcp://127.0.0.1:1503") != here
    assert device_names("modbus-tcp://192.0.2.7:1502") != here
    assert device_names("modbus-tcp://192.0.2.7:1502") == device_names("socket://192.0.2.7:1502")


def test_a_symbolic_link_is_the_port_it_leads_to(tmp_path: Path) -> None:
    port, link = tmp_path / "ttyUSB0", tmp_path / "by-id-load-cell"
    port.touch()
    link.symlink_to(port)
    assert device_names(f"modbus-rtu:{link}") == device_names(str(port)) == (str(port),)
    with locked(bench(load_cell=str(port))), pytest.raises(Refused), locked(
        bench(actuator="modbus-tcp://192.0.2.1:1", load_cell="/dev/other", lvdt=str(link))
    ):
        pytest.fail("the second lock was given")


def test_auxiliary_sensors_are_locked_too(tmp_path: Path) -> None:
    given = bench(actuator="modbus-tcp://192.0.2.1:1", load_cell="/dev/other", lvdt="/dev/more")
    shared = replace(given.lvdt, url="/dev/two")
    with locked(bench()), pytest.raises(Refused), locked(given.model_copy(update={"auxiliary": (shared,)})):
        pytest.fail("the second lock was given")


def test_one_bench_may_name_one_device_twice(folder: Path) -> None:
    with locked(bench(load_cell="/dev/one", lvdt="/dev/one")) as held:
        assert len(held) == len(set(held)) == len(list(folder.iterdir()))


@pytest.mark.parametrize("plant", [os.symlink, os.link], ids=["symbolic link", "hard link"])
def test_a_planted_link_is_refused_and_its_target_is_neither_written_nor_truncated(
    tmp_path: Path, folder: Path, plant: Callable[[Path, Path], None]
) -> None:
    precious = tmp_path / "precious"
    precious.write_text("years of work", encoding="utf-8")
    with locked(bench()):
        names = [path.name for path in folder.iterdir()]
    for name in names:
        (folder / name).unlink()
        plant(precious, folder / name)
    with pytest.raises(Refused, match="cannot be opened") as caught, locked(bench()):
        pytest.fail("the lock was given")
    assert caught.value.slug == "two-instances"
    assert precious.read_text(encoding="utf-8") == "years of work"


def test_a_fifo_in_the_locks_place_does_not_hang_the_campaign(folder: Path) -> None:
    with locked(bench()):
        names = [path.name for path in folder.iterdir()]
    for name in names:
        (folder / name).unlink()
        os.mkfifo(folder / name)
    with pytest.raises(Refused), locked(bench()):
        pytest.fail("the lock was given")


def test_the_second_asker_never_changes_what_the_first_wrote(folder: Path) -> None:
    with locked(bench()):
        before = {path: path.read_bytes() for path in folder.iterdir()}
        with pytest.raises(Refused), locked(bench()):
            pytest.fail("the second lock was given")
        assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.nightly
def test_the_folder_is_the_same_whatever_tmpdir_says(tmp_path: Path) -> None:
    ask = "from rig.campaign.machine_resources import _folder; print(_folder())"
    message = {
        subprocess.check_output([sys.executable, "-c", ask], env=os.environ | {"TMPDIR": place}, text=True)
        for place in (str(tmp_path), "/", "/var/tmp")
    }
    assert len(message) == 1
    assert str(tmp_path) not in message.pop()
