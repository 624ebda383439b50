"""Iteration of the command of a signal until the measured signal follows its target; numbers only.

The response of the machine from command to measured signal is identified with band-limited noise (H1 estimate), split
into its delay and the rest, and inverted where command and measured signal are coherent, as in time waveform
replication (De Cuyper et al. 2003; estimates: Bendat and Piersol, Random Data, chapter 6):

    H1(f) = S_yu / S_uu,    coherence = |S_yu|^2 / (S_uu S_yy),    u_(k+1) = u_k + gain W(f) H(f)^-1 (target - y_k)

W is 1 where the coherence suffices and 0 elsewhere: there the command is not corrected. The whole command leads its
target by the measured delay. Below the lowest frequency of the noise a servo is quasi-static: the lowest coherent
frequency's response is used. A gain below 1 lets the iteration converge where the response depends on the amplitude.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from rig.signals.arrays import BoolArray, ComplexArray, FloatArray
from rig.signals.following import following
from rig.signals.force_motion import force_error
from rig.signals.record import STEP_S, Record, between_ramps, record_of, with_faded_ends

SEGMENTS = 8
"""Of the noise, which overlap by half: 15 averages, with which a coherence of 0.2 is chance at most."""
LEAST_RESPONSE = 0.1
"""Of the response's amplitude: a smaller one is inverted as if it were this, so that no correction exceeds 20 dB."""
EDGE_S = 0.05
"""Over which a command is brought to rest at both ends, within the target's own ramp."""
PADDING_S = 2.0
"""Zeros behind a signal, so that the corrections of its end do not reach its beginning."""
CONTENT = 0.9999
"""Share of the target's variance that lies within the identified band: beyond it, 1 % of the RMS value is left."""
IMPROVED = 0.95
"""An error above this share of the best one so far is no improvement."""
DIVERGED = 1.25
"""An error above this multiple of the best one so far is a divergence."""
MOST_SETBACKS = 2
"""Iterations without an improvement, after each of which the gain is halved."""
SETTLED_SHARE = 0.9
"""Of the tolerance, with which the iteration ends: the recorded run differs from the last trial by noise and heat."""
SMALLER_STEPS = (1.0, 0.5, 0.25)
"""Shares of a correction that are tried where the whole one would exceed a limit."""
CONVERGED, LIMIT, NOT_COHERENT, NOISE_FLOOR, DIVERGENCE, ITERATIONS = (
    "converged", "limit", "not-coherent", "noise-floor", "divergence", "iterations",
)
"""How an iteration ended."""
TARGET, KEPT = "target", "kept"
"""The command with which an iteration began: the target itself, or one from another current, session or run."""
MOST_LINES = 200
"""Of the response in the description of a point."""
LARGEST_DELAY_S = 2e-3
"""Of the rod behind its target, with which a command is final: the host's clock shows no less."""
SPEED_OVER_S = 0.005
"""Over which the speed of the measured signal is taken: the noise of a displacement sensor is no speed."""
MOST_OUTSIDE = 0.5
"""Share of the error's power at frequencies that are not corrected, above which these limit the error."""


@dataclass(frozen=True)
class IterationSettings:
    """How a command is iterated.

    Attributes:
        tolerance: RMS error allowed, relative to the RMS of the target about its mean.
        most: iterations at most, after the first run with the target itself as the command.
        gain: share of the error that each iteration corrects.
        least_coherence: with which a frequency is corrected.
        noise_s: duration of the noise with which the response is identified, ramps included (s).
        noise_level: RMS speed of the noise relative to that of the target.
    """

    tolerance: float = 0.02
    most: int = 6
    gain: float = 0.8
    least_coherence: float = 0.8
    noise_s: float = 20.0
    noise_level: float = 0.5


@dataclass(frozen=True)
class FrequencyResponse:
    """Response from the command to the measured signal.

    Attributes:
        frequency_Hz: (k,), evenly spaced, above 0.
        response: (k,), the delay removed.
        coherence: (k,), 0 to 1.
        delay_s: of the measured signal behind the command (s).
        least_coherence: with which a frequency is corrected.
    """

    delay_s: float
    least_coherence: float
    frequency_Hz: FloatArray = field(repr=False, compare=False)
    response: ComplexArray = field(repr=False, compare=False)
    coherence: FloatArray = field(repr=False, compare=False)

    @property
    def corrected(self) -> BoolArray:
        """Whether a frequency is corrected (k,)."""
        return self.coherence >= self.least_coherence

    @property
    def band_Hz(self) -> tuple[float, float] | None:
        """Lowest and highest frequency that is corrected (Hz); None: none is."""
        inside = self.frequency_Hz[self.corrected]
        return (float(inside[0]), float(inside[-1])) if len(inside) else None

    def covers(self, highest_Hz: float) -> bool:
        """Whether the response is known up to a frequency (Hz)."""
        return bool(len(self.frequency_Hz)) and float(self.frequency_Hz[-1]) >= 0.98 * highest_Hz

    def inverse(self, frequency_Hz: FloatArray) -> ComplexArray:
        """Correction of the command for an error of 1 at these frequencies (m,); 0 where none is corrected."""
        known, weight = self.frequency_Hz, self.corrected.astype(np.float64)
        response = _between(frequency_Hz, known, self.response)
        size = np.maximum(np.abs(response), LEAST_RESPONSE)
        trusted = np.interp(frequency_Hz, np.append(known, 2.0 * known[-1] - known[-2]), np.append(weight, 0.0))
        return np.asarray(trusted * np.conj(response) / size**2, np.complex128)


class CommandLimits(Protocol):
    """The limits of machine and specimen, as the plan checks them."""

    def against(self, command: Record, expected: Record) -> str:
        """Why a command may not be run, in words; empty: it may.

        Args:
            command: what would be commanded.
            expected: the motion that it is expected to give, which determines force and heat.
        """

    def share(self, command: Record) -> float:
        """Largest factor, up to 1, by which the command may be multiplied."""


class Trial(NamedTuple):
    """One run of a command that was measured and not recorded as a point.

    Attributes:
        number: 0 with the target itself as the command, then 1 for each correction.
        error: RMS error after removal of the delay, relative to the RMS of the target about its mean; of a force
            target that of the force, without the difference of the means.
        delay_s: of the measured signal behind its target (s).
        outside: share of the error's power at frequencies that are not corrected.
        command: the command.
        measured: (n,) as the target, delay removed; of a force target the motion equivalent to the measured force.
        force_N: (n,) measured force, delay removed; None of a displacement target.
    """

    number: int
    error: float
    delay_s: float
    outside: float
    command: Record
    measured: FloatArray
    force_N: FloatArray | None = None

    @property
    def led(self) -> bool:
        """Whether the command leads the target by the machine's delay."""
        return abs(self.delay_s) <= LARGEST_DELAY_S

    def betters(self, other: Trial | None) -> bool:
        """Whether this is an improvement over another trial; any is over none."""
        if other is None or self.led != other.led:
            return other is None or self.led
        return self.error <= IMPROVED * other.error

    def within(self, tolerance: float) -> bool:
        """Whether the rod followed the target within a tolerance."""
        return self.led and self.error <= tolerance


@dataclass(frozen=True, eq=False)
class SignalDrive:
    """How a signal is commanded: what is known of the machine's response, and the command to run next.

    Attributes:
        mark: of the target's samples.
        amplitude_m: of the target (m).
        current_A: of the coil.
        gain: share of the error that the next iteration corrects.
        command: to run next; None: the response is to be identified first.
        response: of the machine; None before it was identified.
        noise: with which the response is identified; None where it is known.
        trials: so far, oldest first.
        setbacks: iterations without an improvement.
        limited: why the last correction could not be made in full; empty where it was.
        outcome: how the iteration ended; empty while it goes on.
        cannot: why the target is not followed, in words; empty where it is, or may be.
        start: `TARGET` or `KEPT`.
        of_force: the target is a force.
    """

    mark: str
    amplitude_m: float
    current_A: float
    gain: float
    command: Record | None = None
    response: FrequencyResponse | None = None
    noise: Record | None = None
    trials: tuple[Trial, ...] = ()
    setbacks: int = 0
    limited: str = ""
    outcome: str = ""
    cannot: str = ""
    start: str = TARGET
    of_force: bool = False

    @property
    def key(self) -> tuple[str, float, float]:
        """Equal for drives of the same target at the same current."""
        return self.mark, self.amplitude_m, self.current_A

    @property
    def settled(self) -> bool:
        """Whether the command is final."""
        return bool(self.outcome)

    @property
    def best(self) -> Trial | None:
        """The trial with the smallest error, among those without a delay if there are any; None before the first."""
        return min(self.trials, key=lambda trial: (not trial.led, trial.error), default=None)

    @property
    def errors(self) -> tuple[float, ...]:
        """RMS error of each trial, relative."""
        return tuple(trial.error for trial in self.trials)

    def to_json(self) -> dict[str, Any]:
        """`iteration` of a point in its file and in `rig run --json` (docs/json.md)."""
        response, best = self.response, self.best
        numbers: dict[str, Any] = {
            "outcome": self.outcome, "reason": self.cannot, "start": self.start,
            "follows": "force" if self.of_force else "displacement",
            "errors": [rounded(error) for error in self.errors], "best": None if best is None else best.number,
            "delays_s": [rounded(trial.delay_s) for trial in self.trials], "band_Hz": None, "delay_s": None,
            "frequency_Hz": [], "gain": [], "phase_rad": [], "coherence": [],
        }
        if response is None:
            return numbers
        rows = slice(None, None, -(-len(response.frequency_Hz) // MOST_LINES) or 1)
        lines = {
            "frequency_Hz": response.frequency_Hz, "gain": np.abs(response.response),
            "phase_rad": np.angle(response.response), "coherence": response.coherence,
        }
        band_Hz = response.band_Hz
        return numbers | {
            "band_Hz": None if band_Hz is None else [rounded(edge) for edge in band_Hz],
            "delay_s": rounded(response.delay_s), "least_coherence": response.least_coherence,
            **{name: [rounded(value) for value in values[rows].tolist()] for name, values in lines.items()},
        }

    def is_for(self, target: Record, current_A: float) -> bool:
        """Whether this is the drive of a target at a current."""
        return self.moves_as(target) and self.current_A == current_A

    def moves_as(self, target: Record) -> bool:
        """Whether this is a drive of the target, at whatever current."""
        return (self.mark, self.amplitude_m) == (target.mark, target.amplitude_m)


def rounded(value: float) -> float:
    """Five digits: what is read by people and drawn."""
    return float(f"{value:.5g}")


SignalDrives = tuple[SignalDrive, ...]


def drive_for(target: Record, current_A: float, known: SignalDrives, settings: IterationSettings) -> SignalDrive:
    """The drive known for a target at a current, else the best start for it.

    A drive of the target at another current is the first command; else the target itself is. The response of another
    drive serves where it covers the target's frequencies; else it is identified with noise.

    Raises:
        NoRecord: the target has no frequencies of its own.
    """
    for drive in known:
        if drive.is_for(target, current_A):
            return drive
    new = SignalDrive(target.mark, target.amplitude_m, current_A, settings.gain, of_force=target.of_force)
    same = [drive for drive in known if drive.moves_as(target) and drive.best is not None and not drive.cannot]
    nearest = min(same, key=lambda drive: abs(drive.current_A - current_A), default=None)
    if nearest is not None and nearest.best is not None:
        return replace(new, command=nearest.best.command, response=nearest.response, start=KEPT)
    highest_Hz = band_of(target, settings)[1]
    responses = [
        drive for drive in known
        if drive.response is not None and drive.of_force == target.of_force and drive.response.covers(highest_Hz)
    ]
    if responses:
        response = min(responses, key=lambda drive: abs(drive.current_A - current_A)).response
        return replace(new, command=target, response=response)
    return replace(new, noise=noise_record(target, settings))


def remembered_signal(known: SignalDrives, drive: SignalDrive) -> SignalDrives:
    """What is known, with this drive in place of an earlier one of the same target and current."""
    return (*(one for one in known if one.key != drive.key), drive)


def allowed_start(drive: SignalDrive, target: Record, limits: CommandLimits) -> SignalDrive:
    """The drive with a first run that the limits allow.

    Too strong noise is reduced; a command from another current, session or run that is not allowed gives way to the
    target itself, which the plan has checked. The drive is given up where no noise is allowed.
    """
    noise, command = drive.noise, drive.command
    motions: tuple[Record, ...] = ()
    if command is not None:  # what the rod does is not known from a force: the command's own motion bounds it
        motions = (command,) if target.of_force else (target, _response_to(drive, target, command))
    if command is not None and any(limits.against(command, motion) for motion in motions):
        return replace(drive, command=target, start=TARGET)
    if noise is None or not limits.against(noise, noise):
        return drive
    smaller = replace(noise, amplitude_m=noise.amplitude_m * limits.share(noise))
    why = limits.against(smaller, smaller) if smaller.amplitude_m > 0.0 else limits.against(noise, noise)
    if not why:
        return replace(drive, noise=smaller)
    return replace(drive, noise=None, outcome=LIMIT, cannot=f"the noise for the identification is not allowed: {why}")


def _response_to(drive: SignalDrive, target: Record, command: Record) -> Record:
    """The motion that a command gives by the identified response, its delay removed.

    The file of a stored command may have been changed: that it gives the target's motion, and force, is not certain.
    """
    if drive.response is None:
        return command
    position = command.amplitude_m * command.shape
    spectrum, frequency_Hz = _spectrum(position)
    known = drive.response
    trusted = known.corrected & (np.abs(known.response) > LEAST_RESPONSE)
    response = _between(frequency_Hz, known.frequency_Hz, np.where(trusted, known.response, 1.0))
    return command_record(target, _signal(response * spectrum, len(position)))


def advanced(
    drive: SignalDrive, target: Record, measured: FloatArray, settings: IterationSettings, limits: CommandLimits, *,
    saturated: bool = False, force_N: FloatArray | None = None,
) -> SignalDrive:
    """The drive after one more run, of the noise or of a command: converged, corrected, or given up with the reason.

    Args:
        drive: what was run: its noise while it has one, else its command.
        target: what is to be followed.
        measured: (n,) every `STEP_S` from the begin of the run, about its centre; of a force target the motion
            equivalent to the measured force (`rig.signals.force_motion`).
        settings: of the iteration.
        limits: of machine and specimen.
        saturated: the controller reported during the run that its valve was fully open.
        force_N: (n,) measured force, of a force target.

    Raises:
        NoRecord: nothing is left to command.
        ValueError: the drive has neither noise nor a command with a response.
    """
    if drive.noise is not None:
        known = identified(drive.noise, measured, band_of(target, settings), settings)
        return replace(drive, noise=None, response=known, command=drive.command or target)
    response = drive.response
    if response is None or drive.command is None:
        raise ValueError("a drive must have noise, or a command and a response")
    trial = tried(len(drive.trials), target, drive.command, measured, response, force_N)
    before = drive.best
    limited = _saturation(target, trial) if saturated else drive.limited
    drive = replace(drive, trials=(*drive.trials, trial), limited=limited)
    best = drive.best or trial
    if best.within(SETTLED_SHARE * settings.tolerance):
        return _ended(drive, best, CONVERGED, settings)
    if not trial.betters(before):
        drive = replace(drive, setbacks=drive.setbacks + 1, gain=0.5 * drive.gain)
    if response.band_Hz is None or (best.outside > MOST_OUTSIDE and drive.setbacks):
        return _ended(drive, best, NOT_COHERENT, settings)
    if drive.setbacks >= MOST_SETBACKS:
        diverged = before is not None and trial.error > DIVERGED * before.error
        return _ended(drive, best, LIMIT if drive.limited else DIVERGENCE if diverged else NOISE_FLOOR, settings)
    if trial.number >= settings.most:
        return _ended(drive, best, LIMIT if drive.limited else ITERATIONS, settings)
    return _corrected(drive, target, best, settings, limits)


def _corrected(
    drive: SignalDrive, target: Record, best: Trial, settings: IterationSettings, limits: CommandLimits
) -> SignalDrive:
    """The drive with the next command; where a limit allows only a part of the correction, with that part.

    A part counts as a setback: the second one in a row that brings nothing ends the iteration.
    """
    why = ""
    for share in SMALLER_STEPS:
        gain = share * drive.gain
        command = _commanded(drive, target, best, gain)
        # What the rod does is not known from a force: the command's own motion bounds it.
        expected = command if target.of_force else _expected(drive, target, best, gain)
        refused = limits.against(command, expected)
        if not refused:
            return replace(drive, command=command, limited=why, setbacks=drive.setbacks + bool(why))
        why = why or f"{refused}; {_fitting(limits.share(_commanded(drive, target, best, 1.0)))}"
    return _ended(replace(drive, limited=why), best, LIMIT, settings)


def _saturation(target: Record, trial: Trial) -> str:
    """What a saturated valve means for the target: the speed that the rod reached is what the valve allows."""
    if target.of_force:
        return "the valve is saturated: this force requires more flow than the valve can pass"
    apart = round(SPEED_OVER_S / STEP_S)
    reached_m_s = float(np.max(np.abs(trial.measured[apart:] - trial.measured[:-apart]))) / SPEED_OVER_S
    scale = reached_m_s / max(target.amplitude_m * target.peak_velocity, 1e-12)
    return (
        f"the valve is saturated: the rod reached {reached_m_s:.3g} m/s, and a higher speed requires more flow than "
        f"the valve can pass; {_fitting(min(1.0, scale))}"
    )


def _fitting(scale: float) -> str:
    """What fits, by the command for the whole correction: the response of the machine is taken as linear."""
    percent = math.floor(100.0 * scale)
    if percent > 0:
        return f"the target scaled by {percent / 100.0:g} is within the limit"
    return "no scaled target is within the limit"


def _commanded(drive: SignalDrive, target: Record, best: Trial, gain: float) -> Record:
    """The command that corrects a share of a trial's error."""
    return best.command if drive.response is None else next_command(target, best, drive.response, gain)


def _expected(drive: SignalDrive, target: Record, best: Trial, gain: float) -> Record:
    """The motion that the next command is expected to give: what was measured, less the part of the error it corrects.

    Where the error is not corrected the measured motion stays.
    """
    error = target.amplitude_m * target.shape - best.measured
    spectrum, frequency_Hz = _spectrum(error)
    inside = np.zeros(len(spectrum)) if drive.response is None else drive.response.inverse(frequency_Hz) != 0.0
    return command_record(target, best.measured + _signal(gain * inside * spectrum, len(error)))


REASONS = {
    LIMIT: "the required command exceeds a limit: {limited}",
    NOT_COHERENT: "{outside:.0f} % of the remaining error is at frequencies where command and measured signal are not "
    "coherent (corrected: {band}); these are not corrected",
    NOISE_FLOOR: "further iterations do not reduce the error: the rest does not repeat, or does not depend on the "
    "command",
    DIVERGENCE: "the error grew from {best:.3g} % to {last:.3g} %: the response depends on the motion. Fix: use a "
    "smaller gain",
    ITERATIONS: "the error was still decreasing at the last iteration, {count}. Fix: allow more iterations",
}


def _ended(
    drive: SignalDrive, best: Trial, outcome: str, settings: IterationSettings
) -> SignalDrive:
    """The drive with the best command, and why its error exceeds the tolerance."""
    if best.within(settings.tolerance):
        return replace(drive, command=best.command, outcome=CONVERGED)
    band = None if drive.response is None else drive.response.band_Hz
    reason = REASONS[outcome].format(
        limited=drive.limited,
        outside=100.0 * best.outside, best=100.0 * best.error, last=100.0 * drive.trials[-1].error,
        count=drive.trials[-1].number, band="none" if band is None else f"{band[0]:.3g} to {band[1]:.3g} Hz",
    )
    cannot = (
        f"RMS error {100.0 * best.error:.3g} % at iteration {best.number}, allowed "
        f"{100.0 * settings.tolerance:.3g} %: {reason}"
    )
    return replace(drive, command=best.command, outcome=outcome, cannot=cannot)


def noise_record(target: Record, settings: IterationSettings) -> Record:
    """Band-limited noise for the identification of the response.

    Its velocity spectrum is flat over the frequencies of the target, its RMS speed a share of the target's. The phases
    are random, but the same in every run.

    Raises:
        NoRecord: the target has no band of its own.
    """
    samples = math.floor(settings.noise_s / STEP_S + 1e-6) + 1
    frequency_Hz = np.fft.rfftfreq(samples, STEP_S)
    lowest_Hz, highest_Hz = band_of(target, settings)
    inside = (frequency_Hz >= lowest_Hz) & (frequency_Hz <= highest_Hz)
    phase = np.random.default_rng(41).uniform(0.0, math.tau, samples // 2 + 1)
    spectrum = np.where(inside, np.exp(1j * phase) / np.maximum(frequency_Hz, lowest_Hz), 0.0)
    position_m = np.fft.irfft(spectrum, samples)
    speed_m_s = settings.noise_level * target.amplitude_m * _rms_speed(target.shape) / _rms_speed(position_m)
    ramp_s = min(1.0, 0.1 * settings.noise_s)
    noise = record_of("noise", np.asarray(position_m - np.mean(position_m), np.float64) * speed_m_s, ramp_s)
    return replace(noise, highest_Hz=target.highest_Hz)


def band_of(target: Record, settings: IterationSettings) -> tuple[float, float]:
    """Lowest and highest frequency of the noise (Hz): two lines of the identified response around the target's."""
    step_Hz = 1.0 / segment_s(settings)
    power = np.abs(np.fft.rfft(target.shape - np.mean(target.shape))) ** 2
    below = np.cumsum(power) / np.sum(power)
    frequency_Hz = np.fft.rfftfreq(len(target.shape), STEP_S)
    ends = (int(np.searchsorted(below, share)) for share in (1.0 - CONTENT, CONTENT))
    lowest_Hz, highest_Hz = (float(frequency_Hz[end]) for end in ends)
    return max(0.5 * step_Hz, lowest_Hz - 2.0 * step_Hz), max(target.highest_Hz, highest_Hz) + 2.0 * step_Hz


def segment_s(settings: IterationSettings) -> float:
    """Duration of a segment of the noise (s): its inverse is the spacing of the identified frequencies."""
    return (settings.noise_s - 2.0 * min(1.0, 0.1 * settings.noise_s)) / SEGMENTS


def identified(
    noise: Record, measured: FloatArray, band_Hz: tuple[float, float], settings: IterationSettings
) -> FrequencyResponse:
    """The response of the machine from a run of noise.

    Args:
        noise: the command.
        measured: (n,) as the noise, about its centre.
        band_Hz: lowest and highest frequency of the noise (Hz).
        settings: coherence that suffices, duration of the noise.
    """
    from scipy.signal import csd, welch  # 0.3 s to load, and only iterated signals need it

    command = noise.amplitude_m * noise.shape
    time_s = STEP_S * np.arange(len(command), dtype=np.float64)
    inside = between_ramps(noise, len(command))
    scale = float(np.std(measured)) / float(np.std(command))
    delay_s = following(time_s, measured, time_s[inside], scale * command[inside]).delay_s
    undelayed = shifted(measured, delay_s)
    length = round(segment_s(settings) / STEP_S)
    u, y = command[inside], undelayed[inside]
    frequency_Hz, cross = csd(u, y, fs=1.0 / STEP_S, nperseg=length)  # Hann window, half overlapping, mean removed
    of_command, of_measured = (welch(x, fs=1.0 / STEP_S, nperseg=length)[1] for x in (u, y))
    used = (frequency_Hz >= band_Hz[0]) & (frequency_Hz <= band_Hz[1])
    return FrequencyResponse(
        delay_s, settings.least_coherence, np.asarray(frequency_Hz[used], np.float64),
        np.asarray(cross[used] / of_command[used], np.complex128),
        np.asarray(np.abs(cross[used]) ** 2 / (of_command[used] * of_measured[used]), np.float64),
    )


def tried(
    number: int, target: Record, command: Record, measured: FloatArray, response: FrequencyResponse,
    force_N: FloatArray | None = None,
) -> Trial:
    """A run of a command as it was measured.

    Args:
        number: of the iteration.
        target: what is to be followed.
        command: what was commanded.
        measured: (n,) as the target, about its centre.
        response: which frequencies are corrected.
        force_N: (n,) measured force, of a force target.
    """
    wanted = target.amplitude_m * target.shape
    time_s = STEP_S * np.arange(len(wanted), dtype=np.float64)
    inside = between_ramps(target, len(wanted))
    seen = following(time_s, measured, time_s[inside], wanted[inside])
    undelayed = shifted(measured, seen.delay_s)
    spectrum, frequency_Hz = _spectrum(np.where(inside, wanted - undelayed, 0.0))
    power = np.abs(spectrum) ** 2
    outside = float(np.sum(power[response.inverse(frequency_Hz) == 0.0]) / max(float(np.sum(power)), 1e-300))
    if target.force is None or force_N is None:
        return Trial(number, seen.nrms, seen.delay_s, outside, command, undelayed)
    mean_N = float(np.mean(force_N))
    run_N = mean_N + shifted(force_N - mean_N, seen.delay_s)
    error = force_error(target.force.force_N[inside], run_N[inside])
    return Trial(number, error, seen.delay_s, outside, command, undelayed, run_N)


def next_command(target: Record, trial: Trial, response: FrequencyResponse, gain: float) -> Record:
    """The command of the next iteration.

    Args:
        target: what is to be followed.
        trial: the iteration to start from.
        response: of the machine.
        gain: share of the error to correct.

    Raises:
        NoRecord: nothing is left to command.
    """
    error = target.amplitude_m * target.shape - trial.measured
    spectrum, frequency_Hz = _spectrum(error)
    change = _signal(gain * response.inverse(frequency_Hz) * spectrum, len(error))
    before = trial.command.amplitude_m * trial.command.shape
    return command_record(target, shifted(before, trial.delay_s) + shifted(change, response.delay_s))


def command_record(target: Record, position: FloatArray) -> Record:
    """Samples as the command for a target: at rest at its centre at both ends, of the target's duration and name."""
    return with_samples(target, with_faded_ends(position, EDGE_S))


def with_samples(target: Record, position: FloatArray) -> Record:
    """The target's record with other samples (n,), m, which begin and end at rest at the centre."""
    amplitude_m = float(np.max(np.abs(position)))
    shape = np.asarray(position / amplitude_m if amplitude_m > 0.0 else position, np.float64)
    mark = hashlib.sha256(np.asarray(position, np.float64).tobytes()).hexdigest()
    return replace(target, amplitude_m=amplitude_m, shape=shape, mark=mark)


def shifted(values: FloatArray, lead_s: float) -> FloatArray:
    """Values (n,) every `STEP_S` that lead by so much (s); beyond their ends 0."""
    if lead_s == 0.0:
        return values
    spectrum, frequency_Hz = _spectrum(values)
    return _signal(spectrum * np.exp(2j * math.pi * frequency_Hz * lead_s), len(values))


def _spectrum(values: FloatArray) -> tuple[ComplexArray, FloatArray]:
    size = len(values) + round(PADDING_S / STEP_S)
    size += -size % 1000  # many small factors: the transform of a prime number of samples takes seconds
    return np.fft.rfft(values, size), np.asarray(np.fft.rfftfreq(size, STEP_S), np.float64)


def _signal(spectrum: ComplexArray, count: int) -> FloatArray:
    return np.asarray(np.fft.irfft(spectrum, 2 * (len(spectrum) - 1))[:count], np.float64)


def _between(frequency_Hz: FloatArray, known_Hz: FloatArray, response: ComplexArray) -> ComplexArray:
    real, imaginary = (np.interp(frequency_Hz, known_Hz, part) for part in (response.real, response.imag))
    # Below the lowest line a servo is quasi-static: its response is real.
    low = frequency_Hz < known_Hz[0]
    real, imaginary = np.where(low, abs(response[0]), real), np.where(low, 0.0, imaginary)
    return np.asarray(real + 1j * imaginary, np.complex128)


def _rms_speed(shape: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.diff(shape) ** 2))) / STEP_S
