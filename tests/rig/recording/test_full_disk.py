"""A disk that fills while files are made: an error with its name, every journal kept, nothing half-written left."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from rig.recording.atomic_write import ReservedFile, write_text_durably, write_whole
from rig.recording.conversion.conversion import finish_alone
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import recover
from rig.recording.importing import import_tests
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.journal.recorder import PointJournal
from rig.recording.run import Run

RIG = SyntheticRig(cycles=3, frequency_Hz=2.0)
WAIT_S = 60.0


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 4 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)], capture_output=True, text=True, check=False
    ) if shutil.which("mount") else None
    if mounted is None or mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {'' if mounted is None else mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def campaign_on(disk: Path, *names: str) -> Path:
    """A campaign with one closed journal a name."""
    (disk / "c" / "points").mkdir(parents=True)
    for name in names:
        point = replace(RIG.context().point, id=name)
        writer = JournalWriter(disk / "c" / "points" / f"{name}.journal", RIG.context(point=point).to_json())
        writer.append(RIG.records())
        writer.close(stopped_by=None, lost_records=0)
    return disk / "c"


def fill(disk: Path, left_bytes: int) -> Path:
    """Take all room but this."""
    ballast = disk / "ballast"
    free = shutil.disk_usage(disk).free
    with ballast.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, free - left_bytes)
    assert shutil.disk_usage(disk).free <= left_bytes
    return ballast


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_finaliser_says_that_the_disk_is_full_and_finishes_when_there_is_room(disk: Path) -> None:
    campaign = campaign_on(disk, "p001", "p002")
    ballast = fill(disk, 40_000)
    finaliser = Finaliser.start(campaign)
    for name in ("p001", "p002"):
        finaliser.submit(PointJournal(name, campaign / "points" / f"{name}.journal", 0, 0))
    answers = [finaliser.wait(name, WAIT_S) for name in ("p001", "p002")]
    assert [answer.error_slug for answer in answers] == ["disk-full", "disk-full"]
    assert "No space left on device" in answers[0].error
    assert names_in(campaign / "points") == ["p001.journal", "p002.journal"]
    assert finaliser.alive
    ballast.unlink()
    finaliser.submit(PointJournal("p001", campaign / "points" / "p001.journal", 0, 0))
    assert finaliser.wait("p001", WAIT_S).verdict == "valid"
    finaliser.close()
    assert [(answer.id, answer.verdict) for answer in recover(campaign)] == [("p002", "valid")]
    assert [point.verdict for point in Run.open(campaign).points] == ["valid", "valid"]


def test_recovery_on_a_full_disk_keeps_every_journal_and_a_second_one_finishes_them(disk: Path) -> None:
    campaign = campaign_on(disk, "p001", "p002")
    ballast = fill(disk, 20_000)
    assert [answer.error_slug for answer in recover(campaign)] == ["disk-full", "disk-full"]
    assert names_in(campaign / "points") == ["p001.journal", "p002.journal"]
    ballast.unlink()
    assert [(answer.id, answer.verdict) for answer in recover(campaign)] == [("p001", "valid"), ("p002", "valid")]


def test_whatever_room_is_left_a_file_is_complete_or_not_there(disk: Path) -> None:
    campaign = campaign_on(disk, "p001")
    journal = campaign / "points" / "p001.journal"
    kept, outcomes = journal.read_bytes(), []
    for left_bytes in range(0, 220_000, 20_480):
        ballast = fill(disk, left_bytes)
        answer = finish_alone(journal)
        outcomes.append(answer.error_slug)
        if answer.error:
            assert answer.error_slug == "disk-full"
            assert names_in(campaign / "points") == ["p001.journal"]
        else:
            assert Run.open(campaign).points[0].verdict == "valid"
            (campaign / "points" / "p001.h5").unlink()
            ballast.unlink()
            journal.write_bytes(kept)
        ballast.unlink(missing_ok=True)
    assert outcomes[0] == "disk-full"
    assert outcomes[-1] == ""


def test_an_import_that_finds_no_room_leaves_nothing(disk: Path, tmp_path: Path) -> None:
    time_s = np.arange(4000) * 0.002
    rows = [f"{t:.3f},{20 * np.sin(6 * t):.4f},{300 * np.cos(6 * t):.2f}" for t in time_s]
    (tmp_path / "a.csv").write_text("\n".join(["t_s,x_mm,F_N", *rows, ""]), encoding="ascii")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    fill(disk, 20_000)
    with pytest.raises(Exception, match="No space left on device"):
        import_tests([tmp_path / "a.csv"], columns=columns, out=disk / "out", current_A=0.0)
    assert list((disk / "out").iterdir()) == []


def test_a_text_that_finds_no_room_leaves_the_former_one(disk: Path) -> None:
    path = disk / "campaign.json"
    write_text_durably(path, "first")
    fill(disk, 0)
    with pytest.raises(OSError, match="No space left on device") as caught:
        write_text_durably(path, "second" * 10_000)
    assert caught.value.errno == errno.ENOSPC
    assert path.read_text(encoding="utf-8") == "first"
    assert names_in(disk) == ["ballast", "campaign.json"]


@pytest.mark.few(4)
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EDQUOT])
@pytest.mark.parametrize("call", ["posix_fallocate", "pwrite", "fsync", "replace"])
def test_an_error_at_any_call_reaches_the_caller_and_hdf5_never_sees_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, number: int
) -> None:
    path = tmp_path / "p.h5"
    path.write_bytes(b"what was there")
    real = getattr(os, call)
    for good_calls in (0, 1, 4) if call in {"posix_fallocate", "pwrite"} else (0,):
        calls = 0

        def failing(*arguments: object) -> object:
            nonlocal calls
            calls += 1
            if calls > good_calls:  # noqa: B023 - used up before the next turn
                raise OSError(number, os.strerror(number))
            return real(*arguments)

        with monkeypatch.context() as patched:
            patched.setattr(os, call, failing)
            with pytest.raises(OSError, match=os.strerror(number)) as caught:
                write_whole(path, forty_datasets)
        assert caught.value.errno == number
        assert names_in(tmp_path) == ["p.h5"]
        assert path.read_bytes() == b"what was there"


def forty_datasets(file: ReservedFile) -> None:
    with h5py.File(file, "w") as opened:
        for number in range(40):
            values = np.random.default_rng(number).random(20_000)
            opened.create_dataset(f"d{number}", data=values, chunks=(5_000,), compression="gzip")
        assert np.array_equal(opened["d3"][:], np.random.default_rng(3).random(20_000)), "also what found no room"
