"""Settings read back from the JSON that `StationConfig.to_json` wrote, with the declared types and ranges.

Generic over frozen dataclasses; the station process reads its configuration with it, without a validator package.
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from datetime import date
from typing import Annotated, Any, Literal, TypeVar

from rig.bench.settings import StationConfig
from rig.errors import RigError
from rig.files.quantity import Settings

T = TypeVar("T")


class ConfigProblem(RigError):
    """An entry of the station's configuration is missing, unknown, of the wrong type or out of range."""

    slug = "config-absurd"


def from_json(text: str) -> StationConfig:
    """Read what `StationConfig.to_json` wrote.

    Raises:
        ConfigProblem: not JSON, or an entry is missing, unknown, of the wrong type or out of range; all are named.
    """
    try:
        data = json.loads(text)
    except ValueError as error:
        raise ConfigProblem(f"the station's configuration is not JSON: {error}") from error
    return _build(StationConfig, data, "")


def _build(cls: type[T], data: object, where: str) -> T:
    if not isinstance(data, dict):
        raise ConfigProblem(f"{where or 'configuration'}: expected a mapping, got {data!r}")
    hints = typing.get_type_hints(cls, include_extras=True)
    known = {item.name: item for item in dataclasses.fields(cls)}  # type: ignore[arg-type]  # only dataclasses come here
    problems = [f"{where}{name}: unknown entry" for name in data if name not in known]
    values: dict[str, Any] = {}
    for name, item in known.items():
        if name in data:
            try:
                values[name] = _in_range(_convert(hints[name], data[name], f"{where}{name}"), item.metadata)
            except ConfigProblem as problem:
                problems.append(str(problem))
            except ValueError as problem:
                problems.append(f"{where}{name} = {data[name]!r}: {problem}")
        elif item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
            problems.append(f"{where}{name}: missing")
    if problems:
        raise ConfigProblem("; ".join(problems))
    built = cls(**values)
    if isinstance(built, Settings):
        problems += [f"{where}{'.'.join(map(str, place))}: {problem}" for place, problem in built.problems()]
    if problems:
        raise ConfigProblem("; ".join(problems))
    return built


def _in_range(value: Any, shape: typing.Mapping[str, Any]) -> Any:  # noqa: ANN401 - whatever the field holds
    """The value as it is, inside what the field's metadata allow.

    Raises:
        ValueError: it is outside.
    """
    if value is not None:
        if not shape.get("ge", -math.inf) <= (value if "ge" in shape else 0) <= shape.get("le", math.inf):
            raise ValueError(f"allowed: {shape['ge']} to {shape.get('le', 'any')}")
        if "max_length" in shape and len(value) > shape["max_length"]:
            raise ValueError(f"got a length of {len(value)}, expected at most {shape['max_length']}")
    return value


def _convert(hint: Any, value: Any, where: str) -> Any:  # noqa: ANN401 - any annotation, any JSON value
    """A JSON value as the annotation wants it, its own checks made.

    Raises:
        ConfigProblem: it is of another type.
        ValueError: a check refuses it.
    """
    origin = typing.get_origin(hint)
    if origin is Annotated:
        inner, *checks = typing.get_args(hint)
        result = _convert(inner, value, where)
        for item in checks:
            result = item.check(result)
        return result
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _build(hint, value, f"{where}.")
    arguments = typing.get_args(hint)
    if origin is tuple and isinstance(value, list):
        kinds = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        if len(kinds) == len(value):
            places = [f"{where}[{index}]" for index in range(len(value))]
            return tuple(map(_convert, kinds, value, places))
    if origin in {types.UnionType, typing.Union}:
        return _first_that_fits(arguments, value, where)
    if origin is Literal and value in arguments:
        return value
    if origin is dict and isinstance(value, dict):
        return {name: tuple(item) if isinstance(item, list) else item for name, item in value.items()}
    if hint is date and isinstance(value, str):
        return date.fromisoformat(value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and type(value) is hint and value == value:  # NaN fits nothing
        return value
    raise ConfigProblem(f"{where}: expected {hint}, got {value!r}")


def _first_that_fits(hints: tuple[Any, ...], value: Any, where: str) -> Any:  # noqa: ANN401 - any JSON value
    for hint in hints:
        if hint is types.NoneType:
            if value is None:
                return None
            continue
        try:
            return _convert(hint, value, where)
        except ConfigProblem:
            continue
    raise ConfigProblem(f"{where}: expected {' or '.join(map(str, hints))}, got {value!r}")
