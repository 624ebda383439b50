"""Differences between the original and the new results of a run, each with its cause.

Each step of the analysis is repeated separately: the present definitions are applied to the original points, then to
the new points. The first difference is due to a definition or method that has changed, the second to the points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.fits.fit_record import FitRecord
from rig.fits.plain import plain
from rig.recording.hdf5.reading import channel_names
from rig.recording.quality.verdict import Reason
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray

ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""Relative difference of two samples that is only rounding: aligned channels are stored as float32."""
SAME_TIME_S = 1e-9
SAME_VALUE = 1e-9
"""Relative difference of two results that is only rounding."""
MINOR_SHARE = 0.1
"""Share of a change up to which a part of it is not named as a cause."""
MINOR_IN_STD = 0.01
"""Standard uncertainties up to which a change is not listed for people."""
MINOR_CHANGE = 1e-4
"""The same of values without an uncertainty, relative."""
IDENTITY = frozenset({"id", "waveform", "points", "group", "motion", "test_set"})
"""Entries of characteristics that name a test."""
NUMBERED = ("loops", "friction", "dynamic_range")
"""Lists in characteristics whose entries have an `id`."""


class Cause(StrEnum):
    """Why a result has changed; the value is the key in JSON."""

    ALIGNMENT = "alignment"
    RULE = "quality-rule"
    VERDICTS = "verdicts"
    DEFINITION = "definition"
    METHOD = "fit-method"
    MODEL = "model"

    @property
    def words(self) -> str:
        """The cause in a few words."""
        return WORDS[self]

    @property
    def meaning(self) -> str:
        """What has changed, in a sentence without its subject's name."""
        return MEANINGS[self]


WORDS = {
    Cause.ALIGNMENT: "alignment of samples",
    Cause.RULE: "quality rule",
    Cause.VERDICTS: "verdicts of points",
    Cause.DEFINITION: "definition",
    Cause.METHOD: "fitting method",
    Cause.MODEL: "other model",
}
MEANINGS = {
    Cause.ALIGNMENT: "this version assigns other times to the received samples, for example with another sensor delay",
    Cause.RULE: "the aligned samples are identical, but this version evaluates them with another rule or limit",
    Cause.VERDICTS: "the samples are identical, but other points are valid",
    Cause.DEFINITION: "this version calculates another value from the original points",
    Cause.METHOD: "this version fits other values to the original points",
    Cause.MODEL: "the models of the two fits differ, so only their errors are compared",
}


@dataclass(frozen=True)
class PointChange:
    """Verdict and aligned samples of one point before and now.

    Attributes:
        id: of the point.
        before, after: verdicts; `after` is empty if the point could not be made again.
        added, removed: reasons of the verdict that are new, or no longer apply.
        largest: largest difference of each changed channel (SI).
        force_percent: largest difference of force, in % of the largest force; NaN if unknown.
        delay_s: by how much the sensor delay has changed (s); NaN if unknown.
        causes: of the differences; empty without any.
        remark: why the samples are those of the original; empty if they were aligned again.
    """

    id: str
    before: str
    after: str
    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    largest: Mapping[str, float] = field(default_factory=dict)
    force_percent: float = math.nan
    delay_s: float = math.nan
    causes: tuple[Cause, ...] = ()
    remark: str = ""

    @property
    def changed(self) -> bool:
        """Whether anything differs."""
        return bool(self.causes)

    def to_json(self) -> dict[str, Any]:
        """Plain types without NaN."""
        return {**plain(self), "changed": self.changed}


@dataclass(frozen=True)
class ValueChange:
    """One number before and now.

    Attributes:
        name: what it is, such as `p001 rebound_N` or a parameter.
        unit: SI unit; empty if the name states it.
        before, after: values (NaN: there is none).
        before_std, after_std: their standard uncertainties (NaN: unknown).
        parts: part of the change by each cause.
    """

    name: str
    unit: str
    before: float
    after: float
    before_std: float = math.nan
    after_std: float = math.nan
    parts: Mapping[Cause, float] = field(default_factory=dict)

    @property
    def change(self) -> float:
        """The difference; NaN where a value is missing."""
        return self.after - self.before

    @property
    def changed(self) -> bool:
        """Whether the values differ by more than rounding, or only one of them exists."""
        if math.isnan(self.before) or math.isnan(self.after):
            return math.isnan(self.before) != math.isnan(self.after)
        return abs(self.change) > SAME_VALUE * max(abs(self.before), abs(self.after))

    @property
    def std(self) -> float:
        """The larger standard uncertainty; both results come from the same samples, so they are not added."""
        known = [one for one in (self.before_std, self.after_std) if math.isfinite(one)]
        return max(known, default=math.nan)

    @property
    def in_std(self) -> float:
        """Size of the change in standard uncertainties; NaN where that is unknown."""
        return abs(self.change) / self.std if self.std > 0.0 else math.nan

    @property
    def notable(self) -> bool:
        """Whether the change is more than a small part of the uncertainty (of the value where that is unknown)."""
        if math.isfinite(self.in_std):
            return self.in_std > MINOR_IN_STD
        return not abs(self.change) <= MINOR_CHANGE * max(abs(self.before), abs(self.after))

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Causes that contribute more than a minor share of the change, the largest first."""
        known = {cause: abs(part) for cause, part in self.parts.items() if math.isfinite(part)}
        least = MINOR_SHARE * max(known.values(), default=0.0)
        ordered = sorted(known, key=lambda cause: -known[cause])
        return tuple(cause for cause in ordered if known[cause] > least) or tuple(self.parts)[:1]

    def to_json(self) -> dict[str, Any]:
        """Plain types; NaN becomes null in the file."""
        return {
            "name": self.name, "unit": self.unit or None, "before": self.before, "after": self.after,
            "before_std": self.before_std, "after_std": self.after_std, "change": self.change,
            "change_in_std": self.in_std, "notable": self.notable, "causes": list(self.causes),
            "parts": {str(cause): part for cause, part in self.parts.items()},
        }  # fmt: skip


def point_change(before: RecordedPoint, after: RecordedPoint, remark: str = "") -> PointChange:
    """The differences between a point's original and new file.

    Raises:
        FileProblem: a file cannot be read.
    """
    largest = _largest(before, after)
    old, new = before.quality.verdict, after.quality.verdict
    added, removed = (_others(one.entries, other.entries) for one, other in ((new, old), (old, new)))
    causes: list[Cause] = [Cause.ALIGNMENT] if largest else []
    if (before.verdict, _kinds(old.entries)) != (after.verdict, _kinds(new.entries)) and not largest:
        causes.append(Cause.RULE)
    peak_N = float(np.nanmax(np.abs(before.force_N), initial=0.0)) if before.samples else 0.0
    force = largest.get("force", math.nan if peak_N == 0.0 else 0.0)
    return PointChange(
        before.id, before.verdict, after.verdict, added, removed, largest,
        100.0 * force / peak_N if peak_N > 0.0 else math.nan, after.skew_s - before.skew_s, tuple(causes), remark,
    )  # fmt: skip


def _kinds(reasons: Sequence[Reason]) -> list[tuple[str, int]]:
    return sorted((reason.slug, int(reason.kind)) for reason in reasons)


def _others(reasons: Sequence[Reason], known: Sequence[Reason]) -> tuple[str, ...]:
    """Reasons that are not known, or lead to another verdict."""
    there = {(reason.slug, reason.kind) for reason in known}
    return tuple(str(reason) for reason in reasons if (reason.slug, reason.kind) not in there)


def _largest(before: RecordedPoint, after: RecordedPoint) -> dict[str, float]:
    """Largest difference of each channel that differs by more than rounding (SI); NaN of one that only one file has."""
    names = list(dict.fromkeys(name for point in (before, after) if point.path for name in channel_names(point.path)))
    differences: dict[str, float] = {}
    old_s, new_s = before.time_s, after.time_s
    same_time = len(old_s) == len(new_s) and bool(np.all(np.abs(old_s - new_s) <= SAME_TIME_S))
    if not same_time:
        length = min(len(old_s), len(new_s))
        differences["time"] = float(np.max(np.abs(old_s[:length] - new_s[:length]), initial=0.0))
    for name in names:
        if name == "time":
            continue
        old, new = before.channel(name), after.channel(name)
        if not same_time:
            new = _at(old_s, new_s, new)
        differing = _difference(old, new)
        if differing is not None:
            differences[name] = differing
    return differences


def _difference(old: FloatArray, new: FloatArray) -> float | None:
    """Largest difference; None if it is only rounding, NaN if there is none but other samples are missing."""
    known = np.isfinite(old) & np.isfinite(new)
    largest = float(np.max(np.abs(new[known] - old[known]), initial=0.0))
    size = float(np.max(np.abs(old[known]), initial=0.0))
    if largest > ROUNDING * size:
        return largest
    missing: NDArray[np.bool_] = np.isfinite(old) != np.isfinite(new)
    return math.nan if bool(np.any(missing)) else None


def _at(time_s: FloatArray, known_s: FloatArray, values: FloatArray) -> FloatArray:
    """Values (m,) at other times (n,); NaN outside of them and next to missing values."""
    return np.asarray(np.interp(time_s, known_s, values, left=math.nan, right=math.nan), np.float64)


Numbers = Mapping[str, tuple[float, float]]
"""Name -> value and standard uncertainty (NaN: unknown)."""


def characteristic_numbers(content: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Every number of the object in `characteristics.json`, by test and key."""
    numbers: dict[str, tuple[float, float]] = {}
    for group in NUMBERED:
        listed = content.get(group)
        for entry in listed if isinstance(listed, list) else ():
            if isinstance(entry, Mapping) and isinstance(entry.get("id"), str):
                prefix = f"{entry['id']} dynamic_range" if group == "dynamic_range" else entry["id"]
                numbers |= {f"{prefix} {key}": pair for key, pair in _numbers_of(entry)}
    lag = content.get("lag")
    if isinstance(lag, Mapping):
        numbers |= {f"coil lag {key}": pair for key, pair in _numbers_of(lag)}
    return numbers


def _numbers_of(entry: Mapping[str, Any]) -> Iterator[tuple[str, tuple[float, float]]]:
    for key, value in entry.items():
        if key in IDENTITY:
            continue
        if isinstance(value, Mapping) and _is_number(value.get("value")):
            yield key, (float(value["value"]), float(value["std"]) if _is_number(value.get("std")) else math.nan)
        elif _is_number(value):
            yield key, (float(value), math.nan)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def value_changes(
    original: Numbers | None, present: Numbers, after: Numbers, points: Cause, definition: Cause,
    units: Mapping[str, str] | None = None,
) -> tuple[ValueChange, ...]:
    """Numbers that have changed, and by which cause.

    Args:
        original: as stored with the original; None: there are none.
        present: by the present definitions from the original points.
        after: by the present definitions from the new points.
        points: cause of a difference between `present` and `after`.
        definition: cause of a difference between `original` and `present`.
        units: SI units by name, where the names do not state them.
    """
    before = present if original is None else original
    unknown = (math.nan, math.nan)
    changes = []
    for name in dict.fromkeys((*before, *after)):
        old, now = before.get(name, unknown), after.get(name, unknown)
        between = present.get(name, unknown)
        parts = {definition: between[0] - old[0], points: now[0] - between[0]}
        if original is None:
            del parts[definition]
        elif math.isnan(now[0] - old[0]):  # only one of them has the value
            parts = {definition if math.isnan(between[0]) == math.isnan(now[0]) else points: math.nan}
        change = ValueChange(name, (units or {}).get(name, ""), old[0], now[0], old[1], now[1], parts)
        if change.changed:
            changes.append(change)
    return tuple(changes)


def fit_numbers(fit: FitRecord) -> dict[str, tuple[float, float]]:
    """Parameters of a fit (SI) with their standard errors, and the fit's error."""
    numbers = {
        name: (float(one), math.nan if one.standard_error is None else one.standard_error)
        for name, one in fit.parameters.items()
    }
    return {**numbers, "error": (fit.error.nrmse_percent_of_peak, math.nan)}


def fit_units(fit: FitRecord) -> dict[str, str]:
    """Units of `fit_numbers`."""
    return {**{name: one.unit for name, one in fit.parameters.items()}, "error": "% of force amplitude"}
