"""The computed part of a hybrid test of a quarter car (everything except its damper), and the fully computed car."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.hybrid.discretisation import along_a_line
from rig.hybrid.substructure import Substructure
from rig.signals.arrays import FloatArray
from rig.vehicle.car import Car
from rig.vehicle.laws import CONTROL, Control
from rig.vehicle.motion import CornerDamper, DrivenCar, Ride
from rig.vehicle.road import Road
from rig.vehicle.structure import structure

STATES = 4
"""Heights of body and wheel, their speeds."""
FINE_S = 1e-3
"""Longest step of the reference."""
TABLE_SPEEDS_M_S = tuple(math.copysign(abs(s) ** 2, s) for s in np.linspace(-1.0, 1.0, 41).tolist())
EQUIVALENT_SPEED_M_S = 0.1
SWEEP_Hz = (0.05, 200.0, 4000)
EVENLY_Hz = (0.05, 400.0, 20_000)
BRIDGED_STEP_S, LONGEST_BRIDGED_S = 0.5e-3, 0.05
LEVELS = 5
"""Currents at which the assumed damper's force is known to a law."""


@dataclass(frozen=True)
class QuarterCar:
    """A quarter car on a road with an assumed damper.

    Attributes:
        car: its masses, springs and tyre.
        road: what it drives over.
        damper: what is assumed of the specimen.
        control: the law of its coil's current.
        fixture_kg: moving mass of the rig between load cell and specimen, kg.
    """

    car: Car
    road: Road
    damper: CornerDamper
    control: Control = CONTROL
    fixture_kg: float = 0.0

    def reference(self) -> tuple[float, Ride]:
        """The whole car computed, the assumed damper in it: step (s) and motion."""
        _, height_m, rate_m_s = self.road.under(self.car, FINE_S)
        driven = DrivenCar(structure(self.car), self.damper, control=self.control)
        return FINE_S, driven.drive(height_m, rate_m_s, FINE_S)

    def stiffest(self) -> QuarterCar:
        """The same with the most current that its law may ask for, all the time."""
        return replace(self, control=Control(current_A=self.control.range_A[1]))

    def _matrices(self) -> tuple[FloatArray, FloatArray, float]:
        """State matrix (4, 4), inputs (4, 2) of damper and road force, and the motion ratio.

        The rod's inertia is among the masses: the measured force comes without it.
        """
        own = structure(self.car)
        mass = own.with_inerters(np.array([self.damper.inertia_kg]))
        inverse = np.linalg.inv(mass)
        state = np.zeros((STATES, STATES))
        state[:2, 2:] = np.eye(2)
        state[2:, :2], state[2:, 2:] = -inverse @ own.stiffness, -inverse @ own.damping
        inputs = np.zeros((STATES, 2))
        inputs[2:, 0] = -inverse @ own.damper[0]
        inputs[2:, 1] = inverse @ np.array([0.0, 1.0])
        return state, inputs, float(own.damper[0, 0])

    def currents_A(self) -> list[float]:
        """From the least to the most current of the law, A."""
        low_A, high_A = self.control.range_A
        return [low_A] if low_A == high_A else [float(level) for level in np.linspace(low_A, high_A, LEVELS)]

    def part(self, step_s: float) -> Substructure:
        """The computed part in steps of `step_s`, with the assumed damper's force at the law's currents."""
        currents_A, rest_A = self.currents_A(), self.control.current_A
        state, inputs, ratio = self._matrices()
        transition, before, after = along_a_line(state, inputs, step_s)
        extension = ratio * np.array([1.0, -1.0])
        acceleration, by_input = extension @ state[2:], extension @ inputs[2:]
        return Substructure(
            step_s=step_s, transition=transition.tolist(), force_before=before[:, 0].tolist(),
            force_after=after[:, 0].tolist(), road_before=before[:, 1].tolist(), road_after=after[:, 1].tolist(),
            road_N=self._road_N(step_s).tolist(), extension=[*extension.tolist(), 0.0, 0.0],
            speed=[0.0, 0.0, *extension.tolist()],
            acceleration=acceleration.tolist(), acceleration_force=float(by_input[0]),
            acceleration_road=float(by_input[1]), body=[1.0, 0.0, 0.0, 0.0], wheel=[0.0, 1.0, 0.0, 0.0],
            body_speed=[0.0, 0.0, 1.0, 0.0], wheel_speed=[0.0, 0.0, 0.0, 1.0],
            inertia_kg=self.damper.inertia_kg + self.fixture_kg, force_speeds_m_s=list(TABLE_SPEEDS_M_S),
            force_currents_A=currents_A,
            force_N=[steady_force_N(self.damper, current_A, rest_A).tolist() for current_A in currents_A],
        )

    def road_lost(self, step_s: float) -> float:
        """What of the road's force steps of this length (s) do not carry, RMS, as a share of it; NaN without any."""
        whole_N, steps_N = self._road_N(FINE_S), self._road_N(step_s)
        carried_N = np.interp(np.arange(len(whole_N)) * FINE_S, np.arange(len(steps_N)) * step_s, steps_N)
        there = float(np.mean(whole_N**2))
        return math.sqrt(float(np.mean((carried_N - whole_N) ** 2)) / there) if there > 0.0 else math.nan

    def _road_N(self, step_s: float) -> FloatArray:
        """What the road does to the wheel through the tyre, in steps of `step_s`, N."""
        _, height_m, rate_m_s = self.road.under(self.car, step_s)
        axle = self.car.front
        return axle.tyre_stiffness_N_m * height_m[:, 0] + axle.tyre_damping_N_s_m * rate_m_s[:, 0]

    def highest_mode_Hz(self) -> float:
        """The wheel's hop without the damper, Hz."""
        return float(structure(self.car).modes_Hz()[-1])

    def critical_delay_s(self) -> float:
        """How late a linear damper's force may be before the loop is unstable, s; infinite where it never is.

        The damper's damping is the assumed one's force at 0.1 m/s, whichever way and current of the law is more,
        divided by that. A pure delay: 1 + G(s) c s exp(-s tau) crosses where |G c s| = 1, and tau makes up its phase.
        """
        frequencies = np.geomspace(*SWEEP_Hz)
        loop = self._loop(frequencies)
        beyond = np.abs(loop) - 1.0
        crossed = np.flatnonzero(beyond[:-1] * beyond[1:] <= 0.0)
        turns = np.angle(-loop[crossed]) % (2.0 * np.pi)
        return float(min(turns / (2.0 * np.pi * frequencies[crossed]), default=math.inf))

    def critical_extrapolated_s(self) -> float:
        """The shortest delay over which the loop is unstable if third-order extrapolation bridges it, s.

        A rod that is led by u(t) = 4 x(t) - 6 x(t - tau) + 4 x(t - 2 tau) - x(t - 3 tau) and comes tau late follows
        H = 1 - (1 - exp(-s tau))^4: up to 15 times the target where tau is half a period. The loop is unstable where
        1 + G(s) c s H encircles the origin, c as in `critical_delay_s`. To 0.5 ms; infinite where it is stable up to
        `LONGEST_BRIDGED_S`.
        """
        frequencies = np.linspace(*EVENLY_Hz)
        loop = self._loop(frequencies)
        for delay_s in np.arange(BRIDGED_STEP_S, LONGEST_BRIDGED_S, BRIDGED_STEP_S):
            led = loop * (1.0 - (1.0 - np.exp(-2j * np.pi * frequencies * delay_s)) ** 4)
            phase = np.unwrap(np.angle(1.0 + led))
            if abs(phase[-1] - phase[0]) > np.pi or abs(led[-1]) > 1.0:
                return float(delay_s)
        return math.inf

    def _loop(self, frequencies: FloatArray) -> NDArray[np.complex128]:
        """G(s) c s of damper and car at some frequencies (Hz), (n,): the loop gain without delay."""
        at = [int(np.argmin(np.abs(np.array(TABLE_SPEEDS_M_S) - side * EQUIVALENT_SPEED_M_S))) for side in (-1, 1)]
        forces = [steady_force_N(self.damper, current_A, current_A) for current_A in self.currents_A()]
        damping = max(float(force_N[i]) / TABLE_SPEEDS_M_S[i] for force_N in forces for i in at)
        state, inputs, ratio = self._matrices()
        row = ratio * np.array([0.0, 0.0, 1.0, -1.0])
        s = 2j * np.pi * frequencies
        inner = np.linalg.solve(s[:, None, None] * np.eye(STATES)[None] - state[None], inputs[None, :, :1])
        loop: NDArray[np.complex128] = -damping * np.einsum("i,fij->f", row, inner)
        return loop


def steady_force_N(damper: CornerDamper, current_A: float, rest_A: float) -> FloatArray:
    """What a damper adds to its force at rest with `rest_A` at each of `TABLE_SPEEDS_M_S` once that has lasted, N."""
    rest_N = float(damper.model.force_at(damper.values, 0.0, rest_A))
    return np.asarray(damper.model.force_at(damper.values, TABLE_SPEEDS_M_S, current_A), np.float64) - rest_N
