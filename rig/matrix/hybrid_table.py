"""`[hybrid]` of a matrix file: the car around the damper, computed, while the damper itself is moved.

Each compensator is one point. What it is forecast to do, and with which delay it would be stable, is known before
anything moves: by the same car with the specimen's `prior` in it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rig.bench.model import Bench
from rig.bench.quantity import Problem, Quantity
from rig.bench.section import Section, located
from rig.hybrid.delay_probe import Probe
from rig.hybrid.hybrid_motion import PAUSE_S, RETURN_S, HybridOrder
from rig.hybrid.lead import COMPENSATORS
from rig.hybrid.motion_bounds import Bounds
from rig.matrix.point import Forecast, TestPoint
from rig.signals.waveform import HOLD
from rig.vehicle.car import Car
from rig.vehicle.road_file import RoadFile

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
LONGEST_S = 120.0

Delay = Annotated[float, Quantity("time", "0.5 ms", "200 ms")]
Compensator = Literal["model", "ats", "inverse", "polynomial", "none"]


class HybridCar(Car):
    """`[hybrid.car]`: the entries of a car file; a quarter car."""

    format: Literal[1] = 1
    name: str = Field(default="quarter car", min_length=1, max_length=120)
    kind: Literal["quarter"] = "quarter"


class HybridRoad(RoadFile):
    """`[hybrid.road]`: the entries of a road file, without recorded profiles."""

    format: Literal[1] = 1
    name: str = Field(default="road", min_length=1, max_length=120)

    @model_validator(mode="after")
    def _in_this_file(self) -> Self:
        recorded: list[Problem] = [
            ((name,), "a hybrid test's road stands in its own file; give sweep, random, bump or pothole")
            for name in ("profile", "drive") if getattr(self, name) is not None
        ]  # fmt: skip
        table = self.sweep or self.random or self.bump or self.pothole
        if table is not None and table.duration_s > LONGEST_S:
            text = f"{table.duration_s:g} s; a hybrid test lasts {LONGEST_S:g} s at most"
            name = next(name for name in ("sweep", "random", "bump", "pothole") if getattr(self, name) is table)
            recorded.append(((name, "duration"), text))
        if recorded:
            raise located(recorded)
        return self


class HybridTable(Section):
    """A hybrid test of the specimen in a quarter car."""

    car: HybridCar
    road: HybridRoad
    current_A: Annotated[float, Quantity("current", "0 A", "20 A")] = Field(default=0.0, alias="current")
    compensation: tuple[Compensator, ...] = Field(
        default=("model", "none"), min_length=1, description="what leads the set-points; one point each"
    )
    largest_delay_s: Delay = Field(
        default=0.015, alias="largest_delay", description="of the actuator, with which the test may still begin"
    )
    largest_energy_error: Annotated[float, Quantity("ratio", "1 %", "100 %")] = Field(
        default=0.2, description="energy brought by following wrongly, as a share of the specimen's work"
    )
    probe_amplitude_m: Annotated[float, Quantity("length", "0.1 mm", "10 mm")] = Field(
        default=1e-3, alias="probe_amplitude", description="of the sine that measures the delay"
    )
    probe_frequency_Hz: Annotated[float, Quantity("frequency", "0.5 Hz", "10 Hz")] = Field(
        default=3.0, alias="probe_frequency"
    )

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        twice = [name for name in COMPENSATORS if self.compensation.count(name) > 1]
        if twice:
            raise located([(("compensation",), f"{', '.join(twice)} is given twice; keep one")])
        return self

    @property
    def probe(self) -> Probe:
        """The small motion that measures the delay."""
        return Probe(self.probe_amplitude_m, self.probe_frequency_Hz)

    def quarter_car(self, prior: str, fixture_kg: float = 0.0) -> QuarterCar:
        """The car with the assumed damper.

        Args:
            prior: name of its parameter set.
            fixture_kg: the rig's moving mass between load cell and specimen.
        """
        from rig.dampers import model, parameter_set
        from rig.hybrid.quarter_car import QuarterCar
        from rig.vehicle.motion import CornerDamper

        known = parameter_set(prior)
        damper = CornerDamper(
            model(known.model, "printed" if known.hysteresis == "printed" else "kwok"), dict(known.values)
        )
        return QuarterCar(self.car, self.road.road(Path()), damper, self.current_A, fixture_kg)

    def points(self, prior: str, centre_m: float) -> list[TestPoint]:
        """One point for each compensator, its forecast by the reference."""
        step_s, ride = _reference(self, prior)
        acceleration = np.gradient(ride.speed_m_s[:, 0], step_s)
        forecast = Forecast(
            float(np.max(np.abs(ride.speed_m_s))), float(np.max(np.abs(acceleration))),
            float(np.max(np.abs(ride.force_N))) + _rest_N(self, prior),
            float(np.sum(np.abs(ride.force_N * ride.speed_m_s)) * step_s),
        )  # fmt: skip
        amplitude_m = max(float(np.max(np.abs(ride.extension_m))), self.probe_amplitude_m)
        whole_s = self.probe.duration_s + PAUSE_S + float(ride.time_s[-1]) + RETURN_S
        return [
            TestPoint(
                id=f"hybrid-{name}", waveform=HOLD.name, amplitude_m=amplitude_m, frequency_Hz=1.0 / whole_s,
                current_A=self.current_A, cycles=1, ramp_in_cycles=0.0, ramp_out_cycles=0.0, centre_m=centre_m,
                kind="hybrid", forecast=forecast, compensator=name,
            )
            for name in self.compensation
        ]

    def reasons(self, point: TestPoint, prior: str, bench: Bench) -> list[tuple[str, str]]:
        """Slug and words of why a test cannot be run on a bench, beside the limits that every motion has."""
        car, poll_s = self.quarter_car(prior), bench.actuator.setpoints_s
        if poll_s is None:
            return [(
                "hybrid", "a hybrid test needs an actuator that follows streamed set-points; this bench's controller "
                "makes its motion itself",
            )]
        against = []
        if bench.clock.device_rate != 1.0:
            rate = bench.clock.device_rate
            against.append(("hybrid", f"the bench runs at {rate:g} times real time; a hybrid test runs at 1"))
        critical_s, share = car.critical_delay_s(), 1.0 if point.compensator == "none" else LEFT_SHARE
        acting_s = share * self.largest_delay_s
        if not acting_s * DELAY_MARGIN <= critical_s:
            against.append((
                "hybrid-unstable", f"unstable with a force {1e3 * critical_s:.1f} ms late; {1e3 * acting_s:.1f} ms may "
                f"act ({100 * share:g} % of largest_delay {1e3 * self.largest_delay_s:g} ms), and {DELAY_MARGIN:g} "
                "times that must be stable: a smaller largest_delay, if the actuator keeps it, or a heavier wheel",
            ))
        hop_Hz = car.highest_mode_Hz()
        if hop_Hz * poll_s * FEWEST_STEPS > 1.0:
            against.append((
                "sampling", f"{1.0 / (hop_Hz * poll_s):.3g} steps in a period of the wheel ({hop_Hz:.3g} Hz) at a poll "
                f"of {1e3 * poll_s:g} ms; {FEWEST_STEPS} are needed: a shorter poll, or a softer tyre",
            ))
        return against

    def order(self, point: TestPoint, prior: str, bench: Bench, room_m: tuple[float, float]) -> HybridOrder:
        """What the station is told.

        Args:
            point: the point.
            prior: the assumed damper's parameter set.
            bench: the rig.
            room_m: lowest and highest position allowed.

        Raises:
            ValueError: the bench follows no set-points.
        """
        poll_s, limits = bench.actuator.setpoints_s, bench.limits
        if poll_s is None:
            raise ValueError("this bench's actuator follows no set-points; the plan refuses it")
        car = self.quarter_car(prior, bench.fixture.moving_mass_kg)
        room = min(room_m[1] - point.centre_m, point.centre_m - room_m[0])
        bounds = Bounds(
            min(TRAVEL_MARGIN * point.amplitude_m + TRAVEL_BESIDE_M, room), limits.speed_m_s,
            limits.acceleration_m_s2, self.largest_energy_error, self.largest_delay_s,
        )
        part = car.part(poll_s, [self.current_A])
        return HybridOrder(part, bounds, self.probe, point.compensator, self.current_A, point.centre_m)


def _rest_N(table: HybridTable, prior: str) -> float:
    """What the assumed damper pulls at rest (N), either way."""
    damper = table.quarter_car(prior).damper
    return abs(float(damper.model.force_at(damper.values, 0.0, table.current_A)))


@cache
def _reference(table: HybridTable, prior: str) -> tuple[float, Ride]:
    """The whole car computed; once for each table."""
    return table.quarter_car(prior).reference()
