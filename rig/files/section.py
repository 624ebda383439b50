"""Tables of a user's file as the validator sees them: strict, with the unit in the value or in the key.

A table is a `Section` (a model of the validator), or one of the frozen `rig.bench.settings`, which load no validator:
this module contains what both need.
"""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    create_model,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from protocols.descriptions import Problem
from rig import units
from rig.files.quantity import Quantity, Settings, located


class Section(BaseModel):
    """Base of a table in a user's file: unknown keys, guesses of type, inf and nan are refused.

    A quantity may be written `amplitude = "50 mm"` or, with the unit in the key, `amplitude_mm = 50`.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    units_in_keys: ClassVar[bool] = True

    @model_validator(mode="before")
    @classmethod
    def _fold_unit_suffixes(cls, data: object) -> object:
        return folded(cls, data)

    def problems(self) -> Iterable[Problem]:
        """What entries that are each valid contradict in each other; called when every entry of the table is valid."""
        return ()

    @model_validator(mode="after")
    def _together(self) -> Self:
        _check(self)
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return with_suffixes(cls, handler.resolve_ref_schema(handler(schema)))


class ExtendedSection(Section):
    """Base of a table with entries that came after files without them had been run.

    Of those in `later`, the ones that have their default are left out of what is dumped: digests of earlier files stay
    as they are.
    """

    later: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _without_unused(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields = type(self).model_fields
        unused = {name for name in self.later & fields.keys() if getattr(self, name) == fields[name].default}
        return {name: value for name, value in handler(self).items() if name not in unused}


class DescriptionTable(Section):
    """Base of a table of a device's description, which drivers take as it is written: its keys carry no units."""

    units_in_keys: ClassVar[bool] = False


class OneOrMore:
    """Annotation of a list in whose place one of its entries may be: `Annotated[tuple[int, ...], OneOrMore()]`."""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(
            lambda value: value if isinstance(value, tuple) else (value,), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        several = handler(schema)
        return {"anyOf": [several["items"], {**several, "minItems": 1}]}


def table_of_words(name: str, about: str, words: Iterable[str], entry: Any, **more: Any) -> type[DescriptionTable]:  # noqa: ANN401 - types
    """A table of a description whose keys are words of the program, each of them optional.

    Args:
        name: of the class.
        about: its docstring.
        words: the keys.
        entry: the type of what they hold.
        more: of `pydantic.create_model`: further fields.
    """
    fields: Any = {
        word.replace("-", "_"): (entry | None, Field(None, alias=word if "-" in word else None)) for word in words
    }
    return create_model(name, __base__=DescriptionTable, __doc__=about, **fields, **more)


def all_optional(table: type[Any]) -> type[DescriptionTable]:
    """A frozen dataclass of plain values as a table of a file in which every key may be left out."""
    hints = typing.get_type_hints(table, include_extras=True)
    fields: dict[str, Any] = {}
    for one in dataclasses.fields(table):
        hint = hints[one.name]
        hint = all_optional(hint) if isinstance(hint, type) and dataclasses.is_dataclass(hint) else hint
        fields[one.name] = (hint | None, None)
    return create_model(table.__name__, __base__=DescriptionTable, __doc__=table.__doc__, **fields)


Table = type[Any]
"""A class derived from `Section` or `Settings`."""


def fields_of(table: Table) -> Mapping[str, FieldInfo]:
    """The fields of a table by name in the program."""
    return _fields_of(typing.cast("typing.Hashable", table))


@functools.cache
def _fields_of(table: Table) -> Mapping[str, FieldInfo]:
    if issubclass(table, Section):
        return dict(table.model_fields)
    hints = typing.get_type_hints(table, include_extras=True)
    return {
        field.name: FieldInfo.from_annotated_attribute(hints[field.name], field)
        for field in dataclasses.fields(table)
    }


def key_of(table: Table, name: str) -> str:
    """The key in the file of a field of the program."""
    return fields_of(table)[name].alias or name


def suffixed_keys(table: Table) -> Mapping[str, tuple[str, str]]:
    """Keys with a unit suffix: {"speed_m_s": ("speed", "m/s"), ...}."""
    return _suffixed_keys(typing.cast("typing.Hashable", table))


@functools.cache
def _suffixed_keys(table: Table) -> Mapping[str, tuple[str, str]]:
    keys: dict[str, tuple[str, str]] = {}
    if not getattr(table, "units_in_keys", True):
        return keys
    for name, field in fields_of(table).items():
        quantity = quantity_of(field)
        if quantity is not None:
            key = key_of(table, name)
            keys |= {f"{key}_{end}": (key, unit) for end, unit in units.key_suffixes(quantity.dimension).items()}
    return keys


def constraints(field: FieldInfo) -> Iterator[object]:
    """Every annotation of a field, also of the entries of its list: `Quantity`, `Wording`, `Ge`, `Le` ..."""
    yield from _constraints(field.annotation, field.metadata)


def _constraints(annotation: object, metadata: Sequence[object]) -> Iterator[object]:
    for item in metadata:
        yield item
        yield from getattr(item, "metadata", ())  # a Field(...) inside Annotated
    if (inner := getattr(annotation, "__metadata__", None)) is not None:
        yield from _constraints(None, inner)
    for part in get_args(annotation):
        yield from _constraints(part, ())


def quantity_of(field: FieldInfo) -> Quantity | None:
    """The quantity a field holds, alone or in a list of them; None for other fields."""
    return next((item for item in constraints(field) if isinstance(item, Quantity)), None)


def folded(table: Table, data: object) -> object:
    """A table's data with `amplitude_mm = 50` as `amplitude = "50 mm"`.

    Raises:
        PydanticCustomError: one is given twice, or a value with its unit in the key is no number.
    """
    if not isinstance(data, dict):
        return data
    suffixed = suffixed_keys(table)
    values: dict[str, Any] = {key: value for key, value in data.items() if key not in suffixed}
    for written in data.keys() & suffixed.keys():
        key, unit = suffixed[written]
        if key in values:
            raise PydanticCustomError("written_twice", f"{key} is specified twice (also as {written}); keep one of "
                "them")
        values[key] = _with_unit(data[written], unit, written)
    return values


def with_suffixes(table: Table, schema: JsonSchemaValue) -> JsonSchemaValue:
    """The JSON schema of a table whose quantities may carry the unit in the key; TOML has no null."""
    for entry in schema.get("properties", {}).values():
        _without_null(entry)
    suffixed = suffixed_keys(table)
    if suffixed:
        number = {"type": "number"}
        either: Mapping[str, object] = {"anyOf": [number, {"type": "array", "items": number}]}
        schema["patternProperties"] = {f"^({'|'.join(suffixed)})$": either}
        bare = {key for key, _ in suffixed.values()}
        schema["required"] = [key for key in schema.get("required", []) if key not in bare]
    return schema


def _without_null(entry: dict[str, Any]) -> None:
    """Leave out what stands for "not given" in the program; `entry` is changed in place."""
    if (kinds := entry.get("anyOf")) is None:
        return
    given = [kind for kind in kinds if kind != {"type": "null"}]
    if entry.get("default", ...) is None:
        del entry["default"]
    if len(given) > 1:
        entry["anyOf"] = given
        return
    del entry["anyOf"]
    for key, value in given[0].items():
        entry.setdefault(key, value)


def _check(table: Section | Settings) -> None:
    """Nothing where its entries go together.

    Raises:
        wrong: with every problem.
    """
    problems = tuple(table.problems())
    if problems:
        wrong: Exception = located(problems)
        raise wrong


def settings_schema(table: type[Settings], source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
    """The validator's schema of a table of settings: unit suffixes first, its entries, what they say together last."""
    result = handler(source)
    definition: dict[str, Any] = handler.resolve_ref_schema(result)  # type: ignore[assignment]  # changed in place
    own: Any = {**definition, "strict": False}  # its entries are strict; the table itself comes as a mapping
    name = own.pop("ref", None)

    def together(value: Any) -> Any:  # noqa: ANN401 - an instance of `table`
        _check(value)
        return value

    checked = core_schema.no_info_after_validator_function(together, own)
    whole = core_schema.no_info_before_validator_function(lambda data: folded(table, data), checked)
    definition.clear()
    definition.update(whole, **({} if name is None else {"ref": name}))
    return result


def settings_json_schema(table: type[Settings], schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
    """The JSON schema of a table of settings."""
    result = handler(schema)
    with_suffixes(table, handler.resolve_ref_schema(result))
    return result


Settings.core_schema_of = settings_schema
Settings.json_schema_of = settings_json_schema


def _with_unit(value: object, unit: str, key: str) -> object:
    if isinstance(value, tuple):
        return tuple(_with_unit(item, unit, key) for item in value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise PydanticCustomError("not_a_number", f"the name {key} contains the unit, so the value must be a plain "
            "number")
    return f"{value!r} {unit}"
