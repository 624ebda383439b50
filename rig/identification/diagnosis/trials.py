"""What may explain a misfit, one trial each: what is left where it is fitted together with the damper."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.diagnosis import distortions as of
from rig.identification.diagnosis.descent import Damper, Explained, explain, residual_N
from rig.identification.diagnosis.force_channel import beyond, ends_N, reached_N
from rig.identification.diagnosis.groups import two_groups
from rig.identification.diagnosis.stretches import Stretch
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.projection import Weighting
from rig.identification.series_spring import ComplianceCorrection
from rig.identification.words import UNTRIED, some
from rig.signals.test_set import CurrentReading, current_levels

WORTH_PARTING = 0.5  # share of the misfit of two dampers, of the fitted tests at most and of tests left out
MOST_BENDS = 3
OTHER_AMPLITUDE = 1.2  # smallest stroke or speed of some tests over the largest of the others, from which they differ
SKEWS_S = (0.0, 1e-3, 3e-3, -1e-3, -3e-3)  # to start from where a model jumps at the reversals, which show the skew
SMALLEST_DRIFT = 0.05  # of the force, over all that it follows, which is worth a word in an adequate fit
SMALLEST_TEMPERATURE_SPAN_K = 1.0
NEAR_REVERSAL_m = 1e-3
MOST_TESTS = 20  # beyond which further ones do not count
NO_END_N = 1e9  # beyond any force
FLAT_SHARE = 0.003  # of a test's force: within so much a force without noise is flat
MIXED = "mixed-specimens"


@dataclass(frozen=True)
class Fitted:
    """What is diagnosed: a model, its values (SI), the names of those that were fitted, its tests and their weights.

    `untried` begins the advice where another model may do better (`words.UNTRIED`); empty where all were compared.
    """

    model: DamperModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    tests: Sequence[Measurement]
    weighting: Weighting
    untried: str = UNTRIED


@dataclass(frozen=True)
class Trial:
    """One cause: what it leaves, how many amounts it has, what there is to say; by which sentence if not its own.

    `at_limit`: its amount ended at the limit of its search, so it is no measurement of that amount.
    """

    slug: str
    squares: float
    amounts: int
    numbers: Mapping[str, object]
    sentence: str = ""
    at_limit: bool = False


def trials(
    fitted: Fitted, parts: Sequence[Stretch], damper: Damper, base: Explained
) -> Iterator[Trial]:
    """Every cause but samples that lie alone.

    Args:
        fitted: the fit.
        parts: the samples of its tests.
        damper: the damper, at the best fit to these samples.
        base: that fit.
    """
    yield from _distorted(fitted, parts, damper)
    yield from _two_dampers(fitted, parts, damper, base)


def _distorted(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[Trial]:
    def add(slug: str, distortion: of.Distortion, **numbers: object) -> Trial:
        return Trial(slug, explain(damper, parts, distortion).squares, len(distortion.start), numbers)

    starts = SKEWS_S if fitted.model.jumps_at == "reversal" else (0.0,)
    skewed = min((explain(damper, parts, of.Skew(start_s)) for start_s in starts), key=lambda reached: reached.squares)
    at_limit = bool(abs(skewed.amounts[0]) >= of.Skew.limits[1])
    yield Trial("skew", skewed.squares, 1, numbers_of("skew", skewed), at_limit=at_limit)
    for slug, trend in trends(fitted.tests):
        reached = explain(damper, parts, of.Trend(trend))
        yield Trial(slug, reached.squares, 2, numbers_of(slug, reached))
    yield from _drifting(fitted.tests, parts, damper)
    yield from _softened(fitted, parts, damper)
    yield from _clipped(fitted, parts, damper)
    yield from _compliant(parts, damper)
    tested = current_levels([
        test.current or CurrentReading(float(np.mean(test.current_A))) for test in fitted.tests
    ])  # fmt: skip
    levels = tested.values_A
    if len(levels) > 2:
        law = of.CurrentLaw(levels[0], levels[-1], min(len(levels) - 2, MOST_BENDS))
        yield add("current-law", law, currents=", ".join(f"{level:.3g}" for level in tested.names_A))
    top = max(float(np.max(np.abs(test.v_m_s))) for test in fitted.tests)
    most = max(float(np.max(np.abs(test.u_m))) for test in fitted.tests)
    powered = [value for number, value in enumerate(levels) if number != tested.zero]
    if powered and min(powered) < 0.0 < max(powered):
        unsigned = [
            replace(part, test=replace(part.test, current_A=np.abs(part.test.current_A))) for part in parts
        ]
        yield Trial("current-sign", explain(damper, unsigned, of.Distortion()).squares, 0, {})
    known = {"percent": near_reversals(fitted, parts), "untried": fitted.untried}
    yield add("missing-hysteresis", of.Added(of.after_reversal, parts), **known)
    yield add("speed-shape", of.Added(of.over_speed(top), parts), untried=fitted.untried)
    yield add("stroke-shape", of.Added(of.over_stroke(most), parts))


def near_reversals(fitted: Fitted, parts: Sequence[Stretch]) -> float:
    """Part (%) of the misfit within 1 mm after a reversal."""
    near = total = 0.0
    for part in parts:
        squares = (part.weights * left_N(fitted, part)) ** 2
        near, total = near + float(np.sum(squares[part.since_m < NEAR_REVERSAL_m])), total + float(np.sum(squares))
    return 100.0 * near / max(total, 1e-300)


def trends(tests: Sequence[Measurement]) -> Iterator[tuple[str, Callable[[Stretch], FloatArray]]]:
    """What force may follow: the time in each test, the campaign's, both as one, and a recorded temperature."""
    yield "force-drift", lambda part: part.time
    count = len(tests)
    if count > 2:
        yield "force-drift", lambda part: np.full(part.time.size, part.order)
        yield "force-drift", lambda part: part.order + part.time / count
    ends = _ends_degC(tests)
    if ends is not None:
        middle, span = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]

        def warmth(part: Stretch) -> FloatArray:
            recorded = part.test.temperature_degC
            return np.zeros(part.time.size) if recorded is None else np.asarray((recorded - middle) / span)

        yield "temperature", warmth


def _drifting(tests: Sequence[Measurement], parts: Sequence[Stretch], damper: Damper) -> Iterator[Trial]:
    """A drift in some of the tests, which the same drift in all does not show."""
    reached = explain(damper, parts, of.TrendPerTest(len(tests)))
    drifts = np.abs(reached.amounts)
    ids = [test.id for test, drift in zip(tests, drifts.tolist(), strict=True) if drift >= SMALLEST_DRIFT]
    if ids:
        numbers = {"tests": some(ids), "percent": 100.0 * float(reached.amounts[np.argmax(drifts)])}
        yield Trial("force-drift", reached.squares, _each(tests), numbers, "force-drift-some")


def _ends_degC(tests: Sequence[Measurement]) -> tuple[float, float] | None:
    """Lowest and highest recorded temperature (degC); None where a test has none, or they hardly differ."""
    known = [test.temperature_degC for test in tests if test.temperature_degC is not None]
    if len(known) < len(tests):
        return None
    low, high = (float(end([end(values) for values in known])) for end in (np.min, np.max))
    return (low, high) if high - low >= SMALLEST_TEMPERATURE_SPAN_K else None


def _softened(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[Trial]:
    """A recorded temperature that weakens viscous and yield forces, each at a rate of its own."""
    ends = _ends_degC(fitted.tests)
    if ends is not None:
        reached = explain(damper, parts, of.TemperatureEffect(damper.model, damper.start, 0.5 * (ends[0] + ends[1])))
        viscous, yielding = (100.0 * reached.amounts).tolist()
        numbers = {"viscous_percent_K": viscous, "yield_percent_K": yielding}
        yield Trial("temperature", reached.squares, 2, numbers, "temperature-rates")


def _clipped(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[Trial]:
    """The force channel's ends, the same in all tests or each test's own; first fitted without what is near them.

    A clipped force stays at the end within its noise. Where the measured force goes on changing beyond an end, there is
    none: the trial is repeated with the other end alone.
    """
    noise = {part.index: part.noise_N for part in parts}
    reach = [reached_N(test, noise[k]) for k, test in enumerate(fitted.tests)]
    own = [ends_N(test, noise[k]) for k, test in enumerate(fitted.tests)]
    own = [(min(end[0], least[0]), max(end[1], least[1])) for end, least in zip(own, reach, strict=True)]
    common = min(low for low, _ in own), max(high for _, high in own)
    whole = min(low for low, _ in reach), max(high for _, high in reach)
    for ends in ([common] * len(own), own):
        together, limits = ends is not own, whole
        reached, flat = _ended(parts, damper, ends, noise, limits if together else None)
        if not all(flat) and any(flat):
            ends = [(low if flat[0] else -NO_END_N, high if flat[1] else NO_END_N) for low, high in ends]
            limits = (whole[0] if flat[0] else -NO_END_N, whole[1] if flat[1] else NO_END_N)
            reached, flat = _ended(parts, damper, ends, noise, limits if together else None)
        if all(flat):
            low, high = reached.amounts.tolist() if together else common
            numbers, sentence = {"low_N": low, "high_N": high}, ""
            if len(ends_of := [end for end in (low, high) if abs(end) < NO_END_N]) == 1:
                numbers, sentence = {"end_N": ends_of[0]}, "clipping-one-end"
            yield Trial("clipping", reached.squares, 2 if together else 2 + _each(own), numbers, sentence)


def _ended(
    parts: Sequence[Stretch], damper: Damper, ends: Sequence[tuple[float, float]], noise: Mapping[int, float],
    limits: tuple[float, float] | None,
) -> tuple[Explained, tuple[bool, bool]]:
    """The damper behind a channel that ends (N), and whether the force is flat beyond the lower and the upper end.

    Args:
        parts: the samples.
        damper: the damper.
        ends: lowest and highest force of each test.
        noise: standard deviation of each test's noise (N).
        limits: of the ends that all tests have in common; None: each test's own, as they are.
    """
    inner = []
    for part in parts:
        outside = beyond(part.test, ends[part.index], noise[part.index])
        inner.append(replace(part, weights=np.where(outside, 0.0, part.weights)))
    start = explain(damper, inner, of.Distortion())
    channel = of.ClippingPerTest(ends) if limits is None else of.Clipped(*ends[0], limits)
    reached = explain(damper, parts, channel, start.values)
    left: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for part in parts:
        low_N, high_N = ends[part.index] if limits is None else reached.amounts.tolist()
        damper_N = modelled_force(damper.model, reached.values, part.test)
        flat_N = max(noise[part.index], FLAT_SHARE * float(np.ptp(part.test.force_N)))
        left[0].append(np.abs(part.test.force_N - low_N)[damper_N < low_N] / flat_N)
        left[1].append(np.abs(part.test.force_N - high_N)[damper_N > high_N] / flat_N)
    flat_low, flat_high = (side.size == 0 or float(np.median(side)) < 1.0 for side in map(np.concatenate, left))
    return reached, (flat_low, flat_high)


def _compliant(parts: Sequence[Stretch], damper: Damper) -> Iterator[Trial]:
    try:
        soft = ComplianceCorrection([part.test for part in parts])
    except IdentificationFailed:
        return  # a test whose cycles are unknown has no smooth force, and shows no compliance
    give = of.Compliance(soft.forces, parts, soft.largest_m_N)
    reached = explain(damper, parts, give)
    compliance = float(reached.amounts[0])
    if compliance > 0.0:
        yield Trial("series-compliance", reached.squares, 1, {"stiffness_N_m": 1.0 / compliance})


def _two_dampers(
    fitted: Fitted, parts: Sequence[Stretch], damper: Damper, base: Explained
) -> Iterator[Trial]:
    reached = two_groups(damper, base, parts)
    if reached is None or reached.predicted < WORTH_PARTING:
        return
    if not _parted_by_motion_or_warmth(fitted.tests, reached.second):
        minor = reached.second if 2 * np.count_nonzero(reached.second) <= reached.second.size else ~reached.second
        ids = [test.id for test, other in zip(fitted.tests, minor.tolist(), strict=True) if other]
        amounts = len(fitted.names) + _each(fitted.tests)  # another damper, and whose each test is
        yield Trial(MIXED, reached.squares, amounts, {"tests": some(ids)})


def _parted_by_motion_or_warmth(tests: Sequence[Measurement], second: BoolArray) -> bool:
    """Whether one part has all the larger strokes, all the faster tests, or all the warmer ones.

    What a model lacks over amplitude, speed or temperature parts the tests like that.
    """
    for sizes in ([np.ptp(test.u_m) for test in tests], [np.ptp(test.v_m_s) for test in tests]):
        if _all_above(np.log(np.array(sizes)), second, math.log(OTHER_AMPLITUDE)):
            return True
    if _ends_degC(tests) is None:
        return False
    means = [float(np.mean(test.temperature_degC)) for test in tests if test.temperature_degC is not None]
    return _all_above(np.array(means), second, SMALLEST_TEMPERATURE_SPAN_K)


def _all_above(values: FloatArray, second: BoolArray, by: float) -> bool:
    one, other = values[second], values[~second]
    return any(bool(np.min(large) > np.max(small) + by) for large, small in ((one, other), (other, one)))


def _each(tests: Sequence[object]) -> int:
    """Amounts that one for each test counts as: for each of many they explain no larger part than for each of some."""
    return min(len(tests), MOST_TESTS)


def numbers_of(slug: str, reached: Explained) -> dict[str, object]:
    """What is said of a delay or a trend, from the amounts that were reached."""
    if slug == "skew":
        return {"skew_ms": 1e3 * float(reached.amounts[0])}
    gain, zero_N = reached.amounts.tolist()
    return {"percent": 100.0 * gain, "zero_N": zero_N}


def left_N(fitted: Fitted, part: Stretch) -> FloatArray:
    """Measured force less the fit's (N), shape (n,)."""
    return residual_N(fitted.model, fitted.values, part, of.Distortion(), np.zeros(0))
