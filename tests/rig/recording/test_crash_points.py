"""Recorder, finaliser and recovery killed at every call that reaches the disk: nothing false, nothing finished lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from rig.recording.conversion.conversion import finish_alone
from rig.recording.conversion.recovery import recover_with
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.point_files import FinishedPoint
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

CALLS = ("pwrite", "ftruncate", "fdatasync", "fsync", "replace", "rename", "unlink")
RIG = SyntheticRig(cycles=2, frequency_Hz=2.0)
RECORDS = RIG.records()
BLOCK = 1200


def recover(campaign: Path) -> list[FinishedPoint]:
    """Recovery with the conversion in this process, whose calls can be counted."""
    return recover_with(campaign / "points", lambda journal: finish_alone(journal, recovered=True))


def record(points: Path) -> None:
    """One point from the first sample to the finished file."""
    writer = JournalWriter(points / "p002.journal", RIG.context().to_json(), reserve_bytes=200_000)
    for start in range(0, len(RECORDS), BLOCK):
        writer.append(RECORDS[start : start + BLOCK])
    writer.close(stopped_by=None, lost_records=0)
    assert finish_alone(points / "p002.journal").error == ""


def killed_at(number: int, work: Callable[[], object], *, half: bool) -> bool:
    """Do `work` in a process that is killed at its `number`-th call; `half` lets that call write one half first.

    Returns:
        False when the work was done before.
    """
    child = os.fork()
    if child == 0:
        count_down(number, half=half)
        try:
            work()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def count_down(number: int, *, half: bool) -> None:
    """Kill this process at its `number`-th call of `CALLS`."""
    left, images = number, 0
    path_of = os.readlink

    def one_of_many(name: str, arguments: tuple[object, ...]) -> bool:
        """Of the hundreds of writes into one HDF5 image, all but every 40th: the file has no name yet."""
        nonlocal images
        if name != "pwrite" or not path_of(f"/proc/self/fd/{arguments[0]}").endswith(".h5.tmp"):
            return False
        images += 1
        return images % 40 != 1

    def counting(name: str, call: Callable[..., object]) -> Callable[..., object]:
        def counted(*arguments: object, **named: object) -> object:
            nonlocal left
            if one_of_many(name, arguments):
                return call(*arguments, **named)
            left -= 1
            if left == 0:
                if half and name == "pwrite":
                    handle, data, offset = arguments
                    call(handle, bytes(data)[: len(bytes(data)) // 2], offset)  # type: ignore[arg-type] # as pwrite
                os.kill(os.getpid(), signal.SIGKILL)
            return call(*arguments, **named)

        return counted

    for name in CALLS:
        setattr(os, name, counting(name, getattr(os, name)))


def campaigns(folder: Path) -> Iterator[Path]:
    """Fresh campaign directories, each with a finished point."""
    folder.mkdir()
    (folder / "points").mkdir()
    writer = JournalWriter(folder / "points" / "p001.journal", RIG.context().to_json())
    writer.append(RECORDS)
    writer.close(stopped_by=None, lost_records=0)
    assert finish_alone(folder / "points" / "p001.journal").error == ""
    finished = (folder / "points" / "p001.h5").read_bytes()
    number = 0
    while True:
        number += 1
        campaign = folder / f"campaign{number}"
        (campaign / "points").mkdir(parents=True)
        (campaign / "points" / "p001.h5").write_bytes(finished)
        yield campaign


def assert_true(campaign: Path, finished: bytes) -> RecordedPoint | None:
    """After recovery: the finished point untouched, nothing left over, and of the other only true samples."""
    for answer in recover(campaign):
        assert answer.error == "" or "journal" in answer.error.lower() or "NothingRecorded" in answer.error, answer
    points = campaign / "points"
    assert (points / "p001.h5").read_bytes() == finished
    assert not list(points.glob("*.tmp"))
    left = sorted(path.name for path in points.iterdir())
    assert left in (["p001.h5"], ["p001.h5", "p002.h5"], ["p001.h5", "p002.journal"]), left
    if "p002.h5" not in left:
        return None
    run = Run.open(campaign)
    point = run.points[1]
    raw = point.raw("force")
    assert raw is not None
    true = RECORDS[RECORDS["channel"] == 1]
    assert np.array_equal(raw["value"], true["value"][: len(raw["value"])])
    assert np.array_equal(raw["sequence"], true["sequence"][: len(raw["sequence"])])
    assert point.verdict == "valid" or "INTERRUPTED" in point.reasons[0] or "journal" in point.reasons[0]
    assert len(raw["value"]) == len(true) or point.verdict == "invalid"
    return point


@pytest.mark.few(1)
@pytest.mark.parametrize("half", [False, True], ids=["before", "half-written"])
def test_a_kill_at_any_call_of_recorder_and_finaliser_leaves_true_samples_and_the_finished_point(
    tmp_path: Path, half: bool
) -> None:
    verdicts = []
    for number, campaign in enumerate(campaigns(tmp_path / "c"), start=1):
        finished = (campaign / "points" / "p001.h5").read_bytes()
        if not killed_at(number, lambda points=campaign / "points": record(points), half=half):
            break
        point = assert_true(campaign, finished)
        verdicts.append("none" if point is None else point.verdict)
    print(f"{len(verdicts)} crash points: {verdicts}")  # noqa: T201 - the size of what was explored, with -s
    assert len(verdicts) > 10
    assert {"invalid", "valid"} <= set(verdicts)
    assert verdicts.index("valid") > verdicts.index("invalid"), "complete journals become valid points"


@pytest.mark.nightly
def test_a_kill_at_any_call_of_recovery_loses_nothing_and_a_second_recovery_finishes(tmp_path: Path) -> None:
    killed = 0
    for number, campaign in enumerate(campaigns(tmp_path / "c"), start=1):
        finished = (campaign / "points" / "p001.h5").read_bytes()
        writer = JournalWriter(campaign / "points" / "p002.journal", RIG.context().to_json())
        writer.append(RECORDS)
        writer.close(stopped_by=None, lost_records=0)
        (campaign / "points" / "p003.h5.tmp").write_bytes(b"half a file")
        if not killed_at(number, lambda folder=campaign: recover(folder), half=False):
            break
        killed += 1
        point = assert_true(campaign, finished)
        assert point is not None
        assert point.verdict == "valid"
    assert killed >= 4
