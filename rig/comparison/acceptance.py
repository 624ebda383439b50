"""Values held against acceptance bands: passed or not, with the margin and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from rig.comparison.bands import Band, Bands, LoopBand, ParameterBand
from rig.comparison.changes import Change, change, transfer
from rig.comparison.readings import QUANTITIES, LoopReading, Motion, Reading, RunReadings, one_to_one, plain
from rig.display import Display, Shown
from rig.errors import FileProblem
from rig.matrix.acceptance_table import Decision
from rig.signals.test_set import MotionReading

PERCENT = "%"
FIT = "fit"
"""Where a fitted parameter was found."""
MOTION = ("waveform", "amplitude_m", "frequency_Hz", "current_A")
"""Attributes of a motion in the JSON."""


class State(StrEnum):
    """How a value stands to its band; only the first is a pass."""

    PASSED = "pass"
    FAILED = "fail"
    UNSURE = "unsure"
    MISSING = "missing"


@dataclass(frozen=True)
class Result:
    """One value of one run against one band.

    Attributes:
        quantity: its key, or the parameter's name; `change` says that it is the change against the first run, in %.
        run: name of the run.
        where: which tests: the motion, or the band's own words where no test fits them.
        points: ids of the points it was measured in.
        value: SI, or % of a change; NaN where missing.
        expanded: expanded uncertainty (about 95 %) of what is known of it.
        low, high: the band; None where open.
        unit: of these.
        state: pass, fail, unsure or missing.
        why: what is missing or unsure.
        note: the band's.
        motion: that of `where`; None where no test fits.
    """

    quantity: str
    run: str
    where: str
    points: tuple[str, ...]
    value: float
    expanded: float
    low: float | None
    high: float | None
    unit: str
    state: State
    why: str = ""
    note: str = ""
    change: bool = False
    motion: Motion | None = None

    def shown(self, display: Display) -> Shown:
        """How value, limits and margin are shown."""
        known = QUANTITIES.get(self.quantity)
        own = known is not None and known.unit == self.unit
        return known.shown(display) if known is not None and own else plain(self.unit)

    def band(self, shown: Shown) -> tuple[float | None, float | None]:
        """Lower and upper limit as shown; None where open."""
        low, high = (None if end is None else shown.signed(end) for end in (self.low, self.high))
        return (high, low) if shown.positive == "compression" else (low, high)

    def location(self, display: Display) -> str:
        """`where` in the units of a display, with the ids of the points."""
        where = self.where if self.motion is None else self.motion.phrase(display)
        return where + (f" ({', '.join(self.points)})" if self.points else "")

    @property
    def title(self) -> str:
        """The quantity's name, or the parameter's."""
        known = QUANTITIES.get(self.quantity)
        name = self.quantity if known is None else known.name
        return f"change of {name}" if self.change else name

    @property
    def margin(self) -> float:
        """To the nearer limit, in `unit`; negative outside."""
        return min(
            math.inf if self.high is None else self.high - self.value,
            math.inf if self.low is None else self.value - self.low,
        )

    @property
    def margin_percent(self) -> float:
        """The margin in % of the limit that is nearer; NaN where that is 0."""
        ends = [(abs(self.value - end), end) for end in (self.low, self.high) if end is not None]
        nearest = min(ends)[1] if ends and math.isfinite(self.value) else 0.0
        return 100.0 * self.margin / abs(nearest) if nearest != 0.0 else math.nan

    def to_json(self) -> dict[str, Any]:
        """Every attribute and the margins; null where there is no number."""
        motion = None if self.motion is None else {name: getattr(self.motion, name) for name in MOTION}
        entry = {**vars(self), "points": list(self.points), "state": str(self.state), "margin": self.margin,
                 "margin_percent": self.margin_percent, "motion": motion}  # fmt: skip
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in entry.items()
        }

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> Result:
        """The result that `to_json` wrote.

        Raises:
            LookupError: an attribute is missing.
            TypeError, ValueError: a value is not of its type.
        """
        kept = {name: entry[name] for name in cls.__dataclass_fields__}
        kept |= {name: math.nan if kept[name] is None else float(kept[name]) for name in ("value", "expanded")}
        if (motion := kept["motion"]) is not None:
            read = MotionReading(*(motion[name] for name in MOTION[:3]))
            kept["motion"] = Motion.of(read, None, motion["current_A"])
        return cls(**kept | {"points": tuple(kept["points"]), "state": State(kept["state"])})


@dataclass(frozen=True)
class AcceptanceResult:
    """All results, by band and run; `name` and `decision` are those of the bands."""

    name: str
    decision: Decision
    results: tuple[Result, ...]

    @property
    def passed(self) -> bool:
        """Whether every value is within its band and none is missing."""
        return bool(self.results) and all(result.state == State.PASSED for result in self.results)

    @property
    def not_passed(self) -> tuple[Result, ...]:
        """Those that are not within their band, and those that could not be judged."""
        return tuple(result for result in self.results if result.state != State.PASSED)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            "name": self.name, "decision": self.decision, "passed": self.passed,
            "results": [result.to_json() for result in self.results],
        }  # fmt: skip

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> AcceptanceResult:
        """The results that `to_json` wrote; raises as `Result.from_json`."""
        return cls(entry["name"], entry["decision"], tuple(map(Result.from_json, entry["results"])))


def evaluate(bands: Bands, runs: Sequence[RunReadings], file: str = "bands") -> AcceptanceResult:
    """Hold every run against every band.

    Args:
        bands: the bands.
        runs: the runs; `most_change` is of the later ones against the first.
        file: name of the bands file, for its errors.

    Raises:
        FileProblem: a band needs a second run, or a parameter's unit is not that of the fit.
    """
    problems = [] if len(runs) > 1 or not bands.changes else [
        "most_change limits the change relative to another run. Fix: specify two runs (before, after)"
    ]
    problems += list(dict.fromkeys(_wrong_units(bands, runs)))
    if problems:
        raise FileProblem(file, problems, "config-absurd")
    results = []
    references = [_references(run, runs[0]) for run in runs]
    for key, band in bands.all:
        for index, run in enumerate(runs):
            values = list(_values(key, band, run))
            if band.low is not None or band.high is not None:
                results += [_result(bands, band, run, value) for value in values]
            if band.most_change is not None and index > 0:
                reference = references[index]
                values += _missing(key, band, run, runs[0], reference)
                results += [_changed(bands, band, run, value, runs[0], key, reference) for value in values]
    return AcceptanceResult(bands.name, bands.decision, tuple(results))


@dataclass(frozen=True)
class _Value:
    """A reading with what it is and where it was found; `why` where it cannot be used.

    `lost_repeats` are the planned repeats that are not in it.
    """

    quantity: str
    unit: str
    where: str
    reading: Reading
    points: tuple[str, ...] = ()
    why: str = ""
    loop: LoopReading | None = None
    lost_repeats: tuple[str, ...] = ()

    @property
    def motion(self) -> Motion | None:
        """That of the loop."""
        return None if self.loop is None else self.loop.motion


NONE = Reading(math.nan, math.nan)
References = Mapping[tuple[str, ...], LoopReading]
"""The first run's reading of a motion, by the points of a later run that have this motion."""


def _wrong_units(bands: Bands, runs: Sequence[RunReadings]) -> Iterator[str]:
    for index, band in enumerate(bands.parameter, start=1):
        for run in runs:
            fitted = run.parameters.get(band.name)
            if fitted is not None and fitted.unit != band.unit:
                yield f'parameter[{index}].unit = "{band.unit}": {band.name} is fitted in "{fitted.unit}"'


def _values(key: str, band: Band, run: RunReadings) -> Iterator[_Value]:
    """What a run has of a band's quantity; one that is missing says why."""
    if isinstance(band, ParameterBand):
        yield _parameter(band, run)
        return
    unit = QUANTITIES[key].unit
    if not isinstance(band, LoopBand):
        reading = run.singles.get(key)
        why = "the run contains no valid friction test" if reading is None else ""
        yield _Value(key, unit, "slow triangle at 0 A", reading or NONE, why=why)
        return
    loops = _chosen(key, band, run.loops)
    if not loops:
        why = "the run contains no valid point for this test"
        wanted = [point_id for loop in _chosen(key, band, run.missing) for point_id in loop.ids]
        reasons = [line for line in run.left_out if line.split(" ", 1)[0] in wanted]
        yield _Value(key, unit, band.where or "any loop", NONE, why="; ".join((why, *reasons)))
        return
    for loop in loops:
        known = loop.values.get(key)
        why = "these points do not allow this measurement" if known is None else ""
        lost = run.lost_repeats.get(loop.ids, ())
        yield _Value(key, unit, loop.motion.label, known or NONE, loop.ids, why, loop, lost)
    for loop in _chosen(key, band, run.missing):
        yield _Value(key, unit, loop.motion.label, NONE, loop.ids, "no point with this motion is valid", loop)
    if run.planned is not None and band.where:
        why = "this planned point was not recorded because the campaign ended early"
        for loop in _chosen(key, band, run.planned):
            yield _Value(key, unit, loop.motion.label, NONE, loop.ids, why, loop)
    elif run.not_recorded:
        why = f"planned points not recorded because the campaign ended early: {len(run.not_recorded)}"
        yield _Value(key, unit, band.where or "any loop", NONE, why=why)


def _chosen(key: str, band: LoopBand, loops: Sequence[LoopReading]) -> list[LoopReading]:
    """The loops that a band is about."""
    passive = key == "dynamic_range" and band.current_A is None
    return [loop for loop in loops if band.holds(loop) and not (passive and loop.motion.current_A == 0.0)]


def _references(run: RunReadings, first: RunReadings) -> References:
    """The first run's reading of each motion of a run that both have."""
    pairs = one_to_one([loop.motion for loop in run.loops], [loop.motion for loop in first.loops])
    return {run.loops[own].ids: first.loops[other] for own, other in pairs.items()}


def _missing(key: str, band: Band, run: RunReadings, first: RunReadings, references: References) -> list[_Value]:
    """Motions that the first run has and a band is about, but that a later run was not tested with."""
    if not isinstance(band, LoopBand) or band.point is not None or not _chosen(key, band, run.loops):
        return []
    known = {loop.ids for loop in references.values()}
    return [
        _Value(key, QUANTITIES[key].unit, loop.motion.label, NONE, (), f"{run.name} does not contain this test", loop)
        for loop in _chosen(key, band, first.loops)
        if loop.ids not in known and not any(loop.motion.same_as(other.motion) for other in run.missing)
    ]


def _parameter(band: ParameterBand, run: RunReadings) -> _Value:
    fitted = run.parameters.get(band.name)
    if fitted is None:
        why = f"the fitted model {run.model} has no such parameter" if run.model else "the run has no fit"
        return _Value(band.name, band.unit, FIT, NONE, why=why)
    return _Value(band.name, band.unit, FIT, fitted.reading if not fitted.why else NONE, why=fitted.why)


def _result(bands: Bands, band: Band, run: RunReadings, value: _Value) -> Result:
    return _evaluated(Result(
        value.quantity, run.name, value.where, value.points, value.reading.value, value.reading.expanded,
        band.low, band.high, value.unit, State.MISSING, value.why, band.note, motion=value.motion,
    ), bands, complete=value.reading.complete, lost_repeats=value.lost_repeats)


def _changed(
    bands: Bands, band: Band, run: RunReadings, value: _Value, first: RunReadings, key: str,
    references: References,
) -> Result:  # fmt: skip
    """A value's change against the first run's, in percent."""
    most = 100.0 * (band.most_change or 0.0)
    loop = None if value.loop is None else references.get(value.loop.ids)
    before = _before(band, value, first, key, loop)
    same = "this is the first run: identical data cannot show a change" if run.identity == first.identity else ""
    why = value.why or same or ("" if before is not None else f"{first.name} does not contain this value")
    known = None if why or before is None else change(
        before, value.reading, same_gauge=bool(run.load_cell) and run.load_cell == first.load_cell,
        moved=None if value.loop is None or loop is None else transfer(
            QUANTITIES[key], loop.motion, value.loop.motion),
        of_band=True,
    )  # fmt: skip
    if known is not None and not math.isfinite(known.percent):
        why = "the value of the first run does not differ significantly from 0, so a relative change is undefined"
    known = known or Change(math.nan, math.nan, math.nan, math.nan)
    return _evaluated(Result(
        value.quantity, run.name, value.where, value.points, known.percent, 2.0 * known.percent_std, -most, most,
        PERCENT, State.MISSING, why, band.note, change=True, motion=value.motion,
    ), bands, complete=math.isfinite(known.percent_std), lost_repeats=value.lost_repeats)


def _before(
    band: Band, value: _Value, first: RunReadings, key: str, loop: LoopReading | None
) -> Reading | None:
    if isinstance(band, ParameterBand):
        fitted = first.parameters.get(band.name)
        return None if fitted is None or fitted.why else fitted.reading
    if value.loop is None:
        return first.singles.get(key)
    return None if loop is None else loop.values.get(key)


def _evaluated(result: Result, bands: Bands, *, complete: bool, lost_repeats: tuple[str, ...]) -> Result:
    """The result with its state, by the decision rule (ISO 14253-1, JCGM 106:2012 section 8.3).

    Guarded acceptance leaves the limits' inner margin of one expanded uncertainty undecided. Guarded rejection accepts
    the outer margin: that the value violates its limit is not proved there.

    A value that would pass is missing if a planned repeat is not in it: nothing is accepted with fewer tests than were
    planned. A value that fails is not saved by a repeat that was lost.
    """
    if result.why or not math.isfinite(result.value):
        return result
    state, why = (State.PASSED if result.margin >= 0.0 else State.FAILED), ""
    guarded = {"guarded": State.PASSED, "guarded-acceptance": State.PASSED, "guarded-rejection": State.FAILED}
    if state == guarded.get(bands.decision):
        if not complete:
            state, why = State.UNSURE, (
                "the uncertainty of this value is not fully known (variation between cycles or sensor calibration)"
            )
        elif abs(result.margin) < result.expanded:
            state, why = (
                (State.UNSURE, "the margin is smaller than the expanded uncertainty") if state == State.PASSED
                else (State.PASSED, "outside the limits by less than the expanded uncertainty")
            )
    if state == State.PASSED and lost_repeats:
        names = ", ".join(lost_repeats)
        state, why = State.MISSING, f"planned repeats were not recorded or are not valid: {names}"
    return replace(result, state=state, why=why)
