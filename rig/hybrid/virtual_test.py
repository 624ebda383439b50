"""A hybrid test in process: computed building and simulated transfer system, step by step at one rate.

Each step: position and force are measured, the computed part advances with the force along a line, the compensator
gives the command, the converter rounds and holds it, the transfer system advances exactly. No time passes between
measuring and commanding.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import Compiled, cached, fingerprint
from rig.hybrid import building
from rig.hybrid.compensators import (
    ADAPTIVE_MODEL,
    TERMS,
    Memory,
    Model,
    Settings,
    ahead_by,
    command,
    fresh,
    said,
    settings,
)
from rig.hybrid.discretisation import along_a_line, held
from rig.hybrid.earthquake import Earthquake
from rig.hybrid.transfer_system import (
    ACTUATOR_CAPACITY_N,
    FORCE,
    ORDER,
    POSITION,
    QUANTUM,
    SATURATION,
    TransferSystem,
    sensitivity,
)
from rig.signals.arrays import FloatArray

POSITION_NOISE = 6.25e-14
"""Power of the position sensor's noise, m^2/Hz: variance times step."""
FORCE_NOISE = 1.16e-3
"""Power of the load cell's noise, N^2/Hz."""
FINE_Hz = 4096
"""The reference is computed in steps no longer than this rate's."""
MODEL_NOISE_m = 2e-5


class Loop(NamedTuple):
    """One rate's matrices: computed part (`transition`, `earlier`, `later`), plant (`moved`, `driven`).

    `derivatives` (6, 8) gives the target's from the computed state (6), the ground's acceleration and its rate.
    """

    transition: FloatArray
    earlier: FloatArray
    later: FloatArray
    moved: FloatArray
    driven: FloatArray
    derivatives: FloatArray


class Signals(NamedTuple):
    """What comes from outside at each step (n,): ground acceleration (m/s^2), its rate, sensor noise (m, N)."""

    ground: FloatArray
    ground_rate: FloatArray
    position_noise: FloatArray
    force_noise: FloatArray


class Computed(NamedTuple):
    """What goes on from step to step: computed state, inputs before, what is known, target, commands under way.

    `seen` (2,) are the plant's position (m) and force (N) at a step, `out` (n, 4) the floors and the measured position.
    """

    state: FloatArray
    before: FloatArray
    known: FloatArray
    target: FloatArray
    under_way: FloatArray
    seen: FloatArray
    out: FloatArray


@dataclass(frozen=True)
class VirtualTest:
    """What one test gave.

    Attributes:
        floors_m: displacements of the computed floors (n, 3), m; the first is the specimen's target.
        measured_m: the specimen's (n,), m.
        reference_m: of the whole building (n, 3), m.
        stopped_s: when the actuator's capacity was exceeded and the test ended, s; None: it went through.
        step_s: s.
    """

    floors_m: FloatArray
    measured_m: FloatArray
    reference_m: FloatArray
    stopped_s: float | None
    step_s: float


@njit()
def _step(loop: Loop, signals: Signals, chosen: Settings, memory: Memory, at: Computed, k: int) -> float:
    """One step of the computed part and its compensator from what is seen; the command (m) that arrives now."""
    measured = at.seen[0] + signals.position_noise[k]
    ground, force_N = signals.ground[k], at.seen[1] + signals.force_noise[k]
    for i in range(6):
        total = loop.earlier[i, 0] * at.before[0] + loop.earlier[i, 1] * at.before[1]
        total += loop.later[i, 0] * ground + loop.later[i, 1] * force_N
        for j in range(6):
            total += loop.transition[i, j] * at.state[j]
        at.known[i] = total
    for i in range(6):
        at.state[i] = at.known[i]
    at.known[6], at.known[7] = ground, signals.ground_rate[k]
    at.before[0], at.before[1] = ground, force_N
    at.target[0] = at.state[0]
    if chosen.kind == ADAPTIVE_MODEL:
        for i in range(TERMS):
            at.target[i] = 0.0
            for j in range(8):
                at.target[i] += loop.derivatives[i, j] * at.known[j]
    current_A = command(at.target, measured, chosen, memory)
    current_A = min(max(np.floor(current_A / QUANTUM + 0.5) * QUANTUM, -SATURATION), SATURATION)
    at.under_way[k % at.under_way.size] = current_A
    arrived = at.under_way[(k + 1) % at.under_way.size]
    said(arrived if chosen.kind == ADAPTIVE_MODEL else current_A, memory)
    at.out[k, 0], at.out[k, 1], at.out[k, 2], at.out[k, 3] = at.state[0], at.state[1], at.state[2], measured
    return float(arrived)


def _one_step(key: str) -> Compiled:
    def once(loop: Loop, signals: Signals, chosen: Settings, memory: Memory, at: Computed, k: int) -> float:
        """One step for a plant that is somewhere else; the command (m) that leaves now."""
        _step(loop, signals, chosen, memory, at, k + 0 * len(key))
        return float(at.under_way[k % at.under_way.size])

    return once


def _whole_loop(key: str) -> Compiled:
    def run(loop: Loop, signals: Signals, chosen: Settings, memory: Memory, at: Computed) -> int:
        """Run the loop; returns the number of steps until the capacity was exceeded, or all."""
        plant = np.zeros(ORDER)
        for k in range(signals.ground.size + 0 * len(key)):
            if not abs(plant[FORCE]) < ACTUATOR_CAPACITY_N:
                return k
            at.seen[0], at.seen[1] = plant[POSITION], plant[FORCE]
            arrived = _step(loop, signals, chosen, memory, at, k)
            was = plant.copy()
            for i in range(ORDER):
                total = loop.driven[i] * arrived
                for j in range(ORDER):
                    total += loop.moved[i, j] * was[j]
                plant[i] = total
        return int(signals.ground.size)

    return run


KEY = f"{fingerprint(Path(__file__).parent)} hybrid"
"""Numba does not notice when a compensator changes: another room, other entries of the compiled cache."""
_once, _run = cached(_one_step(KEY)), cached(_whole_loop(KEY))


@njit(cache=True, nogil=True)
def _respond(transition: FloatArray, earlier: FloatArray, later: FloatArray, ground: FloatArray) -> FloatArray:
    """Displacements (n, 3) of a building whose ground moves, from rest."""
    state, out = np.zeros(6), np.zeros((ground.size, 3))
    for k in range(ground.size):
        was = state.copy()
        for i in range(6):
            total = later[i] * ground[k] + (earlier[i] * ground[k - 1] if k > 0 else 0.0)
            for j in range(6):
                total += transition[i, j] * was[j]
            state[i] = total
        for i in range(3):
            out[k, i] = state[i]
    return out


def known_before() -> Model:
    """What a compensator knows of the benchmark's transfer system: the nominal one and the published spread."""
    inverse = TransferSystem().inverse()
    return Model(inverse, sensitivity(), float(inverse[1]), MODEL_NOISE_m)


@cache
def _compensator(name: str, rate_Hz: int, latency_steps: int) -> Settings:
    return settings(name, known_before(), rate_Hz, latency_steps)


class Benchmark:
    """One case under one earthquake at one rate; `test` runs it with a compensator and a transfer system.

    `latency_steps`: how many steps pass between measuring and the arrival of the command that follows from it.
    """

    def __init__(self, case: int, rate_Hz: int, earthquake: Earthquake, latency_steps: int = 0) -> None:
        self.whole = building.reference(building.CASES[case])
        self.rate_Hz, self.latency_steps = rate_Hz, latency_steps
        self.ground = earthquake.at(rate_Hz)
        self.ground_rate = np.gradient(self.ground, 1.0 / rate_Hz)
        self.reference_m = self._reference(earthquake)
        self._derivatives = ahead_by(self._target_derivatives(), (0.5 + latency_steps) / rate_Hz)

    def _reference(self, earthquake: Earthquake) -> FloatArray:
        times = -(-FINE_Hz // self.rate_Hz)
        state, inputs = self.whole.state_space(building.ground_and_force(self.whole)[:, :1])
        transition, earlier, later = along_a_line(state, inputs, 1.0 / (times * self.rate_Hz))
        fine = earthquake.at(times * self.rate_Hz)
        out: FloatArray = _respond(transition, earlier[:, 0].copy(), later[:, 0].copy(), fine)
        return out[::times][: len(self.ground)]

    def _target_derivatives(self) -> FloatArray:
        """Position of the first floor and its derivatives (6, 8) by the whole building with the nominal specimen.

        The ground's acceleration and its rate are known: the record is. Its second rate is taken for zero.
        """
        state, inputs = self.whole.state_space(building.ground_and_force(self.whole)[:, :1])
        going = np.zeros((8, 8))
        going[:6, :6], going[:6, 6], going[6, 7] = state, inputs[:, 0], 1.0
        row = np.eye(8)[0]
        rows = []
        for _ in range(TERMS):
            rows.append(row)
            row = row @ going
        return np.array(rows)

    def test(self, compensator: str, plant: TransferSystem, seed: int) -> VirtualTest:
        """Run the test.

        Args:
            compensator: one of `compensators.NAMES`.
            plant: the transfer system as it is.
            seed: of the sensors' noise.
        """
        course = StepwiseTest(self, compensator, plant, seed)
        return course.result(_run(*course.parts))

    def signals(self, seed: int) -> Signals:
        """The ground's motion, and sensor noise drawn with this seed."""
        noise = np.random.default_rng(seed).standard_normal((2, len(self.ground))) * np.sqrt(self.rate_Hz)
        noise *= np.sqrt([[POSITION_NOISE], [FORCE_NOISE]])
        return Signals(self.ground, self.ground_rate, noise[0], noise[1])

    def loop(self, plant: TransferSystem) -> Loop:
        """The matrices of this problem with a transfer system."""
        step_s = 1.0 / self.rate_Hz
        computed = building.computed_part(self.whole, plant.specimen)
        transition, earlier, later = along_a_line(*computed.state_space(building.ground_and_force(self.whole)), step_s)
        moved, driven = held(*plant.state_space(), step_s)
        return Loop(transition, earlier, later, moved, driven[:, 0].copy(), self._derivatives)


class StepwiseTest:
    """One test of a problem, step by step.

    Args (construction):
        problem: case, earthquake, rate, and how many steps late a command arrives.
        compensator: one of `compensators.NAMES`.
        plant: the transfer system; the computed part is the building without this specimen.
        seed: of the sensors' noise.

    Attributes:
        steps: so far.
        capacity_exceeded: the actuator's force was beyond its capacity: the test is over.
    """

    def __init__(self, problem: Benchmark, compensator: str, plant: TransferSystem, seed: int) -> None:
        chosen = _compensator(compensator, problem.rate_Hz, problem.latency_steps)
        n = len(problem.ground)
        self.steps = 0
        self.capacity_exceeded = False
        self._problem = problem
        self._at = Computed(
            np.zeros(6), np.zeros(2), np.zeros(8), np.zeros(TERMS), np.zeros(chosen.latency_steps + 1), np.zeros(2),
            np.zeros((n, 4)),
        )  # fmt: skip
        self.parts = (problem.loop(plant), problem.signals(seed), chosen, fresh(chosen), self._at)

    @property
    def over(self) -> bool:
        """The record has ended, or the capacity was exceeded."""
        return self.capacity_exceeded or self.steps == len(self._problem.ground)

    def step(self, position_m: float, force_N: float) -> float:
        """The command (m) that leaves now, from what is measured now; 0 once the test is over."""
        self.capacity_exceeded = self.capacity_exceeded or not abs(force_N) < ACTUATOR_CAPACITY_N
        if self.over:
            return 0.0
        self._at.seen[:] = position_m, force_N
        following = _once(*self.parts, self.steps)
        self.steps += 1
        return float(following)

    def result(self, steps: int) -> VirtualTest:
        """What so many steps gave."""
        out, problem = self._at.out, self._problem
        step_s = 1.0 / problem.rate_Hz
        stopped_s = None if steps == len(out) else steps * step_s
        return VirtualTest(out[:steps, :3], out[:steps, 3], problem.reference_m[:steps], stopped_s, step_s)
