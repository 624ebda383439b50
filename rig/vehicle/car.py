"""The car file: masses, springs, tyres and levers of a quarter, half or full car, with where the numbers are from."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from protocols.descriptions import Problem
from rig.files.loader import load_section
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.vehicle.shipped import found

FOLDER = Path(__file__).parent / "cars"
KINDS = ("quarter", "half", "full")
Kind = Literal["quarter", "half", "full"]
Mass = Annotated[float, Quantity("mass", "1 kg", "100000 kg")]
Inertia = Annotated[float, Quantity("moment of inertia", "1 kg m^2", "1000000 kg m^2")]
Rate = Annotated[float, Quantity("stiffness", "100 N/m", "100 kN/mm")]
Damping = Annotated[float, Quantity("damping", "0 N s/m", "100 kN s/m")]
Distance = Annotated[float, Quantity("length", "1 cm", "20 m")]
Travel = Annotated[float, Quantity("length", "1 mm", "1 m")]


class Body(Section):
    """The sprung mass; of a quarter car what one wheel carries, of a half car one side."""

    mass_kg: Mass = Field(alias="mass")
    pitch_inertia_kg_m2: Inertia | None = Field(
        default=None, alias="pitch_inertia", description=(
            "pitch inertia about the centre of gravity; half-car and full-car models only"
        )
    )
    roll_inertia_kg_m2: Inertia | None = Field(
        default=None, alias="roll_inertia", description="roll inertia about the centre of gravity; only for full cars"
    )


class Axle(Section):
    """One axle; every number is that of one wheel."""

    unsprung_mass_kg: Mass = Field(alias="unsprung_mass")
    wheel_rate_N_m: Rate = Field(alias="wheel_rate", description="spring rate at the wheel")
    tyre_stiffness_N_m: Rate = Field(alias="tyre_stiffness")
    tyre_damping_N_s_m: Damping = Field(default=0.0, alias="tyre_damping")
    damping_N_s_m: Damping = Field(
        default=0.0, alias="damping", description=(
            "damping at the wheel in addition to the damper, from bushings and friction"
        )
    )
    motion_ratio: float = Field(
        default=1.0, ge=0.1, le=2.0, description="damper travel divided by wheel travel"
    )
    distance_m: Distance | None = Field(
        default=None, alias="distance", description=(
            "distance from the axle to the centre of gravity; half-car and full-car models only"
        )
    )
    track_m: Distance | None = Field(default=None, alias="track", description="track width; only for full cars")
    anti_roll_N_m: Annotated[float, Quantity("stiffness", "0 N/m", "10 kN/mm")] = Field(
        default=0.0, alias="anti_roll",
        description="anti-roll bar: force at each wheel per metre of difference between left and right wheel travel",
    )
    jounce_travel_m: Travel = Field(default=0.08, alias="jounce_travel", description=(
        "wheel travel to the compression stop"
    ))
    rebound_travel_m: Travel = Field(
        default=0.08, alias="rebound_travel", description="wheel travel to the rebound stop"
    )
    stop_stiffness_N_m: Rate = Field(default=2e5, alias="stop_stiffness", description=(
        "stiffness of each of the two stops, at the wheel"
    ))


class Car(Section):
    """One car."""

    format: Literal[1]
    name: str = Field(min_length=1, max_length=120)
    kind: Kind
    source: str = Field(min_length=1, max_length=2000, description="source of the parameters")
    estimate: bool = Field(default=False, description="true if the parameters were not measured on a single car")
    body: Body
    front: Axle = Field(description="front axle; the only axle of a quarter car")
    rear: Axle | None = None

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        incomplete = [*self._missing(), *self._beside()]
        yield from incomplete
        if not incomplete and self.kind == "full":
            yield from self._beyond_its_size()

    def _required(self) -> dict[tuple[str, ...], bool]:
        """Entries that not every kind of car has, and whether this one has them."""
        several, full = self.kind != "quarter", self.kind == "full"
        required: dict[tuple[str, ...], bool] = {
            ("body", "pitch_inertia"): several, ("body", "roll_inertia"): full, ("rear",): several,
        }
        for name in ("front", "rear") if self.rear is not None else ("front",):
            required |= {(name, "distance"): several, (name, "track"): full}
        return required

    def _given(self, place: tuple[str, ...]) -> bool:
        if place == ("rear",):
            return self.rear is not None
        table, kind = getattr(self, place[0]), Body if place[0] == "body" else Axle
        if table is None:
            return False
        return any(
            getattr(table, name) is not None
            for name, field in kind.model_fields.items() if field.alias == place[1]
        )  # fmt: skip

    def _missing(self) -> Iterator[Problem]:
        for place, required in self._required().items():
            if required and not self._given(place):
                yield place, f"is missing; a {self.kind} car requires this entry"

    def _beside(self) -> Iterator[Problem]:
        def needs(entry: str) -> str:
            return "full" if entry in {"track", "roll_inertia"} else "half"

        for place, required in self._required().items():
            if not required and self._given(place):
                yield place, (
                    f"got an entry that a {self.kind} car does not have. Fix: remove it, or set kind = "
                    f'"{needs(place[-1])}"'
                )

    def _beyond_its_size(self) -> list[Problem]:
        """Inertias that no body between these wheels can have: all mass would have to be outside of them."""
        axles = [axle for axle in (self.front, self.rear) if axle is not None]
        length_m = max(axle.distance_m or 0.0 for axle in axles) + 1.5
        width_m = max(axle.track_m or 0.0 for axle in axles) / 2.0 + 0.5
        problems: list[Problem] = []
        for place, inertia, reach_m in (
            ("pitch_inertia", self.body.pitch_inertia_kg_m2, length_m),
            ("roll_inertia", self.body.roll_inertia_kg_m2, width_m),
        ):
            most = self.body.mass_kg * reach_m**2
            if inertia is not None and inertia > most:
                problems.append((
                    ("body", place),
                    f"got more than {most:.4g} kg m^2, the largest value possible for {self.body.mass_kg:g} kg within "
                    f"{reach_m:.3g} m",
                ))
        return problems

    @cached_property
    def corner_axles(self) -> tuple[Axle, ...]:
        """The axle of each wheel: front left, front right, rear left, rear right."""
        if self.rear is None:
            return (self.front,)
        if self.kind == "half":
            return (self.front, self.rear)
        return (self.front, self.front, self.rear, self.rear)

    @property
    def sides(self) -> tuple[float, ...]:
        """+1 for each left wheel, -1 for each right one; a half car is a left side."""
        return (1.0, -1.0, 1.0, -1.0) if self.kind == "full" else (1.0,) * len(self.corner_axles)

    @property
    def places(self) -> tuple[int, ...]:
        """Of each wheel among front left, front right, rear left, rear right of a full car."""
        return {"quarter": (0,), "half": (0, 2), "full": (0, 1, 2, 3)}[self.kind]

    @property
    def lever_m(self) -> tuple[float, ...]:
        """How far each wheel is in front of the centre of gravity (m)."""
        if self.rear is None:
            return (0.0,)
        front, rear = self.front.distance_m or 0.0, -(self.rear.distance_m or 0.0)
        return (front, rear) if self.kind == "half" else (front, front, rear, rear)

    @property
    def body_inertia(self) -> tuple[float, ...]:
        """Mass (kg) and the inertias (kg m^2) of the body's degrees of freedom."""
        every = (self.body.mass_kg, self.body.pitch_inertia_kg_m2 or 0.0, self.body.roll_inertia_kg_m2 or 0.0)
        return every[: 1 + KINDS.index(self.kind)]


def load_car(given: str | Path) -> Car:
    """A car by the name of one that comes with the program, or by file.

    Raises:
        FileProblem: with every wrong entry of the file, or the names that are known.
    """
    return load_section(found(given, FOLDER, "car"), Car, "car")[0]
