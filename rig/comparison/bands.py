"""The acceptance bands file: between which limits a damper's measured values and fitted parameters must lie."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from protocols.descriptions import Problem
from rig.comparison.readings import QUANTITIES, LoopReading
from rig.files.loader import load_section
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.matrix.acceptance_table import DECISION, Decision

Change = Annotated[float, Quantity("ratio", "0 %", "1000 %", above=True)]
Ratio = Annotated[float, Field(ge=0.0, le=1000.0)]
SPEED_ROOM = 0.05
"""A loop belongs to a band's speed when its peak speed is so near to it, relative."""


class Band(Section):
    """What every band has: its limits (their SI unit is the quantity's) and how much a value may change."""

    low: float | None = None
    high: float | None = None
    most_change: Change | None = Field(
        default=None, description="largest permitted change relative to the first run, in either direction"
    )
    note: str = Field(default="", max_length=200, description="text shown next to the result")

    @property
    def where(self) -> str:
        """Which tests it is about; empty for all."""
        return ""

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if self.low is None and self.high is None and self.most_change is None:
            yield (), "a band requires low, high or most_change"
        if self.low is not None and self.high is not None and not self.low < self.high:
            yield ("low",), "must be below high"


class LoopBand(Band):
    """A band of what loops show; of the keys that choose loops every one that is given must hold."""

    point: str | None = Field(default=None, min_length=1, max_length=80, description="ID of the point")
    waveform: str | None = Field(default=None, min_length=1, max_length=40)
    amplitude_m: Annotated[float, Quantity("length", "0 mm", "1 m", above=True)] | None = Field(
        default=None, alias="amplitude"
    )
    frequency_Hz: Annotated[float, Quantity("frequency", "0 Hz", "1000 Hz", above=True)] | None = Field(
        default=None, alias="frequency"
    )
    current_A: Annotated[float, Quantity("current", "-20 A", "20 A")] | None = Field(default=None, alias="current")
    speed_m_s: Annotated[float, Quantity("speed", "0 m/s", "5 m/s", above=True)] | None = Field(
        default=None, alias="speed", description="peak speed, within 5 %"
    )

    @property
    def where(self) -> str:
        """Which loops it is about."""
        parts = [self.point, self.waveform]
        for value, scale, unit in ((self.amplitude_m, 1e3, "mm"), (self.frequency_Hz, 1.0, "Hz"),
                                   (self.current_A, 1.0, "A"), (self.speed_m_s, 1.0, "m/s")):
            parts.append(None if value is None else f"{scale * value:.4g} {unit}")
        return ", ".join(part for part in parts if part)

    def holds(self, loop: LoopReading) -> bool:
        """Whether a loop is one of those the band is about."""
        if self.point is not None and self.point not in loop.ids:
            return False
        if self.speed_m_s is not None and abs(loop.speed_m_s / self.speed_m_s - 1.0) > SPEED_ROOM:
            return False
        return loop.motion.called(self.waveform, self.amplitude_m, self.frequency_Hz, self.current_A)


class ForceLimits(Section):
    """Limits that are forces."""

    low: Annotated[float, Quantity("force", "-200 kN", "200 kN")] | None = None
    high: Annotated[float, Quantity("force", "-200 kN", "200 kN")] | None = None


class ReboundForce(ForceLimits, LoopBand):
    """`[[rebound_force]]`: force at peak velocity in extension."""


class JounceForce(ForceLimits, LoopBand):
    """`[[jounce_force]]`: force at peak velocity in compression; negative."""

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        yield from super().problems()
        if self.low is not None and self.low >= 0.0:
            yield ("low",), (
                'forces in compression are negative: for a damper that delivers 900 to 1100 N, write low = "-1100 N", '
                'high = "-900 N"'
            )


class Energy(LoopBand):
    """`[[energy]]`: dissipated in a cycle."""

    low: Annotated[float, Quantity("energy", "0 J", "1 MJ")] | None = None
    high: Annotated[float, Quantity("energy", "0 J", "1 MJ")] | None = None


class Damping(LoopBand):
    """`[[damping]]`: equivalent viscous damping."""

    low: Annotated[float, Quantity("damping", "0 N s/m", "1000 kN s/m")] | None = None
    high: Annotated[float, Quantity("damping", "0 N s/m", "1000 kN s/m")] | None = None


class DynamicRange(LoopBand):
    """`[[dynamic_range]]`: force at peak velocity in rebound over that of the same motion at 0 A, without gas force."""

    low: Ratio | None = None
    high: Ratio | None = None


class SingleForce(ForceLimits, Band):
    """`[[friction_force]]` and `[[gas_force]]`: by the slow triangle without current."""


class ParameterBand(Band):
    """`[[parameter]]`: of the fitted model, in the unit of `fit.json`."""

    name: str = Field(min_length=1, max_length=80, description="name as in fit.json, such as Fya")
    unit: str = Field(max_length=40, description="unit as in fit.json; empty for a dimensionless parameter")

    @property
    def where(self) -> str:
        """Which parameter."""
        return self.name


class Bands(Section):
    """A whole bands file."""

    format: Literal[1]
    name: str = Field(min_length=1, max_length=120, description="text shown in the results, such as the drawing number")
    decision: Decision = DECISION
    rebound_force: tuple[ReboundForce, ...] = ()
    jounce_force: tuple[JounceForce, ...] = ()
    energy: tuple[Energy, ...] = ()
    damping: tuple[Damping, ...] = ()
    dynamic_range: tuple[DynamicRange, ...] = ()
    friction_force: tuple[SingleForce, ...] = ()
    gas_force: tuple[SingleForce, ...] = ()
    parameter: tuple[ParameterBand, ...] = ()

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if not self.all:
            names = ", ".join(f"[[{key}]]" for key in (*QUANTITIES, "parameter"))
            yield ("name",), f"no band is specified; expected at least one of {names}"

    @property
    def all(self) -> tuple[tuple[str, Band], ...]:
        """Every band with the key of its quantity, or `parameter`."""
        return tuple((key, band) for key in (*QUANTITIES, "parameter") for band in getattr(self, key))

    @property
    def changes(self) -> bool:
        """Whether any band is about the change against another run."""
        return any(band.most_change is not None for _, band in self.all)


def load_bands(path: Path | str) -> Bands:
    """Read and check a bands file.

    Raises:
        FileProblem: with every wrong entry of the file.
    """
    return load_section(Path(path), Bands, "bands")[0]
