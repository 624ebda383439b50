"""A test point is the same in the matrix, in its journal's header, and in its file."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import h5py
import pytest
from synthetic_rig import SyntheticRig

from rig.errors import FileProblem
from rig.recording.conversion.conversion import build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import PointContext
from rig.recording.point_attributes import NAMES, Commanded, attributes_of, point_fields
from rig.recording.recorded_point import RecordedPoint
from rig.signals.record import RecordFacts
from rig.test_point import TestPoint

ROAD = RecordFacts("iso8608-c", 20.0, 1.0, 12.5, "ab")
LOOP = TestPoint("p001", "sine", 0.02, 1.5, 0.5, 6, 1.0, 0.5, 0.003, 2, 0.25)
POINTS = (
    LOOP,
    TestPoint("steps1", "hold", 0.0, 2.0, 1.0, 2, 0.0, 0.0, kind="current_step", steps_A=(0.2, 1.0)),
    TestPoint("hybrid-model", "hold", 0.02, 0.1, 1.0, 1, 0.0, 0.0, kind="hybrid", steps_A=(0.3,), law="skyhook"),
    TestPoint("response1", "triangle", 0.04, 0.625, 2.0, 4, 1.0, 1.0, kind="response", steps_A=(0.0, 2.0, 0.5),
              steps_s=(0.0, 1234.567891, 1300.0)),
    TestPoint("p002", "road", 0.01, 4.0, 1.0, 1, 0.0, 0.0, kind="signal", record=ROAD),
)
COMMANDED = Commanded(0.0213, 0.0031, 0.01, 20.0, 45.0)
CONTENT = JournalContent("", SyntheticRig(cycles=3).records(), end={"stopped_by": None, "lost_records": 0})


@pytest.mark.parametrize("point", POINTS, ids=lambda point: point.kind)
def test_a_test_point_is_the_same_in_matrix_header_and_file(point: TestPoint, tmp_path: Path) -> None:
    context = SyntheticRig(cycles=3).context(point=point, commanded=COMMANDED)
    assert attributes_of(point, COMMANDED).keys() <= NAMES
    again = PointContext.from_json(context.to_json())
    assert (again.point, again.commanded) == (point, COMMANDED)
    write_file(tmp_path / "p.h5", build(CONTENT, context)[0])
    recorded = RecordedPoint.open(tmp_path / "p.h5")
    read = {one.name: getattr(recorded, one.name) for one in fields(TestPoint)}
    assert (TestPoint(**read), recorded.commanded) == (point, COMMANDED)
    assert (recorded.motion, recorded.described) == (point.motion, point.described)


def test_a_rod_at_rest_has_no_frequency_that_sensors_must_pass(tmp_path: Path) -> None:
    """Steps of 60 ms are 15 samples of 250 Hz; that is no cycle of a motion."""
    point = replace(POINTS[1], frequency_Hz=1.0 / 0.06)
    write_file(tmp_path / "p.h5", build(CONTENT, SyntheticRig(cycles=3).context(point=point))[0])
    reasons = RecordedPoint.open(tmp_path / "p.h5").quality.verdict.entries
    assert "bandwidth" not in {reason.slug for reason in reasons}


def test_what_an_earlier_recording_does_not_state_is_0() -> None:
    stated = {"id": "p", "waveform": "sine", "amplitude_m": 0.01, "frequency_Hz": 1.0, "current_A": 0.5}
    assert TestPoint(**point_fields(stated)) == TestPoint("p", "sine", 0.01, 1.0, 0.5, 0.0, 0.0, 0.0)


def test_steps_that_are_no_numbers_are_refused_with_their_file(tmp_path: Path) -> None:
    path = tmp_path / "p.h5"
    write_file(path, build(CONTENT, SyntheticRig(cycles=3).context(point=replace(LOOP, steps_A=(1.0,))))[0])
    with h5py.File(path, "r+") as file:
        file["entry/test"].attrs["steps_A"] = "1 A"
    with pytest.raises(FileProblem, match="steps_A = '1 A'"):
        RecordedPoint.open(path, whole=False)
