"""Verdict of a test in a third-party file or table: one set of checks for the command and for Python."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocols.quality import Quality
from rig.recording.motion_parts import CURRENT_NOISES
from rig.recording.quality.verdict import Reason, Verdict, invalid, suspect
from rig.recording.quality.verdict_rules import PointEvidence, SensorCounts, evaluate
from rig.signals.arrays import FloatArray
from rig.signals.current_error import loop_error_A
from rig.signals.cycles import MeasuredMotion, measured_motion
from rig.signals.free_motion import RANDOM
from rig.signals.interpolation import LARGEST_STEP_PERIODS
from rig.signals.loop_shape import noise_of, standing
from rig.signals.spikes import spikes
from rig.signals.test_set import TRACKING_A, TRACKING_SHARE

FEWEST_CYCLES = 3
CLIPPED_OF_CYCLES = 0.5
"""In so many of the cycles a force that only ends stands at its end, as identification asks for it."""
UNSTEADY = 1.1
"""Longest or largest of the full cycles over the least, from which they are not one motion."""
DRIFTING = 0.02
"""Shift of the cycles' middle in a cycle, over their amplitude, from which the damping is wrong by 2 %."""
PHASES = 64
"""Values of a cycle whose mean is its middle: interpolated, so that a part of a sample step shifts nothing."""
JITTER_SPREADS = 7.0
"""Median deviations of the steps, of irregularly taken samples, beyond which a step is a gap: 5 standard deviations."""
REVERSED = -0.1
"""Share of all work done that a force must put in, in sum, to be one of a wrong sign."""


@dataclass(frozen=True)
class TestSamples:
    """What is checked of a test: arrays (n,) in SI on one time base, NaN where there is no number.

    Attributes:
        time_s, displacement_m, force_N, velocity_m_s: of the test.
        current_A: the coil's; None where it is not known.
        nominal_current_A: what the test is named by (A).
        current_measured: whether `current_A` was measured.
    """

    __test__ = False  # pytest takes classes called Test for its own

    time_s: FloatArray
    displacement_m: FloatArray
    force_N: FloatArray
    velocity_m_s: FloatArray
    current_A: FloatArray | None
    nominal_current_A: float
    current_measured: bool


@dataclass(frozen=True)
class Assessment:
    """The verdict of a test, flags of its rows (n,), number of rows missing between them, and its motion if any."""

    verdict: Verdict
    flags: NDArray[np.int8]
    lost: int
    motion: MeasuredMotion | None


def assess(test: TestSamples, waveform: str) -> Assessment:
    """Check a test: cycles, missing and stuck samples, sign of the force, steadiness of motion and current."""
    random = waveform == RANDOM
    flags, lost = _flags(test, float(np.median(np.diff(test.time_s))))
    motion = None if random else measured_motion(test.time_s, test.displacement_m)
    return Assessment(_evaluate(test, motion, lost, 0 if random else FEWEST_CYCLES), flags, lost, motion)


def _flags(test: TestSamples, period_s: float) -> tuple[NDArray[np.int8], int]:
    """Flags of each row and the number of rows missing between them."""
    flags = np.zeros(len(test.time_s), np.int8)
    steps = np.diff(test.time_s) / period_s
    spread = JITTER_SPREADS * float(np.median(np.abs(steps - 1.0)))  # 0 of a uniform rate
    after_gap = np.flatnonzero(steps > max(LARGEST_STEP_PERIODS, 1.0 + spread)) + 1
    flags[after_gap] |= np.int8(Quality.GAP_BEFORE)
    flags[~(np.isfinite(test.force_N) & np.isfinite(test.displacement_m))] |= np.int8(Quality.NOT_A_NUMBER)
    return flags, int(np.sum(np.round(steps[after_gap - 1]) - 1))


def _evaluate(
    test: TestSamples, motion: MeasuredMotion | None, lost: int, fewest_cycles: int
) -> Verdict:
    quantities = {"force": test.force_N, "displacement": test.displacement_m}
    return evaluate(
        PointEvidence(
            sensors={name: _counts(name, test.time_s, values, lost, motion) for name, values in quantities.items()},
            samples_a_cycle=np.inf if motion is None else len(test.time_s) / (test.time_s[-1] * motion.frequency_Hz),
            requested_cycles=fewest_cycles,
            requested_amplitude_m=0.0,
            requested_frequency_Hz=0.0,
            current_tolerance_A=np.inf,
            measured_cycles=None if motion is None else motion.cycles,
            current_error_A=0.0,
            extra=[
                *(_reversed(test, motion) if motion is not None or not fewest_cycles else []),
                *_unsteady(motion),
                *_drifting(test, motion),
                *_current_off(test, motion),
                *_spikes(test),
            ],
        )
    )


def _spikes(test: TestSamples) -> Iterator[Reason]:
    """Single samples that leave the signal: one of them can be a tenth of the peak that a report states."""
    for name, unit, factor, values in (
        ("force", "N", 1.0, test.force_N), ("displacement", "mm", 1e3, test.displacement_m)
    ):
        places = spikes(values)
        if not places:
            continue
        first = places[0]
        yield suspect(
            "sensor-spike", f"{len(places)} isolated {name} sample(s) deviate from the signal (first: "
                f"{factor * values[first]:.5g} {unit} at {test.time_s[first]:.6g} s): interference or a damaged row. "
                "Fix: correct the value in the source file, or leave the cell empty",
        )


def _reversed(test: TestSamples, motion: MeasuredMotion | None) -> list[Reason]:
    """A force that drives the rod over the full cycles, which no damper's does; as identification refuses it."""
    known = np.isfinite(test.force_N) & np.isfinite(test.velocity_m_s)
    if motion is not None:
        known &= (test.time_s >= motion.start_s) & (test.time_s < motion.end_s)
    if not np.any(known):
        return []
    work = (test.force_N[known] - np.mean(test.force_N[known])) * test.velocity_m_s[known]
    if not np.sum(work) < REVERSED * np.sum(np.abs(work)):
        return []
    return [invalid(
        "reversed-sign", "the measured force acts with the motion instead of against it: force or displacement has "
            "the wrong sign, or their columns are swapped (displacement increases with extension, a positive force "
            "resists extension). Fix: import again with --scale force=-1 (if only force is positive in compression) or "
            "--scale displacement=-1 (if only displacement is positive in compression)",
    )]


def _unsteady(motion: MeasuredMotion | None) -> list[Reason]:
    """Cycles of different length or size: a sweep, ramps, or motions too short to be tests; their mean is of none."""
    if motion is None or motion.cycles < 2:
        return []
    for what, unit, values in (
        ("last", "s", 1.0 / motion.waveform.frequency_Hz),
        ("have amplitudes of", "mm", 1e3 * motion.waveform.amplitude_m[np.isfinite(motion.waveform.amplitude_m)]),
    ):
        if values.size < 2 or not float(np.max(values)) > UNSTEADY * float(np.min(values)):
            continue
        least, most = float(np.min(values)), float(np.max(values))
        return [invalid(
            "unsteady-motion", f"the cycles {what} {least:.3g} to {most:.3g} {unit}: this is not a single motion. Fix: "
                f"import a sweep with the waveform `random`; import each motion of {FEWEST_CYCLES} or more cycles as "
                "a separate test",
            least=least, most=most,
        )]
    return []


def _drifting(test: TestSamples, motion: MeasuredMotion | None) -> Iterator[Reason]:
    """A middle that moves steadily: the loops do not close, and cycles counted by crossings have a wrong length."""
    known = np.isfinite(test.displacement_m)
    if motion is None or motion.cycles < FEWEST_CYCLES or not np.any(known):
        return
    grid_s = np.linspace(motion.start_s, motion.end_s, PHASES * motion.cycles, endpoint=False)
    middles_m = np.interp(grid_s, test.time_s[known], test.displacement_m[known]).reshape(-1, PHASES).mean(axis=1)
    shift_m = float(np.polyfit(np.arange(motion.cycles), middles_m, 1)[0])
    if abs(shift_m) > DRIFTING * motion.amplitude_m:
        yield suspect(
            "unsteady-motion", f"the mean position of the motion shifts by {1e3 * shift_m:.3g} mm per cycle (limit "
            f"{1e3 * DRIFTING * motion.amplitude_m:.3g} mm): the amplitude, frequency and damping are therefore wrong. "
            "Fix: check the displacement sensor for drift; subtract the drift in the source file, or repeat the test",
            shift_m=shift_m,
        )


def _current_off(test: TestSamples, motion: MeasuredMotion | None) -> list[Reason]:
    """A measured current that was not what the test is named by: in a part of a cycle, or throughout, as a ramp is.

    A command that was recorded without a measurement is what was requested, steps included: it shows the coil's lag.
    """
    current_A = test.current_A
    if motion is None or current_A is None or not test.current_measured:
        return []
    starts_s = np.linspace(motion.start_s, motion.end_s, motion.cycles + 1)
    inside = (test.time_s >= starts_s[0]) & (test.time_s < starts_s[-1]) & np.isfinite(current_A)
    off_A = loop_error_A(test.time_s, current_A, test.nominal_current_A, starts_s)
    if off_A is None or not np.any(inside):
        return []
    limit_A = max(TRACKING_A, TRACKING_SHARE * abs(test.nominal_current_A))
    mean_off_A = abs(float(np.mean(current_A[inside])) - test.nominal_current_A)
    if mean_off_A > limit_A:  # noise, or a pulsed current, has its mean
        off_A = mean_off_A
    else:
        limit_A += CURRENT_NOISES * noise_of(current_A[inside])
    if not off_A > limit_A:
        return []
    return [invalid(
        "current-tracking", f"the current deviates by {1e3 * off_A:.3g} mA from {test.nominal_current_A:.3g} A in "
            f"some cycles (limit {1e3 * limit_A:.3g} mA): this is not a single test. Fix: exclude these cycles; if the "
            "current varies intentionally, import the test with the waveform `random`",
        off_A=off_A, limit_A=limit_A,
    )]


def _counts(
    name: str, time_s: FloatArray, values: FloatArray, lost: int, motion: MeasuredMotion | None
) -> SensorCounts:
    """What a column holds, and whether it stands still over the full cycles; a flat top may be a filter's or a file's.

    No sensor's range is known here, so nothing is said to be saturated: identification looks for a force that ends at
    the same value in half of the cycles, and does without these samples. A force that goes there now and then stood.
    """
    missing = int(np.count_nonzero(~np.isfinite(values)))
    if motion is None:
        return SensorCounts(len(time_s), lost, missing)
    standing_runs = standing(values[(time_s >= motion.start_s) & (time_s < motion.end_s)])
    clipped = name == "force" and standing_runs.ends >= max(2.0, CLIPPED_OF_CYCLES * motion.cycles)
    longest = 0 if clipped else standing_runs.longest
    return SensorCounts(
        len(time_s),
        lost,
        missing,
        standing=longest,
        coarse=standing_runs.coarse,
        step=standing_runs.step,
        span=standing_runs.span,
    )
