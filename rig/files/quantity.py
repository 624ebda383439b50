"""Declaration of an entry of a user's file: key, quantity with unit and range, text, own check. Loads no validator.

These are annotations of a field, `Annotated[float, Quantity(...)]`. When a file is read they are part of the
validator's schema, when values are read back (`rig.bench.settings_json`) their `check` is called: one declaration, one
range.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from protocols.descriptions import Problem
from rig import units

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema, PydanticCustomError


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
        try:
            result = units.parse(value, self.dimension)
        except units.UnitProblem as problem:
            raise ValueError(f"{problem}{self._in_brackets}") from problem
        return self.check(result)

    def check(self, result: float) -> float:
        """The SI value as it is.

        Raises:
            ValueError: it is outside the range.
        """
        if self.low is not None:
            low = units.parse(self.low, self.dimension)
            if result < low or (self.above and result == low):
                raise ValueError(f"too small{self._in_brackets}")
        if self.high is not None and result > units.parse(self.high, self.dimension):
            raise ValueError(f"too large{self._in_brackets}")
        return result

    @property
    def _in_brackets(self) -> str:
        return f" ({self.allowed})" if self.allowed else ""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

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


@dataclass(frozen=True)
class Text:
    """Annotation of a text of 1 to `longest` characters and, where given, of this `pattern`; `wording` describes it."""

    longest: int
    pattern: str | None = None
    wording: Wording | None = None

    def check(self, value: str) -> str:
        """The text as it is.

        Raises:
            ValueError: it is empty, too long, or of another shape.
        """
        if not 1 <= len(value) <= self.longest or (self.pattern is not None and not re.fullmatch(self.pattern, value)):
            raise ValueError(f"must be {self.wording.words if self.wording else f'1 to {self.longest} characters'}")
        return value

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

        return core_schema.str_schema(min_length=1, max_length=self.longest, strict=True, pattern=self.pattern)


class Problems(ValueError):
    """What a check of a whole table found wrong in it, every place of it."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        messages = (f"{'.'.join(map(str, place))}: {text}" if place else text for place, text in problems)
        super().__init__("; ".join(messages))
        self.problems = tuple(problems)


def located(problems: Sequence[Problem]) -> PydanticCustomError:
    """The validator's error of a whole table that names the places inside it."""
    from pydantic_core import PydanticCustomError  # of the validator, which has called this

    return PydanticCustomError("inconsistent", "entries contradict each other", {"problems": list(problems)})


@dataclass(frozen=True)
class Check:
    """Annotation with a check of its own: a function that returns the value, or raises ValueError with what would fit.

    For a table it raises `Problems`. With `alone` nothing else looks at the value, whatever its type; `written` is its
    type in the file where that is another.
    """

    check: Callable[[Any], Any]
    alone: bool = False
    written: Any = None

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

        inner = handler(source) if self.written is None else handler.generate_schema(self.written)
        if self.alone:
            return core_schema.no_info_plain_validator_function(self._placed, json_schema_input_schema=inner)
        return core_schema.no_info_after_validator_function(self._placed, inner)

    def _placed(self, value: Any) -> Any:  # noqa: ANN401 - whatever the field holds
        """The checked value.

        Raises:
            error: problems inside of it, with their places as the validator tells them.
        """
        try:
            return self.check(value)
        except Problems as problems:
            error: Exception = located(problems.problems)
            raise error from problems


def key(name: str | None = None, **shape: object) -> dict[str, object]:
    """Metadata of a field: its key in the file where that is another, range of a whole number, description, examples.

    Whole numbers, texts and truth values are taken as they are written: no "3" for 3.
    """
    given = {"alias": name} if name is not None else {}
    return {**given, **shape}


class Settings:
    """Base of the tables below: how the validator reads one, where there is a validator."""

    __pydantic_config__: ClassVar[Any] = {"extra": "forbid", "strict": True, "allow_inf_nan": False}

    def problems(self) -> Iterator[Problem]:
        """What entries that are each valid contradict in each other."""
        yield from ()

    core_schema_of: ClassVar[Callable[..., Any]]
    json_schema_of: ClassVar[Callable[..., Any]]
    """How the validator reads a table: set by `rig.files.section`, which loads the validator."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: CoreSchema = Settings.core_schema_of(cls, source, handler)
        return schema

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        result: JsonSchemaValue = Settings.json_schema_of(cls, schema, handler)
        return result
