"""From a recorded point to a measurement: kept cycles, motion without noise, force as it was measured.

The motion comes from a harmonic fit over the kept cycles, evaluated at the force's own sample times, so the force is
neither interpolated nor filtered and its noise stays white. The position is referred to mid-stroke: the specimen's,
where the point knows it, else the measured mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.errors import IdentificationFailed, RigError, evaluating, some
from rig.identification.models.measurement import Measurement, MotionError
from rig.identification.points.cached_measurement import cached_measurement
from rig.identification.points.channels import FEWEST_SAMPLES, force_on_grid, measured, refuse_too_few
from rig.identification.points.faint_orders import FAINT_ORDERS, expected
from rig.identification.points.whole_record import has_cycles, prepare_whole
from rig.identification.remarks import Remark, say
from rig.recording.quality.campaign_delay import PointSkew, pooled_skews
from rig.recording.recorded_point import RecordedPoint
from rig.signals.cycles import Cycles, NoCycles, find_cycles, full_cycles, kept_cycles
from rig.signals.derivatives import Motion, harmonic, savitzky_golay, with_orders
from rig.signals.fourier import coefficient_errors, quantisation_step
from rig.signals.loop_shape import noise_of
from rig.signals.sample_times import TimeBase, sample_times

MEDIAN_OF_NORMAL = 0.6744897501960817  # median of |x| of a standard normal x
LOW_ORDERS = 7  # of the motion's series that are always in it
MOST_FOR_FAINT = 40_000  # samples of a test, whose noise more of them average so far that the orders stand out
HIGHEST_OF_RATE = 0.4  # frequency of the highest, as a share of the displacement's sampling rate
SATURATED_OF_NEXT = 4.0  # samples at the extreme value over those one step from it: a smooth top has at most 2.5 times
DRIFTS = 1.25  # of the scatter from cycle to cycle over that beside one gain and zero a cycle, if there is a drift
SATURATED_RUN = 5  # equal extreme values in a row that mean that the force stood at the end of its range


Skews = Mapping[tuple[Path | None, str], PointSkew]
"""What each campaign as a whole knows of its points' skew, by folder and point."""


def campaign_skews(points: Iterable[RecordedPoint]) -> Skews:
    """The skew of every point by all points of its campaign.

    Args:
        points: everything that was recorded, whatever it is for: what is fitted and what is held out lie on one time
            base only when neither is aligned by itself.
    """
    runs: dict[Path | None, dict[str, RecordedPoint]] = {}
    for point in points:
        if point.verdict != "invalid":
            runs.setdefault(_folder(point), {})[point.id] = point
    return {
        (folder, name): skew
        for folder, group in runs.items()
        for name, skew in pooled_skews(list(group.values())).items()
    }


def _folder(point: RecordedPoint) -> Path | None:
    return None if point.path is None else point.path.resolve().parent


def prepare_all(
    points: Iterable[RecordedPoint], skews: Skews | None = None,
    reduced: Callable[[Measurement], Measurement] | None = None,
) -> tuple[list[Measurement], list[Remark]]:
    """Measurements of all usable points, and one warning for each unusable point.

    Args:
        points: points to prepare.
        skews: result of `campaign_skews` for the complete campaigns of the points; None: there are no other points.
        reduced: applied to each measurement before the next one is made, to save memory; None: no change.

    Raises:
        IdentificationFailed: no point is usable; the message states the reason for each.
    """
    measurements: list[Measurement] = []
    refusals: list[Remark] = []
    given = list(points)
    known = campaign_skews(given) if skews is None else skews
    for point in given:
        try:
            test = prepare(point, known.get((_folder(point), point.id)))
            measurements.append(test if reduced is None else reduced(test))
        except RigError as error:
            refusals.append(say("left-out", test=point.id, reason=str(error)))
    if not measurements:
        reasons = some(refusals, "; ") if refusals else "the run contains no points that a fit can use"
        raise IdentificationFailed(f"no point can be used for identification: {reasons}")
    return measurements, refusals


def prepare(point: RecordedPoint, skew: PointSkew | None = None) -> Measurement:
    """A recorded point as a measurement; of motion without cycles the whole record (`whole_record`).

    The inertia of the fixture between load cell and damper is taken off the force.

    Args:
        point: the point.
        skew: what the campaign as a whole knows of the sensors' delays; None: what the point's file says.

    Raises:
        IdentificationFailed: the verdict is invalid, too little of the point can be used, or its data break an
            assumption of the preparation.
        NoCycles: too few whole cycles.
        NotDifferentiable: gaps too long for a velocity.
    """
    if point.verdict == "invalid":
        raise IdentificationFailed(f"the recording is invalid ({'; '.join(point.reasons)})")
    with evaluating("it"):
        return cached_measurement(point, skew, _made)


def _made(point: RecordedPoint, skew: PointSkew | None) -> Measurement:
    """Prepare a point from its file.

    Raises:
        IdentificationFailed: as `prepare`, except for the verdict.
    """
    test = _prepared(point, skew) if has_cycles(point) else prepare_whole(point, skew)
    return _with_time_errors(test, point)


def _time_errors(point: RecordedPoint) -> tuple[float, float]:
    """The step to which a point's times are rounded and the standard error of a single one (s); 0 where there is none.

    Times of arrays, and of files imported before their time base was looked for, are as they were given.
    """
    times = point.quality.time
    if times is not None:
        rounded = times.base == TimeBase.IRREGULAR
        return (times.resolution_s or 0.0 if rounded else 0.0), times.std_s or 0.0
    if point.path is not None and not point.imported:
        return 0.0, 0.0
    stamps = sample_times(point.time_s)
    rounded_to_s = stamps.resolution_s if stamps.base is TimeBase.ROUNDED else 0.0
    return rounded_to_s, rounded_to_s / math.sqrt(12.0)


def _with_time_errors(test: Measurement, point: RecordedPoint) -> Measurement:
    """The test with what errors of its single times add to the force: `|dF/dt| sigma_t` to each sample.

    A rounding that repeats in every cycle is not averaged by more cycles: the error of a cycle's mean delay is that of
    as many samples as it has.
    """
    _, std_s = _time_errors(point)
    if not std_s > 0.0:
        return test
    slope_N_s = float(np.sqrt(np.mean(np.diff(test.force_N, append=test.force_N[-1])[test.scored] ** 2))) / test.dt_s
    noise_N = slope_N_s * std_s if math.isnan(test.noise_N) else math.hypot(test.noise_N, slope_N_s * std_s)
    skew_std_s = math.hypot(test.skew_std_s, std_s / math.sqrt(max(1, test.samples_per_cycle)))
    warning = say("time-errors", std_ms=1e3 * std_s)
    return replace(
        test, noise_N=noise_N, time_noise_N=slope_N_s * std_s, skew_std_s=skew_std_s,
        warnings=(*test.warnings, warning),
    )  # fmt: skip


def _prepared(point: RecordedPoint, skew: PointSkew | None) -> Measurement:
    """A point with cycles as a measurement, the errors of its times left out."""
    cycles, warnings = _usable_cycles(point)
    time_s, displacement_m = _displacement_in(point, cycles)
    shift_s = 0.0 if skew is None else skew.shift_s
    grid_s, force_N, usable = force_on_grid(point, shift_s, float(cycles.start_s[0]), float(cycles.start_s[-1]))
    known_N, frequency_Hz = np.where(usable, force_N, np.nan), float(np.mean(cycles.frequency_Hz))
    resolution_s, _ = _time_errors(point)
    motion, motion_error = _motion(time_s, displacement_m, frequency_Hz, grid_s, known_N, resolution_s)
    if motion.harmonics is None:
        warnings.append(say("no-repeat" if len(cycles) > 1 else "one-cycle-no-series"))
    mean_m = motion.harmonics.mean_m if motion.harmonics is not None else cycles.mean_m
    step_N = quantisation_step(force_N[usable])
    usable, saturated = _without_saturation(force_N, usable, len(cycles), step_N)
    test = measured(point, skew, motion, mean_m, force_N, usable)
    repeats = test.commanded_A is None
    unseen = (None, None) if motion.harmonics is None else motion.harmonics.unseen_at(grid_s) or (None, None)
    return replace(
        test,
        # Of a single cycle the samples may be one fewer than its length over their interval: it depends on the phase.
        samples_per_cycle=min(round(float(np.mean(np.diff(cycles.start_s))) / test.dt_s), grid_s.size),
        unseen_v_m_s=unseen[0],
        unseen_a_m_s2=unseen[1],
        motion_error=motion_error,
        force_step_N=step_N,
        noise_N=cycle_scatter_N(force_N, usable, grid_s, cycles, step_N) if repeats else noise_of(force_N[usable]),
        warnings=(*warnings, *saturated, *test.warnings),
    )


def _usable_cycles(point: RecordedPoint) -> tuple[Cycles, list[Remark]]:
    """The kept cycles; a point with fewer than three full cycles gives what it has, with a warning."""
    whole = find_cycles(point.time_s, point.displacement_m)
    try:
        return kept_cycles(whole), []
    except NoCycles:
        full = full_cycles(whole)
        return full, [say("few-cycles", cycles=len(full))]


def _displacement_in(point: RecordedPoint, cycles: Cycles) -> tuple[FloatArray, FloatArray]:
    """Times (s) and displacement (m) in the kept cycles.

    Raises:
        IdentificationFailed: too few samples.
    """
    inside = (point.time_s >= cycles.start_s[0]) & (point.time_s < cycles.start_s[-1])
    count = np.count_nonzero(np.isfinite(point.displacement_m[inside]))
    if count < FEWEST_SAMPLES:
        raise IdentificationFailed(
            f"got {count} displacement samples in the evaluated cycles, expected {FEWEST_SAMPLES} or more"
        )
    return point.time_s[inside], point.displacement_m[inside]


def _motion(
    time_s: FloatArray, displacement_m: FloatArray, frequency_Hz: float, query_s: FloatArray, force_N: FloatArray,
    resolution_s: float = 0.0,
) -> tuple[Motion, MotionError | None]:
    """Motion at the wanted times and its errors: harmonic where it repeats, else a local polynomial.

    The lowest orders are in the series whether they stand out of the noise or not: one that is left out biases the
    parameters by an unknown amount, and one that is in adds an error that is known. For those above see `faint_orders`.

    Args:
        time_s: times of the displacement (n,), s.
        displacement_m: (n,), m; NaN where it was not measured.
        frequency_Hz: of the cycles.
        query_s: times of the force (k,), s.
        force_N: force (k,), N; NaN where it was not measured.
        resolution_s: printing step of the displacement's times, where these are rounded to it (s).
    """
    fit = harmonic(time_s, displacement_m, frequency_Hz, resolution_s)
    whole = np.isfinite(displacement_m)
    spacing = float(np.median(np.diff(time_s)))
    if fit.repeats:
        reach = min((int(whole.sum()) - 4) // 4, int(HIGHEST_OF_RATE / (spacing * frequency_Hz)))
        certain = np.union1d(fit.orders, np.arange(1, min(LOW_ORDERS, reach) + 1))
        faint = FAINT_ORDERS if max(time_s.size, query_s.size) <= MOST_FOR_FAINT else LOW_ORDERS
        orders = np.union1d(certain, np.arange(1, min(faint, reach) + 1))
        series = with_orders(fit, time_s[whole], displacement_m[whole], orders)
        left_m = displacement_m[whole] - series.at(time_s[whole])[0]
        step_m = math.hypot(quantisation_step(displacement_m[whole]), resolution_s * fit.rms_speed_m_s)
        errors_m = coefficient_errors(time_s[whole], left_m, series.omega_rad_s, orders, step_m)
        series, error = expected(series, errors_m, np.isin(orders, certain), query_s, force_N)
        return Motion(query_s, *series.at(query_s), "harmonic", fit), error
    even_s = np.arange(time_s[0], time_s[-1] + spacing / 2.0, spacing)
    local = savitzky_golay(even_s, np.interp(even_s, time_s[whole], displacement_m[whole]), 0.1 / frequency_Hz)
    at = [np.interp(query_s, even_s, values) for values in (local.u_m, local.v_m_s, local.a_m_s2)]
    return Motion(query_s, at[0], at[1], at[2], "savitzky_golay", None), None


def _without_saturation(
    force_N: FloatArray, usable: BoolArray, cycles: int, step_N: float
) -> tuple[BoolArray, list[Remark]]:
    """Which samples remain where the force stands still at an extreme value in half of the cycles, and a warning.

    What is cut off is a stretch of time, from shortly before the first to shortly after the last sample at the limit:
    to cut by the force itself would keep those whose noise was lucky.

    Raises:
        IdentificationFailed: the force is saturated in too much of the test.
    """
    kept, warnings = usable.copy(), []
    for word, extreme in (("greatest", np.max(force_N[usable])), ("least", np.min(force_N[usable]))):
        same = np.concatenate(([0], ((force_N == extreme) & usable).astype(np.int8), [0]))
        edges = np.flatnonzero(np.diff(same))
        starts, stops = edges[::2], edges[1::2]
        standing = int(np.count_nonzero(stops - starts >= SATURATED_RUN))
        if standing < 2 or 2 * standing < cycles:
            continue
        beside = np.abs(np.abs(force_N[usable] - extreme) - step_N) < 0.5 * step_N
        if np.count_nonzero(same) < SATURATED_OF_NEXT * np.count_nonzero(beside):
            continue
        for start, stop in zip(starts, stops, strict=True):
            margin = SATURATED_RUN + (stop - start) // 5 if stop - start >= SATURATED_RUN else 0
            kept[max(0, start - margin) : stop + margin] = False
        warnings.append(say("saturated-force", end=word, extreme_N=extreme, times=standing))
    if warnings:
        refuse_too_few(int(np.count_nonzero(kept)), kept.size, "saturated or missing")
    return kept, warnings


def cycle_scatter_N(
    force_N: FloatArray, usable: BoolArray, time_s: FloatArray, cycles: Cycles, step_N: float = 0.0
) -> float:
    """Standard deviation (N) of the force at equal phase of successive cycles; nan with fewer than two cycles.

    Each sample is compared with the next cycle's force, interpolated at the same phase. The median of the differences
    is taken, so that the corners of the loop, where interpolation errs, do not count. A median of quantised values is
    itself a whole number of steps, so each value first gets a random part of a step (the same in every call), whose
    variance is taken off again. Where most of it is one gain and one zero a cycle, that is left out: a drift is no
    scatter, and must not hide behind itself.
    """
    if len(cycles) < 2:
        return math.nan
    force_N = force_N + step_N * (np.random.default_rng(0).random(force_N.size) - 0.5)
    phase = np.interp(time_s, cycles.start_s, np.arange(cycles.start_s.size))
    position = np.interp(phase + 1.0, phase, np.arange(phase.size, dtype=float))
    inside = usable & (phase + 1.0 <= phase[-1])
    low = np.minimum(position.astype(np.int64), phase.size - 2)
    inside &= usable[low] & usable[low + 1]
    share = (position - low)[inside]
    first = force_N[inside]
    later = force_N[low[inside]] * (1.0 - share) + force_N[low[inside] + 1] * share
    spread = np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    if first.size == 0:
        return math.nan
    return math.sqrt(max(0.0, repeat_scatter_N(first, later, spread) ** 2 - step_N**2 / 12.0))


def repeat_scatter_N(first_N: FloatArray, later_N: FloatArray, spread: FloatArray | float) -> float:
    """Standard deviation (N) of forces, from those at the same phase of the next cycle.

    Args:
        first_N: forces (n,), at least one.
        later_N: forces of the next cycle (n,).
        spread: standard deviation of the difference if that of each force is 1 N, (n,) or one value for all.
    """
    differences = (first_N - later_N) / spread
    # By the normal equations of one gain and one zero: a singular-value decomposition of all samples takes longer.
    zero, gain = np.ones(first_N.size) / spread, (first_N + later_N) / spread
    normal = np.array([[zero @ zero, zero @ gain], [zero @ gain, gain @ gain]])
    (by_zero, by_gain), *_ = np.linalg.lstsq(normal, np.array([zero @ differences, gain @ differences]), rcond=None)
    steady = differences - by_zero * zero - by_gain * gain
    scatter_N, without_drift_N = (
        float(np.median(np.abs(left_N - np.median(left_N)))) / MEDIAN_OF_NORMAL for left_N in (differences, steady)
    )
    return without_drift_N if scatter_N > DRIFTS * without_drift_N else scatter_N
