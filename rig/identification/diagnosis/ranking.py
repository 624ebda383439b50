"""The causes of a misfit in the order of what they explain.

Each is fitted together with the damper. Its score is the logarithm of the sum of squares that it leaves, over that of
the noise, and a little for each amount it needs, so that of two that explain the same the simpler one is named. The
share that it explains is of what the fit leaves beyond the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.diagnosis import distortions as of
from rig.identification.diagnosis.descent import Damper, Explained, explain, first_step, residual_N
from rig.identification.diagnosis.force_channel import beyond, ends_N, outliers
from rig.identification.diagnosis.groups import two_groups
from rig.identification.diagnosis.plausibility import OFFSET, SIGNS, implausible, law_from_two_currents, mended
from rig.identification.diagnosis.stretches import Stretch, stretches
from rig.identification.models.measurement import Measurement
from rig.identification.models.projection import Weighting
from rig.identification.series_spring import Softened
from rig.identification.uncertainty.fit_entries import Cause
from rig.identification.words import say, some
from rig.signals.plausibility import Doubt

AN_AMOUNT = 0.02  # of the logarithm of what is left, that each amount of a cause must be worth
WORTH_NAMING = 0.15  # share of the misfit from which a cause is listed
WORTH_PARTING = 0.5  # the same of two dampers, of the fitted tests at most and of tests left out
MISFIT_OF_NOISE = 0.02  # of the noise's sum of squares: less than this is no misfit
SAME_CURRENT_A = 0.05
MOST_BENDS = 3
OTHER_AMPLITUDE = 1.2  # smallest stroke or speed of some tests over the largest of the others, from which they differ
SKEWS_S = (0.0, 1e-3, 3e-3, -1e-3, -3e-3)  # to start from where a model jumps at the reversals, which show the skew
SMALLEST_SKEW_S, SKEW_ERRORS = 2e-4, 3.0  # a delay that is worth a word: so long, and so many of its stated errors
BEYOND_DOUBT = 10.0  # standard errors of white noise; noise of a filtered channel has a few times those
SMALLEST_DRIFT = 0.05  # of the force, over all that it follows, which is worth a word in an adequate fit
SMALLEST_TEMPERATURE_SPAN_K = 1.0
NEAR_REVERSAL_m = 1e-3
MENDED = 0.25  # of the squares that are missed, below which a unit is likelier than the one that was given
SLOW = 0.1  # of the greatest speed
MIXED, UNEXPLAINED = "mixed-specimens", "unexplained"


@dataclass(frozen=True)
class Fitted:
    """What is diagnosed: a model, its values (SI), the names of those that were fitted, its tests and their weights."""

    model: DamperModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    tests: Sequence[Measurement]
    weighting: Weighting


@dataclass(frozen=True)
class _Trial:
    """One cause: what it leaves, how many amounts it has, what there is to say; by which sentence if not its own."""

    slug: str
    squares: float
    amounts: int
    numbers: Mapping[str, object]
    sentence: str = ""


def diagnose(fitted: Fitted, *, misfit: bool = True) -> tuple[Cause, ...]:
    """What probably explains the misfit of a fit, most first.

    Wrong units come alone, reversed signs before the others, an offset of the force after them.

    Args:
        fitted: the fit.
        misfit: whether to look for causes of misfit; units, signs and a current law drawn from two currents are looked
            at in any case.
    """
    wrong = implausible(fitted.tests, partial(_likelier_mended, fitted))
    if any(cause.slug not in {SIGNS, OFFSET} for cause in wrong):
        return tuple(wrong)
    causes = [*(cause for cause in wrong if cause.slug == SIGNS), *_saturated(fitted.tests)]
    causes += _of_misfit(fitted) if misfit else _hidden(fitted)
    causes += law_from_two_currents(fitted.model, fitted.values, fitted.tests)
    return (*causes, *(cause for cause in wrong if cause.slug == OFFSET))


def _likelier_mended(fitted: Fitted, doubt: Doubt, ids: Sequence[str]) -> bool:
    """Whether a fit of the other tests foretells these with their unit mended, each in shares of its own force."""
    parts = stretches(fitted.model, fitted.tests, fitted.weighting)
    apart = [part for part in parts if part.test.id in ids]
    others = [part for part in parts if part.test.id not in ids]
    if not others:
        return False
    reached = explain(Damper(fitted.model, fitted.values, fitted.names), others, of.Distortion())

    def left(part: Stretch) -> float:
        missed_N = residual_N(fitted.model, reached.values, part, of.Distortion(), np.zeros(0))
        force_N = part.test.force_N - np.mean(part.test.force_N)
        return float(np.sum(missed_N**2)) / max(float(np.sum(force_N**2)), 1e-300)

    as_they_are = [left(part) for part in apart]
    changed = [left(replace(part, test=mended(part.test, doubt))) for part in apart]
    return float(np.median(changed)) < MENDED * float(np.median(as_they_are))


def _saturated(tests: Sequence[Measurement]) -> list[Cause]:
    """What the preparation took out already."""
    ids = [test.id for test in tests if any(warning.slug == "saturated-force" for warning in test.warnings)]
    return [Cause("clipping", say("clipping-left-out", tests=some(ids)), 1.0, say("next-clipping"))] if ids else []


def _hidden(fitted: Fitted) -> list[Cause]:
    """A delay or a drift that the tests show beyond doubt though what it leaves is within their scatter.

    A drift from cycle to cycle is part of a scatter that two cycles show, and of none where a test has a single one.
    """
    model, tests = fitted.model, fitted.tests
    parts = stretches(model, tests, fitted.weighting)
    floor, damper = sum(part.floor for part in parts), Damper(model, fitted.values, fitted.names)
    left = sum(float(np.sum((part.weights * _residual_N(fitted, part)) ** 2)) for part in parts)
    count = sum(int(np.count_nonzero(part.weights)) for part in parts)
    least_s = max(SMALLEST_SKEW_S, SKEW_ERRORS * max(test.skew_std_s for test in tests))
    looked_for: list[tuple[str, of.Distortion, float]] = [("skew", of.Skew(), least_s)]
    looked_for += [(slug, of.Trend(trend), SMALLEST_DRIFT) for slug, trend in _trends(tests)]
    trials = []
    for slug, distortion, least in looked_for:
        step = first_step(damper, parts, distortion)
        if floor > 0.0 and abs(step.amounts[0]) >= least and step.gain * count >= BEYOND_DOUBT**2 * max(floor, left):
            reached = explain(damper, parts, distortion)
            trials.append(_Trial(slug, reached.squares, len(distortion.start), _numbers(slug, reached)))
    if not trials:
        return []
    base = explain(damper, parts, of.Distortion())
    best = min(trials, key=lambda trial: _score(trial, floor))
    gain = base.squares - best.squares
    share = min(1.0, gain / max(base.squares - floor, gain)) if gain > 0.0 else 0.0
    return [_cause(best, share)] if share >= WORTH_NAMING else []


def _numbers(slug: str, reached: Explained) -> dict[str, object]:
    """What is said of a delay or a trend."""
    if slug == "skew":
        return {"skew_ms": 1e3 * float(reached.amounts[0])}
    gain, zero_N = reached.amounts.tolist()
    return {"percent": 100.0 * gain, "zero_N": zero_N}


def _cause(trial: _Trial, share: float) -> Cause:
    text = say(trial.sentence or trial.slug, **trial.numbers, percent_explained=100.0 * share)
    return Cause(trial.slug, text, share, say(f"next-{trial.slug}", **trial.numbers))


def _residual_N(fitted: Fitted, part: Stretch) -> FloatArray:
    return residual_N(fitted.model, fitted.values, part, of.Distortion(), np.zeros(0))


def _of_misfit(fitted: Fitted) -> list[Cause]:
    model, tests, weighting = fitted.model, fitted.tests, fitted.weighting
    alone = outliers(model, fitted.values, tests, weighting)
    everything = stretches(model, tests, weighting)
    floor = sum(part.floor for part in everything)
    count = sum(int(np.count_nonzero(one)) for one in alone)
    damper = Damper(model, fitted.values, fitted.names)
    parts = stretches(model, tests, weighting, alone) if count else everything
    base = explain(damper, parts, of.Distortion())
    whole = explain(damper, everything, of.Distortion()) if count else base
    if whole.squares - floor < MISFIT_OF_NOISE * floor:
        return []
    excess = whole.squares - floor
    far = whole.squares - base.squares  # of samples that lie alone, which only their own cause explains
    damper = Damper(model, base.values, fitted.names)
    trials = [
        replace(trial, squares=trial.squares + far)
        for trial in (*_distorted(fitted, parts, damper), *_two_dampers(fitted, parts, damper, base))
    ]
    if count:
        percent = 100.0 * count / sum(test.u_m.size for test in tests)
        trials.append(_Trial("outliers", base.squares, 1, {"count": count, "percent": percent}))
    causes: list[Cause] = []
    for trial in sorted(trials, key=lambda trial: _score(trial, floor)):
        share = min(1.0, max(0.0, (whole.squares - trial.squares) / excess))
        if share >= _least_share(trial) and trial.slug not in {cause.slug for cause in causes}:
            causes.append(_cause(trial, share))
    return causes or ([_unexplained(fitted, everything)] if excess > floor else [])


def _unexplained(fitted: Fitted, parts: Sequence[Stretch]) -> Cause:
    """Where a misfit lies that no cause explains."""
    top_m_s = max(float(np.max(np.abs(part.test.v_m_s))) for part in parts)
    whole, by_test = 0.0, np.zeros(len(fitted.tests))
    near = slow = 0.0
    for part in parts:
        squares = (part.weights * _residual_N(fitted, part)) ** 2
        whole, near = whole + float(np.sum(squares)), near + float(np.sum(squares[part.since_m < NEAR_REVERSAL_m]))
        slow += float(np.sum(squares[np.abs(part.test.v_m_s) < SLOW * top_m_s]))
        by_test[part.index] += float(np.sum(squares))
    worst = int(np.argmax(by_test))
    shares = {"near": near, "slow": slow, "of_worst": float(by_test[worst])}
    numbers: dict[str, object] = {name: 100.0 * share / max(whole, 1e-300) for name, share in shares.items()}
    numbers |= {"worst": fitted.tests[worst].id, "count": by_test.size, "least": 100.0 * WORTH_NAMING}
    return Cause(UNEXPLAINED, say(UNEXPLAINED, **numbers), 0.0, say(f"next-{UNEXPLAINED}", **numbers))


def _least_share(trial: _Trial) -> float:
    """Share of the misfit from which a cause is listed: many amounts explain some of it whatever they stand for."""
    share = max(WORTH_NAMING, 1.0 - math.exp(-AN_AMOUNT * trial.amounts))
    return min(WORTH_PARTING, share) if trial.slug == MIXED else share


def _score(trial: _Trial, floor: float) -> float:
    return math.log(max(trial.squares / max(floor, 1e-300), 0.5)) + AN_AMOUNT * trial.amounts


def _distorted(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[_Trial]:
    def add(slug: str, distortion: of.Distortion, **numbers: object) -> _Trial:
        return _Trial(slug, explain(damper, parts, distortion).squares, len(distortion.start), numbers)

    starts = SKEWS_S if fitted.model.jumps_at == "reversal" else (0.0,)
    skewed = min((explain(damper, parts, of.Skew(start_s)) for start_s in starts), key=lambda reached: reached.squares)
    yield _Trial("skew", skewed.squares, 1, _numbers("skew", skewed))
    for slug, trend in _trends(fitted.tests):
        reached = explain(damper, parts, of.Trend(trend))
        yield _Trial(slug, reached.squares, 2, _numbers(slug, reached))
    yield from _drifting(fitted.tests, parts, damper)
    yield from _softened(fitted, parts, damper)
    yield from _clipped(fitted, parts, damper)
    yield from _compliant(parts, damper)
    levels = _levels(fitted.tests)
    if len(levels) > 2:
        law = of.CurrentLaw(levels[0], levels[-1], min(len(levels) - 2, MOST_BENDS))
        yield add("current-law", law, currents=", ".join(f"{level:.3g}" for level in levels))
    top = max(float(np.max(np.abs(test.v_m_s))) for test in fitted.tests)
    most = max(float(np.max(np.abs(test.u_m))) for test in fitted.tests)
    if levels[0] < -SAME_CURRENT_A and levels[-1] > SAME_CURRENT_A:
        unsigned = [
            replace(part, test=replace(part.test, current_A=np.abs(part.test.current_A))) for part in parts
        ]
        yield _Trial("current-sign", explain(damper, unsigned, of.Distortion()).squares, 0, {})
    yield add("missing-hysteresis", of.Added(of.after_reversal, parts), percent=_near_reversals(fitted, parts))
    yield add("speed-shape", of.Added(of.over_speed(top), parts))
    yield add("stroke-shape", of.Added(of.over_stroke(most), parts))


def _near_reversals(fitted: Fitted, parts: Sequence[Stretch]) -> float:
    """Part (%) of the misfit within 1 mm after a reversal."""
    near = total = 0.0
    for part in parts:
        squares = (part.weights * _residual_N(fitted, part)) ** 2
        near, total = near + float(np.sum(squares[part.since_m < NEAR_REVERSAL_m])), total + float(np.sum(squares))
    return 100.0 * near / max(total, 1e-300)


def _trends(tests: Sequence[Measurement]) -> Iterator[tuple[str, Callable[[Stretch], FloatArray]]]:
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


def _drifting(tests: Sequence[Measurement], parts: Sequence[Stretch], damper: Damper) -> Iterator[_Trial]:
    """A drift in some of the tests, which the same drift in all does not show."""
    reached = explain(damper, parts, of.TrendApart(len(tests)))
    drifts = np.abs(reached.amounts)
    ids = [test.id for test, drift in zip(tests, drifts.tolist(), strict=True) if drift >= SMALLEST_DRIFT]
    if ids:
        numbers = {"tests": some(ids), "percent": 100.0 * float(reached.amounts[np.argmax(drifts)])}
        yield _Trial("force-drift", reached.squares, len(tests), numbers, "force-drift-some")


def _ends_degC(tests: Sequence[Measurement]) -> tuple[float, float] | None:
    """Lowest and highest recorded temperature (degC); None where a test has none, or they hardly differ."""
    known = [test.temperature_degC for test in tests if test.temperature_degC is not None]
    if len(known) < len(tests):
        return None
    low, high = (float(end([end(values) for values in known])) for end in (np.min, np.max))
    return (low, high) if high - low >= SMALLEST_TEMPERATURE_SPAN_K else None


def _softened(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[_Trial]:
    """A recorded temperature that weakens viscous and yield forces, each at a rate of its own."""
    ends = _ends_degC(fitted.tests)
    if ends is not None:
        reached = explain(damper, parts, of.Softened(damper.model, damper.start, 0.5 * (ends[0] + ends[1])))
        viscous, yielding = (100.0 * reached.amounts).tolist()
        numbers = {"viscous_percent_K": viscous, "yield_percent_K": yielding}
        yield _Trial("temperature", reached.squares, 2, numbers, "temperature-rates")


def _clipped(fitted: Fitted, parts: Sequence[Stretch], damper: Damper) -> Iterator[_Trial]:
    """The force channel's ends, the same in all tests or each test's own; first fitted without what is near them."""
    noise = {part.index: part.noise_N for part in parts}
    own = [ends_N(test, noise[k]) for k, test in enumerate(fitted.tests)]
    common = min(low for low, _ in own), max(high for _, high in own)
    for ends in ([common] * len(own), own):
        inner = []
        for part in parts:
            outside = beyond(part.test, ends[part.index], noise[part.index])
            inner.append(replace(part, weights=np.where(outside, 0.0, part.weights)))
        start = explain(damper, inner, of.Distortion())
        together = ends is not own
        channel = of.Clipped(*common) if together else of.ClippedApart(own)
        reached = explain(damper, parts, channel, start.values)
        low, high = reached.amounts.tolist() if together else common
        yield _Trial("clipping", reached.squares, 2 if together else 2 + len(own), {"low_N": low, "high_N": high})


def _compliant(parts: Sequence[Stretch], damper: Damper) -> Iterator[_Trial]:
    try:
        soft = Softened([part.test for part in parts])
    except IdentificationFailed:
        return  # a test whose cycles are unknown has no smooth force, and shows no compliance
    give = of.Compliance(soft.forces, parts, soft.largest_m_N)
    reached = explain(damper, parts, give)
    compliance = float(reached.amounts[0])
    if compliance > 0.0:
        yield _Trial("series-compliance", reached.squares, 1, {"stiffness_N_m": 1.0 / compliance})


def _two_dampers(
    fitted: Fitted, parts: Sequence[Stretch], damper: Damper, base: Explained
) -> Iterator[_Trial]:
    reached = two_groups(damper, base, parts)
    if reached is None or reached.foretold < WORTH_PARTING:
        return
    if not _parted_by_motion_or_warmth(fitted.tests, reached.second):
        minor = reached.second if 2 * np.count_nonzero(reached.second) <= reached.second.size else ~reached.second
        ids = [test.id for test, other in zip(fitted.tests, minor.tolist(), strict=True) if other]
        amounts = len(fitted.names) + len(fitted.tests)  # another damper, and whose each test is
        yield _Trial(MIXED, reached.squares, amounts, {"tests": some(ids)})


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


def _levels(tests: Sequence[Measurement]) -> list[float]:
    """Different currents (A), rising."""
    levels: list[float] = []
    for current in sorted(float(np.mean(test.current_A)) for test in tests):
        if not levels or current > levels[-1] + SAME_CURRENT_A:
            levels.append(current)
    return levels


