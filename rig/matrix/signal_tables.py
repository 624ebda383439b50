"""`[matrix.sweep]`, `[matrix.road]`, `[matrix.file]`: motions of the rig that do not repeat, each point a record.

Files named in a table are read with the matrix file: an invalid record is refused with every other wrong entry.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr

from protocols.descriptions import Problem
from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.files.loader import load_section
from rig.files.quantity import Quantity, located
from rig.files.section import ExtendedSection, Section
from rig.matrix.record_file import DISPLACEMENT, FORCE, LARGEST_BYTES, read_record
from rig.signals.drive_iteration import IterationSettings
from rig.signals.force_motion import force_record
from rig.signals.force_target import SpeedOfForce
from rig.signals.record import (
    LONGEST_S,
    STEP_S,
    NoRecord,
    Record,
    SweepMotion,
    record_of,
    sweep_record,
    through_rows,
)
from rig.text_file import read_bytes
from rig.vehicle.road_file import FOLDER as ROADS
from rig.vehicle.road_file import RoadFile
from rig.vehicle.shipped import found

MOST_ROAD_BYTES = 262_144
MOST_RECORDS = 50
LOWEST_Hz = 0.3
"""Of the motion for a force: the travel for a speed grows with the inverse of the frequency."""



def _none_twice(values: tuple[str, ...]) -> tuple[str, ...]:
    """The names as they are.

    Raises:
        ValueError: one stands there twice.
    """
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"{', '.join(twice)} is specified twice; to repeat points, set `repeats = N`")
    return values


Amplitude = Annotated[float, Quantity("length", "0 mm", "1 m", above=True)]
Frequency = Annotated[float, Quantity("frequency", "0.01 Hz", "100 Hz")]
Ramp = Annotated[float, Quantity("time", "0.1 s", "60 s")]
Duration = Annotated[float, Quantity("time", "1 s", "600 s")]
Name = Annotated[str, Field(min_length=1, max_length=1000)]
Names = Annotated[tuple[Name, ...], Field(min_length=1, max_length=MOST_RECORDS), AfterValidator(_none_twice)]
RAMP = Field(default=1.0, alias="ramp", description="ramps at the start and end, excluded from the verdict and the fit")
Maker = tuple[tuple[str | int, ...], Callable[[], Record]]
"""The entry that asks for a record, and what makes it."""


class SignalTable(Section, ABC):
    """What the three tables have in common: their records."""

    _records: tuple[Record, ...] = PrivateAttr(default=())
    _hashes: dict[str, str] = PrivateAttr(default_factory=dict)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`: every record is made, or it is said why it cannot be; of a list each at its place."""
        records: list[Record] = []
        for where, make in self._makers():
            try:
                records.append(make())
            except NoRecord as error:
                yield where, str(error)
            except FileProblem as error:
                yield from ((where, problem) for problem in error.problems)
        self._records = tuple(records)

    @abstractmethod
    def _makers(self) -> list[Maker]: ...

    @property
    def records(self) -> tuple[Record, ...]:
        """One point each, at every current."""
        return self._records

    @property
    def count(self) -> int:
        """Number of points at each current."""
        return len(self.records)

    @property
    def hashes(self) -> Mapping[str, str]:
        """Each file's name or path as the table holds it, and the SHA-256 (hex) of what it holds.

        Of a road file with that of the CSV file that it names.
        """
        return self._hashes


class SweepTable(SignalTable):
    """`[matrix.sweep]`: a sine whose frequency and amplitude change."""

    first_Hz: Frequency = Field(alias="first_frequency")
    last_Hz: Frequency = Field(alias="last_frequency")
    first_m: Amplitude = Field(alias="first_amplitude")
    last_m: Amplitude | None = Field(
        default=None, alias="last_amplitude", description="amplitude at the end; default: the first amplitude"
    )
    duration_s: Duration = Field(alias="duration", description="duration, including both ramps")
    spacing: Literal["linear", "logarithmic"] = Field(
        default="linear", description="frequency and amplitude change by equal amounts (linear) or equal factors "
            "(logarithmic) per second"
    )
    ramp_s: Ramp = RAMP

    def _makers(self) -> list[Maker]:
        if self.first_Hz == self.last_Hz:
            raise located([(("last_frequency",), "equals first_frequency; a sweep requires two different frequencies")])
        last_m = self.first_m if self.last_m is None else self.last_m
        motion = SweepMotion(
            self.duration_s, self.first_Hz, self.last_Hz, self.first_m, last_m, self.spacing == "logarithmic"
        )
        return [(("duration",), partial(sweep_record, motion, self.ramp_s))]


class RoadTable(SignalTable):
    """`[matrix.road]`: the height of a road under a wheel, less its mean, as the motion of the rod."""

    road: Names = Field(description="names of built-in roads, or road files", examples=[["iso8608-c"]])
    amplitude_m: Amplitude = Field(alias="amplitude", description="the signal is scaled so that its largest distance "
        "from the centre has this value")
    speed_m_s: Annotated[float, Quantity("speed", "0.1 m/s", "100 m/s")] | None = Field(
        default=None, alias="speed", description="speed of the car; default: the speed in the road file"
    )
    duration_s: Duration | None = Field(default=None, alias="duration", description="duration from the start of the "
        "road; default: the whole road")
    side: Literal["left", "right"] = "left"
    highest_Hz: Frequency = Field(
        default=5.0, alias="highest_frequency", description="cut-off frequency of a zero-phase low-pass filter"
    )
    ramp_s: Ramp = RAMP

    def _makers(self) -> list[Maker]:
        return [(("road", number), partial(self._record, name)) for number, name in enumerate(self.road)]

    def _record(self, name: str) -> Record:
        path = found(name, ROADS, "road")
        file = load_section(path, RoadFile, "road")[0]
        if self.speed_m_s is not None:
            if file.drive is not None:
                raise NoRecord("is a drive file, which contains its own time stamps. Fix: remove speed")
            file = file.model_copy(update={"speed_m_s": self.speed_m_s})
        content = read_bytes(path, MOST_ROAD_BYTES)
        table = file.profile or file.drive
        if table is not None:
            content += hashlib.sha256(read_bytes(path.parent / table.file, LARGEST_BYTES)).digest()
        self._hashes[name] = hashlib.sha256(content).hexdigest()
        road = file.road(path.parent)
        duration_s = min(road.duration_s, LONGEST_S if self.duration_s is None else self.duration_s)
        time_s = STEP_S * np.arange(int(duration_s / STEP_S + 1e-6) + 1, dtype=np.float64)
        height_m = road.heights(time_s, 1.0 if self.side == "left" else -1.0)
        return record_of(
            path.stem, height_m - np.mean(height_m), self.ramp_s, amplitude_m=self.amplitude_m,
            highest_Hz=self.highest_Hz, sha256=self._hashes[name],
        )


class FileTable(ExtendedSection, SignalTable):
    """`[matrix.file]`: CSV files of time and displacement about the centre, or of time and force."""

    later: ClassVar[frozenset[str]] = frozenset({"target", "lowest_Hz"})

    file: Names = Field(
        description="CSV files with columns such as time_s and displacement_mm; 0 is the specimen's mid-stroke "
            "position",
        examples=[["drive.csv"]],
    )
    target: Literal["displacement", "force"] = Field(
        default="displacement", description="with \"force\", the files contain a column such as force_N, and the "
            "command is iterated until the measured force follows it; requires [matrix.iterate] and specimen.prior"
    )
    lowest_Hz: Annotated[float, Quantity("frequency", "0.05 Hz", "5 Hz")] | None = Field(
        default=None, alias="lowest_frequency", description=f"with target = \"force\": slower changes of the motion "
            f"are removed; default: {LOWEST_Hz:g} Hz"
    )
    amplitude_m: Amplitude | None = Field(
        default=None, alias="amplitude", description="the signal is scaled so that its largest distance from the "
            "centre has this value; default: not scaled"
    )
    highest_Hz: Frequency | None = Field(
        default=None, alias="highest_frequency", description="cut-off frequency of a zero-phase low-pass filter; "
            "default: no filter"
    )
    ramp_s: Ramp = RAMP

    _forces: list[tuple[str, FloatArray]] = PrivateAttr(default_factory=list)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; of forces, the motions depend on the expected damper (`force_record`)."""
        if self.target == DISPLACEMENT:
            if self.lowest_Hz is not None:
                yield ("lowest_frequency",), 'applies only with target = "force"'
            yield from super().problems()
            return
        if self.amplitude_m is not None:
            yield ("amplitude",), (
                'applies only to displacements, but target = "force". Fix: remove amplitude, and scale the column of '
                "the file"
            )
        for number, name in enumerate(self.file):
            try:
                time_s, force_N, self._hashes[name] = read_record(Path(name), FORCE)
                self._forces.append((name, through_rows(time_s, force_N)))
            except NoRecord as error:
                yield ("file", number), str(error)
            except FileProblem as error:
                yield from ((("file", number), problem) for problem in error.problems)

    @property
    def count(self) -> int:
        """See `SignalTable.count`."""
        return len(self._forces) if self.target == FORCE else super().count

    def force_record(self, number: int, inverse: SpeedOfForce) -> Record:
        """The record of a force.

        Args:
            number: of the file, from 0.
            inverse: of the expected damper at the current of the point.

        Raises:
            NoRecord: the damper does not give this force, or the motion is too short.
        """
        name, force_N = self._forces[number]
        return force_record(
            Path(name).stem, force_N, inverse, self.ramp_s, lowest_Hz=self.lowest_Hz or LOWEST_Hz,
            highest_Hz=self.highest_Hz, sha256=self._hashes[name],
        )

    def _makers(self) -> list[Maker]:
        return [(("file", number), partial(self._record, name)) for number, name in enumerate(self.file)]

    def _record(self, name: str) -> Record:
        time_s, position_m, self._hashes[name] = read_record(Path(name))
        even_m: FloatArray = through_rows(time_s, position_m)
        return record_of(
            Path(name).stem, even_m, self.ramp_s, amplitude_m=self.amplitude_m, highest_Hz=self.highest_Hz,
            sha256=self._hashes[name],
        )


class IterateTable(Section):
    """`[matrix.iterate]`: the command of each signal is iterated until the rod follows the signal."""

    tolerance: Annotated[float, Quantity("ratio", "0.1 %", "20 %")] = Field(
        default=0.02, description="RMS deviation of the rod from the signal after removal of the delay, relative to "
            "the RMS of the signal about its mean"
    )
    most: int = Field(
        default=6, alias="iterations", ge=1, le=20, description="largest number of corrections of the command"
    )
    gain: float = Field(default=0.8, ge=0.05, le=1.0, description="share of the error that an iteration corrects")
    least_coherence: float = Field(
        default=0.8, alias="coherence", ge=0.5, le=0.999, description="frequencies with a smaller coherence of "
            "command and displacement are not corrected"
    )
    noise_s: Annotated[float, Quantity("time", "10 s", "120 s")] = Field(
        default=20.0, alias="noise_duration", description="duration of the noise with which the response of the "
            "machine is identified"
    )
    noise_level: Annotated[float, Quantity("ratio", "5 %", "100 %")] = Field(
        default=0.5, description="RMS speed of the noise relative to that of the signal"
    )

    @property
    def settings(self) -> IterationSettings:
        """The settings as a value."""
        return IterationSettings(**{name: getattr(self, name) for name in type(self).model_fields})
