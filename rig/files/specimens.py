"""The specimens file of a simulated rig: properties of the damper by its serial number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from protocols.descriptions import Problem
from protocols.patterns import Pattern, PatternError
from rig.files.section import Section

Factor = Annotated[float, Field(ge=0.0, le=100.0)]


class SimulatedSpecimen(Section):
    """Properties of the dampers whose serial numbers match."""

    units_in_keys = False

    serial: str = Field(
        min_length=1, max_length=200, examples=["MR-103"],
        description="regular expression that the whole serial number must match",
    )
    scale: dict[str, Factor] = Field(default_factory=dict, description="factors on parameters of the damper model")
    option: tuple[str, ...] = Field(default=(), description="constants of the simulated rig, as with --option")

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        try:
            Pattern(self.serial)
        except PatternError as error:
            yield ("serial",), f"not a valid regular expression: {error}"


class SpecimensFile(Section):
    """A whole specimens file."""

    format: Literal[1]
    specimen: tuple[SimulatedSpecimen, ...] = Field(min_length=1)
