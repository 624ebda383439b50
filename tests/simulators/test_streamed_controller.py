"""The simulated controller without a function generator: it follows what is written to it, and only while it may."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.roles import Command, FaultBit, Result, State
from simulators.plant.step import DISPLACEMENT, VELOCITY

if TYPE_CHECKING:
    from conftest import Bench

X, V = 1 + DISPLACEMENT, 1 + VELOCITY
POLL_S = 0.01


@pytest.fixture
def streamed(make_bench: Callable[..., Bench]) -> Bench:
    bench = make_bench("controller.generator=false")
    bench.ready()
    return bench


def send(bench: Bench, position_m: float, velocity_m_s: float, counter: int = 0) -> bool | None:
    """Write registers 360 to 364 by hand: two floats, high word first, and the watchdog's counter."""
    return bench.bank.write(360, [*struct.unpack(">4H", struct.pack(">ff", position_m, velocity_m_s)), counter])


def stream_sine(bench: Bench, cycles: float, amplitude_m: float = 0.01, frequency_Hz: float = 1.0) -> np.ndarray:
    omega, begin_s = 2.0 * np.pi * frequency_Hz, bench.plant.time_s
    rows = []
    while (now_s := bench.plant.time_s - begin_s) < cycles / frequency_Hz:
        angle = omega * now_s
        send(bench, amplitude_m * np.sin(angle), amplitude_m * omega * np.cos(angle), round(now_s / POLL_S))
        rows.append(bench.run(POLL_S))
    return np.concatenate(rows)


def test_a_sine_of_streamed_set_points_is_a_sine_of_the_rod(streamed: Bench) -> None:
    rows = stream_sine(streamed, 3.0)
    later = rows[rows[:, 0] > rows[0, 0] + 1.0]
    spectrum = np.abs(np.fft.rfft(later[: 2 * 8000, X])) / 8000
    assert spectrum[2] == pytest.approx(0.01, rel=0.01)
    assert np.sqrt(np.sum(spectrum[4:12] ** 2)) < 0.003 * spectrum[2]


def test_the_last_set_point_goes_on_at_its_speed_for_50_ms_and_then_holds(streamed: Bench) -> None:
    send(streamed, 0.0, 0.1)
    rows = streamed.run(0.5)
    assert rows[:, X].max() < 0.0055
    assert rows[-1, X] == pytest.approx(0.1 * 0.05, abs=1e-4)
    assert np.abs(rows[-800:, V]).max() < 1e-3


def test_a_set_point_that_arrives_within_a_slice_of_the_plant_counts_from_its_arrival(streamed: Bench) -> None:
    """Counted from the slice's begin, a set-point of 0.8 m/s would be up to 8 mm off at slices of 10 ms."""
    plant = streamed.plant
    send(streamed, 0.0, 0.1)
    streamed.run(0.010)
    streamed.actuator.arrival_s = lambda: plant.time_s + 0.004
    send(streamed, 0.0014, -0.2)
    streamed.run(0.003)
    assert plant.value("setpoint_m") == pytest.approx(0.0013, abs=1e-6)
    streamed.run(0.005)
    assert plant.value("setpoint_m") == pytest.approx(0.0014 - 0.2 * 0.004, abs=1e-6)


def test_set_points_without_a_speed_are_joined_by_lines(streamed: Bench) -> None:
    plant, target_m = streamed.plant, [0.0, 0.0005, 0.0016, 0.0031, 0.0040]
    for before_m, position_m in pairwise(target_m):
        streamed.actuator.follow(position_m, None, POLL_S)
        streamed.run(0.4 * POLL_S)
        assert plant.value("setpoint_m") == pytest.approx(before_m + 0.4 * (position_m - before_m), abs=1e-6)
        streamed.run(0.6 * POLL_S)
        assert plant.value("setpoint_m") == pytest.approx(position_m, abs=1e-6)
    streamed.run(0.1)
    assert plant.value("setpoint_m") == pytest.approx(target_m[-1], abs=1e-9), "in silence it stays there"


def test_without_a_generator_programs_and_moves_are_refused_and_a_halt_is_not(streamed: Bench) -> None:
    assert streamed.start(0.01, 1.0, 1) is Result.REFUSED_VALUE
    assert streamed.command(Command.MOVE_TO, target_position=0.01, speed=0.1) is Result.REFUSED_VALUE
    stream_sine(streamed, 0.6)
    assert streamed.command(Command.HALT) is Result.DONE
    rows = streamed.run(0.3)
    assert np.abs(rows[-800:, V]).max() < 1e-3
    resting_m = rows[-1, X]
    send(streamed, resting_m + 0.01, 0.1)
    assert streamed.run(0.2)[-1, X] == pytest.approx(resting_m, abs=1e-5), "a jump away from a closed valve is ignored"


def test_a_host_that_goes_away_is_noticed_by_the_watchdog_fed_beside_the_set_points(streamed: Bench) -> None:
    assert streamed.actuator.configure(replace(streamed.actuator.limits, watchdog_ms=500))
    for step in range(10):
        streamed.actuator.tick(step * POLL_S)
        send(streamed, 0.0, 0.0, step + 1)
    streamed.actuator.tick(9 * POLL_S + 0.49)
    assert streamed.status().fault_bits == 0
    streamed.actuator.tick(9 * POLL_S + 0.51)
    assert streamed.status().fault_bits == FaultBit.WATCHDOG
    send(streamed, 0.0, 0.2, 50)
    assert np.abs(streamed.run(0.2)[:, V]).max() < 1e-3, "tripped: nothing is followed"


def test_set_points_beyond_limits_or_without_pressure_are_not_followed(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench("controller.generator=false")
    send(bench, 0.0, 0.1)
    assert bench.status().state == State.OFF
    bench.ready()
    for position_m, velocity_m_s in ((0.2, 0.1), (0.0, 3.0), (float("nan"), 0.1), (0.0, float("inf"))):
        send(bench, position_m, velocity_m_s)
        assert bench.status().state == State.HOLD
    assert np.abs(bench.run(0.1)[:, X]).max() < 1e-4


def test_a_controller_with_a_generator_has_no_registers_for_set_points(bench: Bench) -> None:
    assert send(bench, 0.0, 0.1) is None
    assert bench.bank.read(360, 1) is None
