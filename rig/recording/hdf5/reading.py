"""Reading a point's file into plain values; every access goes through `rig.recording.hdf5.hdf5_check`."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import FileProblem
from rig.recording.hdf5.hdf5_check import check_file
from rig.recording.hdf5.hdf5_objects import attributes_of
from rig.recording.layout import FORMAT_VERSION, check_of
from rig.recording.memory import check_memory
from rig.recording.point_attributes import MOTION, NAMES, STEPS, TEXTS, commanded_of, point_fields
from rig.recording.point_files import name_problem
from rig.recording.quality.point_quality import PointQuality
from rig.verdicts import VERDICTS

if TYPE_CHECKING:
    import h5py

SENSOR_ATTRIBUTES = (
    "units", "long_name", "sensor", "serial_number", "sensitivity", "offset", "certificate", "due", "overdue",
    "uncertainty_percent", "delay_s", "range_SI", "rate_Hz",
)
MEMORY_OF_A_SAMPLE = 200
"""Bytes of memory needed per sample to evaluate a point."""


CYCLES = "entry/cycles"
DESCRIBED = tuple(f"entry/{name}" for name in ("test", "quality", "provenance", "data"))
"""The groups whose attributes describe a point."""


def read_description(path: Path, *, whole: bool = True) -> dict[str, Any]:
    """The keyword arguments of `RecordedPoint` that a file holds, without its arrays.

    Args:
        path: the file.
        whole: check all of the file, as one from outside demands; else only what is read here.

    Raises:
        FileProblem: one line for each attribute that is missing or has an impossible value.
    """
    with opened(path, None if whole else DESCRIBED) as file:
        test, quality, provenance = (attributes(file, name) for name in ("test", "quality", "provenance"))
        rate = _number(attributes(file, "data").get("sample_rate_hz"))
    requested: dict[str, Any] = {name: _number(test.get(name)) for name in NAMES - TEXTS}
    requested |= {name: str(test[name]) for name in TEXTS & test.keys()}
    fields: dict[str, Any] = {}
    problems = [
        f"/entry/test: {name} is missing" for name in MOTION if name in TEXTS and not isinstance(test.get(name), str)
    ]
    problems += [
        f"/entry/test: {name} = {test.get(name)!r}; expected a finite number" for name in MOTION
        if name not in TEXTS and requested[name] is None
    ]
    if not problems:
        try:
            fields = point_fields(requested)
        except ValueError:
            problems.append(f"/entry/test: {STEPS} = {test.get(STEPS)!r:.60}; expected currents in A")
    if isinstance(test.get("id"), str) and (problem := name_problem(test["id"])):
        problems.append(f"/entry/test: id = {problem}")
    verdict = quality.get("verdict", "valid")
    if verdict not in VERDICTS:
        problems.append(f"/entry/quality: verdict = {verdict!r}; expected one of {', '.join(VERDICTS)}")
    for name in ("reasons", "reason_kinds"):
        texts = quality.get(name, ())
        texts = quality[name] = (texts,) if isinstance(texts, str) else texts
        if not isinstance(texts, tuple) or not all(isinstance(text, str) for text in texts):
            problems.append(f"/entry/quality: {name} = {texts!r}; expected texts")
    if problems:
        raise FileProblem(str(path), problems)
    return fields | {
        "repeat": int(fields["repeat"]) or 1,
        "commanded": commanded_of(requested),
        "mid_stroke_m": _number(test.get("mid_stroke_m")),
        "verdict": verdict,
        "reasons": quality["reasons"],
        "lost_samples": int(_number(quality.get("lost_samples")) or 0),
        "skew_s": _number(quality.get("skew_s")) or 0.0,
        "skew_std_s": _number(quality.get("skew_std_s")) or 0.0,
        "sample_rate_Hz": rate or 0.0,
        "imported": bool(_number(test.get("imported")) or 0),
        "test": test, "quality": PointQuality.read(quality), "provenance": provenance,
    }


def check_values(path: Path) -> None:
    """Read every column of a file, as its checksums allow: a disk may have lost what its description still tells.

    Raises:
        FileProblem: the file cannot be trusted, or columns cannot be read: each.
    """
    problems: list[str] = []

    def read(_name: str, place: Any) -> None:  # noqa: ANN401 - h5py has no types
        if hasattr(place, "dtype"):
            try:
                _values(path, place)
            except FileProblem as error:
                problems.extend(error.problems)

    with opened(path) as file:
        file.visititems(read)
    if problems:
        raise FileProblem(str(path), problems)


def channel_names(path: Path) -> list[str]:
    """Names of the aligned channels a file holds, time among them.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    with opened(path) as file:
        return list(file["entry/data"])


def read_channel(path: Path, name: str) -> NDArray[Any] | None:
    """One aligned channel (n,), None when the file does not hold it.

    Raises:
        FileProblem: the file fails its checks, the length of the channel differs from that of the time, or there is not
            enough memory to evaluate the samples.
    """
    with opened(path) as file:
        data = file["entry/data"]
        if name not in data:
            return None
        if name == "time":
            check_memory(path, MEMORY_OF_A_SAMPLE * data["time"].size, "record or import shorter tests")
        if data[name].shape != data["time"].shape:
            raise FileProblem(str(path), [
                f"/entry/data/{name} has shape {data[name].shape}, but time has {data['time'].shape}",
            ])
        return _values(path, data[name])


def channel_attributes(path: Path, name: str) -> dict[str, Any]:
    """Attributes of one aligned channel: units, sensor, calibration; empty when the file does not hold it.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    with opened(path) as file:
        data = file["entry/data"]
        if name not in data:
            return {}
        return {key: _plain(value) for key, value in data[name].attrs.items() if key in SENSOR_ATTRIBUTES}


def read_raw(path: Path, name: str) -> dict[str, NDArray[Any]] | None:
    """The columns of one channel as received, None when the file does not hold it.

    Raises:
        FileProblem: the file cannot be trusted, or the columns differ in length.
    """
    return _columns(path, f"entry/raw/{name}")


def read_cycles(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]] | None:
    """The statistics of every cycle of an endurance block (k,) by name; None of any other point.

    Args:
        path: the file.
        names: read, and check, only these columns and nothing else of a file of one's own campaign; None: all of them.

    Raises:
        FileProblem: the file cannot be trusted, the columns differ in length, or the numbers of the cycles are missing.
    """
    columns = _columns(path, CYCLES, names)
    if columns is not None and "number" not in columns:
        raise FileProblem(str(path), ["/entry/cycles: the column number is missing"])
    return columns


def _columns(path: Path, place: str, names: Collection[str] | None = None) -> dict[str, NDArray[Any]] | None:
    """The columns of a group (n,) by name, of `names` those that exist; None if there is no such group.

    Raises:
        FileProblem: the file cannot be trusted, or the columns differ in length.
    """
    with opened(path, None if names is None else (place,), "" if names is None else place) as file:
        if place not in file:
            return None
        group = file[place]
        columns = {key: _values(path, group[key]) for key in group if names is None or key in names}
    if len({len(column) for column in columns.values()}) > 1:
        lengths = {key: len(column) for key, column in columns.items()}
        raise FileProblem(str(path), [f"/{place}: columns of different lengths: {lengths}"])
    return columns


def clock_std_s(path: Path, name: str) -> float | None:
    """Standard uncertainty of a channel's place on the time base (s); None where the file does not state it.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    with opened(path) as file:
        group = file.get(f"entry/raw/{name}")
        return None if group is None else _number(group.attrs.get("clock_std_s"))


def read_events(path: Path) -> list[tuple[int, str, str]]:
    """The events of a point: time (ns on the file's time base), slug, text.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    with opened(path) as file:
        if "entry/events" not in file:
            return []
        group = file["entry/events"]
        times, codes, texts = (_values(path, group[name]) for name in ("time_ns", "code", "text"))
    return [(int(t), _text(c), _text(x)) for t, c, x in zip(times, codes, texts, strict=True)]


@contextmanager
def opened(path: Path, groups: Iterable[str] | None = None, tree: str = "") -> Iterator[h5py.File]:
    """The checked HDF5 file, closed afterwards; only `groups` (of `tree` everything) are checked if no more is read.

    Raises:
        FileProblem: it cannot be trusted, is of a newer format, or lacks the layout's groups.
    """
    file = check_file(path, groups, tree)
    try:
        version = _number(file.attrs.get("format_version"))
        if version is None or version > FORMAT_VERSION:
            shown = "none" if version is None else f"{version:g}"
            raise FileProblem(str(path), [
                f"format_version: {shown}; this software reads versions up to {FORMAT_VERSION}"
            ])
        if "entry/data/time" not in file:
            raise FileProblem(str(path), ["/entry/data/time is missing: this file is not a recorded point"])
        yield file
    finally:
        file.close()


def attributes(file: h5py.File, name: str) -> dict[str, Any]:
    """The attributes of `/entry/<name>` as plain Python values: text, numbers, tuples of text."""
    if f"entry/{name}" not in file:
        return {}
    return {key: _plain(value) for key, value in attributes_of(file[f"entry/{name}"]) if key != "NX_class"}


def _plain(value: object) -> object:
    if isinstance(value, bytes | np.bytes_):
        return _text(value)
    if isinstance(value, np.ndarray):
        return tuple(_plain(item) for item in value)
    if isinstance(value, np.generic):
        return value.item()
    return value


def _text(value: bytes | np.bytes_) -> str:
    text = value.decode("utf-8", "replace")
    return "" if text == " " else text


def _number(value: object) -> float | None:
    if isinstance(value, (int, float, np.number)) and math.isfinite(float(value)):
        return float(value)
    return None


def _values(path: Path, dataset: h5py.Dataset) -> NDArray[Any]:
    try:
        values = np.asarray(dataset[...])
    except OSError as error:
        raise FileProblem(str(path), [f"{dataset.name}: damaged: {error}"]) from error
    checksum = dataset.attrs.get("crc32")
    if checksum is not None and not np.array_equal(checksum, check_of(values)):
        raise FileProblem(str(path), [f"{dataset.name}: the data are damaged: the values do not match their checksum"])
    return values
