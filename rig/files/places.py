"""Locations in a user's file: the line, the spelling of an entry, the table and field that contain it."""

from __future__ import annotations

import json
from typing import get_args, get_origin

from pydantic.fields import FieldInfo

from protocols.descriptions import Place
from rig.files.quantity import Settings
from rig.files.section import Section, Table, fields_of, key_of, suffixed_keys
from rig.files.toml_source import TomlSource, printable


def problem_at(source: TomlSource, place: Place, message: str) -> str:
    """One line about one place: `line 4: limits.speed = "9 m/s": too fast`."""
    line = source.line(place)
    value = value_at(source.data, place)
    entry = dotted(place) + (f" = {shown(value)}" if value is not None and not isinstance(value, dict) else "")
    return f"{f'line {line}: ' if line else ''}{entry}: {message}" if entry else message


def dotted(place: Place) -> str:
    """`("point", 1, "current")` as a user knows it: "point[2].current" (lists count from 1)."""
    text = ""
    for part in place:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{printable(part)}" if text else printable(part)
    return text


def shown(value: object) -> str:
    """A value as TOML writes it, shortened."""
    if isinstance(value, (str, bool)):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, (tuple, list)):
        text = "[" + ", ".join(shown(item) for item in value[:6]) + (", ..." if len(value) > 6 else "") + "]"
    else:
        text = str(value)
    return printable(text, 70)


def keys_of(section: Table) -> list[str]:
    """The keys that a table may have in a file."""
    return [key_of(section, name) for name in fields_of(section)]


def field_at(model: Table, place: Place) -> tuple[Table, FieldInfo | None]:
    """The section that holds a place, and its field there (None for an unknown key).

    Args:
        model: of the file.
        place: as the validator names it: of several tables that may be there, the one that was tried is in brackets.
    """
    section, field, tried, named = model, None, "", False
    for part in place:
        if isinstance(part, int):
            continue
        if part.startswith("["):
            tried = part
            continue
        if named:  # of a table whose keys are names of the user's
            named = False
            continue
        if field is not None:
            inner = section_in(field.annotation, tried)
            if inner is None:
                return section, field
            section, tried = inner, ""
        field = next((f for name, f in fields_of(section).items() if key_of(section, name) == part), None)
        if field is None:
            return section, None
        named = _names_tables(field.annotation)
    return section, field


def _names_tables(annotation: object) -> bool:
    """Whether a field holds tables by names that the user gives."""
    return get_origin(annotation) is dict or any(map(_names_tables, get_args(annotation)))


def section_in(annotation: object, tried: str = "") -> Table | None:
    """The table that a field holds, alone, in a list or as one of several (the one called `tried`); else None."""
    if isinstance(annotation, type) and issubclass(annotation, (Section, Settings)):
        return annotation if not tried or tried == f"[{annotation.__name__}]" else None
    return next(filter(None, (section_in(one, tried) for one in get_args(annotation))), None)


def as_written(place: Place, section: Table, data: object) -> Place:
    """The place with the key as it stands in the file: `amplitude` may be written `amplitude_mm`."""
    index = max(i for i, part in enumerate(place) if isinstance(part, str))
    if value_at(data, place[: index + 1]) is not None:
        return place
    for written, (key, _) in suffixed_keys(section).items():
        candidate = (*place[:index], written)
        if key == place[index] and value_at(data, candidate) is not None:
            return (*candidate, *place[index + 1 :])
    return place


def value_at(data: object, place: Place) -> object:
    """What a file has at a place; None where there is nothing."""
    for part in place:
        inside = data.get(part) if isinstance(data, dict) else None
        if isinstance(data, (tuple, list)) and isinstance(part, int) and part < len(data):
            inside = data[part]
        if inside is None:
            return None
        data = inside
    return data
