"""A prescribed motion in the station: where it is between its samples, and what is refused before any is sent."""

from __future__ import annotations

import base64
import math
import re
import struct
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest

from drivers.ring import Channel
from rig.bench.settings import Limits
from rig.station.errors import StationRefused
from rig.station.signal_source import SignalSource, signal_order

LIMITS = Limits(position_m=(-0.05, 0.05), speed_m_s=0.2, acceleration_m_s2=5.0, force_N=4000.0, current_A=3.0,
                coil_temperature_degC=100.0)
STEP_S = 0.004
HALT = 20.0


def sent(amplitude_m: float = 0.01, rate_Hz: float = 0.5, **changes: object) -> dict[str, object]:
    """One period of a raised cosine: it begins and ends at rest at its centre."""
    count = round(1.0 / (rate_Hz * STEP_S))
    angle = [math.tau * rate_Hz * STEP_S * k for k in range(count + 1)]
    position_m = [0.5 * amplitude_m * (1.0 - math.cos(each)) for each in angle]
    velocity_m_s = [0.5 * amplitude_m * math.tau * rate_Hz * math.sin(each) for each in angle]
    return {"step_s": STEP_S, "centre_m": 0.002, "samples": packed(position_m, velocity_m_s)} | changes


def packed(position_m: list[float], velocity_m_s: list[float]) -> str:
    both = position_m + velocity_m_s
    return base64.b64encode(struct.pack(f"<{len(both)}f", *both)).decode()


def test_between_samples_the_rod_goes_where_the_motion_is() -> None:
    order = signal_order(sent(), LIMITS, HALT)
    assert order.duration_s == pytest.approx(2.0)
    for t_s in (0.0, 0.0013, 0.777, 1.2345, 1.9999):
        setpoint = order.at(t_s)
        assert setpoint.position_m == pytest.approx(0.002 + 0.005 * (1.0 - math.cos(math.pi * t_s)), abs=2e-9)
        assert setpoint.velocity_m_s == pytest.approx(0.005 * math.pi * math.sin(math.pi * t_s), abs=2e-6)


def test_every_set_point_is_recorded_and_the_last_one_is_the_centre() -> None:
    records: list[Any] = []
    source = SignalSource(signal_order(sent(), LIMITS, HALT), records.extend)
    last = None
    for step in range(300):
        setpoint = source.at(0.01 * step)
        if setpoint is None:
            break
        last = setpoint
    assert setpoint is None
    assert last is not None
    assert last.position_m == pytest.approx(0.002, abs=1e-9)
    assert last.velocity_m_s == pytest.approx(0.0, abs=1e-9)
    targets = [record for record in records if record[4] == Channel.SIGNAL_TARGET]
    times = [record for record in records if record[4] == Channel.SIGNAL_TIME]
    assert times[100][2] == pytest.approx(1.0)
    assert targets[100][2] == pytest.approx(0.01, abs=1e-9), "about the centre"


def test_of_an_iterated_command_the_target_is_recorded_beside_it_and_moves_nothing() -> None:
    records: list[Any] = []
    target = sent(amplitude_m=0.008)["samples"]
    source = SignalSource(signal_order(sent(target=target), LIMITS, HALT), records.extend)
    setpoint = source.at(1.0)
    assert setpoint is not None
    assert setpoint.position_m == pytest.approx(0.002 + 0.01), "the command"
    values = {record[4]: record[2] for record in records}
    assert values[Channel.SIGNAL_TARGET] == pytest.approx(0.008)
    assert values[Channel.SIGNAL_COMMAND] == pytest.approx(0.01)
    with pytest.raises(StationRefused, match=re.escape("speed 0.25")):
        signal_order(sent(amplitude_m=0.04, rate_Hz=2.0, target=sent(rate_Hz=2.0)["samples"]), LIMITS, HALT)


def test_a_target_force_is_recorded_at_each_set_point_and_moves_nothing() -> None:
    records: list[Any] = []
    given = sent(force=packed([2.0 * k for k in range(501)], []))
    source = SignalSource(signal_order(given, LIMITS, HALT), records.extend)
    for elapsed_s, force_N in ((0.0, 0.0), (0.001, 0.5), (1.0, 500.0), (2.01, 1000.0)):
        records.clear()
        setpoint = source.at(elapsed_s)
        assert setpoint is not None
        values = {record[4]: record[2] for record in records}
        assert values[Channel.SIGNAL_FORCE] == pytest.approx(force_N, abs=1e-3)
        assert values[Channel.SIGNAL_TARGET] == pytest.approx(setpoint.position_m - 0.002)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (sent(force=packed([1.0] * 5, [])), "5 samples of the force, but 501 of the motion"),
        (sent(force=packed([math.inf] * 501, [])), "expected a signal"),
        (sent(force=3), "expected a signal"),
        (sent(amplitude_m=0.05), "above zero .* 0.052 m"),
        (sent(amplitude_m=-0.06), "below zero .* 0.058 m"),
        (sent(amplitude_m=0.04, rate_Hz=2.0), "speed 0.25"),
        (sent(amplitude_m=0.04, rate_Hz=3.0), "acceleration"),
        (sent(samples=packed([0.001 * k for k in range(3)], [0.0] * 3)), "distance from the centre at start or end"),
        (sent(samples=packed([0.0] * 501, [0.15] + [0.0] * 500)), "speed at start or end 0.15 m/s"),
        # A jump that the speeds hide.
        (sent(samples=packed([0.0] * 250 + [0.01] + [0.0] * 250, [0.0] * 501)), "speed 2.5"),
        (sent(samples=packed([math.nan] * 5, [0.0] * 5)), "expected a signal"),
        (sent(samples=packed([0.0] * 5, [0.0] * 4)), "expected a signal"),
        (sent(samples="no base64!"), "expected a signal"),
        (sent(samples=[0.0, 0.0]), "expected a signal"),
        (sent(samples=packed([0.0] * 200_001, [0.0] * 200_001)), "expected a signal"),
        (sent(target=packed([0.0] * 5, [0.0] * 5)), "5 samples of the target, but 501 of the motion"),
        (sent(target=17), "expected a signal"),
        (sent(step_s=0.5), "expected a signal"),
        (sent(centre_m="x"), "expected a signal"),
        ({"step_s": 0.004}, "expected a signal"),
        ([1.0], "not a table"),
    ],
)  # fmt: skip
def test_what_is_beyond_the_machine_is_not_begun(given: object, message: str) -> None:
    with pytest.raises(StationRefused, match=message):
        signal_order(given, LIMITS, HALT)


def test_a_signal_that_a_halt_would_take_out_of_the_travel_is_not_begun() -> None:
    """Raised cosine of 30 mm and 2 Hz, halted at 1 m/s^2: s = d / (A w^2) = 0.42, highest A (1 + (1 / s + s) / 2)."""
    given = sent(amplitude_m=0.03, rate_Hz=2.0, centre_m=0.0)
    highest_m = 0.015 * (1.0 + 0.5 * (1.0 / 0.42217 + 0.42217))
    for halt_m_s2, limit_m, begins in (
        (20.0, 0.0301, True), (1.0, highest_m + 1e-4, True), (1.0, highest_m - 1e-4, False)
    ):
        limits = replace(LIMITS, position_m=(-0.05, limit_m))
        with nullcontext() if begins else pytest.raises(StationRefused, match="including halts"):
            signal_order(given, limits, halt_m_s2)
