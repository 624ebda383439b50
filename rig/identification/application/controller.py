"""A controller of force without feedback of force: the current command that makes the damper give a wanted force.

Each step the model's state follows the motion with the current that the coil has, the inverse gives the current for the
wanted force, and the command is what brings the lagging coil there within one interval, within the limits of the
current.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.fits.entries import TestedRange
from rig.identification.application.inversion import RESOLVED, current_band_A, currents_A, solve
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.application.tested_range import UNKNOWN, beyond_tested


@dataclass(frozen=True)
class Command:
    """One step of the controller.

    Attributes:
        command_A: current to command (A).
        target_A: coil current for the wanted force (A).
        coil_A: coil current now, by its lag (A).
        attainable: whether a tested current gives the wanted force here.
        resolvable: whether the force tells the current here; where not, the wanted current is held.
        follows: whether the coil can be at the wanted current one interval later.
        extrapolates: whether motion, temperature or the wanted current lies beyond what the tests covered.
        beyond: in which of them, by the names of `predict`; empty where in none.
    """

    command_A: float
    target_A: float
    coil_A: float
    attainable: bool
    resolvable: bool
    follows: bool
    extrapolates: bool
    beyond: str


class Controller:
    """Current commands for wanted forces; one `step` a sampling interval.

    Args:
        law: the fitted model.
        tested: what its tests covered.
        dt_s: sampling interval (s).
        limits_A: least and greatest command (A); None: the tested currents. Wider ones make the coil faster; the coil's
            own current stays within what was tested.
        mid_stroke_m: displacement at mid-stroke (m).

    Raises:
        IdentificationFailed: the tests ran at one current.
        FileProblem: an interval or limits that are none.
    """

    def __init__(
        self,
        law: Law,
        tested: TestedRange | None,
        dt_s: float,
        limits_A: tuple[float, float] | None = None,
        mid_stroke_m: float = 0.0,
    ) -> None:
        self._law, self._tested, self._dt_s = law, tested, dt_s
        self._grid = currents_A(tested)
        self._limits = (float(self._grid[0]), float(self._grid[-1])) if limits_A is None else limits_A
        problems = [f"dt_s = {dt_s:g}, expected a positive time in seconds"] if not 0.0 < dt_s < math.inf else []
        if not self._limits[0] < self._limits[1]:
            problems.append(f"limits_A = {self._limits}, expected the lowest current to be below the highest")
        if problems:
            raise FileProblem("controller", problems)
        self._mid_stroke_m = mid_stroke_m
        self._stays = 0.0 if law.eta_1_s is None else math.exp(-law.eta_1_s * dt_s)
        self._state: FloatArray | None = None
        self._force_N, self._rate_N_s = math.nan, 0.0
        self._before: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self.coil_A = self.target_A = self._command_A = float(np.clip(0.0, *self._limits))

    def step(
        self, force_N: float, displacement_m: float, velocity_m_s: float, acceleration_m_s2: float = 0.0
    ) -> Command:
        """The command for one instant.

        Args:
            force_N: wanted force (N).
            displacement_m: measured displacement (m).
            velocity_m_s: measured velocity (m/s).
            acceleration_m_s2: measured acceleration (m/s^2).

        Raises:
            ValueError: one of them is no number; the controller stays as it was, as if it had not been asked.
        """
        inputs = {"force_N": force_N, "displacement_m": displacement_m, "velocity_m_s": velocity_m_s}
        for name, value in {**inputs, "acceleration_m_s2": acceleration_m_s2}.items():
            if not math.isfinite(value):
                raise ValueError(f"controller: {name} = {value:g}, expected a number. Fix: hold or discard the last "
                    "command")
        self.coil_A = self._stays * self.coil_A + (1.0 - self._stays) * self._command_A
        now = (displacement_m - self._mid_stroke_m, velocity_m_s, acceleration_m_s2)
        state = self._advanced(now)
        motion = self._instant(now)
        target_N, rate_N_s = np.array([force_N]), np.array([self._rate(force_N)])
        answer = solve(self._law, self._grid, state[None, :], motion, target_N, rate_N_s)
        width_A = float(self._grid[-1] - self._grid[0])
        band_A = current_band_A(self._tested, answer, self._dt_s, causal=True)
        resolvable = bool(band_A[0] <= RESOLVED * width_A)
        if resolvable:
            self.target_A = float(answer[0, 0])
        ahead = (self.target_A - self._stays * self.coil_A) / (1.0 - self._stays)
        self._command_A = float(np.clip(ahead, *self._limits))
        beyond = UNKNOWN if self._tested is None else " ".join(beyond_tested(self._tested, self._instant(now)))
        return Command(
            command_A=self._command_A,
            target_A=self.target_A,
            coil_A=self.coil_A,
            attainable=bool(answer[0, 3]),
            resolvable=resolvable,
            follows=abs(ahead - self._command_A) < 1e-9,
            extrapolates=bool(beyond),
            beyond=beyond,
        )

    def _rate(self, force_N: float) -> float:
        """The wanted force's rate (N/s), smoothed."""
        from rig.dampers.trajectory import smoothed_rate  # loads numba

        if not math.isnan(self._force_N):
            self._rate_N_s = float(smoothed_rate(self._rate_N_s, force_N - self._force_N, self._dt_s))
        self._force_N = force_N
        return self._rate_N_s

    def _advanced(self, now: tuple[float, float, float]) -> FloatArray:
        """The state at this instant, moved from the one before with the coil's current."""
        from rig.dampers.trajectory import trajectory_of  # loads numba

        model = self._law.model
        if self._state is None:
            self._state = model.initial_state(now[0])
        elif model.states:
            vectors, seen_A = self._law.vectors(np.full(2, self.coil_A))
            u, v, a = (np.array(pair) for pair in zip(self._before, now, strict=True))
            _, states = trajectory_of(model)(vectors, self._state, u, v, a, seen_A, self._dt_s)
            self._state = states[1]
        self._before = now
        return self._state

    def _instant(self, now: tuple[float, float, float]) -> Motion:
        """One sample of the motion with the wanted current, at the law's temperature."""
        at_degC = self._law.at_degC
        warm = None if at_degC is None else np.array([at_degC])
        u, v, a = (np.array([value]) for value in now)
        return Motion(None, None, 0.0, u, v, a, np.array([self.target_A]), warm)
