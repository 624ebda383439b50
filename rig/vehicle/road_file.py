"""The road file: what a road is made of, with units; or the name of a road that comes with the program."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from protocols.descriptions import Problem
from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.files.loader import load_section
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.text_file import read_bytes
from rig.vehicle.road import (
    CLASSES,
    Obstacle,
    RandomRoad,
    Road,
    Sweep,
    obstacle_road,
    random_road,
    recorded_road,
    sweep_road,
)
from rig.vehicle.shipped import found, names_in

FOLDER = Path(__file__).parent / "roads"
Duration = Annotated[float, Quantity("time", "1 s", "3600 s")]
Speed = Annotated[float, Quantity("speed", "0.1 m/s", "100 m/s")]
Height = Annotated[float, Quantity("length", "0 mm", "50 cm", above=True)]
Length = Annotated[float, Quantity("length", "1 cm", "100 m")]
Hertz = Annotated[float, Quantity("frequency", "0 Hz", "100 Hz")]
MOST_BYTES = 200_000_000


class SweepTable(Section):
    """`[sweep]`."""

    duration_s: Duration = Field(default=60.0, alias="duration")
    first_Hz: Hertz = Field(default=0.0, alias="first_frequency")
    last_Hz: Hertz = Field(default=18.0, alias="last_frequency")
    first_m: Height = Field(default=4e-3, alias="first_height", description="peak-to-peak height at the start")
    last_m: Height = Field(default=1e-3, alias="last_height", description="peak-to-peak height at the end")
    phase_deg: float = Field(default=90.0, ge=-360.0, le=360.0, description="phase lag of the right side")

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if not self.last_Hz > self.first_Hz:
            yield ("last_frequency",), "must be above first_frequency"


class RandomTable(Section):
    """`[random]`: ISO 8608."""

    road_class: Literal["A", "B", "C", "D", "E", "F", "G", "H"] = Field(alias="class")
    duration_s: Duration = Field(default=60.0, alias="duration")
    coherence: Literal["isotropic", "equal", "independent"] = "isotropic"
    track_m: Length = Field(default=1.6, alias="track", description="distance between left and right wheels")
    seed: int = Field(default=0, ge=0)


class ObstacleTable(Section):
    """`[bump]` and `[pothole]`."""

    height_m: Height = Field(alias="height", description="height of the bump or depth of the pothole")
    length_m: Length = Field(alias="length", description="length along the road")
    edge_m: Length = Field(default=0.1, alias="edge", description="length of each edge of a pothole")
    start_m: Annotated[float, Quantity("length", "0 m", "10000 m")] = Field(default=10.0, alias="start")
    sides: Literal["both", "left", "right"] = "both"
    duration_s: Duration = Field(default=10.0, alias="duration")


class RecordedTable(Section):
    """`[profile]` (distance, heights) and `[drive]` (time, heights): a CSV file with one line of names."""

    file: str = Field(
        min_length=1, description="path relative to the road file; columns: distance_m or time_s, then heights in m"
    )


class RoadFile(Section):
    """One road.

    Attributes:
        kinds: the tables of which one says what the road is.
        heading: of the table that this stands in, with a full stop; a road file is a table of its own.
    """

    kinds: ClassVar[tuple[str, ...]] = ("sweep", "random", "bump", "pothole", "profile", "drive")
    heading: ClassVar[str] = ""

    format: Literal[1]
    name: str = Field(min_length=1, max_length=120)
    source: str = Field(default="", max_length=2000)
    speed_m_s: Speed | None = Field(default=None, alias="speed", description="speed of the car; not for a drive file")
    sweep: SweepTable | None = None
    random: RandomTable | None = None
    bump: ObstacleTable | None = None
    pothole: ObstacleTable | None = None
    profile: RecordedTable | None = None
    drive: RecordedTable | None = None

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        given = [name for name in self.kinds if getattr(self, name) is not None]
        if len(given) != 1:
            shown = ", ".join(f"[{self.heading}{name}]" for name in self.kinds)
            what = f"got {len(given)} ({', '.join(given)})" if given else "got none"
            yield (given[1],) if given else (), f"{what}, expected exactly one of {shown}"
        elif given == ["drive"] and self.speed_m_s is not None:
            yield ("speed",), (
                "got a speed with [drive], which specifies wheel motion as a function of time. Fix: remove the speed"
            )
        elif given != ["drive"] and self.speed_m_s is None:
            yield ("speed",), f'is missing; [{given[0]}] requires the speed of the car, such as "25 m/s"'

    def road(self, folder: Path) -> Road:
        """The road; CSV files are looked for in `folder`.

        Raises:
            FileProblem: a CSV file cannot be used.
        """
        speed_m_s = self.speed_m_s or 0.0
        if self.sweep is not None:
            own = self.sweep
            sweep = Sweep(own.duration_s, own.first_Hz, own.last_Hz, own.first_m, own.last_m, own.phase_deg)
            return sweep_road(sweep, self.name, speed_m_s)
        if self.random is not None:
            chance = self.random
            length_m = max(chance.duration_s * speed_m_s, 2.0 / 0.011)
            road = RandomRoad(
                float(CLASSES[chance.road_class]), length_m, chance.coherence, chance.track_m, chance.seed
            )
            return random_road(road, chance.duration_s, speed_m_s, self.name)
        if self.profile is not None or self.drive is not None:
            table = self.profile or self.drive
            at, heights = read_heights(folder / str(table and table.file), "distance_m" if self.profile else "time_s")
            return recorded_road(at, heights, speed_m_s, self.name)
        return self._obstacle(speed_m_s)

    def _obstacle(self, speed_m_s: float) -> Road:
        hole = self.bump is None
        given = self.pothole if self.bump is None else self.bump
        if given is None:
            raise ValueError("a road file without a road was not rejected")
        obstacle = Obstacle(given.height_m, given.length_m, given.edge_m, given.start_m, given.sides, hole)
        return obstacle_road(obstacle, given.duration_s, speed_m_s, self.name)


def read_heights(path: Path, first: str) -> tuple[FloatArray, FloatArray]:
    """Abscissa (k,) and heights (k, 1..4) of a CSV file with a line of names.

    Raises:
        FileProblem: no such file, other columns, or rows that are no ascending finite numbers.
    """
    with io.StringIO(read_bytes(path, MOST_BYTES).decode(errors="replace"), newline=None) as file:
        names = [name.strip() for name in file.readline().split(",")]
        if names[:1] != [first] or len(names) not in {2, 3, 5}:
            raise FileProblem(
                str(path), [f"line 1: got columns {', '.join(names)[:80]!r}, expected {first} and 1, 2 or 4 columns "
                            "of heights in m, separated by commas"],
            )
        try:
            table = np.loadtxt(file, delimiter=",", ndmin=2)
        except ValueError as error:
            raise FileProblem(str(path), [f"got a table with non-numeric values: {error}"]) from error
    if len(table) < 2 or table.shape[1] != len(names):
        raise FileProblem(str(path), [f"got {len(table)} rows of {len(names)} columns, expected at least two rows"])
    if not np.all(np.isfinite(table)) or np.any(np.diff(table[:, 0]) <= 0.0):
        row = int(np.argmax(~(np.diff(table[:, 0]) > 0.0))) + 3
        raise FileProblem(str(path), [(
            f"line {row}: {first} does not increase, or a value is not a finite number"
        )])
    return table[:, 0], table[:, 1:]


def road_names() -> tuple[str, ...]:
    """Names of the roads that come with the program."""
    return names_in(FOLDER)


def load_road(given: str | Path) -> Road:
    """A road by the name of one that comes with the program, or by file.

    Raises:
        FileProblem: with every wrong entry of the file, or the names that are known.
    """
    path = found(given, FOLDER, "road")
    return load_section(path, RoadFile, "road")[0].road(path.parent)
