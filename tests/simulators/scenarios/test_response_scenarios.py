"""A response test in virtual time: the station steps the current in the stroke, a trip ends it at 0 A."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.identification.points.response_steps import COMMAND, response_tests
from rig.matrix.model import load_matrix
from simulators.testing.campaigns import Files, run_campaign

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[[response]]
stroke = "60 mm"
speed = ["0.15 m/s"]
current = ["1 A"]
repeats = 1
window = "200 ms"
[identify]
enabled = false
"""


@pytest.fixture
def matrix(tmp_path: Path) -> Path:
    path = tmp_path / "matrix.toml"
    path.write_text(MATRIX, encoding="utf-8")
    return path


def test_a_campaign_steps_the_current_in_the_straight_parts_and_measures_the_coil(matrix: Path, tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    end = run_campaign(Files(matrix, None), (), 1, tmp_path / "world")
    assert (end.exit_code, end.verdicts) == (0, {"response1": "valid"})
    (point,) = load_matrix(matrix).points()
    began_s = next(at_s for at_s, code, _ in end.truth.log if code == "START")
    commanded = [(at_s - began_s, text) for at_s, code, text in end.truth.log if code == "SET_CURRENT"]
    steps = [(at_s, f"{current_A:.3f} A") for at_s, current_A in zip(point.steps_s, point.steps_A, strict=True)][1:]
    assert [text for _, text in commanded[: len(steps)]] == [text for _, text in steps]
    late_s = np.array([at_s for at_s, _ in commanded[: len(steps)]]) - np.array([at_s for at_s, _ in steps])
    assert np.max(np.abs(late_s)) < 0.02
    assert np.ptp(late_s) < 0.004, "in step with the motion"
    (recorded,) = end.run.points
    assert (recorded.kind, recorded.steps_A, recorded.steps_s) == (point.kind, point.steps_A, point.steps_s)
    largest_N = np.nanmax(recorded.force_N)
    assert recorded.peak_force_N.rebound_N == pytest.approx(largest_N, rel=0.05), "at the higher current"
    tests, left_out = response_tests(end.run.points)
    assert left_out == []
    assert [(test.direction, test.rises, test.origin) for test in tests] == [
        (way, up, COMMAND) for way in ("rebound", "compression") for up in (True, False)
    ]
    for test in tests:
        assert test.current is not None
        assert test.current.lag.value_s == pytest.approx(0.04, abs=max(4.0 * test.current.lag.std_s, 1e-3))
        assert test.force.lag.value_s == pytest.approx(0.04, abs=4.0 * test.force.lag.std_s)
        assert abs(test.force.dead.value_s) < 0.005


@pytest.mark.nightly
def test_a_trip_during_a_current_program_leaves_0_A(matrix: Path, tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    end = run_campaign(Files(matrix, None), ("loadcell-pulled@1.9",), 1, tmp_path / "world")
    assert (end.exit_code, end.slug) == (4, "loadcell-pulled")
    assert end.at_rest
    assert max(end.truth.current_A) > 0.5, "the trip came while a step was on"
    off = np.flatnonzero(np.asarray(end.truth.current_A) > 0.05)[-1]
    assert all(value < 0.05 for value in end.truth.current_A[off + 1 :])
    commanded = [text for _, code, text in end.truth.log if code == "SET_CURRENT"]
    assert commanded[-1] == "0.000 A"
    assert len(commanded) < 5, "no step is commanded after the trip"
