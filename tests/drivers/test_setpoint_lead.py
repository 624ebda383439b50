"""A device that takes no speed is sent the position of the next period, and never has to run after it."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.setpoint_generator import RodLimits, Setpoint
from drivers.setpoint_lead import SetpointLead

PERIOD_S = 0.01
LIMITS = RodLimits(-0.085, 0.085, 0.8, 60.0)
PEAK_M_S = 0.06 * 2.0 * math.pi * 1.5


def sine(now_s: float) -> Setpoint:
    """With the mean speed of the coming period."""
    position_m = [0.06 * math.sin(2.0 * math.pi * 1.5 * at_s) for at_s in (now_s, now_s + PERIOD_S)]
    return Setpoint(position_m[0], (position_m[1] - position_m[0]) / PERIOD_S)


@pytest.mark.parametrize(
    ("position_m", "velocity_m_s", "sent_m"),
    [(0.012, 0.05, 0.0125), (0.012, -0.05, 0.0115), (0.012, 0.5, 0.013), (0.014, 0.5, 0.014)],
    ids=["ahead", "back", "no-further-than-the-travel", "beyond-it-already"],
)
def test_it_is_sent_where_the_rod_is_to_be_a_period_later(
    position_m: float, velocity_m_s: float, sent_m: float
) -> None:
    lead = SetpointLead(RodLimits(-0.013, 0.013), PERIOD_S)
    assert lead.sent(Setpoint(position_m, velocity_m_s), 0.0, math.inf).position_m == pytest.approx(sent_m)


def test_without_a_period_set_points_are_passed_on() -> None:
    assert SetpointLead(LIMITS, 0.0).sent(Setpoint(0.01, 0.5), 1.0, 0.5) == Setpoint(0.01, 0.5)


def test_a_regular_stream_is_led_by_the_whole_period() -> None:
    lead = SetpointLead(LIMITS, PERIOD_S)
    lead.begin(0.0)
    for step in range(200):
        now_s = step * PERIOD_S
        sent_m = lead.sent(sine(now_s), now_s, PEAK_M_S).position_m
        lead.taken(sent_m, now_s)
        if step > 20:
            assert sent_m == pytest.approx(sine(now_s + PERIOD_S).position_m, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, 0.66), st.floats(0.001, 0.03), st.sampled_from([0, 1, 2]), st.sampled_from(["late", "lost", "taken"])
)
def test_whatever_was_late_refused_or_lost_the_device_never_exceeds_the_motions_speed(
    begin_s: float, gap_s: float, refused: int, answer: str
) -> None:
    """The device takes one period for each, or as long as the set-point before was awaited."""
    for slow in (False, True):
        lead = SetpointLead(LIMITS, PERIOD_S)
        lead.begin(sine(begin_s).position_m)
        times = [begin_s + step * PERIOD_S for step in range(60)]
        times = [at_s if step < 30 else at_s + gap_s for step, at_s in enumerate(times)]
        device = from_m = to_m = sine(begin_s).position_m
        reported_s, takes_s, speeds = -math.inf, PERIOD_S, []
        for step, now_s in enumerate(times):
            share = 1.0 if math.isinf(reported_s) else min(1.0, (now_s - reported_s) / takes_s)
            device = from_m + share * (to_m - from_m)
            sent_m = lead.sent(sine(now_s), now_s, PEAK_M_S).position_m
            if 30 <= step < 30 + refused and answer != "late":
                if answer == "lost":
                    lead.lost(sent_m)
                continue
            lead.taken(sent_m, now_s)
            takes_s = max(PERIOD_S, now_s - reported_s) if slow and math.isfinite(reported_s) else PERIOD_S
            from_m, to_m, reported_s = device, sent_m, now_s
            speeds.append((to_m - from_m) / takes_s)
        assert max(map(abs, speeds)) <= 1.03 * PEAK_M_S
        assert max(abs(after - before) for before, after in pairwise(speeds)) < 60.0 * 0.0115 + 0.05


def test_a_lost_set_point_that_the_rod_is_found_at_is_where_the_device_is() -> None:
    lead = SetpointLead(LIMITS, PERIOD_S)
    lead.begin(0.0)
    lead.taken(0.002, 0.0)
    lead.lost(0.007)
    lead.measured(Setpoint(0.0069, 0.0))
    assert lead.sent(Setpoint(0.0069, 0.0), 0.06, 0.5).position_m == pytest.approx(0.0069)
    lead.taken(0.002, 0.10)
    lead.lost(0.007)
    lead.measured(Setpoint(0.0069, 0.3))
    assert lead.sent(Setpoint(0.0069, 0.3), 0.16, 0.5).position_m == pytest.approx(0.0099), "not back to the one before"
    lead.measured(Setpoint(0.05, 0.0))
    assert lead.sent(Setpoint(0.05, 0.1), 0.18, 0.5).position_m == pytest.approx(0.0511, abs=2.1e-4)
