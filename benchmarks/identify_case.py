"""The problem the identification benchmark is about: random truths of Table 1, their residuals and their minimum."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from rig.dampers import model, parameter_set
from rig.identification.models.kernels import fast_tanh
from rig.identification.models.measurement import Measurement
from rig.identification.models.problem import Problem
from rig.study.recordings import table1

SUCCESS = 1.001


@njit(fastmath=True, error_model="numpy", cache=True)
def fast_residual(p, u, v, a, current, force, out):  # noqa: ANN001, ANN201 - numba infers arrays
    for i in range(u.size):
        viscous = p[6] + p[8] * current[i] if v[i] >= 0.0 else p[7] + p[9] * current[i]
        shape = fast_tanh(p[2] * v[i] + p[3] * np.sign(u[i]))
        model_force = p[0] * a[i] + p[1] + (p[4] + p[5] * current[i]) * shape + viscous * v[i]
        out[i] = (force[i] - model_force - (p[10] + p[11] * current[i]) * u[i]) * v[i]
    return out


class Case:
    """One truth: its recordings, objective, residuals and minimum."""

    def __init__(self, tests: list[Measurement], truth: np.ndarray) -> None:
        self.tests, self.truth = tests, truth
        self.problem = Problem(tests, "asymmetric", "v")
        columns = ("u_m", "v_m_s", "a_m_s2", "current_A", "force_N")
        self.u, self.v, self.a, self.current, self.force = (
            np.concatenate([getattr(test, name) for test in tests]) for name in columns
        )
        self.n = self.u.size

    @cached_property
    def minimum(self) -> float:
        """What trf reaches from the truth."""
        polished = least_squares(self.residual, self.truth, x_scale="jac", method="trf", xtol=1e-14, ftol=1e-14)
        return min(2.0 * float(polished.cost), self.problem.objective(self.truth))

    def residual(self, p: np.ndarray) -> np.ndarray:
        """Residuals F w of (12) by the compiled loop, shape (n,)."""
        return fast_residual(p, self.u, self.v, self.a, self.current, self.force, np.empty(self.n))

    def numpy_residual(self, p: np.ndarray) -> np.ndarray:
        """The same as a user would write it."""
        viscous = np.where(self.v >= 0.0, p[6] + p[8] * self.current, p[7] + p[9] * self.current)
        shape = np.tanh(p[2] * self.v + p[3] * np.sign(self.u))
        model_force = p[0] * self.a + p[1] + (p[4] + p[5] * self.current) * shape + viscous * self.v
        return (self.force - model_force - (p[10] + p[11] * self.current) * self.u) * self.v

    def success(self, value: float) -> bool:
        """Whether a value is at the minimum."""
        return value <= SUCCESS * self.minimum


def random_case(seed: int, cycles: int = 1) -> Case:
    """A truth log-uniform within a factor 4 of `demo`, with its noisy recordings; `cycles` repeats them."""
    rng = np.random.default_rng(seed)
    damper = model("asymmetric")
    demo = parameter_set("demo").values
    values = {name: value * 4.0 ** rng.uniform(-1.0, 1.0) for name, value in demo.items()}
    tests = []
    for test in table1("demo", 0.0, 0):
        motion = [np.tile(channel, cycles) for channel in (test.u_m, test.v_m_s, test.a_m_s2, test.current_A)]
        force = damper.force(values, *motion, test.dt_s) + rng.normal(0.0, 5.0, motion[0].size)
        tests.append(
            Measurement(
                id=test.id, u_m=motion[0], v_m_s=motion[1], a_m_s2=motion[2], current_A=motion[3], force_N=force,
                dt_s=test.dt_s, samples_per_cycle=test.samples_per_cycle, amplitude_m=test.amplitude_m,
                frequency_Hz=test.frequency_Hz, nominal_current_A=test.nominal_current_A,
            )
        )  # fmt: skip
    names = Problem(tests, "asymmetric", "v").names
    return Case(tests, np.array([values[name] for name in names]))


def sane_box(names: tuple[str, ...]) -> np.ndarray:
    demo = parameter_set("demo").values
    box = np.array([(-10.0 * abs(demo[name]), 10.0 * abs(demo[name])) for name in names])
    for name in ("beta", "delta"):
        box[names.index(name)] = (0.0, 20.0 * demo[name])
    return box


def wide_box(names: tuple[str, ...]) -> np.ndarray:
    return np.tile([-1e4, 1e4], (len(names), 1))


def timed(call: Callable[[], float]) -> tuple[float, float]:
    started = time.perf_counter()
    value = call()
    return value, time.perf_counter() - started


def cpu_timed(call: Callable[[], float], repeats: int = 1) -> tuple[float, float]:
    """Value and least processor time (s) of so many calls: other work on the same cores counts as little as it can."""
    best = float("inf")
    for _ in range(repeats):
        started = time.process_time()
        value = call()
        best = min(best, time.process_time() - started)
    return value, best
