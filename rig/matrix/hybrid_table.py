"""`[hybrid]` of a matrix file: the car around the damper is computed while the damper itself is moved.

Each compensator with each control law of the current is one point. Its motion and the delay up to which it is stable
are computed before any motion, by the same car with the specimen's `prior`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

from protocols.descriptions import Problem
from rig.bench.model import Bench
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.hybrid.delay_probe import Probe
from rig.hybrid.hybrid_motion import PAUSE_S, RETURN_S, HybridOrder
from rig.hybrid.motion_bounds import Bounds
from rig.matrix.assumed_damper import LEAST_RISE, SPEED_M_S, AssumedDamper
from rig.matrix.streaming import HYBRID_SPEED
from rig.signals.waveform import HOLD
from rig.test_point import HYBRID, Forecast, TestPoint
from rig.vehicle.car import Car
from rig.vehicle.laws import Control, Law, law_named
from rig.vehicle.road_file import RoadFile, Speed

if TYPE_CHECKING:  # they load the compiler
    from rig.hybrid.quarter_car import QuarterCar
    from rig.vehicle.motion import Ride

TRAVEL_MARGIN = 1.5
"""The test may go so much beyond the forecast travel before it is stopped."""
TRAVEL_BESIDE_M = 2e-3
DELAY_MARGIN = 1.25
"""The critical delay must be so many times what may act on the loop."""
LEFT_SHARE = 0.5
"""Of the delay that a compensator is expected to leave, at worst."""
FEWEST_STEPS = 8
"""In a period of the wheel's hop: with fewer the computed wheel is not that wheel."""
ROAD_LOST = 0.25
"""Of the road's force, RMS: when steps carry less of it than the rest, the test is on another road."""
LEAST_TRAVEL_M = 1e-4
FLOOR_S, LEAST_FLOOR_J = 0.5, 1.0
"""Energy errors are a share of the work passed, of what is forecast for such a time at least."""
LONGEST_S = 120.0

Delay = Annotated[float, Quantity("time", "0.5 ms", "200 ms")]
Compensator = Literal["model", "ats", "inverse", "polynomial", "none"]


class HybridCar(Car):
    """`[hybrid.car]`: the entries of a car file; a quarter car."""

    format: Literal[1] = 1
    name: str = Field(default="quarter car", min_length=1, max_length=120)
    kind: Literal["quarter"] = "quarter"

    @field_validator("rear", mode="before")
    @classmethod
    def _one_corner(cls, value: object) -> object:
        text = "a hybrid test simulates only one corner of a car, [hybrid.car.front]. Fix: remove this table"
        raise PydanticCustomError("one_corner", text)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; of a rear axle all is said."""
        return super().problems() if self.rear is None else iter(())


class HybridRoad(RoadFile):
    """`[hybrid.road]`: the entries of a road file, without recorded profiles."""

    format: Literal[1] = 1
    name: str = Field(default="road", min_length=1, max_length=120)
    speed_m_s: Speed = Field(alias="speed", description="of the car")
    kinds: ClassVar[tuple[str, ...]] = ("sweep", "random", "bump", "pothole")
    heading: ClassVar[str] = "hybrid.road."

    @field_validator("profile", "drive", mode="before")
    @classmethod
    def _computed(cls, value: object) -> object:
        shown = ", ".join(f"[{cls.heading}{name}]" for name in cls.kinds)
        text = f"a hybrid test cannot use a recorded road. Fix: replace this table with one of {shown}"
        raise PydanticCustomError("recorded_road", text)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; a recorded road is told already, with those that may stand in its place."""
        if self.profile is None and self.drive is None:
            yield from (*super().problems(), *self._short())

    def _short(self) -> Iterator[Problem]:
        for name in self.kinds:
            table = getattr(self, name)
            if table is not None and table.duration_s > LONGEST_S:
                yield (name, "duration"), (
                    f"got {table.duration_s:g} s; a hybrid test may last at most {LONGEST_S:g} s"
                )


class HybridTable(Section):
    """A hybrid test of the specimen in a quarter car."""

    car: HybridCar
    road: HybridRoad
    current_A: Annotated[float, Quantity("current", "0 A", "20 A")] = Field(default=0.0, alias="current")
    compensation: tuple[Compensator, ...] = Field(
        default=("model", "none"), min_length=1, description="compensation methods for the actuator's delay; one "
            "point each"
    )
    law: tuple[Law, ...] = Field(
        default=("passive",), min_length=1, description="control laws for the coil current, as in `rig ride --law`; "
            "one point each"
    )
    most_current_A: Annotated[float, Quantity("current", "0 A", "20 A", above=True)] = Field(
        default=1.0, alias="most_current", description="maximum current for every law except passive"
    )
    sky_share: Annotated[float, Quantity("ratio", "0 %", "100 %")] = Field(
        default=0.7, description="skyhook share in the laws `hybrid` and `inverse`: at 100 % they control the body, "
            "at 0 % the wheel"
    )
    law_damping_N_s_m: Annotated[float, Quantity("damping", "1 N s/m", "100 kN s/m")] = Field(
        default=3000.0, alias="law_damping", description="damping coefficient requested by the law `inverse`"
    )
    largest_delay_s: Delay = Field(
        default=0.015, alias="largest_delay", description="largest actuator delay at which the test may start"
    )
    largest_energy_error: Annotated[float, Quantity("ratio", "1 %", "100 %")] = Field(
        default=0.2, description="largest permitted energy added by the tracking error, as a share of the work "
            "done by the specimen"
    )
    probe_amplitude_m: Annotated[float, Quantity("length", "0.1 mm", "10 mm")] = Field(
        default=1e-3, alias="probe_amplitude", description="amplitude of the sine motion used to measure the delay"
    )
    probe_frequency_Hz: Annotated[float, Quantity("frequency", "0.5 Hz", "10 Hz")] = Field(
        default=3.0, alias="probe_frequency"
    )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        for entry, given in (("compensation", self.compensation), ("law", self.law)):
            for name in dict.fromkeys(given):
                if tuple(given).count(name) > 1:
                    yield (entry,), f"{name} is specified more than once; keep only one"

    def blind_to_current(self, prior: AssumedDamper) -> Iterator[Problem]:
        """Where the law `inverse` is asked for, and the assumed damper does not resist more with current."""
        if "inverse" not in self.law:
            return
        most_A = self.control("inverse").range_A[1]
        without_N, rise_N = prior.rise_N(most_A)
        if not rise_N > LEAST_RISE * abs(without_N):
            yield (
                ("law",),
                (
                    f"the law `inverse` computes the current from the force, but the force of {prior.description} "
                    f"does not rise with current (at {SPEED_M_S:g} m/s: {without_N:.4g} N at 0 A, "
                    f"{without_N + rise_N:.4g} N at {most_A:g} A). Fix: use another law, or a fit to tests at several "
                    "currents"
                ),
            )

    def control(self, law: Law) -> Control:
        """A law with this table's numbers."""
        return Control(law, self.current_A, self.most_current_A, self.sky_share, self.law_damping_N_s_m)

    @property
    def probe(self) -> Probe:
        """The small motion that measures the delay."""
        return Probe(self.probe_amplitude_m, self.probe_frequency_Hz)

    def quarter_car(self, prior: AssumedDamper, law: Law, fixture_kg: float = 0.0) -> QuarterCar:
        """The car with the assumed damper.

        Args:
            prior: that damper.
            law: of its coil's current.
            fixture_kg: the rig's moving mass between load cell and specimen.
        """
        from rig.hybrid.quarter_car import QuarterCar  # loads numba

        return QuarterCar(self.car, self.road.road(Path()), prior.corner, self.control(law), fixture_kg)

    def points(self, prior: AssumedDamper, centre_m: float) -> list[TestPoint]:
        """One point for each law and compensator, its forecast by the reference."""
        return [
            point
            for law in self.law
            for point in self._points_of(law, prior, centre_m)
        ]

    def _points_of(self, law: Law, prior: AssumedDamper, centre_m: float) -> list[TestPoint]:
        """The tests with one law. Force and heat are the worse of its own and of its most current all the time."""
        step_s, ride, stiffest = _reference(self, prior, law)
        acceleration = np.gradient(ride.speed_m_s[:, 0], step_s)
        forecast = Forecast(
            float(np.max(np.abs(ride.speed_m_s))), float(np.max(np.abs(acceleration))),
            max(float(np.max(np.abs(driven.force_N))) for driven in (ride, stiffest)) + _rest_N(self, prior),
            max(float(np.sum(np.abs(driven.force_N * driven.speed_m_s)) * step_s) for driven in (ride, stiffest)),
        )  # fmt: skip
        amplitude_m = max(float(np.max(np.abs(ride.extension_m))), self.probe_amplitude_m)
        whole_s = self.probe.duration_s + PAUSE_S + float(ride.time_s[-1]) + RETURN_S
        passive = law == "passive"
        return [
            TestPoint(
                id=f"hybrid-{name}" if passive else f"hybrid-{name}-{law}", waveform=HOLD.name,
                amplitude_m=amplitude_m, frequency_Hz=1.0 / whole_s, current_A=self.control(law).range_A[1], cycles=1,
                ramp_in_cycles=0.0, ramp_out_cycles=0.0, centre_m=centre_m, kind=HYBRID,
                steps_A=() if passive else (self.current_A,), forecast=forecast, compensator=name, law=law,
            )
            for name in self.compensation
        ]

    def reasons(self, point: TestPoint, prior: AssumedDamper, bench: Bench) -> list[tuple[str, str]]:
        """Slug and words of why a test cannot be run on a bench, beside the limits that every motion has."""
        car, poll_s = self.quarter_car(prior, law_named(point.law)), bench.actuator.setpoints_s
        if poll_s is None:
            return [(
                "hybrid", "a hybrid test requires an actuator that follows streamed set-points; this bench's "
                    "controller generates the motion itself",
            )]
        against = []
        if bench.clock.device_rate != 1.0:
            rate = bench.clock.device_rate
            against.append(("hybrid", f"this bench runs at {rate:g} times real time; a hybrid test requires real time"))
        if law_named(point.law) != "passive" and (bench.ecu.by_hand or bench.ecu.url is not None):
            against.append(("hybrid", (
                f"the law `{point.law}` changes the coil current at every step, which requires a current source on "
                'CAN. Fix: law = ["passive"]'
            )))
        extrapolated_s = car.critical_extrapolated_s() if point.compensator == "polynomial" else math.inf
        if not self.largest_delay_s * DELAY_MARGIN <= extrapolated_s:
            against.append((
                "hybrid-unstable", f"polynomial extrapolation over a delay of {1e3 * extrapolated_s:.1f} ms or more is "
                    f"unstable with this car and damper; largest_delay is {1e3 * self.largest_delay_s:g} ms, and the "
                    f"test must be stable with {DELAY_MARGIN:g} times that delay. Fix: use the compensation method "
                    "`model`, `ats` or `inverse`, a smaller largest_delay, if the actuator can achieve it, or a "
                    "heavier wheel",
            ))
        critical_s, share = car.critical_delay_s(), 1.0 if point.compensator == "none" else LEFT_SHARE
        acting_s = share * self.largest_delay_s
        if not acting_s * DELAY_MARGIN <= critical_s:
            against.append((
                "hybrid-unstable",
                f"the test is unstable if the force is {1e3 * critical_s:.1f} ms late; a delay of {1e3 * acting_s:.1f} "
                f"ms may occur ({100 * share:g} % of largest_delay, {1e3 * self.largest_delay_s:g} ms), and the test "
                f"must be stable with {DELAY_MARGIN:g} times that delay. Fix: use a smaller largest_delay, if the "
                "actuator can achieve it, or a heavier wheel",
            ))
        hop_Hz = car.highest_mode_Hz()
        if hop_Hz * poll_s * FEWEST_STEPS > 1.0:
            against.append((
                "sampling", f"{1.0 / (hop_Hz * poll_s):.3g} steps per period of the wheel vibration ({hop_Hz:.3g} Hz) "
                    f"at a poll period of {1e3 * poll_s:g} ms; at least {FEWEST_STEPS} are required. Fix: use a "
                    "shorter poll period or a softer tyre",
            ))
        return against + _of_road(self, prior, law_named(point.law), poll_s)

    def _energy_floor_J(self, point: TestPoint) -> float:
        """The work of half a second as it is forecast."""
        road_s = point.motion_s - self.probe.duration_s - PAUSE_S - RETURN_S
        work_J = 0.0 if point.forecast is None else point.forecast.energy_J
        return max(LEAST_FLOOR_J, FLOOR_S * work_J / road_s)

    def ride(self, point: TestPoint, prior: AssumedDamper) -> Ride:
        """What the whole car does with a point's law, computed: the forecast of its test."""
        return _reference(self, prior, law_named(point.law))[1]

    def order(self, point: TestPoint, prior: AssumedDamper, bench: Bench, room_m: tuple[float, float]) -> HybridOrder:
        """What the station is told.

        Args:
            point: the point.
            prior: the assumed damper.
            bench: the rig.
            room_m: lowest and highest position allowed.

        Raises:
            ValueError: the bench follows no set-points.
        """
        poll_s, limits = bench.actuator.setpoints_s, bench.limits
        if poll_s is None:
            raise ValueError("this bench's actuator does not follow set-points, so it cannot run a hybrid test")
        car = self.quarter_car(prior, law_named(point.law), bench.fixture.moving_mass_kg)
        room = min(room_m[1] - point.centre_m, point.centre_m - room_m[0])
        bounds = Bounds(
            min(TRAVEL_MARGIN * point.amplitude_m + TRAVEL_BESIDE_M, room), limits.speed_m_s,
            limits.acceleration_m_s2, self.largest_energy_error, self.largest_delay_s,
            room, bench.actuator.halt_deceleration_m_s2, self._energy_floor_J(point),
            limits.speed_m_s if point.forecast is None else HYBRID_SPEED * point.forecast.peak_speed_m_s,
        )
        return HybridOrder(car.part(poll_s), bounds, self.probe, point.compensator, car.control, point.centre_m)


def _of_road(table: HybridTable, prior: AssumedDamper, law: Law, poll_s: float) -> list[tuple[str, str]]:
    """Slug and words of why a road is none for a test: it hardly moves the damper, or is over between two steps."""
    _, ride, _ = _reference(table, prior, law)
    travel_m = float(np.max(np.abs(ride.extension_m)))
    if not travel_m >= LEAST_TRAVEL_M:
        return [(
            "hybrid", f"the road moves the damper by only {1e3 * travel_m:.3g} mm; required: at least "
                f"{1e3 * LEAST_TRAVEL_M:g} mm. Fix: use a road with a higher profile (left side) that starts within "
                "the duration and takes longer than a few milliseconds to cross",
        )]
    lost = table.quarter_car(prior, law).road_lost(poll_s)
    if not lost <= ROAD_LOST:
        return [(
            "sampling", f"with steps of {1e3 * poll_s:g} ms, {100 * lost:.3g} % of the road's force (RMS) is lost; "
                f"allowed: at most {100 * ROAD_LOST:g} %. Fix: use a longer bump or edge, a lower speed or last "
                "frequency, or a shorter poll period",
        )]
    return []


def _rest_N(table: HybridTable, prior: AssumedDamper) -> float:
    """What the assumed damper pulls at rest (N), either way."""
    damper = table.quarter_car(prior, "passive").damper
    return abs(float(damper.model.force_at(damper.values, 0.0, table.current_A)))


@cache
def _reference(table: HybridTable, prior: AssumedDamper, law: Law) -> tuple[float, Ride, Ride]:
    """Step (s), the whole car computed, and it again with the law's most current all the time; once for each table."""
    car = table.quarter_car(prior, law)
    step_s, ride = car.reference()
    return step_s, ride, ride if law == "passive" else car.stiffest().reference()[1]
