"""What one run says of its damper, as values that another run's can be held against, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from rig.campaign_folder import CampaignFolder
from rig.characteristics import Characteristics, characterise
from rig.characteristics.loop import LoopCharacteristics, Measured, over_repeats
from rig.display import SI, Display, Shown
from rig.errors import FileProblem
from rig.fits.entries import Estimate
from rig.fits.fit_record import fit_in
from rig.matrix.model import load_matrix
from rig.recording.endurance import withdrawn_points
from rig.recording.hdf5.reading import channel_attributes
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import REANALYSIS, Run, planned_points
from rig.signals.delay_estimation.sample_match import student
from rig.signals.test_set import (
    MOTION_SHARE,
    NOMINAL_SHARE,
    CurrentReading,
    MotionReading,
    mean_current,
    mean_motion,
    names_current,
    same_current,
    same_motion,
)
from rig.test_point import LOOP, TestPoint, rate_text

COVERAGE = 2.0
"""Expanded uncertainties are so many standard ones: about 95 %."""
NEAR_ZERO = 0.05
"""Share of the larger force of a test up to which the other one is near zero: its relative change says nothing."""
EXACT = 1e-6
LESS_THAN_ALONE = 0.99
"""Largest difference in a pair of motions, as a share of `MOTION_SHARE`: what can be one test is better than alone."""
PEAK_OF_MEAN = {"sine": math.pi / 2.0, "triangle": 1.0}
"""Peak speed of a waveform over its mean one, which is four amplitudes a cycle."""


@dataclass(frozen=True)
class Quantity:
    """What is compared: its key, its title, its short name, its SI unit, and which calibrations it scales with.

    Between motions that differ a little it is taken to follow amplitude^a frequency^b speed^n, with `powers` (a, b):
    n is between 0 (dry friction) and 1 (viscous damping) for what follows a force, and about 0 for a ratio of forces.
    """

    key: str
    title: str
    name: str
    unit: str
    by_force: bool = True
    by_displacement: bool = False
    powers: tuple[float, float] = (0.0, 0.0)
    speed_power: float = 0.5

    def shown(self, display: Display) -> Shown:
        """How its values are shown; of the forces only friction has no direction."""
        if self.unit == "N":
            force = display.force
            return replace(force, positive="rebound") if self.key == "friction_force" else force
        if self.key == "energy":
            return display.energy
        return display.damping if self.key == "damping" else plain(self.unit)


def plain(unit: str) -> Shown:
    """A quantity that is shown in its SI unit; the ratio "1" without a unit."""
    return Shown("" if unit == "1" else unit, 1.0)


LOOP_QUANTITIES = (
    Quantity("rebound_force", "Force at peak velocity, rebound", "rebound force", "N"),
    Quantity("jounce_force", "Force at peak velocity, compression", "compression force", "N"),
    Quantity("energy", "Energy per cycle", "energy", "J", by_displacement=True, powers=(1.0, 0.0)),
    Quantity("damping", "Equivalent viscous damping", "damping", "N s/m", by_displacement=True, powers=(-1.0, -1.0)),
    Quantity("dynamic_range", "Dynamic range, rebound", "dynamic range", "1", by_force=False, speed_power=0.0),
)
SINGLE_QUANTITIES = (
    Quantity("friction_force", "Friction", "friction", "N"), Quantity("gas_force", "Gas force", "gas force", "N"),
)
QUANTITIES = {quantity.key: quantity for quantity in (*LOOP_QUANTITIES, *SINGLE_QUANTITIES)}


@dataclass(frozen=True)
class Reading:
    """A value (SI), its standard uncertainty from scatter (NaN: unknown) and from calibrations (NaN: not stated).

    `freedom` is the number of degrees of freedom from which `std` is known: three cycles leave two, and an interval of
    twice such a standard uncertainty holds 82 %, not 95 %. `near_zero` is the size below which the value is near zero
    relative to others of its test. `gas_force` is the size of the static gas force (N) that a force at a speed
    includes; if it was not measured, the mean of both forces of its test where it acts as a gas force does, else 0.
    """

    value: float
    std: float
    calibration: float = 0.0
    near_zero: float = 0.0
    freedom: float = math.inf
    gas_force: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether it differs from zero by enough for a relative change to have a meaning."""
        scatter = COVERAGE * widening(self.freedom) * self.std if math.isfinite(self.std) else 0.0
        return abs(self.value) > max(scatter, self.near_zero)

    @property
    def small(self) -> bool:
        """Whether a relative change would say little: near zero, or a force of which the gas force is the larger part.

        Where the damping force hardly exceeds the gas force, a small change of the damping force is a large share of
        their difference.
        """
        return abs(self.value) <= max(self.near_zero, self.gas_force)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty (about 95 %) of what is known of it."""
        parts = (widening(self.freedom) * self.std, self.calibration)
        return COVERAGE * math.hypot(*(part for part in parts if math.isfinite(part)))

    @property
    def complete(self) -> bool:
        """Whether both parts of the uncertainty are known."""
        return math.isfinite(self.std) and math.isfinite(self.calibration)


def widening(freedom: float) -> float:
    """Factor on a standard uncertainty with these degrees of freedom, so that twice it is an interval of 95 %."""
    return student(max(1, math.floor(freedom))) if math.isfinite(freedom) else 1.0


@dataclass(frozen=True)
class Motion:
    """A motion at a current: as requested, of imported tests as measured.

    Attributes:
        waveform, amplitude_m, frequency_Hz, current_A: what the motion and the current are called.
        read: what is known of the motion.
        current: what is known of the current; None where it changes.
        by_speed: whether the matrix states its speed.
    """

    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    read: MotionReading
    current: CurrentReading | None
    by_speed: bool = field(default=False, compare=False)

    @classmethod
    def of(
        cls, read: MotionReading, current: CurrentReading | None, current_A: float, *, by_speed: bool = False
    ) -> Motion:
        """From what is known of both; `current_A` is what the current is called."""
        return cls(read.waveform, *read.nominal, current_A, read, current, by_speed)

    @property
    def label(self) -> str:
        """In one phrase, in SI units and by its frequency, as JSON states it: "sine, 50 mm, 1 Hz, 0.5 A"."""
        return replace(self, by_speed=False).phrase(SI)

    def phrase(self, shown: Display) -> str:
        """In one phrase, in the units of a display and the terms of the matrix: "sine, 50 mm, 0.131 m/s, 0.5 A"."""
        rate = rate_text(self.waveform, self.amplitude_m, self.frequency_Hz, shown, by_speed=self.by_speed)
        return (
            f"{self.waveform}, {shown.displacement.text(self.amplitude_m)}, {rate}, "
            f"{round(self.current_A, 4) + 0.0:.4g} A"
        )

    def same_as(self, other: Motion) -> bool:
        """Whether both are one test, by what was requested where that is known of both, else by what was measured."""
        return self.at_current_of(other) and same_motion(self.read, other.read)

    def at_current_of(self, other: Motion) -> bool:
        """Whether both currents are one."""
        if self.current is None or other.current is None:
            return self.current is other.current and self.current_A == other.current_A
        return self.current_A == other.current_A == 0.0 or same_current(self.current, other.current)

    def called(
        self, waveform: str | None, amplitude_m: float | None, frequency_Hz: float | None, current_A: float | None
    ) -> bool:
        """Whether a user's numbers, where they are given, mean this motion."""
        share = NOMINAL_SHARE if self.read.requested is None else EXACT
        return (
            waveform in {None, self.waveform}
            and (amplitude_m is None or math.isclose(amplitude_m, self.amplitude_m, rel_tol=share))
            and (frequency_Hz is None or math.isclose(frequency_Hz, self.frequency_Hz, rel_tol=share))
            and (current_A is None or current_A == self.current_A or (
                self.current is not None and names_current(current_A, self.current)
            ))
        )  # fmt: skip

    def apart_from(self, other: Motion) -> float:
        """Relative difference of both motions: the larger one of amplitude and frequency."""
        return max(
            abs(math.log(one / another)) if one > 0.0 and another > 0.0 else math.inf
            for one, another in ((self.read.amplitude_m, other.read.amplitude_m),
                                 (self.read.frequency_Hz, other.read.frequency_Hz))
        )  # fmt: skip


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
        missing: a reading without values of each motion that was recorded, but in no valid point.
        not_recorded: ids of points that the campaign planned and that have no file.
        planned: a reading without values of each motion that only such points have; None if it is not known.
        lost_repeats: ids of the points of a reading -> ids of planned repeats of its motion that are not in it, because
            they were not recorded or are not valid.
    """

    run: Run
    specimen: str
    loops: tuple[LoopReading, ...]
    singles: Mapping[str, Reading]
    model: str
    parameters: Mapping[str, FittedReading]
    load_cell: str
    left_out: tuple[str, ...]
    missing: tuple[LoopReading, ...] = ()
    not_recorded: tuple[str, ...] = ()
    planned: tuple[LoopReading, ...] | None = ()
    lost_repeats: Mapping[tuple[str, ...], tuple[str, ...]] = field(default_factory=dict)

    @property
    def identity(self) -> str:
        """By which a copy of the run is known as the same one."""
        return f"{self.run.campaign.get('id') or self.run.path.resolve()} {self.run.campaign.get(REANALYSIS, '')}"

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.name


def one_to_one(motions: Sequence[Motion], others: Sequence[Motion]) -> dict[int, int]:
    """Which motion of one list is which of another; each motion is in one pair at most.

    Two speeds of one test can differ by less than the tolerance of `Motion.same_as`. The pairs therefore minimise the
    sum of the squared relative differences, where a motion without a partner counts as the largest difference.

    Returns:
        Indices of `motions` -> indices of `others`.
    """
    alone = 1.0
    costs = np.full((len(motions), len(others)), alone)
    for row, motion in enumerate(motions):
        for column, other in enumerate(others):
            if motion.same_as(other):
                costs[row, column] = min(motion.apart_from(other) / MOTION_SHARE, LESS_THAN_ALONE) ** 2
    rows, columns = linear_sum_assignment(costs)
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if costs[row, column] < alone}


def readings_of(run: Run, characteristics: Characteristics | None = None) -> RunReadings:
    """Everything a run can be compared by. Points that are not valid are left out and named.

    Args:
        run: the run.
        characteristics: of the run, if they are known already.

    Raises:
        FileProblem: its `fit.json` is no fit.
    """
    characteristics = characterise(run) if characteristics is None else characteristics
    points = {point.id: point for point in run.valid}
    model, parameters = fitted_of(run)
    first = next(iter(run.points))
    singles = _singles(characteristics, points)
    gas = singles.get("gas_force")
    loops = _loops(characteristics, points, 0.0 if gas is None else abs(gas.value))
    missing, absent = tuple(_missing(run, loops)), _not_recorded(run)
    planned = _planned(run, absent)
    others = [line for line in characteristics.left_out if not line.endswith(": invalid")]  # the run has said why
    return RunReadings(
        run, _specimen(run), loops, singles, model, parameters,
        _load_cell(first), tuple(dict.fromkeys((*run.left_out, *others))),
        missing, absent, None if planned is None else _without(planned, (*loops, *missing)),
        _lost_repeats(run, loops, planned or ()),
    )


def _missing(run: Run, loops: Sequence[LoopReading]) -> Iterator[LoopReading]:
    for point in run.points:
        if point.kind != LOOP or any(point.id in loop.ids for loop in loops):
            continue
        motion = _motion_of(point)
        if not any(motion.same_as(loop.motion) for loop in loops):
            turn = PEAK_OF_MEAN.get(point.waveform, math.nan)
            yield LoopReading(motion, (point.id,), 4.0 * turn * point.amplitude_m * point.frequency_Hz, {})


def _motion_of(point: RecordedPoint) -> Motion:
    """The motion of a point that was not evaluated."""
    nominal = (point.amplitude_m, point.frequency_Hz)
    read = MotionReading(point.waveform, *nominal, requested=nominal if point.motion_requested else None)
    requested_A = point.current_A if point.current_requested else math.nan
    current = CurrentReading(point.current_A, requested_A=requested_A)
    return Motion.of(read, current, point.current_A, by_speed=point.by_speed)


def _not_recorded(run: Run) -> tuple[str, ...]:
    """Points of the campaign that it ended before."""
    recorded = {point.id for point in run.points} | withdrawn_points(run.path)
    return tuple(name for name in planned_points(run.campaign) if name not in recorded)


def planned_loop(point: TestPoint) -> LoopReading:
    """A loop that is to be measured, without values."""
    nominal = point.amplitude_m, point.frequency_Hz
    read = MotionReading(point.waveform, *nominal, requested=nominal)
    current = CurrentReading(point.current_A, requested_A=point.current_A)
    motion = Motion.of(read, current, point.current_A, by_speed=point.by_speed)
    return LoopReading(motion, (point.id,), point.peak_speed_m_s, {})


def _planned(run: Run, absent: Sequence[str]) -> tuple[LoopReading, ...] | None:
    """The loops of points without a file; None if the matrix of the run does not state them."""
    if not absent:
        return ()
    try:
        points = {point.id: point for point in load_matrix(CampaignFolder(run.path).matrix).points()}
    except FileProblem:
        return None
    if not points.keys() >= set(absent):
        return None
    return tuple(planned_loop(points[name]) for name in absent if points[name].kind == LOOP)


def _without(loops: Sequence[LoopReading], known: Sequence[LoopReading]) -> tuple[LoopReading, ...]:
    """The loops whose motion no known one has."""
    return tuple(loop for loop in loops if not any(loop.motion.same_as(other.motion) for other in known))


def _lost_repeats(
    run: Run, loops: Sequence[LoopReading], absent: Sequence[LoopReading]
) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Of each reading the planned repeats of its motion that it does not contain."""
    planned, used = set(planned_points(run.campaign)), {name for loop in loops for name in loop.ids}
    lost = [(point.id, _motion_of(point)) for point in run.points
            if point.kind == LOOP and point.id in planned - used]  # fmt: skip
    lost += [(loop.ids[0], loop.motion) for loop in absent]
    repeats = {loop.ids: tuple(name for name, motion in lost if motion.same_as(loop.motion)) for loop in loops}
    return {ids: names for ids, names in repeats.items() if names}


def _loops(
    characteristics: Characteristics, points: Mapping[str, RecordedPoint], gas_force_N: float
) -> tuple[LoopReading, ...]:
    ranges = {ratio.id: Measured(ratio.rebound, ratio.std, math.nan) for ratio in characteristics.dynamic_range}
    groups: dict[tuple[object, ...], list[LoopCharacteristics]] = {}
    for loop in characteristics.loops:
        if loop.id in points:
            groups.setdefault((*loop.motion, loop.level_A, loop.current is None), []).append(loop)
    return tuple(_loop(_common(members, points), members, points, ranges, gas_force_N) for members in groups.values())


def _common(members: Sequence[LoopCharacteristics], points: Mapping[str, RecordedPoint]) -> Motion:
    """The motion of repeats."""
    currents = [loop.current for loop in members if loop.current is not None]
    read = mean_motion([loop.motion_read for loop in members])
    by_speed = all(points[loop.id].by_speed for loop in members)
    current = mean_current(currents) if currents else None
    return Motion.of(read, current, members[0].level_A, by_speed=by_speed)


def _loop(
    motion: Motion, members: Sequence[LoopCharacteristics], points: Mapping[str, RecordedPoint],
    ranges: Mapping[str, Measured], gas_force_N: float,
) -> LoopReading:
    unknown = Measured(math.nan, math.nan, math.nan)
    values = {}
    for quantity in LOOP_QUANTITIES:
        measured = [
            {"rebound_force": loop.rebound_N, "jounce_force": loop.jounce_N, "energy": loop.energy_J,
             "damping": loop.equivalent_damping_N_s_m,
             "dynamic_range": ranges.get(loop.id, unknown)}[quantity.key]
            for loop in members
        ]  # fmt: skip
        reading = averaged(measured)
        if math.isfinite(reading.value):
            percent = calibration_percent(quantity, points[members[0].id])
            # The larger one of the scatters of cycles and of repeats is used: it is known from both.
            freedom = sum(loop.cycles for loop in members) - 1
            calibration = abs(reading.value) * percent / 100.0
            values[quantity.key] = Reading(reading.value, reading.std, calibration, freedom=freedom)
    forces = _beside({key: values[key] for key in ("rebound_force", "jounce_force") if key in values})
    if not gas_force_N and len(forces) > 1:
        gas_force_N = max(0.0, -0.5 * math.fsum(force.value for force in forces.values()))
    values |= {key: replace(force, gas_force=gas_force_N) for key, force in forces.items()}
    speed_m_s = float(np.mean([loop.peak_speed_m_s for loop in members]))
    return LoopReading(motion, tuple(loop.id for loop in members), speed_m_s, values)


def averaged(measured: Iterable[Measured]) -> Reading:
    """The mean of repeats; its uncertainty is the larger of what each states and what they differ by."""
    return Reading(*over_repeats(measured))


def _singles(characteristics: Characteristics, points: Mapping[str, RecordedPoint]) -> dict[str, Reading]:
    tests = [test for test in characteristics.friction if test.id in points]
    singles = {}
    for quantity in SINGLE_QUANTITIES:
        reading = averaged(test.friction_N if quantity.key == "friction_force" else test.gas_force_N for test in tests)
        if math.isfinite(reading.value):
            percent = calibration_percent(quantity, points[tests[0].id])
            singles[quantity.key] = Reading(reading.value, reading.std, abs(reading.value) * percent / 100.0)
    return _beside(singles)


def _beside(forces: Mapping[str, Reading]) -> dict[str, Reading]:
    """Forces of one test, each with the size below which it is near zero beside the others."""
    largest_N = max((abs(force.value) for force in forces.values()), default=0.0)
    return {key: replace(force, near_zero=NEAR_ZERO * largest_N) for key, force in forces.items()}


def calibration_percent(quantity: Quantity, point: RecordedPoint) -> float:
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
    fit = fit_in(run.path)
    if fit is None:
        return "", {}
    poor = "" if fit.adequate is not False else (
        "the model does not fit the tests, so its parameters are not properties of the damper"
    )
    return fit.model, {name: _fitted(entry, poor) for name, entry in fit.parameters.items()}


def _fitted(entry: Estimate, poor: str) -> FittedReading:
    known = entry.identifiable and entry.value is not None
    why = poor if known else entry.reason or "the data do not determine this parameter"
    value, error = (math.nan if one is None else one for one in (entry.value, entry.standard_error))
    return FittedReading(Reading(value, error), entry.unit, why)


def _specimen(run: Run) -> str:
    specimen = run.campaign.get("specimen") or run.points[0].provenance.get("specimen", "")
    return str(specimen.get("serial_number", "") if isinstance(specimen, Mapping) else specimen or "")


def _load_cell(point: RecordedPoint) -> str:
    """Which load cell measured, by serial number and sensitivity; empty where none is recorded."""
    attributes = {} if point.path is None or point.imported else channel_attributes(point.path, "force")
    serial = str(attributes.get("serial_number", ""))
    return f"{serial}, {attributes.get('sensitivity')}" if serial else ""
