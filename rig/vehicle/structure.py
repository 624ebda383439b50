"""A car's equations of motion about its static equilibrium: masses, springs, tyres, and where its dampers act.

Degrees of freedom q (n,), upwards and nose up positive: quarter car z, zu; half car z, theta, zu front, zu rear; full
car z, theta, phi, zu front left, front right, rear left, rear right. Body heave z (m), pitch theta (rad), roll phi
(rad, left side up), wheels zu (m):

    M q'' + C q' + K q = P (kt zr + ct zr') - sum_i w_i T_i(e_i, e_i') + stops and lifted tyres
    zc_i = z + a_i theta + b_i phi        height of the body over wheel i
    e_i  = r_i (zc_i - zu_i) = w_i . q    extension of damper i (m); its force T_i (N) resists extension

as in the full car of the c-FOA paper, section 4.2. The inertia of a damper's rod, m e'', is part of M: r^2 m between
body and wheel. What it would pull at rest (gas preload) is carried by the springs: q = 0 is the height at which the car
stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.vehicle.car import Car

G_M_S2 = 9.80665
BODY = {"quarter": ("heave",), "half": ("heave", "pitch"), "full": ("heave", "pitch", "roll")}
"""What the body of each kind of car can do, in the order of the degrees of freedom."""


@dataclass(frozen=True)
class Structure:
    """The matrices of one car, n degrees of freedom, c corners.

    Attributes:
        car: what they were made of.
        mass: M (n, n) without the dampers' inertia.
        damping: C (n, n).
        stiffness: K (n, n).
        corner_height: B (c, n): zc = B q.
        damper: w (c, n): e = w q.
        tyre_stiffness: kt (c,), N/m.
        tyre_damping: ct (c,), N s/m.
        static_load_N: what each tyre carries at rest (c,).
        stops: jounce travel (m), rebound travel (m), stiffness (N/m) of each corner, (c, 3).
    """

    car: Car
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner_height: FloatArray
    damper: FloatArray
    tyre_stiffness: FloatArray
    tyre_damping: FloatArray
    static_load_N: FloatArray
    stops: FloatArray

    @cached_property
    def body(self) -> tuple[str, ...]:
        """Names of the body's degrees of freedom."""
        return BODY[self.car.kind]

    @property
    def corners(self) -> int:
        """Number of wheels."""
        return len(self.tyre_stiffness)

    def with_inerters(self, mass_kg: FloatArray) -> FloatArray:
        """M (n, n) with the inertia (kg) of each corner's damper between body and wheel."""
        total: FloatArray = self.mass + np.einsum("c,ci,cj->ij", mass_kg, self.damper, self.damper)
        return total

    def modes_Hz(self) -> FloatArray:
        """Undamped natural frequencies (Hz), ascending, (n,)."""
        rates = np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness))
        frequencies: FloatArray = np.sort(np.sqrt(np.abs(rates.real))) / (2.0 * np.pi)
        return frequencies

    def transfer(self, frequency_Hz: FloatArray, damping_N_s_m: FloatArray, inertia_kg: FloatArray) -> FloatArray:
        """Analytic response of the car whose dampers are linear: q for zr = 1 m at each wheel, complex.

        Args:
            frequency_Hz: (f,).
            damping_N_s_m: constant damping of each damper, (c,).
            inertia_kg: inertia of each damper, (c,).

        Returns:
            (f, n, c), from the road under each wheel to each degree of freedom.
        """
        mass = self.with_inerters(inertia_kg)
        damping = self.damping + np.einsum("c,ci,cj->ij", damping_N_s_m, self.damper, self.damper)
        wheels = np.zeros((len(mass), self.corners))
        wheels[-self.corners :] = np.eye(self.corners)
        w = 2.0 * np.pi * frequency_Hz
        dynamic = (
            self.stiffness[None] - w[:, None, None] ** 2 * mass[None] + 1j * w[:, None, None] * damping[None]
        )
        road = wheels[None] * (self.tyre_stiffness + 1j * w[:, None] * self.tyre_damping)[:, None, :]
        response: FloatArray = np.linalg.solve(dynamic, road)
        return response


def structure(car: Car) -> Structure:
    """The equations of a car."""
    axles = car.corner_axles
    body = len(BODY[car.kind])
    count = len(axles)
    size = body + count
    heights = np.zeros((count, size))
    heights[:, 0] = 1.0
    if body > 1:
        heights[:, 1] = car.lever_m
    if body > 2:
        heights[:, 2] = [side * 0.5 * (axle.track_m or 0.0) for axle, side in zip(axles, car.sides, strict=True)]
    wheels = np.eye(size)[body:]
    mass = np.diag([*car.body_inertia, *(axle.unsprung_mass_kg for axle in axles)])
    tyre_N_m = np.array([axle.tyre_stiffness_N_m for axle in axles])
    tyre_N_s_m = np.array([axle.tyre_damping_N_s_m for axle in axles])
    relative = heights - wheels
    stiffness = np.einsum("c,ci,cj->ij", [axle.wheel_rate_N_m for axle in axles], relative, relative)
    if car.kind == "full":
        for left in (0, 2):
            roll = relative[left] - relative[left + 1]
            stiffness += axles[left].anti_roll_N_m * np.outer(roll, roll)
    stiffness += np.einsum("c,ci,cj->ij", tyre_N_m, wheels, wheels)
    damping = np.einsum("c,ci,cj->ij", tyre_N_s_m, wheels, wheels)
    damping += np.einsum("c,ci,cj->ij", [axle.damping_N_s_m for axle in axles], relative, relative)
    return Structure(
        car, mass, damping, stiffness, heights, relative * np.array([[axle.motion_ratio] for axle in axles]),
        tyre_N_m, tyre_N_s_m, _static_load_N(car),
        np.array([(axle.jounce_travel_m, axle.rebound_travel_m, axle.stop_stiffness_N_m) for axle in axles]),
    )


def _static_load_N(car: Car) -> FloatArray:
    """What each tyre carries at rest: its wheel, and the body's share by the axles' distances."""
    axles, levers = car.corner_axles, car.lever_m
    if len(axles) == 1:
        shares = [1.0]
    else:
        front, rear = abs(levers[0]), abs(levers[-1])
        sides = len(axles) / 2
        shares = [(rear if lever > 0 else front) / (front + rear) / sides for lever in levers]
    return np.array([
        G_M_S2 * (share * car.body.mass_kg + axle.unsprung_mass_kg)
        for share, axle in zip(shares, axles, strict=True)
    ])
