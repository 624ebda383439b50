"""One loop's characteristics, cycle by cycle, with what the cycles' scatter leaves uncertain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.identification.diagnosis.force_channel import FLAT_WITHIN, ends_N
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.points.preparation import prepare
from rig.identification.uncertainty.scoring import cycle_energies_J
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.fourier import quantisation_step
from rig.signals.loop_shape import noise_of
from rig.signals.peak_force import UNKNOWN, PeakForce
from rig.signals.test_set import CurrentReading, MotionReading
from rig.signals.waveform import TRIANGLE

MIDDLE = 0.5
"""Share of the amplitude about the mean position in which the force is taken: away from the reversals."""
NEAR_PEAK = 0.97
"""Samples whose speed is at least this share of the greatest one count as "at peak velocity"."""
FEW_MISSING = 0.9
FEWEST_FOR_A_LINE = 5
SMALLEST_SPREAD = 0.004
PHASES = 200
NOISE_SHARE = 0.1
"""Share of the steepest slope that noise may make of it."""
SLOWEST = 0.6  # of the greatest speed: a force that stays the same from there to the top has no viscous part
STEADY = 0.9  # of the greatest speed: where hardly any fast sample is slower, the speed does not change
MOST_OF_FAST = 0.8  # of the samples at these speeds; measured dampers that were not cut off have up to 0.67
RISE_ERRORS = 3.0  # standard errors, beyond which the force is larger at the greater speeds
LARGEST_NOISE = 0.02  # of the force's span: beyond, nothing looks flat


@dataclass(frozen=True)
class Measured:
    """A value, its standard uncertainty from the scatter over cycles, and that scatter (standard deviation of one)."""

    value: float
    std: float
    scatter: float

    def with_error(self, relative: float) -> Measured:
        """The same with a relative standard uncertainty that its scatter does not show."""
        return Measured(self.value, math.hypot(self.std, relative * self.value), self.scatter)

    def to_json(self) -> dict[str, float | None]:
        """`value`, `std`, `scatter`; null where unknown."""
        return {name: value if math.isfinite(value) else None for name, value in vars(self).items()}


@dataclass(frozen=True)
class LoopCharacteristics:
    """One valid loop.

    Attributes:
        id: of the point; `waveform`, `amplitude_m`, `frequency_Hz`, `current_A` as requested; of an imported test as
            measured.
        peak_speed_m_s: greatest measured speed, m/s; of a triangle the speed of its flanks: the corners overshoot it.
        rebound_N: mean force at peak velocity in extension, N (positive); `jounce_N` in compression (negative). Of a
            triangle at its constant velocity, about mid-stroke.
        energy_J: dissipated in a cycle, the loop's area, J; NaN where a stretch of every cycle has no force samples.
        equivalent_damping_N_s_m: `E / (pi omega X^2)`: the viscous damper that dissipates as much in a sine of the
            measured amplitude and frequency, N s/m.
        steepest_N_s: greatest rate of change of the mean cycle's force, N/s: at the reversals.
        force_scatter_N: standard deviation of the force from cycle to cycle at equal phase, N, noise included.
        cycles: number of cycles.
        current: what is known of its current; None where that changes.
        motion_read: what is known of its motion.
        level_A: the level of current to which it belongs in its run, A.
        group: amplitude (m) and frequency (Hz) of the motion to which it belongs in its run.
        amplitude_level_m: the amplitude to which it belongs in its run, whatever its frequency, m.
        peak_force_N: largest force in rebound and in compression, N (`rig.signals.peak_force`).
    """

    id: str
    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    peak_speed_m_s: float
    rebound_N: Measured
    jounce_N: Measured
    energy_J: Measured
    equivalent_damping_N_s_m: Measured
    steepest_N_s: float
    force_scatter_N: float
    cycles: int
    current: CurrentReading | None
    motion_read: MotionReading
    level_A: float
    group: tuple[float, float]
    amplitude_level_m: float
    peak_force_N: PeakForce = UNKNOWN

    @property
    def motion(self) -> tuple[str, float, float]:
        """What loops at different currents must share to be compared."""
        return (self.waveform, *self.group)

    def to_json(self) -> dict[str, Any]:
        """Every attribute; measured ones as objects."""
        entry = {
            name: value.to_json() if isinstance(value, Measured) else value for name, value in vars(self).items()
            if name not in {"current", "motion_read", "group", "peak_force_N"}
        }  # fmt: skip
        entry |= {f"peak_force_{name}": value for name, value in self.peak_force_N._asdict().items()}
        return {name: None if isinstance(x, float) and not math.isfinite(x) else x for name, x in entry.items()}


def characterise_loop(point: RecordedPoint, prepared: Measurement | None = None) -> LoopCharacteristics:
    """Measure a loop; `prepared` is its measurement where that was made already.

    Raises:
        RigError: too little of the point can be used; the message says why.
    """
    measured = prepare(point) if prepared is None else prepared
    energies_J = cycle_energies_J(measured, measured.force_N)
    omega_1_s = math.tau / (samples_a_cycle(measured.u_m) * measured.dt_s)
    dampings, rebounds, jounces = list[float](), list[float](), list[float]()
    for energy_J, (start, stop) in zip(energies_J, _cycles(measured, len(energies_J)), strict=True):
        part = slice(start, stop)
        u, v, force = measured.u_m[part], measured.v_m_s[part], measured.force_N[part]
        good = measured.scored[part] & np.isfinite(force)
        amplitude_m = 0.5 * float(np.max(u) - np.min(u))
        dampings.append(float(energy_J) / (math.pi * omega_1_s * amplitude_m**2))
        for forces, speed_m_s in ((rebounds, v), (jounces, -v)):
            if point.waveform == TRIANGLE.name:
                forces.append(_mean_known(force, _flanks(u) & (speed_m_s > 0.0), good))
            else:
                forces.append(_at_peak(force, speed_m_s, good))
    speeds_m_s = np.abs(measured.v_m_s)
    on_flanks = point.waveform == TRIANGLE.name
    # The steps of a coarse displacement repeat in every cycle: no scatter shows their error.
    step_m = quantisation_step(point.displacement_m[np.isfinite(point.displacement_m)])
    resolution = step_m / math.sqrt(12.0) / max(0.5 * float(np.ptp(measured.u_m)), 1e-12)
    return LoopCharacteristics(
        id=point.id,
        waveform=point.waveform,
        amplitude_m=point.amplitude_m,
        frequency_Hz=point.frequency_Hz,
        current_A=point.current_A,
        peak_speed_m_s=float(np.median(speeds_m_s[_flanks(measured.u_m)]) if on_flanks else np.max(speeds_m_s)),
        rebound_N=over_cycles(rebounds),
        jounce_N=over_cycles(jounces),
        energy_J=_energy_J(point, measured, energies_J).with_error(resolution),
        equivalent_damping_N_s_m=over_cycles(dampings).with_error(2.0 * resolution),
        steepest_N_s=steepest_N_s(measured),
        force_scatter_N=measured.noise_N,
        cycles=len(energies_J),
        current=measured.current,
        motion_read=measured.motion,
        level_A=point.current_A,
        group=(point.amplitude_m, point.frequency_Hz),
        amplitude_level_m=point.amplitude_m,
        peak_force_N=point.peak_force_N,
    )


def _energy_J(point: RecordedPoint, measured: Measurement, energies_J: FloatArray) -> Measured:
    """Energy of a cycle with what noise and delay leave uncertain.

    Few cycles may agree by chance, so the standard error is at least that of the force's noise. A delay between force
    and displacement is the same in all cycles and shows in no scatter.
    """
    mean = over_cycles(energies_J.tolist())
    scored, dt_s, delay_s = measured.scored, measured.dt_s, delay_std_s(point, measured)
    force_N = measured.force_N[scored]
    # The noise of a sum over the samples, of which each cycle has its share.
    by_noise_J = noise_of(force_N) * dt_s * float(np.linalg.norm(measured.v_m_s)) / len(energies_J)
    std_J = by_noise_J if by_noise_J > mean.std else mean.std
    slope_W = float(np.sum((force_N - np.mean(force_N)) * measured.a_m_s2[scored])) * dt_s
    omega_1_s = math.tau / (samples_a_cycle(measured.u_m) * dt_s)
    by_delay_J = math.hypot(slope_W / len(energies_J) * delay_s, 0.5 * mean.value * (omega_1_s * delay_s) ** 2)
    return Measured(mean.value, math.hypot(std_J, by_delay_J), mean.scatter)


def delay_std_s(point: RecordedPoint, measured: Measurement) -> float:
    """Standard uncertainty (s) of the delay between force and displacement, the bench file's declarations trusted.

    They are trusted unless the signals contradict them.
    """
    skew = point.quality.skew
    if skew.trusted_std_s is None or skew.state == "doubted":
        return measured.skew_std_s
    return min(measured.skew_std_s, skew.trusted_std_s)


def steepest_N_s(measured: Measurement) -> float:
    """Greatest rate of change (N/s) of the mean cycle's force, over as short a time as its noise allows.

    The cycles are laid on one grid of phases; the grid's differences are taken over 1, 2, 4 ... places until three
    standard deviations of their noise are a small share of the greatest. NaN where half of the phases have no force.
    """
    period = samples_a_cycle(measured.u_m)
    places = min(PHASES, int(period))
    scored = measured.scored & np.isfinite(measured.force_N)
    phase = (np.flatnonzero(scored) / period) % 1.0
    place = np.minimum((phase * places).astype(np.int64), places - 1)
    count = np.bincount(place, minlength=places)
    seen = np.flatnonzero(count)
    if 2 * seen.size < places:
        return math.nan
    at_s = np.bincount(place, phase, places)[seen] / count[seen] * period * measured.dt_s
    force_N = np.bincount(place, measured.force_N[scored], places)[seen] / count[seen]
    noise_N = measured.noise_N if math.isfinite(measured.noise_N) else noise_of(measured.force_N[scored])
    noise_N *= math.sqrt(2.0 * seen.size / phase.size)
    reach, slope_N_s = 1, math.nan
    while reach <= max(1, seen.size // 8):
        apart_s = (np.roll(at_s, -reach) - at_s) % (period * measured.dt_s)
        slope_N_s = float(np.max(np.abs(np.roll(force_N, -reach) - force_N) / apart_s))
        if 3.0 * noise_N / float(np.mean(apart_s)) <= NOISE_SHARE * slope_N_s:
            break
        reach *= 2
    return slope_N_s


def over_cycles(values: list[float]) -> Measured:
    """Mean over the cycles; its uncertainty needs at least two."""
    known = np.array([value for value in values if math.isfinite(value)])
    if len(known) == 0:
        return Measured(math.nan, math.nan, math.nan)
    scatter = float(np.std(known, ddof=1)) if len(known) > 1 else math.nan
    return Measured(float(np.mean(known)), scatter / math.sqrt(len(known)), scatter)


def over_repeats(values: Iterable[Measured]) -> tuple[float, float]:
    """Mean over repeats and its standard uncertainty: the larger of what each states and what they differ by.

    Both are NaN where nothing is known; the uncertainty also where neither of the two is.
    """
    known = [value for value in values if math.isfinite(value.value)]
    if not known:
        return math.nan, math.nan
    means = np.array([value.value for value in known])
    stated = math.sqrt(sum(value.std**2 for value in known)) / len(known)
    between = float(np.std(means, ddof=1)) / math.sqrt(len(known)) if len(known) > 1 else 0.0
    return float(np.mean(means)), max(stated, between) if math.isfinite(stated) else between or math.nan


def _cycles(measured: Measurement, count: int) -> Iterator[tuple[int, int]]:
    """First sample of each cycle, and that of the next."""
    edges = np.rint(np.linspace(0.0, len(measured.u_m), count + 1)).astype(int).tolist()
    return itertools.pairwise(edges)


def _flanks(u_m: FloatArray) -> NDArray[np.bool_]:
    """The samples about the middle of a motion (n,), away from its reversals."""
    low_m, high_m = float(np.min(u_m)), float(np.max(u_m))
    return np.abs(u_m - 0.5 * (low_m + high_m)) <= MIDDLE * 0.5 * (high_m - low_m)


def _mean_known(force_N: FloatArray, chosen: NDArray[np.bool_], good: NDArray[np.bool_]) -> float:
    """Mean force (N) of the chosen samples; NaN where more than a few of them carry no force."""
    known = chosen & good
    if not np.any(known) or np.count_nonzero(known) < FEW_MISSING * np.count_nonzero(chosen):
        return math.nan
    return float(np.mean(force_N[known]))


def _at_peak(force_N: FloatArray, speed_m_s: FloatArray, good: NDArray[np.bool_]) -> float:
    """Force (N) at the greatest speed in one direction: a straight line through the samples near it.

    Where the speed hardly varies there (a triangle's flank), their mean. NaN where more than a few carry no force:
    those that a channel cut off were the greatest; and where nothing moves in this direction.
    """
    peak_m_s = float(np.max(speed_m_s))
    if not peak_m_s > 0.0:
        return math.nan  # no motion in this direction
    near = speed_m_s >= NEAR_PEAK * peak_m_s
    chosen = good & near
    if np.count_nonzero(chosen) < FEW_MISSING * np.count_nonzero(near):
        return math.nan
    below = speed_m_s[chosen] / peak_m_s - 1.0
    if np.count_nonzero(chosen) < FEWEST_FOR_A_LINE or float(np.std(below)) < SMALLEST_SPREAD:
        return float(np.mean(force_N[chosen]))
    return float(np.polyfit(below, force_N[chosen], 1)[1])


def without_cut_ends(test: Measurement) -> tuple[Measurement, list[str]]:
    """The measurement without the samples at which its force was cut off, or looks like that, and this in words.

    Where noise comes after the cut, no sample equals its neighbour. What tells then is a force that stays within the
    noise while the speed changes much, and is no larger at the greater speeds, which viscous dampers do not show.

    Args:
        test: its measurement.
    """
    ends_cut = [
        f"the force is constant at its {warning.numbers['end']} value, {warning.numbers['extreme_N']:.0f} N"
        for warning in test.warnings if warning.slug == "saturated-force"
    ]
    if ends_cut:
        return test, ends_cut  # its preparation did without these samples
    scored, speed_m_s = test.scored, np.abs(test.v_m_s)
    noise_N = max(noise_of(test.force_N[scored]), 0.5 * test.force_step_N)
    top_m_s = float(np.max(speed_m_s))
    fast = scored & (speed_m_s > SLOWEST * top_m_s)
    if not 0.0 < noise_N < LARGEST_NOISE * float(np.ptp(test.force_N[scored])):
        return test, []
    if np.percentile(speed_m_s[fast], 10.0) > STEADY * top_m_s:
        return test, []  # a triangle's flank: the force of one speed is flat
    kept = scored.copy()
    for side, end_N in zip((-1.0, 1.0), ends_N(test, noise_N), strict=True):
        at_end = np.abs(test.force_N - end_N) < FLAT_WITHIN * noise_N
        one_way = fast & (side * test.v_m_s > 0.0)
        if np.count_nonzero(one_way & at_end) <= MOST_OF_FAST * np.count_nonzero(one_way):
            continue
        force_N, speed = test.force_N[one_way & at_end], speed_m_s[one_way & at_end]
        slower = speed < np.median(speed)
        rise_N = float(np.mean(force_N[~slower]) - np.mean(force_N[slower]))
        if abs(rise_N) < RISE_ERRORS * 2.0 * noise_N / math.sqrt(speed.size):
            kept &= ~at_end
            ends_cut.append(
                f"the force remains at {end_N:+.0f} N, within noise, from {100 * SLOWEST:.0f} to 100 % of the peak "
                "speed; the channel has probably reached the end of its range"
            )
    return (replace(test, usable=kept) if ends_cut else test), ends_cut
