"""Worlds in which a point's motion is recorded out of tolerance, and the point is not run again: its record is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from matrices import matrix_text

from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.runs import live

MATRIX = matrix_text("0.5 A", amplitude="5 mm", frequency="4 Hz", more='waveform = ["triangle"]')
"""The first motion comes out 5 % too small, its second one begins 5 s after the start."""
UNSETTLED = "current-tracking: the measured current did not reach 0.5 A in 5 s"


@pytest.mark.parametrize(
    ("events", "message"),
    [(("current-tracking@0.9",), UNSETTLED), (("current-tracking@0.9", "sigint@5"), "")],
    ids=["given-up", "stopped"],
)
def test_a_record_out_of_tolerance_is_reported_of_a_point_that_is_not_run_again(
    events: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    """The session that recorded it tells what the next one would: an invalid file, not a point without one."""
    plan = ScenarioPlan(1, MATRIX, tuple(map(FaultEvent.parse, events)))
    scenario, ended = live(plan, tmp_path, most_sessions=1)
    assert ended.failed == ()
    (point,) = scenario.sessions[0].answer.points
    assert point.file is not None
    assert (point.file.name, point.verdict) == ("p001-out-of-tolerance1.h5", "invalid")
    assert point.file.is_file()
    assert any(reason.startswith("out-of-tolerance: p001: 4.7") for reason in point.reasons)
    assert point.reasons[-1] == message or not message
