from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_rig import SyntheticRig, put

from drivers.ring import RingWriter
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import recover
from rig.recording.journal.journal_file import JournalWriter, read_journal
from rig.recording.journal.recorder import PointRecorder, RecorderFailed
from rig.recording.run import Run

WAIT_S = 30.0


def recorded(campaign: Path, rig: SyntheticRig, stopped_by: str | None = None) -> Path:
    """Play a synthetic point through the ring into a journal."""
    records = rig.records()
    with RingWriter(campaign / "ring", 1 << 16) as ring:
        recorder = PointRecorder(campaign / "ring", campaign / "points")
        put(ring, records[:50])
        recorder.begin(rig.context(), expected_s=rig.length_s)
        for start in range(0, len(records), 500):
            put(ring, records[start:start + 500])
        journal = recorder.end(stopped_by)
        recorder.close()
    assert journal.records == len(records)
    assert journal.lost_records == 0
    return journal.path


def test_the_journal_holds_exactly_what_came_through_the_ring_while_the_point_ran(campaign: Path) -> None:
    rig = SyntheticRig()
    content = read_journal(recorded(campaign, rig))
    assert np.array_equal(content.records, rig.records())


def test_a_point_goes_through_the_finaliser_into_a_file_with_true_physics(campaign: Path) -> None:
    rig = SyntheticRig()
    journal = recorded(campaign, rig)
    finaliser = Finaliser.start(campaign)
    from rig.recording.journal.recorder import PointJournal

    finaliser.submit(PointJournal("p001", journal, 0, 0))
    finished = finaliser.wait("p001", WAIT_S)
    finaliser.close()
    assert finished.error == ""
    assert finished.verdict == "valid", finished.reasons
    assert not journal.exists()
    (point,) = Run.open(campaign).points
    time_s = point.time_s + point.test["controller_clock_at_zero_s"]
    assert np.nanmax(np.abs(point.displacement_m - rig.displacement(time_s))) < 1e-6
    force = point.force_samples
    assert np.allclose(force.force_N, rig.force(force.time_s + point.test["controller_clock_at_zero_s"]), atol=0.5)
    moving = np.abs(point.time_s - np.mean(point.time_s)) < 1.5
    power_W = np.nanmean((point.force_N * point.velocity_m_s)[moving])
    speed = 2 * np.pi * rig.frequency_Hz * rig.amplitude_m
    assert power_W == pytest.approx(0.5 * rig.damping * speed**2, rel=0.01)
    assert point.quality.motion.amplitude_m == pytest.approx(rig.amplitude_m, rel=1e-3)


def test_a_stopped_point_is_invalid_and_names_the_cause(campaign: Path) -> None:
    recorded(campaign, SyntheticRig(), stopped_by="force-limit")
    (finished,) = recover(campaign)
    assert finished.verdict == "invalid"
    assert finished.reasons[0].startswith("force-limit")


def test_a_second_attempt_keeps_the_first_file_under_another_name(campaign: Path) -> None:
    recorded(campaign, SyntheticRig(), stopped_by="operator")
    recover(campaign)
    (campaign / "ring").unlink()
    recorded(campaign, SyntheticRig())
    (second,) = recover(campaign)
    assert second.verdict == "valid"
    assert sorted(path.name for path in (campaign / "points").iterdir()) == ["p001-attempt1.h5.old", "p001.h5"]


def test_a_journal_whose_file_is_already_complete_is_only_deleted(campaign: Path) -> None:
    journal = recorded(campaign, SyntheticRig())
    kept = journal.read_bytes()
    recover(campaign)
    written_ns = (campaign / "points/p001.h5").stat().st_mtime_ns
    journal.write_bytes(kept)
    (again,) = recover(campaign)
    assert again.error == ""
    assert not journal.exists()
    assert (campaign / "points/p001.h5").stat().st_mtime_ns == written_ns


def test_a_damaged_header_leaves_the_journal_where_it_is(campaign: Path) -> None:
    journal = recorded(campaign, SyntheticRig())
    data = bytearray(journal.read_bytes())
    data[30] ^= 1
    journal.write_bytes(data)
    (finished,) = recover(campaign)
    assert "header is damaged" in finished.error
    assert journal.read_bytes() == bytes(data)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_recorded(campaign: Path) -> None:
    with RingWriter(campaign / "ring", 1024):
        recorder = PointRecorder(campaign / "ring", campaign / "missing")
        with pytest.raises(RecorderFailed, match="p001"):
            recorder.begin(SyntheticRig().context())
        recorder.close()


def test_the_recorder_keeps_its_cursor_moving_between_points(campaign: Path) -> None:
    with RingWriter(campaign / "ring", 1024) as ring:
        recorder = PointRecorder(campaign / "ring", campaign / "points")
        put(ring, SyntheticRig().records()[:500])
        deadline = time.monotonic() + WAIT_S
        while ring.recorder_cursor < 500 and time.monotonic() < deadline:
            assert recorder.healthy
        recorder.close()
        assert ring.recorder_cursor == 500


def test_an_answer_comes_even_when_the_finaliser_is_gone(campaign: Path) -> None:
    from rig.recording.journal.recorder import PointJournal

    finaliser = Finaliser.start(campaign)
    finaliser.close()
    assert not finaliser.alive
    finaliser.submit(PointJournal("p001", campaign / "points/p001.journal", 0, 0))
    assert finaliser.wait("p001", WAIT_S).error_slug == "conversion-crashed"


def test_closing_the_finaliser_finishes_what_it_was_given_and_answers_each_point_once(campaign: Path) -> None:
    from rig.recording.journal.recorder import PointJournal

    journal = recorded(campaign, SyntheticRig())
    names = [f"p00{number}" for number in range(1, 5)]
    for name in names[1:]:
        (campaign / "points" / f"{name}.journal").write_bytes(journal.read_bytes())
    finaliser = Finaliser.start(campaign)
    for name in names:
        finaliser.submit(PointJournal(name, campaign / "points" / f"{name}.journal", 0, 0))
    finaliser.close()
    assert [(answer.id, answer.error) for answer in finaliser.results()] == [(name, "") for name in names]
    assert len(Run.open(campaign).points) == 4


def test_a_killed_finaliser_leaves_journals_that_can_be_recovered(campaign: Path) -> None:
    from rig.recording.journal.recorder import PointJournal

    journal = recorded(campaign, SyntheticRig())
    finaliser = Finaliser.start(campaign)
    finaliser.submit(PointJournal("p001", journal, 0, 0))
    finaliser.kill()
    answer = finaliser.wait("p001", WAIT_S)
    if answer.error:
        assert "rig recover" in answer.error
        assert [point.error for point in recover(campaign)] == [""]
    assert Run.open(campaign).points[0].verdict == "valid"


RECORD_FOR_EVER = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from synthetic_rig import SyntheticRig, put
from drivers.ring import RingWriter
from rig.recording.journal.recorder import PointRecorder
campaign = Path(sys.argv[1])
rig = SyntheticRig(cycles=40)
ring = RingWriter(campaign / "ring", 1 << 16)
recorder = PointRecorder(campaign / "ring", campaign / "points")
recorder.begin(rig.context(), expected_s=60.0)
for record in rig.records():
    put(ring, record.reshape(1))
    if record["channel"] == 1:
        print(int(record["sequence"]), flush=True)
        time.sleep(0.001)
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("lines", [150, 431])
def test_a_killed_recorder_loses_less_than_100_ms_and_never_lies(campaign: Path, lines: int) -> None:
    here = str(Path(__file__).parent)
    process = subprocess.Popen(
        [sys.executable, "-c", RECORD_FOR_EVER, str(campaign), here], stdout=subprocess.PIPE, text=True,
    )
    assert process.stdout is not None
    with process.stdout:
        for _ in range(lines):
            last = int(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    rig = SyntheticRig(cycles=40)
    found = read_journal(campaign / "points/p001.journal").records
    assert np.array_equal(found, rig.records()[:len(found)])
    assert found[found["channel"] == 1]["sequence"].max() >= last - 100
    (finished,) = recover(campaign)
    assert finished.verdict == "invalid"
    assert any(reason.startswith("INTERRUPTED") for reason in finished.reasons)
    assert Run.open(campaign).points[0].quality.recovered is True


def test_a_point_stopped_at_any_moment_is_invalid_and_has_a_file(campaign: Path) -> None:
    """Also one stopped before its first cycle, while it ramps in, or with a handful of samples."""
    rig = SyntheticRig()
    records = rig.records()
    lengths = [40, 150, 400, 900, 1500, *range(2000, len(records), 700)]
    for number, length in enumerate(lengths):
        name = f"p{number:03d}"
        point = replace(rig.context().point, id=name)
        writer = JournalWriter(campaign / "points" / f"{name}.journal", rig.context(point=point).to_json())
        writer.append(records[:length])
        writer.close(stopped_by="sigint", lost_records=0)
    finished = recover(campaign)
    assert [(point.error, point.verdict) for point in finished] == [("", "invalid")] * len(lengths)
    assert [len(point.time_s) > 0 for point in Run.open(campaign).points] == [True] * len(lengths)
