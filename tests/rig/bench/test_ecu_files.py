"""A bench file whose current source is a DBC and a roles file, beside it or inside it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign.file_copies import keep_bench
from rig.campaign.machine_resources import station_config
from rig.errors import FileProblem

EXAMPLES = Path(__file__).parents[3] / "examples"
BENCH = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
ROLES = (EXAMPLES / "coil-driver-roles.toml").read_text(encoding="utf-8")
BY_FILE = 'dbc = "coil-driver.dbc"\nroles = "coil-driver-roles.toml"'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("coil-driver.dbc", "coil-driver-roles.toml"):
        shutil.copy(EXAMPLES / name, tmp_path)
    return tmp_path


def bench(folder: Path, ecu: str = BY_FILE, extra: str = "") -> Path:
    gone = ("dbc", "command_period", 'stale_after = "30 ms') if "stale_after" in ecu else ("dbc",)
    lines = [line for line in BENCH.splitlines() if not line.startswith(gone)]
    at = lines.index("[ecu]") + 1
    path = folder / "bench.toml"
    path.write_text("\n".join([*lines[:at], ecu, *lines[at:]]) + "\n" + extra, encoding="utf-8")
    return path


def test_files_beside_the_bench_count_by_their_content_and_are_kept_with_it(folder: Path, tmp_path: Path) -> None:
    path = bench(folder)
    loaded = Bench.load(path)
    digest = loaded.digest
    assert loaded.ecu.dbc == str(folder / "coil-driver.dbc")
    kept = tmp_path / "campaign"
    kept.mkdir()
    keep_bench(path, kept / "bench.toml")
    assert Bench.load(kept / "bench.toml").digest == digest
    (folder / "coil-driver-roles.toml").write_text(ROLES.replace("= 100", "= 101"), encoding="utf-8")
    assert Bench.load(path).digest != digest


def test_roles_may_stand_in_the_bench_file_itself(folder: Path) -> None:
    inline = ROLES.replace("\n[", "\n[ecu.roles.")
    path = bench(folder, 'dbc = "coil-driver.dbc"', "[ecu.roles]\n" + inline)
    assert isinstance(Bench.load(path).ecu.roles, dict)
    path.write_text(path.read_text().replace('"DriverStatus.Actual"', '"DriverStatus.Actuu"'), encoding="utf-8")
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if "Actuu" in text)
    with pytest.raises(FileProblem, match=f"line {line}: ecu.roles.measured_current = .*nearest: Actual"):
        Bench.load(path)


@pytest.mark.parametrize(
    ("ecu", "message"),
    [
        ('dbc = "coil-driver.dbc"', 'a DBC file requires roles.*write roles = "ecu-roles.toml"'),
        ('dbc = "demo"\nroles = "coil-driver-roles.toml"', 'a DBC file; "demo" already defines the meaning'),
        ('dbc = "none.dbc"\nroles = "coil-driver-roles.toml"', "none.dbc: there is no such file"),
        ('dbc = "coil-driver.dbc"\nroles = "none.toml"', "none.toml: there is no such file"),
        (f'{BY_FILE}\ninterface_options = {{channel = "x"}}', r"belongs in \[ecu\]\. Fix"),
    ],
)
def test_what_does_not_go_together_is_refused_by_line(folder: Path, ecu: str, message: str) -> None:
    with pytest.raises(FileProblem, match=rf"line \d+: ecu\..*{message}"):
        Bench.load(bench(folder, ecu))


def _fixed(folder: Path) -> Path:
    shutil.copy(EXAMPLES / "coil-driver.dbc", folder)
    return folder


def test_a_limit_beyond_the_set_point_and_a_patience_below_two_statuses_are_refused(folder: Path) -> None:
    dbc = folder / "coil-driver.dbc"
    dbc.write_text(dbc.read_text().replace("[-5000|5000]", "[-2000|2000]"), encoding="utf-8")
    with pytest.raises(FileProblem, match=r"limits\.current = .*exceeds the set-point range of the current source"):
        Bench.load(bench(folder))
    with pytest.raises(FileProblem, match=r"ecu\.command_period = .*too long for an ECU with a time-out of 60 ms"):
        Bench.load(bench(_fixed(folder), f'{BY_FILE}\ncommand_period = "40 ms"\nstale_after = "90 ms"'))
    slow = 'periods = {DriverStatus = "20 ms"}\n' + ROLES
    (folder / "coil-driver-roles.toml").write_text(slow, encoding="utf-8")
    dbc.write_text((EXAMPLES / "coil-driver.dbc").read_text(), encoding="utf-8")
    with pytest.raises(FileProblem, match=r"ecu\.stale_after = .*two update periods of the measured current"):
        Bench.load(bench(folder))


STATION = """
import sys
from pathlib import Path
from drivers.catalogue import make_actuator, make_current_source
from drivers.connection import ActuatorConnection, CanAddress
from rig.bench.settings_json import from_json
import rig.station.threads.devices
config = from_json(Path(sys.argv[1]).read_text())
actuator = make_actuator(config.actuator.described, ActuatorConnection("modbus-tcp://127.0.0.1:1"))
source = make_current_source(*config.ecu.described_source, CanAddress("virtual", "x"))
assert "pydantic" not in sys.modules, "the station loads no validator"
print(actuator.capabilities.generator, source.timing.status_s)
"""


def test_the_station_makes_its_devices_of_tables_when_the_files_are_gone(folder: Path) -> None:
    page = (EXAMPLES.parent / "docs/how-to/write-a-register-map.md").read_text(encoding="utf-8")
    (folder / "mine.toml").write_text(page.split("```toml\n")[1].split("```")[0], encoding="utf-8")
    path = bench(folder)
    path.write_text(path.read_text().replace('register_map = "demo"', 'register_map = "mine.toml"'), encoding="utf-8")
    config = station_config(Bench.load(path), None, folder / "ring")
    (folder / "station.json").write_text(config.to_json(), encoding="utf-8")
    for name in ("mine.toml", "coil-driver.dbc", "coil-driver-roles.toml"):
        (folder / name).unlink()
    done = subprocess.run(
        [sys.executable, "-c", STATION, str(folder / "station.json")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "0.005"]
