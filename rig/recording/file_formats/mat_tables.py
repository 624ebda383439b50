"""Tables and timetables in MATLAB files: objects of MATLAB, read by mat-io as they are stored.

A timetable's times are stored as durations in ms, or as dates in ms with the fraction as imaginary part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rig.signals.arrays import FloatArray

TABLES = frozenset(("table", "timetable"))


def tables(file: Path) -> Iterator[tuple[str, dict[str, FloatArray], dict[str, str]]]:
    """Each table's name, columns (time in s) and their units; the sizes in the file have been checked.

    Raises:
        ImportError: mat-io is not installed.
    """
    from matio import load_from_mat

    for name, value in load_from_mat(str(file), raw_data=True).items():
        kind = getattr(value, "classname", "")
        if kind in TABLES:
            yield name, *(_table if kind == "table" else _timetable)(value.properties)


def _table(properties: Mapping[str, Any]) -> tuple[dict[str, FloatArray], dict[str, str]]:
    return _columns(properties["varnames"], properties["data"], _field(properties["props"], "VariableUnits"))


def _timetable(properties: Mapping[str, Any]) -> tuple[dict[str, FloatArray], dict[str, str]]:
    held = properties["any"]
    names = [str(name) for name in _cells(_field(held, "dimNames"))]
    columns, units = _columns(_field(held, "varNames"), _field(held, "data"), _field(held, "varUnits"))
    rows = int(np.asarray(_inner(_field(held, "numRows"))).reshape(-1)[0])
    time_s = _row_times(_inner(_field(held, "rowTimes")), rows)
    if time_s is None:
        return columns, units
    name = names[0] if names else "Time"
    return {name: time_s, **columns}, {name: "s", **units}


def _columns(names: Any, data: Any, units: Any) -> tuple[dict[str, FloatArray], dict[str, str]]:  # noqa: ANN401 - nested
    columns: dict[str, FloatArray] = {}
    stated: dict[str, str] = {}
    texts = [str(text) for text in _cells(units)] if units is not None else []
    for k, (name, values) in enumerate(zip(_cells(names), _cells(data), strict=False)):
        time_s = _seconds(values)
        if time_s is not None:
            columns[str(name)], stated[str(name)] = time_s, "s"
        elif isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
            columns[str(name)] = values
            if k < len(texts) and texts[k] not in {"", "[]"}:
                stated[str(name)] = texts[k]
    return columns, stated


def _row_times(held: Any, rows: int) -> FloatArray | None:  # noqa: ANN401 - nested objects
    """Times of a timetable's rows (s): stored one by one, or as a rate or a step."""
    time_s = _seconds(held)
    if time_s is not None:
        return time_s
    step_s = _seconds(_inner(_field(held, "stepSize")))
    if step_s is not None and len(step_s) == 1 and step_s[0] > 0.0:
        return np.asarray(float(step_s[0]) * np.arange(rows), np.float64)
    rate = np.asarray(_inner(_field(held, "sampleRate")), np.float64).reshape(-1)
    return np.asarray(np.arange(rows) / rate[0], np.float64) if len(rate) == 1 and rate[0] > 0.0 else None


def _seconds(value: Any) -> FloatArray | None:  # noqa: ANN401 - nested objects
    """A duration, or a date counted from the first one (s, (n,)); None for anything else."""
    kind = getattr(value, "classname", "")
    if kind not in {"duration", "datetime"}:
        return None
    stored = np.asarray(value.properties["millis" if kind == "duration" else "data"]).reshape(-1)
    if kind == "duration":
        return np.asarray(stored.real, np.float64) * 1e-3
    steps = stored - stored[:1]
    return np.asarray(np.real(steps) + np.imag(steps), np.float64) * 1e-3


def _field(held: Any, name: str) -> Any:  # noqa: ANN401 - nested objects
    """A field of a struct, a dictionary or an array of one of them; None where it has none."""
    held = _inner(held)
    if isinstance(held, Mapping):
        return held.get(name)
    names = getattr(getattr(held, "dtype", None), "names", None) or ()
    if name not in names:
        return None
    value = held[name]
    single = isinstance(value, np.ndarray) and value.dtype.kind == "O" and value.size == 1
    return value.reshape(-1)[0] if single else value


def _inner(value: Any) -> Any:  # noqa: ANN401 - nested objects
    """What is in arrays of one object."""
    while isinstance(value, np.ndarray) and value.dtype.kind == "O" and value.size == 1:
        value = value.reshape(-1)[0]
    return value


def _cells(value: Any) -> list[Any]:  # noqa: ANN401 - nested objects
    """The elements of a cell array, texts as `str`."""
    cells = []
    elements = value.reshape(-1) if isinstance(value, np.ndarray) and value.dtype.kind == "O" else [value]
    for one in elements:
        inner = _inner(one)
        text = isinstance(inner, np.ndarray) and inner.dtype.kind in "US"
        cells.append((str(inner.reshape(-1)[0]) if inner.size else "") if text else inner)
    return cells
