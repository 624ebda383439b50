"""Tests as a whole: are sizes and signs those of a damper, and is the current law one that two currents can show?

A new statement of this kind is a function and its `FromTests` in `FROM_TESTS`, at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.errors import some
from rig.fits.entries import Cause
from rig.identification.diagnosis.statement import Fitted, Statement
from rig.identification.diagnosis.trials import CLIPPING, CURRENT_LAW
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.undetermined import levels_of
from rig.identification.remarks import filled
from rig.identification.uncertainty.covariance import quantile
from rig.signals.plausibility import SMALLEST_CURRENT_A, Doubt, TestSize, doubts

CHANNEL = {
    "units-time": "cycle_s", "units-displacement": "span_m", "units-force": "force_N", "units-current": "current_A",
}  # fmt: skip
"""Which of a test's sizes (SI) a doubt is about."""
OTHER_TESTS = 30.0  # times the largest of the others, or part of the smallest, within which a corrected test agrees
SAME_RATE = (0.5, 2.0)  # of the displacement's rate over the velocity given, between which one belongs to the other
NEAR_MIDDLE = 0.3  # of the amplitude
OFFSET_OF_PEAK = 0.01  # by which the force must be off towards extension to be no gas force
CLEAR_OF_PEAK = 0.03  # the same where rebound is not the weaker one, which speaks for signs that are right
WEAKER_REBOUND = 0.01  # of the peak, by which rebound must be the weaker one at speed to speak for reversed signs
LARGEST_ZERO = 0.3  # of the greatest peak: an offset beyond is seldom a zero or a preload, whatever rebound does
SAME_SPEED = 1e-3  # of the largest singular value, below which speeds are one
ZERO_ERRORS = 3.0  # stated standard deviations of the force's zero
ZERO_CURRENT_ERRORS = 10.0  # standard errors, up to which the small currents of tests are an offset
AT_ZERO = 0.25  # of the yield force at the top current: more at 0 A is seldom friction alone
CURRENTS_OF_A_LINE = 2
LOWEST_OF_TOP = 0.1  # least current over the greatest, below which zero current was as good as tested

UNITS = {
    one.slug: one for one in (
        Statement(
            "units-time",
            text=(
                "a cycle lasts {value:.3g} {unit}, which is implausible for a damper test: the time is probably in "
                "{likely}"
            ),
            next="multiply the time by {factor:g}, or specify its unit on import (--column time=NAME:ms)",
        ),
        Statement(
            "units-displacement",
            text=(
                "the displacement spans {value:.3g} {unit}, which is implausible for a damper test: the values are "
                "probably in {likely}"
            ),
            next=(
                "multiply the displacement by {factor:g}, or specify its unit on import (--column displacement=NAME:mm)"
            ),
        ),
        Statement(
            "units-force",
            text=(
                "the largest force is {value:.3g} {unit}, which is implausible for a damper test: the values are "
                "probably in {likely}"
            ),
            next="multiply the force by {factor:g}, or specify its unit on import (--column force=NAME:kN)",
        ),
        Statement(
            "units-current",
            text=(
                "the largest current is {value:.3g} {unit}, which is implausible for a coil: the values are probably "
                "in {likely}"
            ),
            next="multiply the current by {factor:g}, or specify its unit on import (--column current=NAME:mA)",
        ),
    )
}  # fmt: skip
OF_SOME = "in {tests} only: {what}"
VELOCITY = Statement(
    "units-velocity",
    text=(
        "the rate of the displacement is {ratio:.3g} times the given velocity: one of the two, or the sampling "
        "interval, is in the wrong unit"
    ),
    next="provide displacement in m, velocity in m/s, acceleration in m/s^2 and the interval in s",
)  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class FromTests(Statement):
    """A statement about sizes, signs and currents, without a fit with its cause.

    Attributes:
        find: its causes, given the fit without the tests that are inconsistent with the others, and all tests; none
            for good tests.
        of_misfit: whether it is only looked for where the model does not fit.
        last: whether it is listed behind the causes that explain a misfit, not before them.
    """

    find: Callable[[Fitted, Sequence[Measurement]], Iterator[Cause]]
    of_misfit: bool = False
    last: bool = False


def units(tests: Sequence[Measurement], likelier: Callable[[Doubt, Sequence[str]], bool]) -> list[Cause]:
    """Units that are probably wrong, likeliest first; empty where all is as in a damper's test.

    Args:
        tests: all that were fitted.
        likelier: whether tests of these ids fit the others better with a corrected unit. A size alone does not tell of
            a few tests: among strokes of 60 mm one of 0.4 mm in a second may be meant, or a cycle of 250 s.
    """
    apart = {slug: (doubt, ids) for slug, (doubt, ids) in _of_some(tests).items() if likelier(doubt, ids)}
    causes = [
        *(_wrong_unit(doubt, apart.pop(doubt.slug, (doubt, []))[1]) for doubt in doubts(_size(tests))),
        *(_wrong_unit(doubt, ids) for doubt, ids in apart.values()),
    ]
    return causes or _rates(tests)


def _size(tests: Sequence[Measurement]) -> TestSize:
    return TestSize(
        span_m=max(float(np.ptp(test.u_m)) for test in tests),
        speed_m_s=max(float(np.max(np.abs(test.v_m_s))) for test in tests),
        force_N=max(test.peak_force_N for test in tests),
        current_A=_greatest_current_A(tests),
        cycle_s=float(np.median([samples_a_cycle(test.u_m) * test.dt_s for test in tests])),
    )


def _greatest_current_A(tests: Sequence[Measurement]) -> float:
    """Greatest current (A); 0 where it is small and the same in all tests: what is measured without any."""
    greatest_A = max(float(np.max(np.abs(test.current_A))) for test in tests)
    means = [float(np.mean(test.current_A)) for test in tests]
    error_A = ZERO_CURRENT_ERRORS * max(test.current_std_A for test in tests)
    without = max(means) - min(means) <= max(0.5 * greatest_A, error_A)
    without = without or all(test.nominal_current_A == 0.0 for test in tests)
    return 0.0 if without and greatest_A < SMALLEST_CURRENT_A else greatest_A


def _of_some(tests: Sequence[Measurement]) -> dict[str, tuple[Doubt, list[str]]]:
    """Units of some tests only, by slug: their numbers times the factor are of the size of the others'.

    A small current is none of them: at 0 A one is measured.
    """
    by_slug: dict[str, tuple[Doubt, list[str]]] = {}
    sizes = [_size([test]) for test in tests]
    doubted = [{doubt.slug: doubt for doubt in doubts(size)} for size in sizes]
    for slug, field in CHANNEL.items():
        others = [getattr(size, field) for size, of_test in zip(sizes, doubted, strict=True) if slug not in of_test]
        if not others:
            continue
        for test, size, of_test in zip(tests, sizes, doubted, strict=True):
            doubt = of_test.get(slug)
            if doubt is None or (slug == "units-current" and doubt.factor > 1.0):
                continue
            if min(others) / OTHER_TESTS <= doubt.factor * getattr(size, field) <= max(others) * OTHER_TESTS:
                by_slug.setdefault(slug, (doubt, []))[1].append(test.id)
    return by_slug


def corrected(test: Measurement, doubt: Doubt) -> Measurement:
    """The test with its numbers in the unit that they probably are in."""
    factor = doubt.factor
    if doubt.slug == "units-time":
        timed = test.moved(test.u_m, test.v_m_s / factor, test.a_m_s2 / factor**2)
        return replace(timed, dt_s=test.dt_s * factor)
    if doubt.slug == "units-displacement":
        return test.moved(test.u_m * factor, test.v_m_s * factor, test.a_m_s2 * factor)
    name = CHANNEL[doubt.slug]
    return replace(test, **{name: factor * getattr(test, name)})


def _wrong_unit(doubt: Doubt, ids: Sequence[str]) -> Cause:
    """Of all tests, or of those with these ids."""
    numbers = {"value": doubt.value, "unit": doubt.taken_as, "likely": doubt.likely, "factor": doubt.factor}
    cause = UNITS[doubt.slug].cause(1.0, "", **numbers)
    return replace(cause, text=filled(doubt.slug, OF_SOME, {"what": cause.text, "tests": some(ids)})) if ids else cause


def _rates(tests: Sequence[Measurement]) -> list[Cause]:
    """Is the velocity that of the displacement?"""
    ratios = []
    for test in tests:
        given = float(np.std(test.v_m_s))
        ratios.append(float(np.std(np.gradient(test.u_m, test.dt_s))) / given if given > 0.0 else np.nan)
    ratio = float(np.nanmedian(ratios)) if np.any(np.isfinite(ratios)) else 1.0
    return [] if SAME_RATE[0] < ratio < SAME_RATE[1] else [VELOCITY.cause(1.0, ratio=ratio)]


def _middle(fitted: Fitted) -> tuple[Statement, float] | None:
    """Is the force's middle where gas puts it? Gas pushes a rod out, so the middle is negative; else what it is (N).

    Where it is positive, both signs are reversed or not. Dampers resist rebound more than jounce: where rebound is the
    weaker one too, the signs are reversed. Else it is an offset, a preload or a load cell's zero, unless it is larger
    than those are beside a powered damper's force; without current friction is all there is to compare. Both must be
    clear beyond what the tests differ by.
    """
    tests, measured = fitted.tests, _middle_N(fitted.tests)
    if measured is None:
        return None
    offset_N, growth_N, offset_doubt_N, growth_doubt_N = measured
    peaks_N = [test.peak_force_N for test in tests]
    peak_N, top_N = float(np.median(peaks_N)), max(peaks_N)
    least_N = ZERO_ERRORS * max(test.force_zero_std_N for test in tests)
    clear = CLEAR_OF_PEAK if growth_N > 0.0 else OFFSET_OF_PEAK
    if offset_N <= max(clear * peak_N, least_N):
        return None
    levels = levels_of(tests)
    powered = len(levels) > 1 or levels.zero is None
    weaker = growth_N < -max(WEAKER_REBOUND * peak_N, growth_doubt_N)
    reversed_ = weaker or (powered and offset_N - offset_doubt_N > LARGEST_ZERO * top_N)
    return (SIGNS if reversed_ else OFFSET), offset_N


def reversed_signs(fitted: Fitted, all_tests: Sequence[Measurement]) -> Iterator[Cause]:
    """The force's middle is where gas does not put it, and rebound the weaker direction, or the middle far off."""
    del all_tests
    doubt = _middle(fitted)
    if doubt is not None and doubt[0] is SIGNS:
        yield SIGNS.cause(0.0, offset_N=doubt[1])


def offset(fitted: Fitted, all_tests: Sequence[Measurement]) -> Iterator[Cause]:
    """The force's middle is where gas does not put it, and nothing else speaks for reversed signs."""
    del all_tests
    doubt = _middle(fitted)
    if doubt is not None and doubt[0] is OFFSET:
        yield OFFSET.cause(0.0, offset_N=doubt[1])


def _middle_N(tests: Sequence[Measurement]) -> tuple[float, float, float, float] | None:
    """The force's middle at standstill, by how much rebound is stronger than jounce at speed, and 95 % of each (N)."""
    rows, middles = [], []
    for test in tests:
        near = test.scored & (np.abs(test.u_m - np.mean(test.u_m)) < NEAR_MIDDLE * 0.5 * float(np.ptp(test.u_m)))
        out, into = near & (test.v_m_s > 0.0), near & (test.v_m_s < 0.0)
        if not (np.any(out) and np.any(into)):
            continue
        middles.append(0.5 * (float(np.mean(test.force_N[out])) + float(np.mean(test.force_N[into]))))
        speed = float(np.mean(np.abs(test.v_m_s[near])))
        rows.append((1.0, speed, speed * float(np.mean(test.current_A))))
    if not rows:
        return None
    table = np.array(rows)
    amounts, _, rank, _ = np.linalg.lstsq(table, np.array(middles), rcond=SAME_SPEED)
    at_speed = np.array((0.0, *np.median(table[:, 1:], axis=0)))
    freedom, inverse = len(rows) - int(rank), np.linalg.pinv(table.T @ table, rcond=SAME_SPEED**2)
    offset_N, growth_N = float(amounts[0]), float(at_speed @ amounts)
    if not freedom or rank == 1:  # a line through two tests, or one speed: nothing tells the growth from the offset
        return offset_N, growth_N, np.inf, np.inf
    doubt_N = quantile(1, freedom) * float(np.linalg.norm(table @ amounts - middles)) / np.sqrt(freedom)
    growth_doubt_N = doubt_N * float(np.sqrt(at_speed @ inverse @ at_speed))
    return offset_N, growth_N, doubt_N * float(np.sqrt(inverse[0, 0])), growth_doubt_N


def saturated(fitted: Fitted, all_tests: Sequence[Measurement]) -> Iterator[Cause]:
    """What the preparation took out already, of any test."""
    del fitted
    ids = [test.id for test in all_tests if any(warning.slug == "saturated-force" for warning in test.warnings)]
    if ids:
        yield SATURATED.cause(1.0, tests=some(ids))


def law_from_two_currents(fitted: Fitted, all_tests: Sequence[Measurement]) -> Iterator[Cause]:
    """A law drawn through two currents that leaves much of the force at zero current, where nothing was measured."""
    del all_tests
    model, values, tests = fitted.model, fitted.values, fitted.tests
    levels = levels_of(tests)
    if len(levels) != CURRENTS_OF_A_LINE or levels.values_A[0] < LOWEST_OF_TOP * levels.values_A[1]:
        return
    low_A, top_A = levels.values_A
    top_speed = max(float(np.max(np.abs(test.v_m_s))) for test in tests)
    complete = {**values, "eta": 1.0} if "eta" in model.names else dict(values)
    halves = [
        0.5 * (model.force_at(complete, v, at_A) - model.force_at(complete, -v, at_A))
        for v in (top_speed, 0.5 * top_speed)
        for at_A in (0.0, top_A)
    ]
    zero_N, top_N = (float(2.0 * halves[k + 2] - halves[k]) for k in (0, 1))
    if top_N > 0.0 and zero_N >= AT_ZERO * top_N:
        yield LAW_OF_TWO.cause(0.0, low_A=low_A, top_A=top_A, zero_N=zero_N, percent=100.0 * zero_N / top_N)


SIGNS = FromTests(
    "signs-reversed", seen=True, find=reversed_signs,
    text=(
        "the mean force at low speed is {offset_N:+.3g} N, towards extension, but gas force pushes the rod out: force "
        "and displacement probably both have the wrong sign, unless the zero of the load cell is wrong by that amount"
    ),
    next=(
        "check the signs with a slow manual extension, in which displacement must increase and force must be positive; "
        "if both signs are reversed, multiply both signals by -1; if neither is, check the zero of the load cell"
    ),
)  # fmt: skip
SATURATED = FromTests(
    CLIPPING.slug, find=saturated,
    text="the force is clipped in {tests}; the clipped samples are excluded from the fit",
    next=CLIPPING.next,
)  # fmt: skip
LAW_OF_TWO = FromTests(
    CURRENT_LAW.slug, find=law_from_two_currents, last=True,
    text=(
        "the current law is determined only by the tests at {low_A:.3g} and {top_A:.3g} A and predicts {zero_N:.3g} N "
        "at 0 A, {percent:.0f} % of the yield force at {top_A:.3g} A, but 0 A was not measured: the force probably "
        "saturates"
    ),
    next="run tests at 0 A and at an intermediate current",
)  # fmt: skip
OFFSET = FromTests(
    "force-offset", seen=True, find=offset, last=True,
    text=(
        "the mean force at low speed is {offset_N:+.3g} N, towards extension, because of a preload or a wrong zero of "
        "the load cell; the model's offset includes this force. A gas damper with both signs reversed gives the same "
        "result if it does not resist rebound more than compression"
    ),
    next=(
        "read the load cell with the rod free, and check the signs with a slow manual extension, in which displacement "
        "must increase and force must be positive"
    ),
)  # fmt: skip

FROM_TESTS = (SIGNS, SATURATED, LAW_OF_TWO, OFFSET)
"""In the order in which they are listed, the `last` ones behind the causes of a misfit."""
