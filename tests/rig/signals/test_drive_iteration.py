"""Iteration of a command: it converges on linear and non-linear machines, keeps limits, and says why it ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from rig.signals.arrays import FloatArray
from rig.signals.drive_iteration import (
    FrequencyResponse,
    IterationSettings,
    SignalDrive,
    advanced,
    allowed_start,
    band_of,
    drive_for,
    identified,
    noise_record,
    remembered_signal,
    shifted,
    with_samples,
)
from rig.signals.following import following
from rig.signals.iteration_time import trials_s
from rig.signals.record import STEP_S, Record, record_of

SETTINGS = IterationSettings(noise_s=10.0)
Machine = Callable[[FloatArray], FloatArray]


def random_record(lowest_Hz: float, highest_Hz: float, amplitude_m: float, duration_s: float = 10.0) -> Record:
    """Random motion with a flat displacement spectrum."""
    count = round(duration_s / STEP_S) + 1
    frequency_Hz = np.fft.rfftfreq(count, STEP_S)
    phase = np.random.default_rng(7).uniform(0.0, math.tau, len(frequency_Hz))
    inside = (frequency_Hz >= lowest_Hz) & (frequency_Hz <= highest_Hz)
    position = np.fft.irfft(np.where(inside, np.exp(1j * phase), 0.0), count)
    position *= amplitude_m / float(np.max(np.abs(position)))
    return record_of("random", np.asarray(position, np.float64), 1.0)


TARGET = random_record(0.5, 15.0, 3e-3)


def servo(bandwidth_Hz: float = 12.0, delay_s: float = 0.004, noise_m: float = 2e-6,
          softens_m: float = math.inf) -> Machine:
    """A second-order position loop with damping 0.7; a command softens as `softens_m` tanh(u / softens_m)."""
    random = np.random.default_rng(3)

    def moved(command_m: FloatArray) -> FloatArray:
        soft_m = command_m if math.isinf(softens_m) else softens_m * np.tanh(command_m / softens_m)
        size = len(soft_m) + 2000
        s = 2j * math.pi * np.fft.rfftfreq(size, STEP_S)
        w = math.tau * bandwidth_Hz
        jitter_s = random.normal(0.0, 3e-4)  # the host's clock against the sensor's differs from run to run
        response = w**2 / (s**2 + 1.4 * w * s + w**2) * np.exp(-s * (delay_s + jitter_s))
        rod_m = np.fft.irfft(np.fft.rfft(soft_m, size) * response, size)[: len(soft_m)]
        return np.asarray(rod_m + noise_m * random.standard_normal(len(rod_m)), np.float64)

    return moved


@dataclass
class Limits:
    """Allows commands up to an acceleration; keeps what it was asked."""

    acceleration_m_s2: float = math.inf
    asked: list[Record] = field(default_factory=list)

    def against(self, command: Record, expected: Record) -> str:
        del expected
        self.asked.append(command)
        fits = command.amplitude_m * command.peak_acceleration <= self.acceleration_m_s2
        return "" if fits else f"acceleration above {self.acceleration_m_s2:g} m/s^2"

    def share(self, command: Record) -> float:
        return min(1.0, self.acceleration_m_s2 / (command.amplitude_m * command.peak_acceleration))


def iterate(machine: Machine, target: Record = TARGET, limits: Limits | None = None,
            settings: IterationSettings = SETTINGS, known: tuple[SignalDrive, ...] = ()) -> SignalDrive:
    limits = limits or Limits()
    drive = allowed_start(drive_for(target, 1.0, known, settings), target, limits)
    while not drive.settled:
        command = drive.noise or drive.command
        assert command is not None
        assert command is target or any(command.mark == asked.mark for asked in limits.asked), "never unchecked"
        run_m = machine(command.amplitude_m * command.shape)
        drive = advanced(drive, target, run_m, settings, limits)
        assert len(drive.trials) <= settings.most + 1
    return drive


def true_error(machine: Machine, command: Record | None, target: Record = TARGET) -> tuple[float, float]:
    """RMS error and delay (s) of a run of a command."""
    assert command is not None
    rod_m = machine(command.amplitude_m * command.shape)
    time_s = STEP_S * np.arange(len(rod_m))
    inside = (time_s >= target.ramp_s) & (time_s <= time_s[-1] - target.ramp_s)
    seen = following(time_s, rod_m, time_s[inside], target.amplitude_m * target.shape[inside])
    return seen.nrms, seen.delay_s


def test_a_servo_of_12_Hz_follows_random_motion_to_15_Hz_within_2_percent() -> None:
    drive = iterate(servo())
    assert drive.outcome == "converged", drive.cannot
    assert drive.errors[0] > 0.15, "without iteration"
    assert len(drive.errors) - 1 <= 4
    error, delay_s = true_error(servo(), drive.command)
    assert error < 0.02
    assert abs(delay_s) < 1.5e-3, "the command leads by the machine's delay"


def test_a_machine_that_softens_with_the_amplitude_converges_too() -> None:
    machine = servo(softens_m=4e-3)
    drive = iterate(machine)
    assert drive.outcome == "converged", drive.cannot
    assert true_error(machine, drive.command)[0] < 0.02


def test_the_response_is_that_of_the_servo_and_its_delay() -> None:
    noise = noise_record(TARGET, SETTINGS)
    machine = servo(noise_m=0.0)
    response = identified(noise, machine(noise.amplitude_m * noise.shape), band_of(TARGET, SETTINGS), SETTINGS)
    s, w = 2j * math.pi * response.frequency_Hz, math.tau * 12.0
    expected = np.abs(w**2 / (s**2 + 1.4 * w * s + w**2))
    inside = (response.frequency_Hz > 1.0) & (response.frequency_Hz < 15.0)
    assert np.abs(response.response)[inside] == pytest.approx(expected[inside], rel=0.04)
    assert 0.015 < response.delay_s < 0.03
    assert response.band_Hz is not None
    assert response.band_Hz[1] > 14.9


def test_frequencies_without_coherence_are_not_corrected() -> None:
    """Above 6 Hz a disturbance covers the rod's motion: nothing is inverted there, and the reason is named."""
    random = np.random.default_rng(5)

    def disturbed(command_m: FloatArray) -> FloatArray:
        count = len(command_m)
        spectrum = np.fft.rfft(random.standard_normal(count))
        frequency_Hz = np.fft.rfftfreq(count, STEP_S)
        spectrum[(frequency_Hz < 6.0) | (frequency_Hz > 20.0)] = 0.0
        own_m = np.fft.irfft(spectrum, count)
        return np.asarray(servo()(command_m) + own_m * 2.5e-4 / np.std(own_m), np.float64)

    drive = iterate(disturbed)
    assert drive.response is not None
    assert drive.response.band_Hz is not None
    assert drive.response.band_Hz[1] < 9.0
    assert np.all(drive.response.inverse(np.array([10.5, 14.0, 60.0])) == 0.0)
    assert drive.outcome == "not-coherent"
    assert "not coherent" in drive.cannot
    assert drive.command is not None
    change = drive.command.amplitude_m * drive.command.shape - shifted(
        TARGET.amplitude_m * TARGET.shape, sum(trial.delay_s for trial in drive.trials[:drive.best.number])
    )  # fmt: skip
    power = np.abs(np.fft.rfft(change)) ** 2
    above = np.fft.rfftfreq(len(change), STEP_S) > 10.5
    assert np.sum(power[above]) < 0.02 * np.sum(power)


@pytest.mark.parametrize("room", [1.1, 1.3])
def test_a_limit_ends_the_iteration_with_the_scale_that_fits(room: float) -> None:
    """At once, or after two corrections that the limit allows in part and that both reduce the error."""
    machine, peak_m_s2 = servo(), TARGET.amplitude_m * TARGET.peak_acceleration
    limits = Limits(room * peak_m_s2)
    drive = iterate(machine, limits=limits)
    assert drive.outcome == "limit"
    assert "acceleration above" in drive.cannot
    scale = float(drive.cannot.rpartition("scaled by ")[2].split()[0])
    assert 0.4 < scale < 1.0
    assert drive.command is not None
    assert drive.command.amplitude_m * drive.command.peak_acceleration <= limits.acceleration_m_s2
    assert drive.best is not None
    assert drive.command.mark == drive.best.command.mark, "the best command is kept"
    smaller = replace(TARGET, amplitude_m=0.9 * scale * TARGET.amplitude_m)
    assert iterate(machine, smaller, Limits(limits.acceleration_m_s2)).outcome == "converged"


def test_a_saturated_valve_is_named_with_the_scale_that_fits() -> None:
    """The rod of this machine moves at 0.6 of the target's peak speed at most, whatever the command."""
    fastest_m = 0.6 * TARGET.amplitude_m * TARGET.peak_velocity * STEP_S

    def valve(command_m: FloatArray) -> FloatArray:
        rod_m, moved = 0.0, np.empty_like(command_m)
        for index, wanted_m in enumerate(command_m.tolist()):
            rod_m += max(-fastest_m, min(fastest_m, wanted_m - rod_m))
            moved[index] = rod_m
        return moved

    drive = drive_for(TARGET, 1.0, (), SETTINGS)
    while not drive.settled:
        command = drive.noise or drive.command
        assert command is not None
        run_m = valve(command.amplitude_m * command.shape)
        drive = advanced(drive, TARGET, run_m, SETTINGS, Limits(), saturated=drive.noise is None)
    assert drive.outcome == "limit"
    assert "valve is saturated" in drive.cannot
    assert float(drive.cannot.rpartition("scaled by ")[2].split()[0]) == pytest.approx(0.6, abs=0.02)


def test_noise_that_is_too_strong_is_reduced_and_a_target_without_room_given_up() -> None:
    noise = noise_record(TARGET, SETTINGS)
    half = Limits(0.5 * noise.amplitude_m * noise.peak_acceleration)
    drive = allowed_start(drive_for(TARGET, 1.0, (), SETTINGS), TARGET, half)
    assert drive.noise is not None
    assert drive.noise.amplitude_m == pytest.approx(0.5 * noise.amplitude_m)
    none = allowed_start(drive_for(TARGET, 1.0, (), SETTINGS), TARGET, Limits(0.0))
    assert (none.outcome, none.noise) == ("limit", None)


def test_noise_of_the_sensor_ends_the_iteration_at_its_floor() -> None:
    drive = iterate(servo(noise_m=1.2e-4), settings=replace(SETTINGS, tolerance=0.01))
    assert drive.outcome in {"noise-floor", "not-coherent"}
    assert len(drive.errors) <= 7
    assert drive.best is not None
    assert drive.best.error == min(drive.errors[1:])


def test_a_response_of_the_wrong_sign_diverges_and_the_best_command_is_kept() -> None:
    machine = servo()
    drive = drive_for(TARGET, 1.0, (), SETTINGS)
    assert drive.noise is not None
    drive = advanced(drive, TARGET, machine(drive.noise.amplitude_m * drive.noise.shape), SETTINGS, Limits())
    assert drive.response is not None
    wrong = replace(drive.response, response=-drive.response.response)
    drive = replace(drive, response=wrong)
    while not drive.settled:
        assert drive.command is not None
        drive = advanced(drive, TARGET, machine(drive.command.amplitude_m * drive.command.shape), SETTINGS, Limits())
    assert drive.outcome == "divergence"
    assert drive.gain < SETTINGS.gain
    assert drive.best is not None
    assert drive.command is drive.best.command


def test_another_current_starts_from_the_command_and_another_signal_from_the_response() -> None:
    machine = servo()
    first = iterate(machine)
    other_current = drive_for(TARGET, 2.0, (first,), SETTINGS)
    assert (other_current.noise, other_current.start) == (None, "kept")
    assert first.best is not None
    assert other_current.command is first.best.command
    slower = random_record(0.5, 10.0, 5e-3)
    assert drive_for(slower, 1.0, (first,), SETTINGS).noise is None
    assert drive_for(slower, 1.0, (first,), SETTINGS).command is slower
    faster = random_record(0.5, 20.0, 1e-3)
    assert drive_for(faster, 1.0, (first,), SETTINGS).noise is not None, "its frequencies are not identified"
    again = drive_for(TARGET, 1.0, remembered_signal((other_current,), first), SETTINGS)
    assert again is first


def test_a_command_that_is_no_longer_allowed_gives_way_to_the_target() -> None:
    first = iterate(servo())
    assert first.command is not None
    assert first.command.peak_acceleration * first.command.amplitude_m > TARGET.peak_acceleration * TARGET.amplitude_m
    limits = Limits(TARGET.peak_acceleration * TARGET.amplitude_m)
    start = allowed_start(drive_for(TARGET, 2.0, (first,), SETTINGS), TARGET, limits)
    assert (start.command, start.start) == (TARGET, "target")


def test_the_description_of_an_iteration_is_json_with_one_error_for_each_trial() -> None:
    drive = iterate(servo())
    described = drive.to_json()
    assert described["outcome"] == "converged"
    assert described["errors"] == pytest.approx(drive.errors, rel=1e-4)
    assert described["best"] == len(drive.errors) - 1
    assert len(described["frequency_Hz"]) == len(described["gain"]) == len(described["coherence"])
    assert described["band_Hz"][1] > 14.9


def test_a_response_inverts_nothing_beyond_its_last_frequency() -> None:
    lines_Hz = np.arange(1.0, 11.0)
    response = FrequencyResponse(0.0, 0.8, lines_Hz, np.full(10, 0.5 + 0j), np.full(10, 0.99))
    inverse = response.inverse(np.array([0.0, 5.5, 10.0, 12.0, 400.0]))
    assert inverse == pytest.approx([2.0, 2.0, 2.0, 0.0, 0.0])
    weak = replace(response, response=np.full(10, 0.01 + 0j))
    assert abs(weak.inverse(np.array([5.0]))[0]) <= 1.0, "a response below 0.1 is not amplified by more than 20 dB"


def test_the_force_of_a_stored_command_is_checked_for_the_motion_that_it_gives() -> None:
    """Its file may have been changed: a larger command moves the rod further than the target."""

    class ByMotion(Limits):
        def against(self, command: Record, expected: Record) -> str:
            del command
            return "" if expected.amplitude_m <= 1.3 * TARGET.amplitude_m else "force"

    frequency_Hz = np.arange(0.5, 16.0, 0.5)
    response = FrequencyResponse(0.0, 0.8, frequency_Hz, np.full(31, 0.8 + 0.0j), np.ones(31))
    for factor, start in ((1.25, "kept"), (3.0, "target")):
        command = with_samples(TARGET, factor * TARGET.amplitude_m * TARGET.shape)
        kept = SignalDrive(TARGET.mark, TARGET.amplitude_m, 1.0, 0.8, command, response, start="kept")
        assert allowed_start(kept, TARGET, ByMotion()).start == start


def test_the_trials_of_a_force_include_its_own_noise() -> None:
    """As in `drive_for`: a response to displacement does not serve for a force."""
    trials_s_each = (SETTINGS.most + 1) * TARGET.duration_s
    force = replace(TARGET, of_force=True, mark="force")
    other = random_record(0.5, 10.0, 2e-3)
    assert trials_s([(TARGET, 1.0), (other, 1.0)], SETTINGS) == pytest.approx(SETTINGS.noise_s + 2 * trials_s_each)
    assert trials_s([(TARGET, 1.0), (force, 1.0)], SETTINGS) == pytest.approx(2 * (SETTINGS.noise_s + trials_s_each))
