"""What one run says of its damper, as values that another run's can be held against, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.characteristics import Characteristics, characterise
from rig.characteristics.loop import LoopCharacteristics, Measured
from rig.errors import FileProblem
from rig.recording.hdf5.reading import channel_attributes
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import IMPORTED_TOLERANCE, RELATIVE_TOLERANCE, Run
from rig.text_file import read_json

COVERAGE = 2.0
"""Expanded uncertainties are so many standard ones: about 95 %."""
CURRENT_STEP_A, IMPORTED_CURRENT_A = 1e-3, 0.02
PEAK_OF_MEAN = {"sine": math.pi / 2.0, "triangle": 1.0}
"""Peak speed of a waveform over its mean one, which is four amplitudes a cycle."""


@dataclass(frozen=True)
class Quantity:
    """What is compared: its key, what people call it, its SI unit, and which calibrations it scales with."""

    key: str
    title: str
    unit: str
    by_force: bool = True
    by_displacement: bool = False


LOOP_QUANTITIES = (
    Quantity("rebound_force", "Force at peak velocity, rebound", "N"),
    Quantity("jounce_force", "Force at peak velocity, jounce", "N"),
    Quantity("energy", "Energy per cycle", "J", by_displacement=True),
    Quantity("damping", "Equivalent viscous damping", "N s/m", by_displacement=True),
    Quantity("dynamic_range", "Dynamic range, rebound", "1", by_force=False),
)
SINGLE_QUANTITIES = (Quantity("friction_force", "Friction", "N"), Quantity("gas_force", "Gas force", "N"))
QUANTITIES = {quantity.key: quantity for quantity in (*LOOP_QUANTITIES, *SINGLE_QUANTITIES)}


@dataclass(frozen=True)
class Reading:
    """A value (SI), its standard uncertainty from scatter (NaN: unknown) and from calibrations (NaN: not stated)."""

    value: float
    std: float
    calibration: float = 0.0

    @property
    def expanded(self) -> float:
        """Expanded uncertainty (k = 2) of what is known of it."""
        return COVERAGE * math.hypot(*(part for part in (self.std, self.calibration) if math.isfinite(part)))

    @property
    def complete(self) -> bool:
        """Whether both parts of the uncertainty are known."""
        return math.isfinite(self.std) and math.isfinite(self.calibration)


@dataclass(frozen=True)
class Motion:
    """A motion at a current, as it was wanted; of an imported test, as it was estimated."""

    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    imported: bool = False

    @property
    def label(self) -> str:
        """As people say it: "sine, 50 mm, 1 Hz, 0.5 A"."""
        return (
            f"{self.waveform}, {1e3 * self.amplitude_m:.4g} mm, {self.frequency_Hz:.4g} Hz, "
            f"{round(self.current_A, 4) + 0.0:.4g} A"
        )

    def same_as(self, other: Motion) -> bool:
        """Whether both are the same test; with 5 % and 20 mA of room where one was only estimated."""
        estimated = self.imported or other.imported
        room = IMPORTED_TOLERANCE if estimated else RELATIVE_TOLERANCE
        return (
            self.waveform == other.waveform
            and math.isclose(self.amplitude_m, other.amplitude_m, rel_tol=room)
            and math.isclose(self.frequency_Hz, other.frequency_Hz, rel_tol=room)
            and abs(self.current_A - other.current_A) <= (IMPORTED_CURRENT_A if estimated else CURRENT_STEP_A)
        )


@dataclass(frozen=True)
class LoopReading:
    """All valid loops of one motion in a run, repeats averaged: ids, peak speed (m/s), a reading for each quantity."""

    motion: Motion
    ids: tuple[str, ...]
    speed_m_s: float
    values: Mapping[str, Reading]


@dataclass(frozen=True)
class FittedReading:
    """A fitted parameter with its unit; `why` it cannot be used, empty where it can."""

    reading: Reading
    unit: str
    why: str = ""


@dataclass(frozen=True)
class RunReadings:
    """A run for comparing.

    Attributes:
        run: as recorded.
        specimen: its serial number.
        loops: readings of each motion.
        singles: readings of the tests that are no loops: `friction_force`, `gas_force`.
        model: of the fit, empty without one; `parameters` of it by name.
        load_cell: serial number and sensitivity of the load cell, empty where none is recorded.
        left_out: what was not used, a line each.
        lacking: a reading without values of each motion that was recorded, but in no valid point.
        not_recorded: ids of points that the campaign planned and that have no file.
    """

    run: Run
    specimen: str
    loops: tuple[LoopReading, ...]
    singles: Mapping[str, Reading]
    model: str
    parameters: Mapping[str, FittedReading]
    load_cell: str
    left_out: tuple[str, ...]
    lacking: tuple[LoopReading, ...] = ()
    not_recorded: tuple[str, ...] = ()

    @property
    def identity(self) -> str:
        """By which a copy of the run is known as the same one."""
        return str(self.run.campaign.get("id") or self.run.path.resolve())

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.path.name

    def loop_of(self, motion: Motion) -> LoopReading | None:
        """The reading of a motion; None where the run has none."""
        return next((loop for loop in self.loops if loop.motion.same_as(motion)), None)


def readings_of(run: Run) -> RunReadings:
    """Everything a run can be compared by. Points that are not valid are left out and named.

    Raises:
        FileProblem: its `fit.json` is no fit.
    """
    characteristics = characterise(run)
    points = {point.id: point for point in run.valid}
    model, parameters = fitted_of(run)
    first = next(iter(run.points))
    loops = _loops(characteristics, points)
    others = [line for line in characteristics.left_out if not line.endswith(": invalid")]  # the run has said why
    return RunReadings(
        run, _specimen(run), loops, _singles(characteristics, points), model, parameters,
        _load_cell(first), tuple(dict.fromkeys((*run.left_out, *others))),
        tuple(_lacking(run, loops)), _not_recorded(run),
    )


def _lacking(run: Run, loops: Sequence[LoopReading]) -> Iterator[LoopReading]:
    for point in run.points:
        if point.kind != "loop" or any(point.id in loop.ids for loop in loops):
            continue
        motion = Motion(
            point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A, bool(point.imported)
        )
        if not any(motion.same_as(loop.motion) for loop in loops):
            turn = PEAK_OF_MEAN.get(point.waveform, math.nan)
            yield LoopReading(motion, (point.id,), 4.0 * turn * point.amplitude_m * point.frequency_Hz, {})


def _not_recorded(run: Run) -> tuple[str, ...]:
    """Points of the campaign that it ended before."""
    planned, recorded = run.campaign.get("points"), {point.id for point in run.points}
    names = [name for name in planned if isinstance(name, str)] if isinstance(planned, list) else []
    return tuple(name for name in names if name not in recorded)


def _loops(characteristics: Characteristics, points: Mapping[str, RecordedPoint]) -> tuple[LoopReading, ...]:
    ranges = {(*ratio.motion, ratio.current_A): Measured(ratio.rebound, ratio.std, math.nan)
              for ratio in characteristics.dynamic_range}  # fmt: skip
    groups: list[tuple[Motion, list[LoopCharacteristics]]] = []
    for loop in characteristics.loops:
        if loop.id not in points:
            continue
        motion = Motion(
            loop.waveform, loop.amplitude_m, loop.frequency_Hz, loop.current_A, bool(points[loop.id].imported)
        )
        group = next((members for known, members in groups if known.same_as(motion)), None)
        if group is None:
            groups.append((motion, [loop]))
        else:
            group.append(loop)
    return tuple(_loop(motion, members, points, ranges) for motion, members in groups)


def _loop(
    motion: Motion, members: Sequence[LoopCharacteristics], points: Mapping[str, RecordedPoint],
    ranges: Mapping[tuple[str, float, float, float], Measured],
) -> LoopReading:
    unknown = Measured(math.nan, math.nan, math.nan)
    values = {}
    for quantity in LOOP_QUANTITIES:
        measured = [
            {"rebound_force": loop.rebound_N, "jounce_force": loop.jounce_N, "energy": loop.energy_J,
             "damping": loop.equivalent_damping_N_s_m,
             "dynamic_range": ranges.get((*loop.motion, loop.current_A), unknown)}[quantity.key]
            for loop in members
        ]  # fmt: skip
        reading = averaged(measured)
        if math.isfinite(reading.value):
            percent = _calibration_percent(quantity, points[members[0].id])
            values[quantity.key] = Reading(reading.value, reading.std, abs(reading.value) * percent / 100.0)
    speed_m_s = float(np.mean([loop.peak_speed_m_s for loop in members]))
    return LoopReading(motion, tuple(loop.id for loop in members), speed_m_s, values)


def averaged(measured: Iterable[Measured]) -> Reading:
    """The mean of repeats; its uncertainty is the larger of what each states and what they differ by."""
    known = [value for value in measured if math.isfinite(value.value)]
    if not known:
        return Reading(math.nan, math.nan)
    values = np.array([value.value for value in known])
    stated = math.sqrt(sum(value.std**2 for value in known)) / len(known)
    between = float(np.std(values, ddof=1)) / math.sqrt(len(known)) if len(known) > 1 else 0.0
    return Reading(float(np.mean(values)), max(stated, between) if math.isfinite(stated) else between or math.nan)


def _singles(characteristics: Characteristics, points: Mapping[str, RecordedPoint]) -> dict[str, Reading]:
    tests = [test for test in characteristics.friction if test.id in points]
    singles = {}
    for quantity in SINGLE_QUANTITIES:
        reading = averaged(test.friction_N if quantity.key == "friction_force" else test.gas_force_N for test in tests)
        if math.isfinite(reading.value):
            percent = _calibration_percent(quantity, points[tests[0].id])
            singles[quantity.key] = Reading(reading.value, reading.std, abs(reading.value) * percent / 100.0)
    return singles


def _calibration_percent(quantity: Quantity, point: RecordedPoint) -> float:
    """Standard uncertainty (%) by the sensors' certificates; NaN where one that matters is not stated."""
    needed = [name for name, matters in (("force", quantity.by_force), ("displacement", quantity.by_displacement))
              if matters]  # fmt: skip
    stated = [point.test.get(f"{name}_uncertainty_percent") for name in needed]
    return math.hypot(*(value if isinstance(value, (int, float)) else math.nan for value in stated)) if stated else 0.0


def fitted_of(run: Run) -> tuple[str, dict[str, FittedReading]]:
    """The model of the run's fit and its parameters; an empty name where there is no fit.

    Raises:
        FileProblem: `fit.json` is no fit.
    """
    file = run.path / "fit.json"
    if not file.is_file():
        return "", {}
    fit = read_json(file)
    entries = fit.get("parameters")
    if not isinstance(entries, dict) or not all(isinstance(entry, dict) for entry in entries.values()):
        raise FileProblem(str(file), ["not a fit: expected a JSON object with `model` and `parameters`"])
    poor = "" if fit.get("adequate") is not False else "the fit does not describe the tests: not a property"
    return str(fit.get("model", "")), {name: _fitted(entry, poor) for name, entry in entries.items()}


def _fitted(entry: Mapping[str, Any], poor: str) -> FittedReading:
    value, error = _number(entry.get("value")), _number(entry.get("standard_error"))
    why = poor
    if not entry.get("identifiable", True) or not math.isfinite(value):
        why = str(entry.get("reason") or "the data do not determine it")
    return FittedReading(Reading(value, error), str(entry.get("unit", "")), why)


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan


def _specimen(run: Run) -> str:
    specimen = run.campaign.get("specimen") or run.points[0].provenance.get("specimen", "")
    return str(specimen.get("serial_number", "") if isinstance(specimen, Mapping) else specimen or "")


def _load_cell(point: RecordedPoint) -> str:
    """Which load cell measured, by serial number and sensitivity; empty where none is recorded."""
    attributes = {} if point.path is None or point.imported else channel_attributes(point.path, "force")
    serial = str(attributes.get("serial_number", ""))
    return f"{serial}, {attributes.get('sensitivity')}" if serial else ""
