"""From what was given to measurements: a run, recorded points, or measurements already prepared.

What reads recordings takes as long to load as a fit takes; for measurements alone it is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement
from rig.identification.points.consistency import refuse_seen, refuse_twice, without_still
from rig.identification.points.current_steps import lag_of
from rig.identification.points.mean_cycles import mean_cycles
from rig.identification.points.preparation import campaign_skews, prepare_all
from rig.identification.points.whole_record import cut_in_time
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run, Selection

if TYPE_CHECKING:
    from rig.identification.points.current_steps import CurrentLag

    Tests = Run | Sequence[RecordedPoint] | Sequence[Measurement]


FITTED = frozenset({"loop", "signal"})
"""Kinds of points that a model is fitted to, or scored on."""


@dataclass(frozen=True)
class FitInputs:
    """What is fitted, what is held out, and what else the recordings tell.

    Attributes:
        fitted: measurements to fit.
        held_out: measurements kept out of the fit.
        warnings: what was left out, and why.
        lag: the coil's, from points with current steps; None without any.
        unusable_steps: why points with current steps told nothing.
        temperature_degC: lowest and highest coil temperature (degC) of the fitted points; None where nothing was
            recorded.
    """

    fitted: list[Measurement]
    held_out: list[Measurement]
    warnings: tuple[str, ...] = ()
    lag: CurrentLag | None = None
    unusable_steps: tuple[str, ...] = ()
    temperature_degC: tuple[float, float] | None = None


def fit_inputs(
    tests: Tests, holdout: str | Tests | None, campaign: Sequence[RecordedPoint], *, every_sample: bool = False
) -> FitInputs:
    """Measurements to fit and held-out measurements, aligned using all points of their campaigns.

    Args:
        tests: tests to fit, some of which may be held out.
        holdout: held-out tests (a filter, or other tests), or `last 30 %` of the time for motion without cycles.
        campaign: all points of the campaigns.
        every_sample: keep all samples of long tests (a robust loss needs single outliers); otherwise use mean cycles.

    Raises:
        IdentificationFailed: nothing or everything is held out, a test is listed twice or on both sides, or no test
            contains motion.
    """
    share = _last_share(holdout) if isinstance(holdout, str) else None
    if share is not None:
        known = fit_inputs(tests, None, campaign, every_sample=every_sample)
        beginnings, ends = cut_in_time(known.fitted, share)
        return replace(known, fitted=beginnings, held_out=ends)
    fitted = _measurements(tests)
    held_out = [] if holdout is None else _measurements(holdout)
    if not fitted or held_out is None or (holdout is not None and not held_out):
        return _recorded(tests, holdout, campaign, None if every_sample else mean_cycles)
    refuse_twice(fitted)
    refuse_seen(fitted, held_out)
    if not every_sample:
        fitted, held_out = ([mean_cycles(test) for test in group] for group in (fitted, held_out))
    return _moving(FitInputs(fitted, held_out))


def _last_share(holdout: str) -> float | None:
    from rig.identification.points.whole_record import last_share  # reads recordings, which measurements do not need

    return last_share(holdout)


def _measurements(tests: str | Tests) -> list[Measurement] | None:
    """The tests where all are measurements; None otherwise."""
    if not isinstance(tests, Sequence) or isinstance(tests, str):
        return None
    measurements = [test for test in tests if isinstance(test, Measurement)]
    return measurements if len(measurements) == len(tests) else None


def _recorded(
    tests: Tests, holdout: str | Tests | None, campaign: Sequence[RecordedPoint],
    reduced: Callable[[Measurement], Measurement] | None,
) -> FitInputs:
    """Like `fit_inputs`, for recordings among the tests; `reduced` is applied to each measurement.

    Raises:
        IdentificationFailed: as in `fit_inputs`.
    """
    def points_of(group: Tests, *, suspect: bool = False) -> list[RecordedPoint]:
        if isinstance(group, Run):
            return list(group.usable if suspect else group.valid)
        return [item for item in group if isinstance(item, RecordedPoint)]

    recorded = points_of(tests)
    points = [point for point in recorded if point.kind in FITTED]
    fitted = _kept(tests, reduced)
    kept_out: list[RecordedPoint] = []
    held_out: list[Measurement] = []
    others: Tests = ()
    if isinstance(holdout, str):
        selection = Selection.parse(holdout)
        kept_out = [point for point in points if selection.holds(point)]
        points = [point for point in points if not selection.holds(point)]
        if not kept_out:
            raise IdentificationFailed(f"holdout: {holdout!r} matches none of the {len(points)} points; "
                                       f"{selection.values_of(points)}")
        if not points:
            raise IdentificationFailed(f"holdout: {holdout!r} matches every point, so no test remains for the fit")
    elif holdout is not None:
        others = holdout
        kept_out = [point for point in points_of(others) if point.kind in FITTED]
        held_out = _kept(others, reduced)
        count = len(others.valid if isinstance(others, Run) else others)
        if not count:
            where = f"the run {others.path} contains no valid point" if isinstance(others, Run) else (
                "no test was "
                "specified"
            )
            raise IdentificationFailed(f"holdout: {where}. Fix: omit holdout to fit without validation")
        if not kept_out and not held_out:
            raise IdentificationFailed(
                f"holdout: none of the {count} points contains loops; only loops are used for validation"
            )
    given: list[RecordedPoint | Measurement] = [*points, *fitted]
    given_out: list[RecordedPoint | Measurement] = [*kept_out, *held_out]
    skews = campaign_skews([*points_of(tests, suspect=True), *points_of(others, suspect=True), *campaign])
    refused: list[str] = []
    if points or not fitted:
        prepared, left_out = prepare_all(points, skews, reduced)
        fitted += prepared
        refused += left_out
    if kept_out:
        prepared, left_out = prepare_all(kept_out, skews, reduced)
        held_out += prepared
        refused += left_out
    refuse_twice(given)  # reads forces: before the preparation, a point would count as changed in memory
    refuse_seen(given, given_out)
    lag, unusable_steps = lag_of(recorded)
    return _moving(FitInputs(fitted, held_out, tuple(refused), lag, tuple(unusable_steps), _temperature_degC(points)))


def _kept(tests: Tests, reduced: Callable[[Measurement], Measurement] | None) -> list[Measurement]:
    """The measurements among the tests."""
    measurements = [] if isinstance(tests, Run) else [item for item in tests if isinstance(item, Measurement)]
    return measurements if reduced is None else [reduced(test) for test in measurements]


def _moving(known: FitInputs) -> FitInputs:
    """The same without tests of a constant channel, each with a warning.

    Raises:
        IdentificationFailed: none is left on one side.
    """
    fitted, still = without_still(known.fitted)
    held_out, still_too = without_still(known.held_out)
    return replace(known, fitted=fitted, held_out=held_out, warnings=(*known.warnings, *still, *still_too))


def _temperature_degC(points: Sequence[RecordedPoint]) -> tuple[float, float] | None:
    low = [value for point in points if (value := point.quality.coil_low_degC) is not None]
    high = [value for point in points if (value := point.quality.coil_high_degC) is not None]
    return (min(low), max(high)) if low and high else None
