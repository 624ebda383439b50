"""From what the validator found to one clear line for each wrong entry: place, value, range, what would fit."""

from __future__ import annotations

import difflib
import json
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import ValidationError

from rig import units
from rig.bench.quantity import Quantity, Section, quantity_of
from rig.bench.toml_source import Place, TomlSource, read_toml
from rig.errors import FileProblem

if TYPE_CHECKING:
    from pathlib import Path

    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

M = TypeVar("M", bound=Section)

_KINDS = {
    "string_type": "a text in quotes",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "date_type": "a date such as 2030-01-01",
    "tuple_type": "a list in [ ]",
    "model_type": "a table",
    "dict_type": "a table",
}


def load_section(path: Path, model: type[M]) -> tuple[M, TomlSource]:
    """Read and validate a user's file.

    Returns:
        The validated model and its source.

    Raises:
        FileProblem: with every wrong entry of the file at once.
    """
    source = read_toml(path)
    try:
        return model.model_validate(source.data), source
    except ValidationError as error:
        details = _without_echoes(error.errors(include_url=False))
        lines = [line for item in details for line in _lines(item, model, source)]
        raise FileProblem(str(path), lines, "config-absurd") from error


def problem_at(source: TomlSource, place: Place, message: str) -> str:
    """One line about one place: `line 4: limits.speed = "9 m/s": too fast`."""
    line = source.line(place)
    value = _value_at(source.data, place)
    entry = dotted(place) + (f" = {shown(value)}" if value is not None and not isinstance(value, dict) else "")
    return f"{f'line {line}: ' if line else ''}{entry}: {message}" if entry else message


def dotted(place: Place) -> str:
    """`("point", 1, "current")` as a user knows it: "point[2].current" (lists count from 1)."""
    text = ""
    for part in place:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def shown(value: object) -> str:
    """A value as TOML writes it, shortened."""
    if isinstance(value, (str, bool)):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, (tuple, list)):
        text = "[" + ", ".join(shown(item) for item in value[:6]) + (", ..." if len(value) > 6 else "") + "]"
    else:
        text = str(value)
    return text if len(text) <= 70 else text[:66] + " ..."


def close_match(name: str, known: list[str]) -> str | None:
    """The known name a user most likely meant."""
    matches = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return matches[0] if matches else None


def _without_echoes(details: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out "too short" of lists whose items were refused: the items are what is wrong."""
    return [
        item
        for item in details
        if item["type"] != "too_short"
        or not any(other["loc"][:-1] == item["loc"] and other is not item for other in details)
    ]


def _lines(detail: ErrorDetails, model: type[Section], source: TomlSource) -> list[str]:
    context: dict[str, Any] = detail.get("ctx") or {}
    if "problems" in context:
        return [problem_at(source, (*detail["loc"], *place), message) for place, message in context["problems"]]
    place = tuple(part for part in detail["loc"] if isinstance(part, int) or "[" not in part)
    section, field = _field_at(model, place)
    written, quantity = place, quantity_of(field) if field else None
    if quantity is not None:
        written = _as_written(place, section, source)
    return [problem_at(source, written, _message(detail, section, quantity, str(place[-1]) if place else ""))]


def _message(detail: ErrorDetails, section: type[Section], quantity: Quantity | None, key: str) -> str:
    kind, context = detail["type"], detail.get("ctx") or {}
    if kind == "extra_forbidden":
        known = [section.key_of(name) for name in section.model_fields]
        match = close_match(key, [*known, *section.suffixed_keys()])
        return f"unknown key; did you mean {match}?" if match else f"unknown key; known here: {', '.join(known)}"
    if kind == "missing":
        example = f'; write for example {key} = "{units.DIMENSIONS[quantity.dimension].example}"' if quantity else ""
        return f"missing{example}"
    if kind in _KINDS:
        return f"must be {_KINDS[kind]}"
    if kind == "literal_error":
        value = str(detail["input"])
        match = close_match(value, [item.strip("'") for item in str(context["expected"]).split(", ")])
        return f"must be {context['expected']}" + (f"; did you mean {match}?" if match else "")
    if kind == "too_short":
        return "must not be empty"
    if kind == "too_long":
        return f"at most {context['max_length']} entries are allowed"
    if kind == "value_error":
        allowed = f" ({quantity.allowed})" if quantity and quantity.allowed else ""
        return f"{context['error']}{allowed}"
    text = detail["msg"]
    return (text[0].lower() + text[1:]).replace("input should", "must")


def _field_at(model: type[Section], place: Place) -> tuple[type[Section], FieldInfo | None]:
    """The section that holds a place, and its field there (None for an unknown key)."""
    section, field = model, None
    for part in place:
        if isinstance(part, int):
            continue
        if field is not None:
            inner = _section_in(field.annotation)
            if inner is None:
                return section, field
            section = inner
        field = next((f for name, f in section.model_fields.items() if section.key_of(name) == part), None)
        if field is None:
            return section, None
    return section, field


def _section_in(annotation: object) -> type[Section] | None:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    for part in get_args(annotation):
        if (found := _section_in(part)) is not None:
            return found
    return None


def _as_written(place: Place, section: type[Section], source: TomlSource) -> Place:
    """The place with the key as it stands in the file: `amplitude` may be written `amplitude_mm`."""
    index = max(i for i, part in enumerate(place) if isinstance(part, str))
    if _value_at(source.data, place[: index + 1]) is not None:
        return place
    for written, (key, _) in section.suffixed_keys().items():
        candidate = (*place[:index], written)
        if key == place[index] and _value_at(source.data, candidate) is not None:
            return (*candidate, *place[index + 1 :])
    return place


def _value_at(data: object, place: Place) -> object:
    for part in place:
        inside = data.get(part) if isinstance(data, dict) else None
        if isinstance(data, (tuple, list)) and isinstance(part, int) and part < len(data):
            inside = data[part]
        if inside is None:
            return None
        data = inside
    return data
