"""Names of points that look like each other's attempts never meet, and nothing of another point is ever moved."""

from __future__ import annotations

import errno
import fcntl
import os
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_rig import SyntheticRig

from rig.recording.conversion.conversion import finish_alone
from rig.recording.conversion.recovery import set_aside
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.journal.recorder import PointJournal, kept_apart
from rig.recording.point_files import (
    attempt_name,
    free_old_journal,
    free_out_of_tolerance_name,
    journal_name,
    names_in,
)
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

RIG = SyntheticRig(cycles=3, frequency_Hz=2.0)
RECORDS = RIG.records()
LIKE_EACH_OTHER = (
    "loop", "loop-1", "loop-2", "loop-10", "p100", "p1000", "x", "x-attempt1", "x-attempt2", "x-attempt2-attempt2",
    "x-out-of-tolerance1", "x-unreadable-20260102T030405", "p001", "p001-attempt1",
)
IDS = st.sampled_from(LIKE_EACH_OTHER) | st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", fullmatch=True)


def journal_of(folder: Path, point_id: str, *, name: str = "", provenance: bool = True) -> Path:
    point = replace(RIG.context().point, id=name or point_id)
    context = RIG.context(point=point, provenance={"point": point_id, "attempt": "1"} if provenance else {})
    path = folder / f"{name or point_id}.journal"
    writer = JournalWriter(path, context.to_json())
    writer.append(RECORDS)
    writer.close(stopped_by=None, lost_records=0)
    return path


def test_the_first_attempt_has_the_points_name_and_later_ones_say_which_they_are() -> None:
    assert [attempt_name("p001", attempt) for attempt in (1, 2, 3)] == ["p001", "p001-attempt2", "p001-attempt3"]


@given(st.sets(IDS, min_size=1, max_size=8), st.integers(2, 4))
def test_no_two_attempts_of_any_points_have_one_name(ids: set[str], attempts: int) -> None:
    ids = {each for each in ids if sum(each.casefold() == other.casefold() for other in ids) == 1}
    names = [attempt_name(each, attempt, ids) for each in ids for attempt in range(1, attempts + 1)]
    assert len({name.casefold() for name in names}) == len(names)


@given(IDS)
def test_a_journals_name_is_found_again_in_the_name_it_was_set_aside_under(point_id: str) -> None:
    journal = Path("points") / f"{point_id}.journal"
    assert journal_name(journal) == point_id
    assert journal_name(free_old_journal(journal)) == point_id


@pytest.mark.parametrize("point_id", LIKE_EACH_OTHER)
def test_setting_one_point_aside_touches_no_other(tmp_path: Path, point_id: str) -> None:
    for name in LIKE_EACH_OTHER:
        journal_of(tmp_path, name)
    before = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}
    set_aside(tmp_path, point_id, LIKE_EACH_OTHER)
    after = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}
    moved = before.keys() - after.keys()
    assert moved == {f"{point_id}.journal"}
    assert [journal_name(tmp_path / name) for name in after.keys() - before.keys()] == [point_id]
    assert set(after.values()) == set(before.values())


def test_files_go_by_the_point_they_hold_and_not_by_what_their_name_looks_like(tmp_path: Path) -> None:
    ids = ("x", "x-attempt2")
    for point_id, name in (("x", "x"), ("x", "x-attempt3"), ("x", "x.attempt2"), ("x-attempt2", "x-attempt2")):
        finish_alone(journal_of(tmp_path, point_id, name=name))
    (tmp_path / "x-attempt4.h5").write_bytes(b"damaged")
    set_aside(tmp_path, "x", ids)
    assert sorted(path.name for path in tmp_path.glob("*.h5")) == ["x-attempt2.h5"]
    assert len(list(tmp_path.glob("x-attempt*.h5.old"))) == 4
    set_aside(tmp_path, "x-attempt2", ids)
    assert (tmp_path / "x-attempt2-attempt1.h5.old").exists()


def test_a_journal_that_is_being_converted_is_never_moved(tmp_path: Path) -> None:
    journal = journal_of(tmp_path, "loop")
    handle = os.open(journal, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with pytest.raises(OSError, match="unavailable") as caught:
        set_aside(tmp_path, "loop", ("loop",))
    os.close(handle)
    assert caught.value.errno == errno.EWOULDBLOCK
    assert list(tmp_path.iterdir()) == [journal]


def test_a_journal_of_the_same_name_without_a_word_on_its_point_is_the_points(tmp_path: Path) -> None:
    journal_of(tmp_path, "p001", provenance=False)
    (tmp_path / "p001-attempt2.journal").write_bytes(b"damaged")
    set_aside(tmp_path, "p001", ("p001", "p002"))
    assert not list(tmp_path.glob("*.journal"))
    assert len(list(tmp_path.glob("*.journal.old"))) == 2


def test_a_motion_out_of_tolerance_is_kept_listed_and_not_used(campaign: Path) -> None:
    points = campaign / "points"
    ids = ("p001", "p001-out-of-tolerance2")
    for number in (1, 2):
        writer = JournalWriter(points / "p001.journal", RIG.context().to_json())
        writer.append(RECORDS)
        writer.event(RECORDS["host_ns"][100].item(), "out-of-tolerance", f"{number} mm of 30 mm reached")
        writer.close(stopped_by=None, lost_records=0)
        kept = kept_apart(PointJournal("p001", points / "p001.journal", len(RECORDS), 0), ids)
        assert finish_alone(kept.path).verdict == "invalid"
    finish_alone(journal_of(points, "p001"))
    run = Run.open(campaign)
    assert [point.id for point in run.points] == ["p001"]
    assert [point.id for point in run.usable] == ["p001"]
    assert [point.id for point in run.apart] == ["p001-out-of-tolerance1", "p001.out-of-tolerance2"]
    assert [point.reasons for point in run.apart] == [
        (f"out-of-tolerance: {number} mm of 30 mm reached",) for number in (1, 2)
    ]
    raw = run.apart[0].raw("force")
    assert raw is not None
    assert raw["value"].tolist() == RECORDS["value"][RECORDS["channel"] == 1].tolist()
    assert set(run.to_pandas()["id"]) == {"p001", "p001-out-of-tolerance1", "p001.out-of-tolerance2"}


def test_a_kept_motion_killed_before_it_had_its_name_is_still_no_valid_point(campaign: Path) -> None:
    writer = JournalWriter(campaign / "points" / "p001.journal", RIG.context().to_json())
    writer.append(RECORDS)
    writer.event(RECORDS["host_ns"][100].item(), "out-of-tolerance", "29 mm of 30 mm reached")
    writer.close(stopped_by=None, lost_records=0)
    finish_alone(campaign / "points" / "p001.journal")
    assert RecordedPoint.open(campaign / "points" / "p001.h5").verdict == "invalid"


def test_names_in_a_folder_are_those_of_the_points(tmp_path: Path) -> None:
    old = "d-unreadable-20260102T030405000000.journal.old"
    for name in ("a.h5", "a-attempt1.h5.old", "b.journal", "c.h5.tmp", old):
        (tmp_path / name).touch()
    assert names_in(tmp_path) == {"a", "a-attempt1", "b", "c", "d"}
    (tmp_path / "a-out-of-tolerance1.h5").touch()
    assert free_out_of_tolerance_name(tmp_path, "a") == "a-out-of-tolerance2"
