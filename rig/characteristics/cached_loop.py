"""Cached characteristics of recorded loops: each loop is evaluated only once."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from dataclasses import astuple, fields
from typing import Any

import numpy as np

from rig.characteristics.loop import LoopCharacteristics, Measured, characterise_loop
from rig.identification.models.measurement import Measurement
from rig.recording.point_cache import Entry, PointCache
from rig.recording.recorded_point import RecordedPoint
from rig.signals.peak_force import PeakForce
from rig.signals.test_set import CurrentReading, MotionReading

NAME = "loop"
MOTION = [one.name for one in fields(MotionReading)]
MEASURED = {one.name for one in fields(LoopCharacteristics) if one.type == "Measured"}


def cached_loop(point: RecordedPoint, measured: Measurement) -> LoopCharacteristics:
    """Return the cached result of `characterise_loop` for the same data and code, or compute and cache it.

    Raises:
        RigError: too little of the point can be used; the message says why.
    """
    cache = PointCache(point, NAME, _digest(measured))
    entry = cache.read()
    if entry is not None:
        with contextlib.suppress(KeyError, TypeError, ValueError):  # an entry that this program did not write
            return _read(entry.values)
    made = characterise_loop(point, measured)
    cache.write(Entry(_values(made), {}))
    return made


def _digest(measured: Measurement) -> str:
    """SHA-256 of a measurement, independent of its source."""
    digest = hashlib.sha256()
    for one in fields(measured):
        value = getattr(measured, one.name)
        if isinstance(value, np.ndarray):
            digest.update(value.tobytes())
        elif one.name == "motion_error":
            digest.update(b"" if value is None else value.errors_m.tobytes())
        elif one.name != "file":
            digest.update(repr(value).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()


def _values(loop: LoopCharacteristics) -> dict[str, Any]:
    values = dict(vars(loop))
    values |= {name: astuple(values[name]) for name in MEASURED}
    current = None if loop.current is None else astuple(loop.current)
    return values | {"current": current, "motion_read": astuple(loop.motion_read)}


def _read(values: Mapping[str, Any]) -> LoopCharacteristics:
    known = dict(values)
    known |= {name: Measured(*known[name]) for name in MEASURED}
    motion = dict(zip(MOTION, known["motion_read"], strict=True))
    motion["requested"] = None if motion["requested"] is None else tuple(motion["requested"])
    return LoopCharacteristics(**known | {
        "current": None if known["current"] is None else CurrentReading(*known["current"]),
        "motion_read": MotionReading(**motion),
        "group": tuple(known["group"]), "peak_force_N": PeakForce(*known["peak_force_N"]),
    })
