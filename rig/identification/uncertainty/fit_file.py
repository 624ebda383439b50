"""Reading and writing `fit.json`: the object of the file, dataclasses made of its entries, entries of dataclasses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from rig.errors import FileProblem
from rig.fit_file import FIX, read_fit
from rig.recording.point_files import campaign_in


class _Dataclass(Protocol):
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


Record = TypeVar("Record", bound=_Dataclass)

FIT_KEYS = ("model", "parameters", "error", "method")


def read_fit_object(path: Path) -> tuple[Path, dict[str, Any]]:
    """The file of a fit and its object; a campaign's folder stands for the `fit.json` in it.

    Raises:
        FileProblem: there is none, or it is no whole fit (`rig.fit_file`).
    """
    fit = read_fit(campaign_in(path) if path.is_dir() else path)
    missing = [f"{key}: is missing" for key in FIT_KEYS if fit.content.get(key) is None]
    if missing:
        raise FileProblem(str(fit.file), [*missing, FIX])
    return fit.file, dict(fit.content)


@contextmanager
def entries_of(path: Path) -> Iterator[None]:
    """What a wrong entry raises becomes a problem of the file.

    Raises:
        FileProblem: an entry is missing or not of its kind.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        text = f"not as `rig identify` writes it: {type(error).__name__}: {error}"
        raise FileProblem(str(path), [text, FIX]) from error


def record(kind: type[Record], entry: Mapping[str, Any], **known: object) -> Record:
    """A dataclass from an entry: lists as tuples, null as NaN where a number must stand; `known` fields as they are.

    Raises:
        TypeError: a field without default is missing.
        AttributeError: the entry is no object.
    """
    values: dict[str, Any] = {}
    for one in fields(kind):
        if one.name not in entry:
            continue
        value = entry[one.name]
        if value is None and one.type == "float":
            value = math.nan
        values[one.name] = tuple(value) if isinstance(value, list) else value
    return kind(**{**values, **known})


def number(value: float | None) -> float | None:
    """A number as JSON has it: null in place of what is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def plain(record: object) -> dict[str, Any]:
    """The fields of a dataclass, what is not finite as null."""
    return {key: number(value) if isinstance(value, float) else value for key, value in vars(record).items()}


def estimate_entry(estimate: object) -> dict[str, Any]:
    """The entry of a parameter's `Estimate`: its reason only where there is one."""
    entry = plain(estimate)
    if not entry["reason"]:
        del entry["reason"]
    return entry


def summary_entry(summary: object) -> dict[str, Any]:
    """The entry of an `ErrorSummary`: its numbers, then each test; a fitted one lies beyond nothing."""
    entry = plain(summary)
    tests = [plain(error) for error in entry["per_test"]]
    for test in tests:
        beyond = test.pop("beyond")
        test |= {} if beyond is None else {"beyond": list(beyond)}
    return {**entry, "per_test": tests}
