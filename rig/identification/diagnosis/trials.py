"""What may explain a misfit, one trial each: what is left where it is fitted together with the damper.

A new statement of this kind is a function and its `FromFit` in `FROM_FITS`, at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.errors import IdentificationFailed, some
from rig.fits.entries import Cause
from rig.identification.diagnosis import distortions as of
from rig.identification.diagnosis.descent import Damper, Explained, explain, residual_N
from rig.identification.diagnosis.force_channel import beyond, ends_N, reached_N
from rig.identification.diagnosis.groups import two_groups
from rig.identification.diagnosis.statement import Fitted, Statement
from rig.identification.diagnosis.stretches import Stretch
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.series_spring import ComplianceCorrection
from rig.signals.test_set import CurrentReading, current_levels

FEWEST_OF_LEVEL = 4  # tests at one level of current, from which on one of them may be in the wrong part
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


@dataclass(frozen=True)
class Start:
    """Where each trial starts: a fit, the samples of its tests, the damper at the best fit to these, and that fit."""

    fitted: Fitted
    parts: Sequence[Stretch]
    damper: Damper
    base: Explained


@dataclass(frozen=True)
class Trial:
    """One cause: what it leaves, how many amounts it has, what there is to say; by which part if not by its text.

    `at_limit`: its amount ended at the limit of its search, so it is no measurement of that amount.
    """

    statement: Statement
    squares: float
    amounts: int
    numbers: Mapping[str, object]
    part: str = ""
    at_limit: bool = False

    def cause(self, share: float) -> Cause:
        """The cause, which explains that share of the misfit (0 to 1)."""
        return self.statement.cause(share, self.part, **self.numbers, percent_explained=100.0 * share)


@dataclass(frozen=True, eq=False, kw_only=True)
class FromFit(Statement):
    """A statement that is made where its cause, fitted together with the damper, explains enough of the misfit.

    Attributes:
        find: its trials; none where these tests cannot show it.
    """

    find: Callable[[Start], Iterator[Trial]]


def trials(start: Start) -> Iterator[Trial]:
    """Every cause but samples that lie alone."""
    for statement in FROM_FITS:
        yield from statement.find(start)


def _trial(start: Start, statement: Statement, distortion: of.Distortion, **numbers: object) -> Trial:
    squares = explain(start.damper, start.parts, distortion).squares
    return Trial(statement, squares, len(distortion.start), numbers)


def _delayed(start: Start) -> Iterator[Trial]:
    starts = SKEWS_S if start.fitted.model.jumps_at == "reversal" else (0.0,)
    reached = (explain(start.damper, start.parts, of.Skew(start_s)) for start_s in starts)
    skewed = min(reached, key=lambda one: one.squares)
    at_limit = bool(abs(skewed.amounts[0]) >= of.Skew.limits[1])
    yield Trial(SKEW, skewed.squares, 1, numbers_of(SKEW, skewed), at_limit=at_limit)


def _following(start: Start, statement: Statement) -> Iterator[Trial]:
    for followed, trend in trends(start.fitted.tests):
        if followed is statement:
            reached = explain(start.damper, start.parts, of.Trend(trend))
            yield Trial(statement, reached.squares, 2, numbers_of(statement, reached))


def _other_law(start: Start) -> Iterator[Trial]:
    levels, names, _ = _tested(start.fitted.tests)
    if len(levels) > 2:
        law = of.CurrentLaw(levels[0], levels[-1], min(len(levels) - 2, MOST_BENDS))
        yield _trial(start, CURRENT_LAW, law, currents=", ".join(f"{level:.3g}" for level in names))


def _signless(start: Start) -> Iterator[Trial]:
    levels, _, zero = _tested(start.fitted.tests)
    powered = [value for number, value in enumerate(levels) if number != zero]
    if powered and min(powered) < 0.0 < max(powered):
        unsigned = [
            replace(part, test=replace(part.test, current_A=np.abs(part.test.current_A))) for part in start.parts
        ]
        yield Trial(CURRENT_SIGN, explain(start.damper, unsigned, of.Distortion()).squares, 0, {})


def _tested(tests: Sequence[Measurement]) -> tuple[Sequence[float], Sequence[float], int | None]:
    """Levels of the current (A), the same as they are named, and which of them is zero."""
    tested = current_levels([test.current or CurrentReading(float(np.mean(test.current_A))) for test in tests])
    return tested.values_A, tested.names_A, tested.zero


def _after_reversals(start: Start) -> Iterator[Trial]:
    numbers = {"percent": near_reversals(start.fitted, start.parts), "untried": start.fitted.untried}
    yield _trial(start, HYSTERESIS, of.Added(of.after_reversal, start.parts), **numbers)


def _over_speed(start: Start) -> Iterator[Trial]:
    top = max(float(np.max(np.abs(test.v_m_s))) for test in start.fitted.tests)
    yield _trial(start, SPEED_SHAPE, of.Added(of.over_speed(top), start.parts), untried=start.fitted.untried)


def _over_stroke(start: Start) -> Iterator[Trial]:
    most = max(float(np.max(np.abs(test.u_m))) for test in start.fitted.tests)
    yield _trial(start, STROKE_SHAPE, of.Added(of.over_stroke(most), start.parts))


def near_reversals(fitted: Fitted, parts: Sequence[Stretch]) -> float:
    """Part (%) of the misfit within 1 mm after a reversal."""
    near = total = 0.0
    for part in parts:
        squares = (part.weights * left_N(fitted, part)) ** 2
        near, total = near + float(np.sum(squares[part.since_m < NEAR_REVERSAL_m])), total + float(np.sum(squares))
    return 100.0 * near / max(total, 1e-300)


def trends(tests: Sequence[Measurement]) -> Iterator[tuple[Statement, Callable[[Stretch], FloatArray]]]:
    """What force may follow: the time in each test, the campaign's, both as one, and a recorded temperature."""
    yield FORCE_DRIFT, lambda part: part.time
    count = len(tests)
    if count > 2:
        yield FORCE_DRIFT, lambda part: np.full(part.time.size, part.order)
        yield FORCE_DRIFT, lambda part: part.order + part.time / count
    ends = _ends_degC(tests)
    if ends is not None:
        middle, span = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]

        def warmth(part: Stretch) -> FloatArray:
            recorded = part.test.temperature_degC
            return np.zeros(part.time.size) if recorded is None else np.asarray((recorded - middle) / span)

        yield TEMPERATURE, warmth


def _drifting(start: Start) -> Iterator[Trial]:
    """A drift in all tests, or in some of them, which the same drift in all does not show."""
    yield from _following(start, FORCE_DRIFT)
    tests = start.fitted.tests
    reached = explain(start.damper, start.parts, of.TrendPerTest(len(tests)))
    drifts = np.abs(reached.amounts)
    ids = [test.id for test, drift in zip(tests, drifts.tolist(), strict=True) if drift >= SMALLEST_DRIFT]
    if ids:
        numbers = {"tests": some(ids), "percent": 100.0 * float(reached.amounts[np.argmax(drifts)])}
        yield Trial(FORCE_DRIFT, reached.squares, _each(tests), numbers, "some")


def _ends_degC(tests: Sequence[Measurement]) -> tuple[float, float] | None:
    """Lowest and highest recorded temperature (degC); None where a test has none, or they hardly differ."""
    known = [test.temperature_degC for test in tests if test.temperature_degC is not None]
    if len(known) < len(tests):
        return None
    low, high = (float(end([end(values) for values in known])) for end in (np.min, np.max))
    return (low, high) if high - low >= SMALLEST_TEMPERATURE_SPAN_K else None


def _warmed(start: Start) -> Iterator[Trial]:
    """A force that follows a recorded temperature, or viscous and yield forces that weaken at a rate of their own."""
    yield from _following(start, TEMPERATURE)
    damper, parts, ends = start.damper, start.parts, _ends_degC(start.fitted.tests)
    if ends is not None:
        reached = explain(damper, parts, of.TemperatureEffect(damper.model, damper.start, 0.5 * (ends[0] + ends[1])))
        viscous, yielding = (100.0 * reached.amounts).tolist()
        numbers = {"viscous_percent_K": viscous, "yield_percent_K": yielding}
        yield Trial(TEMPERATURE, reached.squares, 2, numbers, "rates")


def _clipped(start: Start) -> Iterator[Trial]:
    """The force channel's ends, the same in all tests or each test's own; first fitted without what is near them.

    A clipped force stays at the end within its noise. Where the measured force goes on changing beyond an end, there is
    none: the trial is repeated with the other end alone.
    """
    tests, parts, damper = start.fitted.tests, start.parts, start.damper
    noise = {part.index: part.noise_N for part in parts}
    reach = [reached_N(test, noise[k]) for k, test in enumerate(tests)]
    own = [ends_N(test, noise[k]) for k, test in enumerate(tests)]
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
            numbers, side = {"low_N": low, "high_N": high}, ""
            if len(ends_of := [end for end in (low, high) if abs(end) < NO_END_N]) == 1:
                numbers, side = {"end_N": ends_of[0]}, "one-end"
            yield Trial(CLIPPING, reached.squares, 2 if together else 2 + _each(own), numbers, side)


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


def _compliant(start: Start) -> Iterator[Trial]:
    parts = start.parts
    try:
        soft = ComplianceCorrection([part.test for part in parts])
    except IdentificationFailed:
        return  # a test whose cycles are unknown has no smooth force, and shows no compliance
    give = of.Compliance(soft.forces, parts, soft.largest_m_N)
    reached = explain(start.damper, parts, give)
    compliance = float(reached.amounts[0])
    if compliance > 0.0:
        yield Trial(COMPLIANCE, reached.squares, 1, {"stiffness_N_m": 1.0 / compliance})


def _two_dampers(start: Start) -> Iterator[Trial]:
    fitted, reached = start.fitted, two_groups(start.damper, start.base, start.parts)
    if reached is None or reached.predicted < WORTH_PARTING:
        return
    if not (_parted_by_motion_or_warmth(fitted.tests, reached.second)
            or is_level_of_current(fitted.tests, reached.second)):  # fmt: skip
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


def is_level_of_current(tests: Sequence[Measurement], second: BoolArray) -> bool:
    """Whether one part is all tests at one level of current: what a model lacks there parts them like that.

    Where the level has `FEWEST_OF_LEVEL` tests or more, one test may be in the wrong part.
    """
    read = current_levels([test.current or CurrentReading(float(np.mean(test.current_A))) for test in tests])
    of_test = np.array([-1 if level is None else level for level in read.of_test])
    levels, counts = np.unique(of_test, return_counts=True)

    def parts(level: int, count: int) -> bool:
        wrong = int(np.count_nonzero((of_test == level) != second))
        return min(wrong, second.size - wrong) <= (1 if count >= FEWEST_OF_LEVEL else 0)

    return len(levels) > 1 and any(map(parts, levels.tolist(), counts.tolist()))


def _all_above(values: FloatArray, second: BoolArray, by: float) -> bool:
    one, other = values[second], values[~second]
    return any(bool(np.min(large) > np.max(small) + by) for large, small in ((one, other), (other, one)))


def _each(tests: Sequence[object]) -> int:
    """Amounts that one for each test counts as: for each of many they explain no larger part than for each of some."""
    return min(len(tests), MOST_TESTS)


def numbers_of(statement: Statement, reached: Explained) -> dict[str, object]:
    """What is said of a delay or a trend, from the amounts that were reached."""
    if statement is SKEW:
        return {"skew_ms": 1e3 * float(reached.amounts[0])}
    gain, zero_N = reached.amounts.tolist()
    return {"percent": 100.0 * gain, "zero_N": zero_N}


def left_N(fitted: Fitted, part: Stretch) -> FloatArray:
    """Measured force less the fit's (N), shape (n,)."""
    return residual_N(fitted.model, fitted.values, part, of.Distortion(), np.zeros(0))


SKEW = FromFit(
    "skew", find=_delayed,
    text=(
        "a delay of {skew_ms:+.3g} ms between the displacement and the force explains {percent_explained:.0f} % of the "
        "misfit"
    ),
    next=(
        "measure the delay between the two channels with a single sharp motion, or shift the force by this delay "
        "before the fit"
    ),
)  # fmt: skip
FORCE_DRIFT = FromFit(
    "force-drift", find=_drifting,
    text=(
        "a drift of the force channel over time, {percent:+.3g} % in gain and {zero_N:+.3g} N in zero from the start "
        "to the end of the tests, explains {percent_explained:.0f} % of the misfit"
    ),
    next=(
        "check the zero and gain of the load cell before and after the tests; warm up the amplifier and the damper, "
        "and repeat the first test at the end"
    ),
    parts={"some": (
        "a drift of the force channel within single tests ({tests}; largest {percent:+.3g} % in gain from start to "
        "end) explains {percent_explained:.0f} % of the misfit"
    )},
)  # fmt: skip
TEMPERATURE = FromFit(
    "temperature", find=_warmed,
    text=(
        "the effect of the recorded temperature, {percent:+.3g} % of the force and {zero_N:+.3g} N from the lowest to "
        "the highest temperature, explains {percent_explained:.0f} % of the misfit"
    ),
    next="fit with --temperature-law both, or keep the damper within a temperature window",
    parts={"rates": (
        "the recorded temperature, which reduces viscous forces by {viscous_percent_K:.2g} % and yield forces by "
        "{yield_percent_K:.2g} % per kelvin, explains {percent_explained:.0f} % of the misfit"
    )},
)  # fmt: skip
CLIPPING = FromFit(
    "clipping", find=_clipped,
    text=(
        "clipping of the force channel at {low_N:.4g} and {high_N:.4g} N explains {percent_explained:.0f} % of the "
        "misfit"
    ),
    next="use a larger range of the force channel, or reduce speed and current",
    parts={"one-end": (
        "clipping of the force channel at {end_N:.4g} N explains {percent_explained:.0f} % of the misfit"
    )},
)  # fmt: skip
COMPLIANCE = FromFit(
    "series-compliance", find=_compliant,
    text=(
        "a series spring of {stiffness_N_m:.3g} N/m (for example, compliant mounts) explains {percent_explained:.0f} % "
        "of the misfit"
    ),
    next="fit with --series-spring; measure the displacement at the damper itself",
)  # fmt: skip
CURRENT_LAW = FromFit(
    "current-law", find=_other_law,
    text=(
        "a current law other than the model's, over {currents} A, explains {percent_explained:.0f} % of the misfit: "
        "the force probably saturates"
    ),
    next="fit with --current-law saturating, or compare the laws with --current-law all",
)  # fmt: skip
CURRENT_SIGN = FromFit(
    "current-sign", find=_signless,
    text=(
        "the currents have both signs, but the force follows the magnitude of the current, which explains "
        "{percent_explained:.0f} % of the misfit"
    ),
    next="enter all currents as positive values: the direction of the magnetic field does not affect the yield force",
)  # fmt: skip
HYSTERESIS = FromFit(
    "missing-hysteresis", find=_after_reversals,
    text=(
        "a force that depends on the travel after each reversal, which the model does not include, explains "
        "{percent_explained:.0f} % of the misfit; {percent:.0f} % of the misfit is within 1 mm after a reversal"
    ),
    next="{untried}run slow triangle tests with several amplitudes, which show the force after a reversal",
)  # fmt: skip
SPEED_SHAPE = FromFit(
    "speed-shape", find=_over_speed,
    text="a force-velocity shape other than the model's explains {percent_explained:.0f} % of the misfit",
    next="{untried}run sine tests at the same frequency with more amplitudes",
)  # fmt: skip
STROKE_SHAPE = FromFit(
    "stroke-shape", find=_over_stroke,
    text=(
        "a force-displacement shape other than the model's, such as end stops or progressive gas stiffness, explains "
        "{percent_explained:.0f} % of the misfit"
    ),
    next="run tests with smaller amplitudes at more positions along the stroke",
)  # fmt: skip
MIXED = FromFit(
    "mixed-specimens", find=_two_dampers,
    text=(
        "two dampers instead of one explain {percent_explained:.0f} % of the misfit; tests of the second damper: "
        "{tests}"
    ),
    next="check which damper was mounted, and identify the tests of each damper separately",
)  # fmt: skip

FROM_FITS = (
    SKEW, FORCE_DRIFT, TEMPERATURE, CLIPPING, COMPLIANCE, CURRENT_LAW, CURRENT_SIGN, HYSTERESIS,
    SPEED_SHAPE, STROKE_SHAPE, MIXED,
)  # fmt: skip
"""In the order in which they are tried; they are listed by what they explain."""
