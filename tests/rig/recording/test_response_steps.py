"""From a recorded response point to its times: a synthetic rig whose coil and fluid are known."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from synthetic_rig import SyntheticRig

from drivers.ring import Channel
from rig.display import SI
from rig.document.terminal import lines
from rig.identification.points.current_steps import lag_of
from rig.identification.points.response_steps import COMMAND, CURRENT, ResponseTest, response_tests
from rig.matrix.response_table import ResponseTable
from rig.recording.conversion.conversion import build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import PointContext
from rig.recording.recorded_point import RecordedPoint
from rig.report.response import response_blocks, response_section
from rig.results.content import content_of
from rig.test_point import TestPoint

COIL_S, FLUID_S, STEP_N = 0.012, 0.006, 500.0
TABLE = ResponseTable(amplitude_m=0.03, speed_m_s=(0.15,), current_A=(1.0,), repeats=3, window_s=0.15)
(POINT,) = TABLE.points(1, 0.0, 0.0)


@dataclass(frozen=True)
class SteppedRig(SyntheticRig):
    """A triangle whose current is stepped: force = spring + 500 N/A x fluid current against the motion."""

    point: TestPoint = POINT
    fluid_s: float = FLUID_S
    late_s: float = 0.0
    coil_s: float = COIL_S
    filter_delay_s: float = 0.0

    def displacement(self, time_s: np.ndarray) -> np.ndarray:
        phase = self.phase(time_s)
        return self.amplitude_m * self.envelope(time_s) * (1.0 - np.abs(4.0 * ((phase + 0.25) % 1.0) - 2.0))

    def current(self, time_s: np.ndarray, second_s: float = 0.0) -> np.ndarray:
        """The coil's current, or what the fluid makes of it (A)."""
        total, lag_s = np.zeros(len(time_s)), self.coil_s
        changes = np.diff((0.0, *self.point.steps_A))
        for at_s, change_A in zip(self.point.steps_s, changes, strict=True):
            since_s = np.maximum(time_s - self.start_s - self.late_s - at_s, 0.0)
            share = 1.0 - np.exp(-since_s / lag_s)
            if second_s:
                share = 1.0 - (lag_s * np.exp(-since_s / lag_s) - second_s * np.exp(-since_s / second_s)) / (
                    lag_s - second_s
                )
            total += change_A * share
        return total

    def force(self, time_s: np.ndarray) -> np.ndarray:
        step = 1e-5
        way = np.sign(self.displacement(time_s + step) - self.displacement(time_s - step))
        return self.stiffness * self.displacement(time_s) + STEP_N * way * self.current(time_s, second_s=self.fluid_s)

    def seen_current(self, time_s: np.ndarray) -> np.ndarray:
        """The coil's current behind a second-order Butterworth low-pass with this delay."""
        if not self.filter_delay_s:
            return self.current(time_s)
        fine_s = np.arange(time_s[0] - 0.5, time_s[-1] + 1e-3, 1e-4)
        cutoff_Hz = math.sqrt(2.0) / (math.tau * self.filter_delay_s)
        passed = sosfilt(butter(2, cutoff_Hz, fs=1e4, output="sos"), self.current(fine_s))
        return np.interp(time_s, fine_s, passed)

    def records(self) -> np.ndarray:
        everything = super().records()
        coil = everything["channel"] == Channel.COIL_CURRENT
        at_s = everything["device_us"][coil] * 1e-6 + 42.0
        noise_A = 0.002 * np.random.default_rng(2).standard_normal(len(at_s))
        everything["value"][coil] = self.seen_current(at_s) + noise_A
        commands = np.zeros(len(self.point.steps_s), everything.dtype)
        commands["host_ns"] = np.round(1e9 * (self.start_s + self.late_s + np.array(self.point.steps_s)))
        commands["device_us"], commands["value"] = -1, self.point.steps_A
        commands["channel"], commands["sequence"] = Channel.COMMANDED_CURRENT, np.arange(len(commands))
        whole = np.concatenate((everything, commands))
        return whole[np.argsort(whole["host_ns"], kind="stable")]


def rig_of(**changes: object) -> SteppedRig:
    fields = {
        "amplitude_m": POINT.amplitude_m, "frequency_Hz": POINT.frequency_Hz, "cycles": int(POINT.cycles),
        "noise_N": 5.0, "rate_Hz": 500.0, "stiffness": 2000.0,
    }
    return SteppedRig(**{**fields, **changes})  # type: ignore[arg-type]  # the fields' own types


def recorded(folder: Path, rig: SteppedRig, **context: object) -> RecordedPoint:
    given: PointContext = rig.context(point=rig.point, **context)
    path = folder / "points" / "p.h5"
    path.parent.mkdir()
    content = JournalContent("", rig.records(), end={"stopped_by": None, "lost_records": 0})
    write_file(path, build(content, given)[0])
    return RecordedPoint.open(path)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[RecordedPoint, tuple[ResponseTest, ...]]:
    point = recorded(tmp_path_factory.mktemp("response"), rig_of())
    tests, left_out = response_tests([point])
    assert left_out == []
    return point, tests


def test_the_point_is_valid_and_its_current_is_not_taken_for_off(
    measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]
) -> None:
    assert (measured[0].verdict, measured[0].reasons) == ("valid", ())


def test_each_direction_and_sign_is_a_test_of_all_its_repeats(
    measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]
) -> None:
    kinds = [(test.direction, test.from_A, test.to_A, test.steps, test.discarded) for test in measured[1]]
    assert kinds == [
        ("rebound", 0.0, 1.0, 3, 0), ("rebound", 1.0, 0.0, 3, 0),
        ("compression", 0.0, 1.0, 3, 0), ("compression", 1.0, 0.0, 3, 0),
    ]  # fmt: skip


def test_coil_and_fluid_are_told_apart(measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]) -> None:
    """Coil 12 ms, fluid 6 ms: the force follows the command with both, the current with one of them."""
    for test in measured[1]:
        assert test.origin == COMMAND
        assert test.current is not None
        assert abs(test.velocity_m_s) == pytest.approx(0.15, rel=0.01)
        assert abs(test.force.size) == pytest.approx(STEP_N, rel=0.02)
        assert test.current.lag.value_s == pytest.approx(COIL_S, abs=max(4.0 * test.current.lag.std_s, 1e-4))
        assert test.behind_s[0] == pytest.approx(FLUID_S, abs=4.0 * test.behind_s[1])
        assert test.behind_s[1] < 0.003
        (time, *_) = test.force.crossing
        assert time.measured
        assert time.low_s < 0.0201 < time.high_s, "63.2 % of two lags of 12 and 6 ms: 20.1 ms"


def test_a_declared_filter_of_the_current_is_removed(tmp_path: Path) -> None:
    """A filter of 5 ms makes the force lead the current; declared, coil and fluid are as without it."""
    rig = rig_of(filter_delay_s=0.005)
    (undeclared, *_), _ = response_tests([recorded(tmp_path, rig)])
    assert undeclared.behind_s[0] == pytest.approx(FLUID_S - 0.005, abs=4.0 * undeclared.behind_s[1])
    (tmp_path / "declared").mkdir()
    tests, _ = response_tests([recorded(tmp_path / "declared", rig, current_delay_s=0.005)])
    for test in tests:
        assert test.current is not None
        assert test.current.order == 1, "the filter is not taken for a second lag"
        assert test.current.lag.value_s == pytest.approx(COIL_S, abs=max(4.0 * test.current.lag.std_s, 2e-4))
        assert test.behind_s[0] == pytest.approx(FLUID_S, abs=4.0 * test.behind_s[1])


def test_steps_outside_the_straight_part_are_discarded_and_counted(tmp_path: Path) -> None:
    """The first repeat's steps come 2 ms after the reversals: no baseline at constant speed lies before them."""
    half_s, first = 0.5 / POINT.frequency_Hz, slice(1, 5)
    times_s = np.array(POINT.steps_s)
    times_s[first] -= (times_s[first] / half_s + 0.5) % 1.0 * half_s - 0.002
    point = recorded(tmp_path, rig_of(point=replace(POINT, steps_s=tuple(map(float, times_s)))))
    tests, left_out = response_tests([point])
    assert [(test.steps, test.discarded) for test in tests] == [(2, 1)] * 4
    assert point.verdict == "suspect"
    assert point.reasons == (
        "response-steps: 4 of 12 steps discarded: outside the constant-speed part of the stroke",
    )
    assert left_out == ["response1: 4 of 12 steps discarded: outside the constant-speed part of the stroke"]
    blocks = response_blocks([test.to_json() for test in tests], SI, narrow=True)
    assert "Discarded steps: 4 of 12 in response1." in [text for text, _ in lines(blocks, 80)]


def test_faster_than_real_time_the_measured_current_is_the_origin(tmp_path: Path) -> None:
    """The host's commands are 30 ms off; the current, with its own clock, is not."""
    rig = rig_of(late_s=0.0)
    point = recorded(tmp_path, rig, device_rate=20.0)
    tests, _ = response_tests([point])
    assert {test.origin for test in tests} == {CURRENT}
    for test in tests:
        if not test.force.why:
            assert test.force.crossing[0].low_s < 0.0201 < test.force.crossing[0].high_s


def test_the_coil_s_lag_under_motion_is_that_of_current_steps(
    measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]
) -> None:
    lag, refused = lag_of([measured[0]])
    assert refused == []
    assert lag is not None
    assert lag.in_motion == 12
    assert lag.eta_1_s == pytest.approx(1.0 / COIL_S, abs=5.0 * lag.std_1_s)
    assert lag.behind_s is not None
    assert lag.behind_s[0] == pytest.approx(FLUID_S, abs=4.0 * lag.behind_s[1])


def test_eta_under_motion_is_that_of_another_coil_without_a_fluid_s_lag(tmp_path: Path) -> None:
    """A coil of 20 ms: eta is 50 1/s."""
    lag, _ = lag_of([recorded(tmp_path, rig_of(coil_s=0.02, fluid_s=0.0))])
    assert lag is not None
    assert lag.eta_1_s == pytest.approx(50.0, abs=min(5.0 * lag.std_1_s, 0.5))
    assert lag.behind_s is not None
    assert lag.behind_s[0] == pytest.approx(0.0, abs=4.0 * lag.behind_s[1])
    assert lag.behind_s[1] < 0.003


def test_the_measured_times_are_rows_of_the_results_database(
    measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]
) -> None:
    point, tests = measured
    assert point.path is not None
    rows = {row["quantity"]: row for row in content_of(point.path.parents[1]).children["characteristics"]}
    for test in tests:
        kind = f"{'on' if test.rises else 'off'}_{test.direction}"
        time, coil = rows[f"response_t63_{kind}"], rows[f"response_coil_t63_{kind}"]
        assert (time["value"], time["standard_uncertainty"]) == (test.best(0).value_s, test.best(0).std_s)
        assert (time["unit"], time["subject"], time["point"]) == ("s", "specimen", point.id)
        assert coil["value"] == pytest.approx(COIL_S, rel=0.05)
        assert f"response_dead_time_{kind}" in rows


def test_report_terminal_and_json_show_the_same_numbers(
    measured: tuple[RecordedPoint, tuple[ResponseTest, ...]]
) -> None:
    tests = measured[1]
    numbers = json.loads(json.dumps([test.to_json() for test in tests], allow_nan=False))
    shown = [text for text, _ in lines(response_blocks(numbers, SI, narrow=True), 80)]
    assert max(map(len, shown)) <= 80
    assert any("0 → 1" in line for line in shown)
    blocks = response_section(tests, ["response2: invalid"], SI)
    figures = [block for block in blocks if type(block).__name__ in {"Cards", "Figures"}]
    assert len(figures) == 2
    assert response_section((), (), SI) == []
