"""Fields of a user's file that carry a unit, and the strict section they live in."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from rig import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from pydantic.fields import FieldInfo
    from pydantic.json_schema import JsonSchemaValue


@dataclass(frozen=True)
class Quantity:
    """Annotation of a float: written with its unit, held in SI, inside a range.

    `Annotated[float, Quantity("speed", "1 mm/s", "5 m/s")]` takes "0.8 m/s" and holds 0.8. The range is shown to the
    user as it is written here; `above` excludes the lower end.
    """

    dimension: str
    low: str | None = None
    high: str | None = None
    above: bool = False

    @property
    def allowed(self) -> str:
        """The range in words, empty when there is none."""
        if self.low is not None and self.high is not None:
            return f"allowed: {'more than ' if self.above else ''}{self.low} to {self.high}"
        if self.low is not None:
            return f"allowed: {'more than' if self.above else 'at least'} {self.low}"
        return "" if self.high is None else f"allowed: at most {self.high}"

    def convert(self, value: object) -> float:
        """Parse and check the range.

        Args:
            value: the text from the file.

        Returns:
            SI value.

        Raises:
            ValueError: not this quantity, or outside the range.
        """
        allowed = f" ({self.allowed})" if self.allowed else ""
        try:
            result = units.parse(value, self.dimension)
        except units.UnitProblem as problem:
            raise ValueError(f"{problem}{allowed}") from problem
        if self.low is not None:
            low = units.parse(self.low, self.dimension)
            if result < low or (self.above and result == low):
                raise ValueError(f"too small{allowed}")
        if self.high is not None and result > units.parse(self.high, self.dimension):
            raise ValueError(f"too large{allowed}")
        return result

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.convert, metadata={"pydantic_js_functions": [self._json_schema]}
        )

    def _json_schema(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        dimension = units.DIMENSIONS[self.dimension]
        description = f"{dimension.article} {dimension.name} with its unit; {self.allowed}".strip("; ")
        return {
            "type": "string",
            "pattern": units.pattern(self.dimension),
            "examples": [dimension.example],
            "description": description,
        }


@dataclass(frozen=True)
class Wording:
    """Annotation of a text with a pattern: the pattern in words, and an example; people are never shown the pattern."""

    words: str
    example: str


def constraints(field: FieldInfo) -> Iterator[object]:
    """Every annotation of a model's field, also of the entries of its list: `Quantity`, `Wording`, `Ge`, `Le` ..."""
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
    """The quantity a model's field holds, alone or in a list of them; None for other fields."""
    return next((item for item in constraints(field) if isinstance(item, Quantity)), None)


class Section(BaseModel):
    """Base of every table in a user's file: unknown keys, guesses of type, inf and nan are refused.

    A quantity may be written `amplitude = "50 mm"` or, with the unit in the key, `amplitude_mm = 50`.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @classmethod
    def key_of(cls, name: str) -> str:
        """The key in the file of a field of the model."""
        return cls.model_fields[name].alias or name

    @classmethod
    @functools.cache
    def suffixed_keys(cls) -> dict[str, tuple[str, str]]:
        """Keys with a unit suffix: {"speed_m_s": ("speed", "m/s"), ...}."""
        keys: dict[str, tuple[str, str]] = {}
        for name, field in cls.model_fields.items():
            quantity = quantity_of(field)
            if quantity is not None:
                key = cls.key_of(name)
                keys |= {f"{key}_{end}": (key, unit) for end, unit in units.key_suffixes(quantity.dimension).items()}
        return keys

    @model_validator(mode="before")
    @classmethod
    def _fold_unit_suffixes(cls, data: object) -> object:
        if not isinstance(data, dict):
            return data
        suffixed = cls.suffixed_keys()
        folded: dict[str, Any] = {key: value for key, value in data.items() if key not in suffixed}
        for written in data.keys() & suffixed.keys():
            key, unit = suffixed[written]
            if key in folded:
                raise PydanticCustomError("written_twice", f"{key} is given twice (also as {written}); keep one")
            folded[key] = _with_unit(data[written], unit, written)
        return folded

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        result = handler.resolve_ref_schema(handler(schema))
        suffixed = cls.suffixed_keys()
        if suffixed:
            number = {"type": "number"}
            either: Mapping[str, object] = {"anyOf": [number, {"type": "array", "items": number}]}
            result["patternProperties"] = {f"^({'|'.join(suffixed)})$": either}
            bare = {key for key, _ in suffixed.values()}
            result["required"] = [key for key in result.get("required", []) if key not in bare]
        return result


def _with_unit(value: object, unit: str, key: str) -> object:
    if isinstance(value, tuple):
        return tuple(_with_unit(item, unit, key) for item in value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise PydanticCustomError("not_a_number", f"{key} has its unit in the key and takes a plain number")
    return f"{value!r} {unit}"
