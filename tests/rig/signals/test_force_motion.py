"""Forces as targets: the motion for a force, and the iteration that makes a simulated damper give it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from rig.matrix.assumed_damper import of_set
from rig.signals.arrays import FloatArray
from rig.signals.drive_iteration import IterationSettings, SignalDrive, advanced, allowed_start, drive_for
from rig.signals.force_motion import equivalent_motion, force_error, force_record
from rig.signals.record import STEP_S, NoRecord, Record, between_ramps, record_of

DEMO = of_set("demo")
CURRENT_A = 1.0
INVERSE = DEMO.speed_of_force(CURRENT_A)
SETTINGS = IterationSettings(tolerance=0.08, noise_s=10.0, noise_level=1.0)


def random_motion(amplitude_m: float, duration_s: float = 12.0) -> Record:
    """Random motion of 0.5 to 4 Hz with a flat speed spectrum."""
    count = round(duration_s / STEP_S) + 1
    frequency_Hz = np.fft.rfftfreq(count, STEP_S)
    phase = np.random.default_rng(5).uniform(0.0, math.tau, len(frequency_Hz))
    inside = (frequency_Hz >= 0.5) & (frequency_Hz <= 4.0)
    position = np.fft.irfft(np.where(inside, np.exp(1j * phase) / np.maximum(frequency_Hz, 0.5), 0.0), count)
    return record_of("random", np.asarray(position * amplitude_m / np.max(np.abs(position)), np.float64), 1.0)


def force_of(motion: Record, scale: float = 1.0) -> FloatArray:
    """Force (N) of the demo damper along a motion, all but inertia and gas force times `scale`."""
    scaled = {name: value * scale for name, value in DEMO.values.items() if name.startswith(("Fy", "C", "K"))}
    values = {**DEMO.values, **scaled}
    along = motion.motion(motion.amplitude_m)
    return np.asarray(DEMO.model.force(values, *along, CURRENT_A, STEP_S), np.float64)


def record_for(force_N: FloatArray) -> Record:
    return force_record("force", force_N, INVERSE, 1.0, lowest_Hz=0.3, highest_Hz=5.0)


class Machine:
    """A servo of 12 Hz with the demo damper and a load cell with a noise of 5 N."""

    def __init__(self) -> None:
        w = math.tau * 12.0
        self.servo = bilinear([w * w], [1.0, 1.4 * w, w * w], 1.0 / STEP_S)
        self.random = np.random.default_rng(3)
        self.checked: list[tuple[Record, Record]] = []

    def run(self, command: Record) -> FloatArray:
        rod_m = lfilter(*self.servo, command.amplitude_m * command.shape)
        v = np.gradient(rod_m, STEP_S)
        force_N = DEMO.model.force(DEMO.values, rod_m, v, np.gradient(v, STEP_S), CURRENT_A, STEP_S)
        return np.asarray(force_N + self.random.normal(0.0, 5.0, len(rod_m)), np.float64)

    def against(self, command: Record, expected: Record) -> str:
        self.checked.append((command, expected))
        return ""

    def share(self, command: Record) -> float:
        return 1.0


def iterate(target: Record, settings: IterationSettings = SETTINGS) -> tuple[SignalDrive, Machine]:
    machine = Machine()
    drive = allowed_start(drive_for(target, CURRENT_A, (), settings), target, machine)
    assert target.force is not None
    while not drive.settled:
        command = drive.noise or drive.command
        assert command is not None
        force_N = machine.run(command)
        motion_m = equivalent_motion(target.force, command, target, force_N)
        drive = advanced(drive, target, motion_m, settings, machine, force_N=force_N)
    return drive, machine


def test_the_equivalent_motion_of_the_target_is_the_first_command_and_has_no_drift() -> None:
    force_N = force_of(random_motion(0.035))
    record = record_for(force_N + 120.0)
    assert record.of_force
    assert record.force is not None
    without = record_for(force_N).force
    assert without is not None
    assert record.force.force_N == pytest.approx(without.force_N, abs=1e-6), "a mean is no motion"
    assert float(np.mean(INVERSE.speed(record.force.force_N))) == pytest.approx(0.0, abs=1e-6)
    motion_m = equivalent_motion(record.force, record, record, record.force.force_N)
    inside = between_ramps(record, len(motion_m))
    assert motion_m[inside] == pytest.approx((record.amplitude_m * record.shape)[inside], abs=1e-9)
    assert record.amplitude_m < 0.05


def test_a_servo_gives_the_force_of_a_damper_with_10_percent_more_force() -> None:
    target = record_for(force_of(random_motion(0.05), 1.1))
    drive, machine = iterate(target)
    assert drive.errors[0] > 0.12, "with the first command"
    assert drive.outcome == "converged", drive.cannot
    assert len(drive.errors) - 1 <= 4
    assert drive.command is not None
    again_N, inside = machine.run(drive.command), between_ramps(target, len(target.shape))
    assert target.force is not None
    assert force_error(target.force.force_N[inside], again_N[inside]) < 0.09
    assert all(command is expected for command, expected in machine.checked), "the command itself bounds the motion"
    assert drive.to_json()["follows"] == "force"
    assert drive.trials[-1].force_N is not None


def test_a_force_of_hysteresis_ends_with_its_reason_and_the_plan_knows_it() -> None:
    slow = random_motion(0.004)
    target = DEMO.with_forecast(record_for(force_of(slow)), CURRENT_A)
    assert target.force is not None
    assert target.force.forecast_error > 0.3, "no motion that is calculated in advance gives it"
    drive, _ = iterate(target)
    assert drive.outcome not in {"", "converged"}
    assert "allowed 8 %" in drive.cannot


def test_a_force_beyond_the_damper_is_refused_with_its_time() -> None:
    force_N = 0.5 * force_of(random_motion(0.035))
    force_N[4000] = 9000.0
    with pytest.raises(NoRecord, match=r"force of 9000 N at 4.00 s; allowed: -\d+ to \d+ N, which the expected"):
        record_for(force_N)


def test_a_response_of_forces_is_not_used_for_displacements() -> None:
    drive, _ = iterate(record_for(force_of(random_motion(0.05), 1.1)))
    motion = random_motion(0.02)
    assert drive_for(motion, CURRENT_A, (drive,), SETTINGS).noise is not None
    assert drive_for(record_for(force_of(replace(motion), 1.0)), CURRENT_A, (drive,), SETTINGS).noise is None
