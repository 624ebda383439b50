"""From the validator's errors to one clear line for each wrong entry: location, value, range, what would fit."""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from annotated_types import Ge, Gt, Le, Lt, MaxLen
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from protocols.descriptions import Place, Problem
from protocols.near_miss import near_names
from rig import units
from rig.errors import FileProblem
from rig.files.places import as_written, dotted, field_at, keys_of, problem_at, section_in, shown, value_at
from rig.files.quantity import Quantity, Text, Wording
from rig.files.section import Section, Table, constraints, fields_of, key_of, quantity_of, suffixed_keys
from rig.files.toml_source import TomlSource, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from pydantic_core import ErrorDetails

M = TypeVar("M", bound=Section)

MOST_SHOWN = 40
"""Wrong entries shown of one file; who has more has one cause for most of them."""

_KINDS = {
    "string_type": "a string in quotes",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "date_type": "a date such as 2030-01-01",
    "date_from_datetime_inexact": "a date such as 2030-01-01",
    "date_from_datetime_parsing": "a date such as 2030-01-01",
    "tuple_type": "a list in [ ]",
    "model_type": "a table",
    "dataclass_type": "a table",
    "dict_type": "a table",
}
_BEYOND = {
    "greater_than": "too small", "greater_than_equal": "too small",
    "less_than": "too large", "less_than_equal": "too large",
}  # fmt: skip
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_TEXTS = ("string_pattern_mismatch", "string_too_short", "string_too_long")

TABLES = {
    "bench": frozenset(
        {"limits", "actuator", "ecu", "load_cell", "lvdt", "auxiliary", "fixture", "clock", "station", "checks"}
    ),
    "matrix": frozenset(
        {"specimen", "matrix", "point", "friction", "current_step", "response", "hybrid", "temperature", "acceptance",
         "line", "identify", "campaign", "report"}
    ),
    "benchmark": frozenset({"benchmark", "recordings"}),
    "study": frozenset({"data", "comparison", "symmetry", "sensitivity", "parallel", "per_current"}),
    "car": frozenset({"body", "front", "rear"}),
    "road": frozenset({"sweep", "random", "bump", "pothole", "profile", "drive"}),
    "bands": frozenset({
        "rebound_force", "jounce_force", "energy", "damping", "dynamic_range", "friction_force", "gas_force",
        "parameter",
    }),
}
"""Tables by which a file is recognised for what it is; a test compares them with the models. `[display]` is in two."""
_PLACES = {
    "bench": "rig plan MATRIX --bench {path}",
    "matrix": "rig plan {path} --bench BENCH",
    "study": "rig study {path}",
    "benchmark": "rig study {path}",
    "car": "rig ride FIT --car {path}",
    "road": "rig ride FIT --road {path}",
    "bands": "rig compare RUN --bands {path}",
}


class WrongKind(FileProblem):
    """Another of the user's files than the one that is wanted; `kind` is what it is: `bench`, `matrix`, `study`."""

    def __init__(self, path: Path, kind: str, expected: str) -> None:
        self.kind = kind
        place = _PLACES[kind].format(path=path)
        super().__init__(str(path), [f"this is a {kind} file, expected a {expected} file. Fix: pass it as {place}"])


def load_section(
    path: Path, model: type[M], kind: str = "", located: Callable[[Mapping[str, Any], Path], Any] | None = None
) -> tuple[M, TomlSource]:
    """Read and validate a user's file.

    Args:
        path: the file.
        model: what it holds.
        kind: a key of `TABLES`: a file of another kind is called so, in one line.
        located: makes the names of further files whole; given the data and the file's folder.

    Returns:
        The validated model and its source.

    Raises:
        WrongKind: it is another of the user's files.
        FileProblem: with every wrong entry of the file at once (the first `MOST_SHOWN` of them).
    """
    source = read_toml(path)
    if not source.data:
        way = f"; `rig schema {kind}` prints every key" if kind in {"bench", "matrix"} else ""
        raise FileProblem(str(path), [f"this file has no entries; docs/files.md describes its format{way}"])
    if kind and not source.data.keys() & TABLES[kind]:
        for other, tables in TABLES.items():
            if source.data.keys() & tables:
                raise WrongKind(path, other, kind)
    data = source.data if located is None else located(source.data, path.absolute().parent)
    made, problems = validated(data, model)
    if made is None:
        raise FileProblem(str(path), lines_of(source, problems), "config-absurd")
    return made, source


def validated(data: Mapping[str, Any], model: type[M]) -> tuple[M | None, list[Problem]]:
    """The data as a model, or None and what is wrong: where in the data (keys as they are written), and what.

    Of more than `MOST_SHOWN` wrong entries the rest is counted in the last problem.
    """
    try:
        return model.model_validate(data), []
    except ValidationError as error:
        details = _without_echoes(error.errors(include_url=False), model)
    problems = [problem for item in details[:MOST_SHOWN] for problem in _problems(item, model, data)]
    if len(details) > MOST_SHOWN:
        problems.append(((), f"{len(details) - MOST_SHOWN} further errors omitted; fix these first"))
    return None, problems


def lines_of(source: TomlSource, problems: Sequence[Problem]) -> list[str]:
    """What is wrong with a file, a line for each entry in the file's order; what has no line comes last."""
    ordered = sorted(problems, key=lambda problem: source.line(problem[0]) or sys.maxsize)
    return [problem_at(source, place, message) for place, message in ordered]


def _without_echoes(details: list[ErrorDetails], model: Table) -> list[ErrorDetails]:
    """Leave out what follows: "too short" where the list's items were refused, "missing" where the key is misspelt."""
    lists = {item["loc"][:-1] for item in details}
    missing = {item["loc"] for item in details if item["type"] == "missing"}
    misspelt = set[tuple[str | int, ...]]()
    for item in details[:MOST_SHOWN]:
        if item["type"] in _UNKNOWN:
            section, _ = field_at(model, item["loc"])
            misspelt.add((*item["loc"][:-1], _meant(section, str(item["loc"][-1]))))
    gone = {"too_short": lists, "missing": missing & misspelt}
    return [item for item in details if item["loc"] not in gone.get(item["type"], ())]


def _meant(section: Table, key: str) -> str:
    """The key that an unknown one resembles, without the unit that may end it; empty where there is none."""
    suffixed = suffixed_keys(section)
    meant = next(iter(near_names(key, [*keys_of(section), *suffixed])), "")
    return suffixed.get(meant, (meant,))[0]


def _place(detail: ErrorDetails, data: object) -> Place:
    """Where something is wrong; of several things the validator may have tried, none is named."""
    place: Place = ()
    for part in detail["loc"]:
        holder = value_at(data, place)
        tried = "[" in part if isinstance(part, str) else not isinstance(holder, (tuple, list))
        if not tried or value_at(data, (*place, part)) is not None:
            place = (*place, part)
    return place


def _problems(detail: ErrorDetails, model: Table, data: object) -> list[Problem]:
    """Places and messages of one thing that the validator has found."""
    context: dict[str, Any] = detail.get("ctx") or {}
    place = _place(detail, data)
    if "problems" in context:
        return [(_written((*place, *inside), model, data), message) for inside, message in context["problems"]]
    section, field = field_at(model, detail["loc"])
    written = place
    if field is not None and quantity_of(field) is not None:
        written = as_written(place, section, data)
    if detail["type"] in _UNKNOWN:
        message = _unknown_key(model, section, str(place[-1]))
    elif detail["type"] == "missing":
        message = _missing(field, place)
    else:
        message = _message(detail, field)
    return [(written, message)]


def _written(place: Place, model: Table, data: object) -> Place:
    """A place inside a table with its key as it is in the file: `speed` may be written `speed_mm_s`."""
    return as_written(place, field_at(model, place)[0], data) if any(isinstance(part, str) for part in place) else place


def _unknown_key(model: Table, section: Table, key: str) -> str:
    """Where an unknown key belongs, else which key was meant, else which there are."""
    homes = [f"[{name}]" for name, table in _tables(model) if table is not section and key in keys_of(table)]
    for name, field in fields_of(model).items() if section is not model else ():
        if key_of(model, name) == key and section_in(field.annotation) is None:
            homes.append("the top of the file, before the first table")
    if homes:
        # A key that several tables have, such as `name`, may not be intended for any of them.
        others = f"; allowed here: {', '.join(keys_of(section))}" if len(homes) > 1 else ""
        return f"this key is not allowed here. Fix: move it to {' or '.join(homes)}{others}"
    other_names: Mapping[str, str] = getattr(section, "other_names", {})
    if key in other_names:
        return f"unknown key; did you mean {other_names[key]}?"
    known = keys_of(section)
    near = near_names(key, [*known, *suffixed_keys(section)])
    return f"unknown key; did you mean {near[0]}?" if near else f"unknown key; allowed here: {', '.join(known)}"


def _tables(model: Table) -> Iterator[tuple[str, Table]]:
    """Name and section of every table that a file may have."""
    for name, field in fields_of(model).items():
        table = section_in(field.annotation)
        if table is not None:
            yield key_of(model, name), table
            yield from ((f"{key_of(model, name)}.{inner}", below) for inner, below in _tables(table))


def _missing(field: FieldInfo | None, place: Place) -> str:
    """What to write where something is missing."""
    key = place[-1]
    if field is None:
        return "missing"
    if isinstance(key, int):
        return f"missing; the list needs {len(get_args(field.annotation))} entries"
    table = section_in(field.annotation)
    if table is not None and not field.examples:  # an example shows the simpler form of what may also be a table
        # Where one of several kinds of device may stand, no key is needed by all: the first kind's are shown.
        heading = key if any(isinstance(part, int) for part in place) else dotted(place)
        return f"missing; write a table [{heading}] with {_needed(table)}"
    example = _example(field)
    return "missing" + (f"; write, for example, {key} = {example}" if example else "")


def _needed(table: Table) -> str:
    """The keys that a table must have; its first two where it needs none."""
    needed = [key_of(table, name) for name, inner in fields_of(table).items() if inner.is_required()]
    return ", ".join(needed or keys_of(table)[:2])


def _message(detail: ErrorDetails, field: FieldInfo | None) -> str:
    kind, context = detail["type"], detail.get("ctx") or {}
    limits = [] if field is None else list(constraints(field))
    if kind == "tuple_type" and field is not None and section_in(field.annotation) is not None:
        return f"each entry needs its own heading in double brackets: [[{detail['loc'][-1]}]]"
    if kind in _KINDS:
        table = section_in(field.annotation) if field is not None and _KINDS[kind] == "a table" else None
        return f"must be {_KINDS[kind]}{_allowed(limits)}" + (f" with {_needed(table)}" if table is not None else "")
    if kind in _BEYOND:
        return f"{_BEYOND[kind]}{_allowed(limits)}"
    if kind in _TEXTS:
        return _text_message(kind, limits)
    if kind == "literal_error":
        return _not_among(str(context["expected"]), detail["input"])
    if kind == "too_short":
        return f"at least {context['min_length']} entries are required" if context["min_length"] > 1 else "is empty"
    if kind == "too_long":
        return f"at most {context['max_length']} entries are allowed"
    if kind == "value_error":
        return str(context["error"])
    text = detail["msg"]
    return (text[0].lower() + text[1:]).replace("input should", "must")


def _not_among(expected: str, value: object) -> str:
    if "'" not in expected:
        return f"must be {expected}" + ("; write the number without quotes" if isinstance(value, str) else "")
    near = near_names(str(value), re.findall(r"'([^']*)'", expected))
    return f"must be {expected}" + (f"; did you mean {near[0]}?" if near else "")


def _text_message(kind: str, limits: list[object]) -> str:
    """What is wrong with a text: its shape in words, never as a pattern."""
    for item in limits:
        wording = item.wording if isinstance(item, Text) else item
        if isinstance(wording, Wording):
            return f'must be {wording.words}, for example "{wording.example}"'
    if kind == "string_too_short":
        return "must not be empty"
    lengths = [item.max_length if isinstance(item, MaxLen) else item.longest for item in limits
               if isinstance(item, MaxLen | Text)]  # fmt: skip
    most = next(iter(lengths), 0)
    return f"must have at most {most} characters" if most else "is not allowed here"


def _allowed(limits: list[object]) -> str:
    """The range of a quantity or a plain number in parentheses; empty where there is none."""
    low = high = ""
    for item in limits:
        if isinstance(item, Quantity):
            return f" ({item.allowed})" if item.allowed else ""
        if isinstance(item, Ge | Gt):
            low = f"{item.ge}" if isinstance(item, Ge) else f"more than {item.gt}"
        if isinstance(item, Le | Lt):
            high = f"{item.le}" if isinstance(item, Le) else f"less than {item.lt}"
    if low and high:
        return f" (allowed: {low} to {high})"
    if low:
        return f" (allowed: {low if low.startswith('more') else f'at least {low}'})"
    return f" (allowed: at most {high})" if high else ""


def _example(field: FieldInfo) -> str:
    """How a missing key could be written, as TOML; empty if unknown."""
    if field.examples:
        return shown(field.examples[0])
    for item in constraints(field):
        if isinstance(item, FieldInfo) and item.examples:
            return shown(item.examples[0])
        wording = item.wording if isinstance(item, Text) else item
        if isinstance(wording, Wording):
            return shown(wording.example)
        if isinstance(item, Quantity):
            return shown(units.DIMENSIONS[item.dimension].example)
    return "1" if get_args(field.annotation) == (1,) else ""


