"""Cached measurements of recorded points: fits, reports and comparisons prepare each point only once."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from rig.identification.models.measurement import Measurement, MotionError
from rig.identification.remarks import known_remark
from rig.recording.point_cache import Entry, PointCache
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint

NAME = "prepared"
SINGLE = {one.name for one in fields(Measurement) if one.type in {"str", "float", "int", "bool"}} - {"file"}
"""Scalar fields (text, number or boolean), without the file's path, which changes if the run is moved."""
ERROR = "motion_error."


def cached_measurement(
    point: RecordedPoint, skew: PointSkew | None, prepare: Callable[[RecordedPoint, PointSkew | None], Measurement]
) -> Measurement:
    """Return the cached measurement of a point for the same data and code, or prepare and cache it.

    Args:
        point: the point.
        skew: as in `prepare`.
        prepare: creates the measurement.
    """
    cache = PointCache(point, NAME, repr(skew))
    entry = cache.read()
    if entry is not None:
        with contextlib.suppress(KeyError, TypeError, ValueError):  # an entry that this program did not write
            return _read(entry, str(point.path))
    made = prepare(point, skew)
    cache.write(_entry(made))
    return made


def _entry(test: Measurement) -> Entry:
    values = {name: getattr(test, name) for name in SINGLE}
    arrays = {name: one for name, one in vars(test).items() if isinstance(one, np.ndarray)}
    warnings = [[str(one), one.slug, dict(one.numbers)] for one in test.warnings]
    error = test.motion_error
    together = None
    if error is not None:
        arrays |= {f"{ERROR}rates_rad_s": error.rates_rad_s, f"{ERROR}errors_m": error.errors_m}
        if error.together_m is not None:
            together = error.together_m.shape
            arrays[f"{ERROR}together_m"] = error.together_m.ravel()
    return Entry({
        "single": values, "warnings": warnings, "mean_error_m": None if error is None else error.mean_error_m,
        "together": together,
    }, arrays)  # fmt: skip


def _read(entry: Entry, file: str) -> Measurement:
    known: dict[str, Any] = {**entry.values["single"], **entry.arrays}
    mean_error_m, together = entry.values["mean_error_m"], entry.values["together"]
    of_error = {name: known.pop(name) for name in list(known) if name.startswith(ERROR)}
    error = None
    if mean_error_m is not None:
        error = MotionError(
            of_error[f"{ERROR}rates_rad_s"], of_error[f"{ERROR}errors_m"], mean_error_m,
            None if together is None else of_error[f"{ERROR}together_m"].reshape(together),
        )
    warnings = tuple(known_remark(text, slug, numbers) for text, slug, numbers in entry.values["warnings"])
    return Measurement(**known, file=file, motion_error=error, warnings=warnings)
