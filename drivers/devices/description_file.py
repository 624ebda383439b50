"""A device's description, read without trust: a small file of text, and entries of the kind they must be."""

from __future__ import annotations

import contextlib
import difflib
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from protocols.errors import LocalProtocolError

LARGEST_BYTES = 262_144


def read_text(path: Path, also: str = "utf-8") -> str:
    """A description's text: UTF-8, or else in the encoding `also`.

    Raises:
        LocalProtocolError: not there, unreadable, no file, too large, or in neither encoding.
    """
    try:
        if not path.is_file():
            raise LocalProtocolError(f"{path}: there is no such file")
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise LocalProtocolError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > LARGEST_BYTES:
        raise LocalProtocolError(f"{path}: larger than the {LARGEST_BYTES // 1024} KiB that a description may have")
    with contextlib.suppress(UnicodeDecodeError):
        return data.decode("utf-8-sig")
    try:
        return data.decode(also)
    except UnicodeDecodeError as error:
        raise LocalProtocolError(
            f"{path}: byte {error.start} is 0x{data[error.start]:02X}, which is not UTF-8 text; save it as UTF-8"
        ) from error


def read_description(path: Path) -> dict[str, Any]:
    """A description's entries.

    Raises:
        LocalProtocolError: it cannot be read, or is not TOML.
    """
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise LocalProtocolError(f"{path}: not TOML: {error}") from error


def table(given: Mapping[str, Any], key: str, place: str) -> Mapping[str, Any]:
    """The table `key`.

    Raises:
        LocalProtocolError: it is missing or no table; `place` is its heading.
    """
    value = given.get(key)
    if value is None:
        raise LocalProtocolError(f"[{place}] is missing")
    if not isinstance(value, Mapping):
        raise LocalProtocolError(f"{place} = {value!r:.40}: must be a table, with the heading [{place}]")
    return value


def only(given: Collection[str], known: Collection[str], place: str) -> None:
    """Refuse names that mean nothing here.

    Raises:
        LocalProtocolError: one of them; what it could have been.
    """
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise LocalProtocolError(f"{place}: {name!r} is not one of {', '.join(known)}{hint}")


def all_of(given: Collection[str], needed: Collection[str], place: str, reason: str) -> None:
    """Refuse what lacks a name.

    Raises:
        LocalProtocolError: the first of `needed` that is not there.
    """
    for name in needed:
        if name not in given:
            raise LocalProtocolError(f"{place}: {name!r} is missing; {reason} needs it")


def whole(value: object, low: int, high: int, place: str) -> int:
    """A whole number of that range.

    Raises:
        LocalProtocolError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise LocalProtocolError(_wrong(value, place, f"a whole number of {low} to {high}"))
    return value


def number(value: object, place: str) -> float:
    """A plain number.

    Raises:
        LocalProtocolError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise LocalProtocolError(_wrong(value, place, "a number"))
    return value


def text(value: object, place: str) -> str:
    """A text.

    Raises:
        LocalProtocolError: it is none.
    """
    if not isinstance(value, str):
        raise LocalProtocolError(_wrong(value, place, "a text in quotes"))
    return value


def truth(value: object, place: str) -> bool:
    """True or false.

    Raises:
        LocalProtocolError: neither.
    """
    if not isinstance(value, bool):
        raise LocalProtocolError(_wrong(value, place, "true or false"))
    return value


def distinct(codes: Mapping[str, int], place: str) -> None:
    """Refuse one number for two names.

    Raises:
        LocalProtocolError: two that are the same.
    """
    names: dict[int, str] = {}
    for name, code in codes.items():
        if code in names:
            raise LocalProtocolError(f"{place}: {names[code]} and {name} are both {code}; a code has one meaning")
        names[code] = name


def _wrong(value: object, place: str, wanted: str) -> str:
    return f"{place} is missing; write {wanted}" if value is None else f"{place} = {value!r:.40}: must be {wanted}"
