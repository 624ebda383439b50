"""Tests as a whole: are sizes and signs those of a damper, and is the current law one that two currents can show?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.model import DamperModel
from rig.fits.entries import Cause
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.undetermined import levels_of
from rig.identification.uncertainty.covariance import quantile
from rig.identification.words import say, some
from rig.signals.plausibility import SMALLEST_CURRENT_A, Doubt, TestSize, doubts

SIGNS, OFFSET = "signs-reversed", "force-offset"
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
    if not ids:
        return _certain(doubt.slug, **numbers)
    text = say("units-of-some", what=say(doubt.slug, **numbers), tests=some(ids))
    return Cause(doubt.slug, text, 1.0, say(f"next-{doubt.slug}", **numbers))


def _certain(slug: str, **numbers: object) -> Cause:
    return Cause(slug, say(slug, **numbers), 1.0, say(f"next-{slug}", **numbers))


def _rates(tests: Sequence[Measurement]) -> list[Cause]:
    """Is the velocity that of the displacement?"""
    ratios = []
    for test in tests:
        given = float(np.std(test.v_m_s))
        ratios.append(float(np.std(np.gradient(test.u_m, test.dt_s))) / given if given > 0.0 else np.nan)
    ratio = float(np.nanmedian(ratios)) if np.any(np.isfinite(ratios)) else 1.0
    return [] if SAME_RATE[0] < ratio < SAME_RATE[1] else [_certain("units-velocity", ratio=ratio)]


def middle(tests: Sequence[Measurement]) -> list[Cause]:
    """Is the force's middle where gas puts it? Gas pushes a rod out, so the middle is negative.

    Where it is positive, both signs are reversed or not. Dampers resist rebound more than jounce: where rebound is the
    weaker one too, the signs are reversed. Else it is an offset, a preload or a load cell's zero, unless it is larger
    than those are beside a powered damper's force; without current friction is all there is to compare. Both must be
    clear beyond what the tests differ by.
    """
    measured = _middle_N(tests)
    if measured is None:
        return []
    offset_N, growth_N, offset_doubt_N, growth_doubt_N = measured
    peaks_N = [test.peak_force_N for test in tests]
    peak_N, top_N = float(np.median(peaks_N)), max(peaks_N)
    least_N = ZERO_ERRORS * max(test.force_zero_std_N for test in tests)
    clear = CLEAR_OF_PEAK if growth_N > 0.0 else OFFSET_OF_PEAK
    if offset_N <= max(clear * peak_N, least_N):
        return []
    levels = levels_of(tests)
    powered = len(levels) > 1 or levels.zero is None
    weaker = growth_N < -max(WEAKER_REBOUND * peak_N, growth_doubt_N)
    slug = SIGNS if weaker or (powered and offset_N - offset_doubt_N > LARGEST_ZERO * top_N) else OFFSET
    return [Cause(slug, say(slug, offset_N=offset_N), 0.0, say(f"next-{slug}"))]


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
    freedom, told = len(rows) - int(rank), np.linalg.pinv(table.T @ table, rcond=SAME_SPEED**2)
    offset_N, growth_N = float(amounts[0]), float(at_speed @ amounts)
    if not freedom or rank == 1:  # a line through two tests, or one speed: nothing tells the growth from the offset
        return offset_N, growth_N, np.inf, np.inf
    doubt_N = quantile(1, freedom) * float(np.linalg.norm(table @ amounts - middles)) / np.sqrt(freedom)
    growth_doubt_N = doubt_N * float(np.sqrt(at_speed @ told @ at_speed))
    return offset_N, growth_N, doubt_N * float(np.sqrt(told[0, 0])), growth_doubt_N


def law_from_two_currents(
    model: DamperModel, values: Mapping[str, float], tests: Sequence[Measurement]
) -> list[Cause]:
    """A law drawn through two currents that leaves much of the force at zero current, where nothing was measured."""
    levels = levels_of(tests)
    if len(levels) != CURRENTS_OF_A_LINE or levels.values_A[0] < LOWEST_OF_TOP * levels.values_A[1]:
        return []
    low_A, top_A = levels.values_A
    top_speed = max(float(np.max(np.abs(test.v_m_s))) for test in tests)
    complete = {**values, "eta": 1.0} if "eta" in model.names else dict(values)
    halves = [
        0.5 * (model.force_at(complete, v, at_A) - model.force_at(complete, -v, at_A))
        for v in (top_speed, 0.5 * top_speed)
        for at_A in (0.0, top_A)
    ]
    zero_N, top_N = (float(2.0 * halves[k + 2] - halves[k]) for k in (0, 1))
    if top_N <= 0.0 or zero_N < AT_ZERO * top_N:
        return []
    numbers = {"low_A": low_A, "top_A": top_A, "zero_N": zero_N, "percent": 100.0 * zero_N / top_N}
    return [Cause("current-law", say("current-law-two", **numbers), 0.0, say("next-current-law-two", **numbers))]
