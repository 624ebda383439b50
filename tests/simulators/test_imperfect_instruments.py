"""What the options that make an instrument wrong do to what is sent, and what they leave alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import demo_ecu as wire
import numpy as np
import pytest

from drivers.roles import Command, Result
from protocols.frame_format import FrameDecoder
from simulators.clock import DeviceClock
from simulators.conditioner import group_delay_s
from simulators.controller_input import ControllerInput
from simulators.ecu import Ecu
from simulators.options import FORCE_INPUT, InputOptions, RigOptions, SensorOptions, with_option
from simulators.plant.plant import Plant
from simulators.sensor import Sensor

if TYPE_CHECKING:
    from tests.simulators.conftest import Bench

DT_S = 1.0 / 8000.0
SILENT = {"noise": 0.0, "resolution": 0.0, "jitter_s": 0.0, "burst_rate_Hz": 0.0, "latency_s": 0.0}


def values(options: SensorOptions, force_N: np.ndarray, current_A: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
    """Simulated times (s) and values of what a sensor sends for a force at the plant's steps."""
    sensor = Sensor(options, DeviceClock(0.0, 0.0), np.random.default_rng(1), 0.0)
    decoder = FrameDecoder()
    frames = []
    for first in range(0, len(force_N), 80):
        part = slice(first, first + 80)
        now = None if current_A is None else current_A[part]
        frames += decoder.feed(sensor.sample(force_N[part], first * DT_S, DT_S, [], now))
    return np.array([frame[1] * 1e-6 for frame in frames]), np.array([frame[2] for frame in frames])


def test_hum_drift_and_crosstalk_add_what_they_say() -> None:
    steps = 16_000
    current_A = np.linspace(0.0, 2.0, steps)
    quiet, still_N = SensorOptions(**SILENT, rate_Hz=1000.0), np.full(steps, 100.0)
    time_s, plain = values(quiet, still_N, current_A)
    assert plain == pytest.approx(100.0)
    _, drifting = values(SensorOptions(**SILENT, rate_Hz=1000.0, drift_per_s=2.0), still_N)
    assert drifting == pytest.approx(100.0 + 2.0 * time_s, abs=1e-4)
    _, coupled = values(SensorOptions(**SILENT, rate_Hz=1000.0, crosstalk_per_A=30.0), still_N, current_A)
    assert coupled == pytest.approx(100.0 + 30.0 * time_s, abs=0.02)
    _, humming = values(SensorOptions(**SILENT, rate_Hz=1000.0, hum=40.0), still_N)
    line = np.abs(np.fft.rfft(humming[:1000] - 100.0)) / 500.0
    assert line.argmax() == 50
    assert line[50] == pytest.approx(40.0, rel=1e-3)


@pytest.mark.parametrize("delay_s", [0.0, 0.3e-3, 2e-3, 20.03e-3])
def test_an_input_is_late_by_its_filter_and_its_delay(delay_s: float) -> None:
    given = InputOptions(delay_s=delay_s, gain=1.02, zero=3.0)
    late = ControllerInput(given, DT_S, 0.0)
    time_s = DT_S * np.arange(1, 8001)
    seen = []
    for part in np.array_split(np.sin(2 * math.pi * 2.0 * time_s), 400):
        late.take(part)
        seen.append(late.read(np.random.default_rng(0)))
    at_s = time_s[19::20]
    expected = 3.0 + 1.02 * np.sin(2 * math.pi * 2.0 * (at_s - delay_s - group_delay_s(500.0)))
    assert np.array(seen)[200:] == pytest.approx(expected[200:], abs=2e-4)


def test_an_input_has_noise_and_steps_of_its_own() -> None:
    given = ControllerInput(FORCE_INPUT, DT_S, 100.0)
    random = np.random.default_rng(5)
    read = np.array([given.read(random) for _ in range(4000)])
    assert np.std(read) == pytest.approx(10.0, rel=0.05)
    assert read % 0.5 == pytest.approx(0.0, abs=1e-9)


def test_the_position_loop_believes_its_own_sensor(make_bench: Callable[..., Bench]) -> None:
    """With a sensor that shows 3 % and 1 mm too much the rod moves 3 % and 1 mm short of it; the loop is content."""
    bench = make_bench("position_input.gain=1.03", "position_input.zero=0.001", "servo.stiffness_N_m=0").ready()
    assert bench.status().position_m == pytest.approx(0.001, abs=60e-6)
    assert bench.command(Command.MOVE_TO, target_position=0.03, speed=0.05) is Result.DONE
    bench.run(2.0)
    assert bench.plant.value("position_m") == pytest.approx((0.03 - 0.001) / 1.03, abs=60e-6)
    assert bench.status().position_m == pytest.approx(0.03, abs=100e-6)
    assert bench.status().servo_error_m == pytest.approx(0.0, abs=60e-6)


def status_of(*assignments: str, target_A: float) -> tuple[float, float, float]:
    """True current (A), reported current (A) and reported coil temperature (degC) a second after a command."""
    options = RigOptions()
    for assignment in assignments:
        options = with_option(options, assignment)
    plant = Plant(options)
    ecu = Ecu(plant, options.coil, 23.0, DeviceClock(0.0, 0.0), np.random.default_rng(2), lambda _code, _text: None)
    counter, sent = 0, []
    for _ in range(100):
        counter = (counter + 1) % 15
        ecu.receive(wire.COMMAND_ID, wire.encode(wire.CoilCommand(counter, True, True, target_A)))
        ecu.tick(plant.time_s)
        plant.advance(80)
        sent += ecu.frames()
    reported = [wire.decode(wire.CoilStatus, data).current_A for name, data in sent if name == wire.STATUS_ID]
    warm = [wire.decode(wire.CoilTemperature, data).coil_degC for name, data in sent if name == wire.TEMPERATURE_ID]
    return plant.value("current_A"), float(np.mean(reported[-20:])), warm[-1]


def test_an_ecu_regulates_on_its_own_wrong_measurement() -> None:
    wrong = ("coil.current_offset_A=0.1", "coil.current_gain=1.05")
    true_A, reported_A, _ = status_of(*wrong, target_A=1.0)
    assert reported_A == pytest.approx(1.0, abs=2e-3)
    assert true_A == pytest.approx((1.0 - 0.1) / 1.05, abs=1e-6)
    true_A, reported_A, _ = status_of(*wrong, target_A=0.0)
    assert true_A == 0.0
    assert reported_A == pytest.approx(0.1, abs=2e-3)


def test_the_coils_sensor_shows_the_coil_and_its_error() -> None:
    assert status_of("damper.start_degC=40", target_A=0.0)[2] == pytest.approx(40.0, abs=0.2)
    assert status_of("damper.start_degC=40", "coil.temperature_offset_K=-12", target_A=0.0)[2] == pytest.approx(
        28.0, abs=0.2
    )
