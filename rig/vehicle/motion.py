"""A car with its dampers, and what it does on a road."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rig.dampers import DamperModel
from rig.dampers.arrays import FloatArray
from rig.vehicle.corner_speeds import COIL_SHARE, Corners, Equations, Motion
from rig.vehicle.laws import CONTROL, Control
from rig.vehicle.stepping import GAMMA, loop_of
from rig.vehicle.structure import Structure


@dataclass(frozen=True)
class CornerDamper:
    """A damper as one corner of a car has it.

    Attributes:
        model: the same object as plant and identifier use.
        values: complete parameters, SI.
    """

    model: DamperModel
    values: dict[str, float]

    @property
    def inertia_kg(self) -> float:
        """The rod's inertia, which becomes part of the car's mass matrix (kg)."""
        return sum(self.values[name] for name in self.model.of_term("inertia"))

    @property
    def vector(self) -> FloatArray:
        """Parameters in the kernel's order, without that inertia."""
        own = self.model.of_term("inertia")
        return self.model.vector({name: 0.0 if name in own else value for name, value in self.values.items()})

    @property
    def lag_1_s(self) -> float:
        """Rate of the coil's lag (1/s); infinite for a damper without one."""
        return self.values.get("eta", math.inf) or math.inf


@dataclass(frozen=True)
class Ride:
    """What a car did; time along the first axis, c corners, n degrees of freedom.

    Attributes:
        time_s: (k,).
        place: q (k, n), m and rad about rest.
        velocity: q' (k, n).
        acceleration: q'' (k, n).
        force_N: of the dampers, without what they pull at rest (k, c).
        extension_m: of the dampers (k, c).
        speed_m_s: of the dampers (k, c).
        current_A: in the coils (k, c).
        tyre_N: vertical load of the tyres (k, c); 0 where a tyre has left the road.
    """

    time_s: FloatArray
    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    force_N: FloatArray
    extension_m: FloatArray
    speed_m_s: FloatArray
    current_A: FloatArray
    tyre_N: FloatArray


@dataclass(frozen=True)
class DrivenCar:
    """A car with its dampers, ready to drive.

    Attributes:
        structure: its equations.
        front: damper of the front wheels, of a quarter car its only one.
        rear: of the rear wheels; None: the same as in front.
        control: what commands the coils.
    """

    structure: Structure
    front: CornerDamper
    rear: CornerDamper | None = None
    control: Control = CONTROL

    @property
    def dampers(self) -> tuple[CornerDamper, ...]:
        """The damper of each corner, (c,)."""
        in_front = -(-self.structure.corners // 2)
        rear = self.rear or self.front
        return tuple(self.front if corner < in_front else rear for corner in range(self.structure.corners))

    def drive(self, road_m: FloatArray, road_m_s: FloatArray, step_s: float) -> Ride:
        """Drive over a road from rest.

        Args:
            road_m: height under each wheel at t = 0, h, 2 h ... (k, c).
            road_m_s: how fast it rises there (k, c).
            step_s: h.

        Raises:
            ValueError: the road has another number of wheels, or is no finite numbers.
        """
        own = self.structure
        if road_m.shape != road_m_s.shape or road_m.ndim != 2 or road_m.shape[1] != own.corners:
            raise ValueError(f"road: got shapes {road_m.shape} and {road_m_s.shape}, expected {own.corners} wheels")
        if not (np.all(np.isfinite(road_m)) and np.all(np.isfinite(road_m_s))):
            raise ValueError("road: got values that are not finite")
        n, c = len(own.mass), own.corners
        motion = Motion(np.zeros((11, n)), np.zeros((11, c)), np.zeros((c, c)))
        out = loop_of(self.front.model, (self.rear or self.front).model)(
            self._equations(step_s), self._corners(step_s), motion,
            np.concatenate([road_m, road_m_s], axis=1), step_s,
        )  # fmt: skip
        parts = np.split(out, np.cumsum([n, n, n, c, c, c, c]), axis=1)
        return Ride(np.arange(len(out), dtype=np.float64) * step_s, *parts)

    def _equations(self, step_s: float) -> Equations:
        own = self.structure
        b = 0.5 * GAMMA * step_s
        mass = own.with_inerters(np.array([damper.inertia_kg for damper in self.dampers]))
        inverse = np.linalg.inv(mass + b * own.damping + b * b * own.stiffness)
        return Equations(
            np.array([mass, own.damping, own.stiffness, np.linalg.inv(mass), inverse]),
            np.array([own.corner_height, own.damper]),
            np.array([own.tyre_stiffness, own.tyre_damping, own.static_load_N, *own.stops.T]),
            np.ascontiguousarray(own.damper @ inverse @ own.damper.T),
            np.ascontiguousarray(b * (inverse @ own.damper.T)),
        )

    def _corners(self, step_s: float) -> Corners:
        front, rear = self.front, self.rear or self.front
        states = np.zeros((self.structure.corners, max(1, front.model.states, rear.model.states)))
        for corner, damper in enumerate(self.dampers):
            states[corner, : max(1, damper.model.states)] = damper.model.initial_state()
        coils = np.zeros((3, len(states)))
        coils[COIL_SHARE] = [1.0 - math.exp(-damper.lag_1_s * step_s) for damper in self.dampers]
        return Corners(front.vector, rear.vector, states, states.copy(), coils, np.array(self.control.vector))
