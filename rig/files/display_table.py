"""`[display]` in a bench or matrix file: units and signs that people read; see `rig.display`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from rig.display import (
    ENERGY_UNITS,
    FORCE_UNITS,
    LENGTH_UNITS,
    SPEED_UNITS,
    TEMPERATURE_UNITS,
    Display,
    Paper,
    Positive,
    spelt,
)
from rig.files.section import Section

ForceUnit = Literal[FORCE_UNITS]  # type: ignore[valid-type]  # one list serves the schema and the message
LengthUnit = Literal[LENGTH_UNITS]  # type: ignore[valid-type]  # the same
SpeedUnit = Literal[SPEED_UNITS]  # type: ignore[valid-type]  # the same
TemperatureUnit = Literal[TEMPERATURE_UNITS]  # type: ignore[valid-type]  # the same
EnergyUnit = Literal[ENERGY_UNITS]  # type: ignore[valid-type]  # the same


class DisplayTable(Section):
    """Units and signs on the terminal, page and report; files and JSON stay in SI, with extension positive.

    An entry of the matrix file replaces that of the bench file.
    """

    force: ForceUnit | None = Field(default=None, description="unit of forces; default: N")
    displacement: LengthUnit | None = Field(
        default=None, description="unit of displacements, amplitudes and strokes; default: mm"
    )
    speed: SpeedUnit | None = Field(default=None, description="unit of speeds; default: m/s")
    temperature: TemperatureUnit | None = Field(default=None, description="unit of temperatures; default: degC")
    energy: EnergyUnit | None = Field(default=None, description="unit of energies (per cycle); default: J")
    positive: Positive | None = Field(
        default=None, description="direction in which force, displacement and speed are positive; default: rebound"
    )
    paper: Paper | None = Field(default=None, description="paper size of printed reports and PDF files; default: A4")

    @field_validator("force", "displacement", "speed", "temperature", "energy", "paper", mode="before")
    @classmethod
    def _spelling(cls, value: object) -> object:
        """Other spellings are accepted, as in quantities."""
        return spelt(value)


def display_of(*tables: DisplayTable) -> Display:
    """The display of these tables, the bench file's first; an entry of a later one counts more."""
    return Display.of(*(table.model_dump() for table in tables))
