"""A hybrid test in process: computed building and simulated transfer system, step by step at one rate.

Each step: position and force are measured, the computed part goes on to now with the force along a line, the
compensator gives the command, the converter rounds and holds it, the transfer system moves on exactly. No time passes
between measuring and commanding.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from rig.dampers.compiled_cache import njit
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


@njit(cache=True, nogil=True)
def _run(loop: Loop, signals: Signals, chosen: Settings, memory: Memory, out: FloatArray) -> int:
    """Run the loop; returns the number of steps until the capacity was exceeded, or all."""
    plant, computed, known = np.zeros(ORDER), np.zeros(6), np.zeros(8)
    before, now, target = np.zeros(2), np.zeros(2), np.zeros(TERMS)
    under_way = np.zeros(chosen.latency_steps + 1)
    for k in range(signals.ground.size):
        if not abs(plant[FORCE]) < ACTUATOR_CAPACITY_N:
            return k
        measured = plant[POSITION] + signals.position_noise[k]
        now[0], now[1] = signals.ground[k], plant[FORCE] + signals.force_noise[k]
        for i in range(6):
            total = loop.earlier[i, 0] * before[0] + loop.earlier[i, 1] * before[1]
            total += loop.later[i, 0] * now[0] + loop.later[i, 1] * now[1]
            for j in range(6):
                total += loop.transition[i, j] * computed[j]
            known[i] = total
        computed[:] = known[:6]
        known[6], known[7] = now[0], signals.ground_rate[k]
        before[0], before[1] = now[0], now[1]
        target[0] = computed[0]
        if chosen.kind == ADAPTIVE_MODEL:
            for i in range(TERMS):
                target[i] = 0.0
                for j in range(8):
                    target[i] += loop.derivatives[i, j] * known[j]
        wanted = command(target, measured, chosen, memory)
        wanted = min(max(np.floor(wanted / QUANTUM + 0.5) * QUANTUM, -SATURATION), SATURATION)
        under_way[k % under_way.size] = wanted
        arrived = under_way[(k + 1) % under_way.size]
        said(arrived if chosen.kind == ADAPTIVE_MODEL else wanted, memory)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = computed[0], computed[1], computed[2], measured
        was = plant.copy()
        for i in range(ORDER):
            total = loop.driven[i] * arrived
            for j in range(ORDER):
                total += loop.moved[i, j] * was[j]
            plant[i] = total
    return int(signals.ground.size)


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
        out[k] = state[:3]
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
        chosen = _compensator(compensator, self.rate_Hz, self.latency_steps)
        n, step_s = len(self.ground), 1.0 / self.rate_Hz
        noise = np.random.default_rng(seed).standard_normal((2, n)) * np.sqrt(self.rate_Hz)
        noise *= np.sqrt([[POSITION_NOISE], [FORCE_NOISE]])
        out = np.zeros((n, 4))
        signals = Signals(self.ground, self.ground_rate, noise[0], noise[1])
        steps = _run(self._loop(plant), signals, chosen, fresh(chosen), out)
        stopped_s = None if steps == n else steps * step_s
        return VirtualTest(out[:steps, :3], out[:steps, 3], self.reference_m[:steps], stopped_s, step_s)

    def _loop(self, plant: TransferSystem) -> Loop:
        step_s = 1.0 / self.rate_Hz
        computed = building.computed_part(self.whole, plant.specimen)
        transition, earlier, later = along_a_line(*computed.state_space(building.ground_and_force(self.whole)), step_s)
        moved, driven = held(*plant.state_space(), step_s)
        return Loop(transition, earlier, later, moved, driven[:, 0].copy(), self._derivatives)
