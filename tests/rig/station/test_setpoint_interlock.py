"""Set-points in time, and set-points taken: what is counted, what stops the rig, and what must not."""

from __future__ import annotations

import math
from unittest.mock import MagicMock

import pytest

from drivers.roles import Program, Waveform
from drivers.setpoint_generator import Setpoint
from drivers.streamed_actuator import StreamedActuator
from rig.bench.settings import ActuatorConfig, Limits
from rig.station.interlocks.setpoint_interlock import SetpointInterlock, unfollowable
from rig.station.threads import setpoint_stream
from rig.station.threads.setpoint_stream import PollSteps, SetpointStream

PERIOD_S = 0.01
MS = 1_000_000


def interlock(late_s: float = PERIOD_S) -> SetpointInterlock:
    return SetpointInterlock(PERIOD_S, late_s, 1.0)


def slugs(made: SetpointInterlock, *lateness_ms: float) -> list[str]:
    return [finding.slug for late_ms in lateness_ms for finding in made.sent(1e-3 * late_ms, 0)]


def test_three_steps_late_in_a_row_stop_the_rig_and_two_do_not() -> None:
    made = interlock()
    assert slugs(made, 0.1, 0.2, 12.0, 0.1, 0.1) == []
    # 35 ms late: the steps due at 0, 10 and 20 ms are 35, 25 and 15 ms late, the one due at 30 ms is in time.
    assert slugs(interlock(), 35.0) == ["setpoints-late"]
    assert slugs(interlock(), 25.0, 0.0) == []


def test_five_late_steps_of_a_hundred_stop_the_rig_however_far_apart() -> None:
    made = interlock()
    for _ in range(4):
        assert slugs(made, 11.0, *[0.1] * 10) == []
    assert slugs(made, 11.0) == ["setpoints-late"]
    seldom = interlock()
    for _ in range(20):
        assert slugs(seldom, 11.0, *[0.1] * 30) == []


def test_what_is_left_out_is_counted_and_the_quantile_is_of_what_was_sent() -> None:
    made = interlock(late_s=0.1)
    slugs(made, *[0.04] * 985, *[3.0] * 10, *[45.0] * 5)
    counted = made.counted
    assert (counted.steps, counted.skipped, counted.late) == (1000 + 5 * 4, 20, 0)
    assert counted.worst_s == pytest.approx(0.045)
    assert counted.quantile_s(0.98) == pytest.approx(1e-4)
    assert counted.quantile_s(0.99) == pytest.approx(3e-3, abs=1.1e-4)
    assert counted.numbers()["p99_s"] == counted.quantile_s(0.99)


def test_omitted_set_points_are_a_warning_once_a_motion_though_none_is_late() -> None:
    made = interlock(late_s=0.1)
    found = [finding for late_ms in [12.0, 0.1] * 10 for finding in made.sent(1e-3 * late_ms, 0)]
    assert [(finding.slug, finding.warns, finding.value) for finding in found] == [("setpoints-late", True, 5)]
    assert slugs(interlock(late_s=0.1), *([12.0] + [0.1] * 30) * 10) == []
    made.restart()
    assert slugs(made, *[12.0, 0.1] * 10) == ["setpoints-late"]


def test_a_set_point_is_due_at_once_while_it_is_on_its_way_and_at_the_next_poll_after_its_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """So a simulated rig's clock waits for the exchange: both ends take it for the same time."""
    due: list[int | None] = []
    monkeypatch.setattr(setpoint_stream, "setpoint_due", due.append)
    driver = MagicMock(
        StreamedActuator, in_motion=True, rod_moves=True, breaks=0, last=Setpoint(0.0, 0.0), taken_m=0.0, gap_s=0.0,
    )
    supervisor = MagicMock()
    supervisor.config.device_rate = 1.0
    stream = SetpointStream(driver, ActuatorConfig(url="modbus-tcp://127.0.0.1:1"), supervisor)
    stream.steps.begin(1000)
    stream.sending(1007)
    stream.answered(MagicMock(position_m=0.0, received_ns=1009))
    stream.failed(MagicMock())
    driver.rod_moves = False
    stream.sending(2000)
    assert due == [1007, 10_001_000, 10_001_000, None]


def sine(step: int) -> Setpoint:
    angle = 2.0 * math.pi * 4.0 * step * PERIOD_S
    return Setpoint(0.02 * math.sin(angle), 0.02 * 8.0 * math.pi * math.cos(angle))


def answered(made: SetpointInterlock, step: int, taken_m: float, position_m: float) -> list[str]:
    return [finding.slug for finding in made.answered(sine(step), taken_m, position_m, 0)]


def test_a_device_that_shows_the_set_points_and_a_rod_that_lags_are_well() -> None:
    made = interlock()
    for step in range(200):
        # 30 Hz and 0.7 of damping: about 7 ms behind; the set-point shown is a poll old.
        assert answered(made, step, sine(step - 1).position_m, math.nan) == []
    made.restart()
    for step in range(200):
        behind = 0.02 * math.sin(2.0 * math.pi * 4.0 * (step * PERIOD_S - 0.0074))
        assert answered(made, step, math.nan, behind) == []
    assert not made.lost


@pytest.mark.parametrize("stuck_at", range(25))
@pytest.mark.parametrize("shows", [True, False])
def test_set_points_that_are_not_taken_are_noticed_within_150_ms(stuck_at: int, shows: bool) -> None:
    made = interlock()
    held_m = sine(stuck_at).position_m
    for step in range(stuck_at + 1):
        assert answered(made, step, sine(step).position_m if shows else math.nan, sine(step).position_m) == []
    found = [answered(made, step, held_m if shows else math.nan, held_m) for step in range(stuck_at + 1, stuck_at + 16)]
    assert ["setpoints-lost"] in found
    assert made.lost
    made.restart()
    assert not made.lost


def test_steps_lie_on_a_grid_that_does_not_drift_and_a_late_one_is_not_made_up_for() -> None:
    steps = PollSteps(10 * MS, on_grid=True)
    steps.begin(0)
    assert steps.take(-1) is None
    sent = [(0, 0), (10_400_000, 400_000), (20_300_000, 300_000), (57_000_000, 27 * MS), (60_100_000, 100_000)]
    for now_ns, late_ns in sent:
        assert steps.take(now_ns) == late_ns
    assert steps.next_ns == 70 * MS
    assert steps.take(69 * MS) is None


def test_polls_that_take_too_long_follow_each_other_at_once_where_no_set_points_are_streamed() -> None:
    steps = PollSteps(10 * MS, on_grid=False)
    steps.begin(0)
    for now_ns in (0, 15 * MS, 30 * MS):
        assert steps.take(now_ns) is not None
        assert steps.next_ns <= now_ns + 10 * MS
    assert steps.next_ns == 30 * MS, "it is late already: the next poll follows at once, none is made up for"


LIMITS = Limits(
    position_m=(-0.085, 0.085), speed_m_s=0.8, acceleration_m_s2=60.0, force_N=5e3, current_A=3.0,
    coil_temperature_degC=120.0,
)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (Program(Waveform.SINE, 0.02, 5.0), []),
        (Program(Waveform.SINE, 0.002, 5.1), ["at most 5 Hz"]),
        (Program(Waveform.SINE, 0.03, 4.5), ["speed 0.848"]),
        (Program(Waveform.TRIANGLE, 0.05, 4.1), ["speed 0.82 m/s, allowed 0.8 m/s"]),
        (Program(Waveform.SINE, 0.1, 5.5), ["at most 5 Hz", "speed 3.4557", "acceleration 119.4"]),
    ],
)
def test_a_motion_beyond_the_limits_or_with_too_few_set_points_is_not_streamed(
    program: Program, message: list[str]
) -> None:
    problems = unfollowable(program, LIMITS, PERIOD_S)
    assert len(problems) == len(message)
    assert all(words in problem for words, problem in zip(message, problems, strict=True))
