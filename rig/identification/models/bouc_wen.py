"""Partial separation of the Bouc-Wen models: given the hysteretic shape, the force is linear in the rest.

Both are fitted in the normalised form (Ikhouane and Rodellar 2005):
w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n] has three shape parameters, rho, sigma, n, and
F = kx u + kv v + kw w + f0 is linear in the others. A grid over the
three on one cycle of each test is the start; Levenberg-Marquardt on the projected objective finishes on all.
For `bouc_wen`: z = z0 w, z0 = (A/(beta + gamma))^(1/n), rho = A/z0, sigma = gamma/(beta + gamma), alpha = kw/z0, with
A = 1, because A only scales alpha, beta and gamma. `thinning_bouc_wen` has one shape parameter more, vt, the bend of
its viscous force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers.arrays import FloatArray
from rig.dampers.loop_curve import hysteresis_series
from rig.dampers.loop_slopes import hysteresis_with_slopes
from rig.dampers.model import DamperModel
from rig.identification.models.measurement import Measurement, first_cycle
from rig.identification.models.projection import Projection, Weighting
from rig.identification.models.separable import Solution, levenberg_marquardt, limits_met

YIELD_LENGTHS = np.geomspace(0.004, 0.5, 6)  # 1/rho, as a share of the smallest amplitude
SIGMAS = (0.3, 0.8, 2.5)
EXPONENTS = (1.2, 2.0, 4.0)
BENDS = (0.1, 0.4)  # vt, as a share of the greatest speed
SLOWEST_BEND, FASTEST_BEND = 1e-3, 3.0
SIGMA_LIMITS = (0.02, 50.0)  # below 0.5 the loop's flanks feed energy back; published sets lie there too
STARTS = 3
ROUGH, FINE = 1e-3, 1e-8  # share of the objective that a step must promise: among starts, at last
LOWEST_EXPONENT = 1.0


class BoucWenForm:
    """The normalised Bouc-Wen model split for projection; n is searched as n - 1, which is positive."""

    pointwise = False
    fixed_names: tuple[str, ...] = ("kx", "kv", "kv_b", "f0")
    yield_names: tuple[str, ...] = ("kw", "kw_b")
    powers: tuple[int, ...] = (2,)
    shape_names: tuple[str, ...] = ("rho", "sigma", "n - 1")
    bends: tuple[int, ...] = (0, 0, 0)
    logarithmic: tuple[bool, ...] = (True, True, True)

    def __init__(self, smallest_amplitude_m: float) -> None:
        steepest = 2.0 / (YIELD_LENGTHS[0] * smallest_amplitude_m)
        self.limits = np.array([(1e-3 / smallest_amplitude_m, steepest), SIGMA_LIMITS, (1e-3, 15.0)])

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Form.fixed_columns`."""
        del a
        return np.column_stack((u, v, v * current, np.ones_like(u)))

    def yielding(self, source: Measurement, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """See `Form.yielding`."""
        rho, sigma, n = float(shape[0]), float(shape[1]), LOWEST_EXPONENT + float(shape[2])
        motion = (source.u_m, source.v_m_s, source.dt_s, source.samples_per_cycle)
        if slope:
            return list(hysteresis_with_slopes(rho, sigma, n, *motion)[:, rows])
        return [hysteresis_series(0.0, rho, sigma, n, *motion)[rows]]


class ThinningForm(BoucWenForm):
    """The thinning Bouc-Wen model split for projection; its second yield shape is tanh(v/vt)."""

    yield_names: tuple[str, ...] = ("kw", "kw_b", "kw_c", "kw_d", "kt", "kt_b", "kt_c", "kt_d")
    powers: tuple[int, ...] = (4, 4)
    shape_names: tuple[str, ...] = (*BoucWenForm.shape_names, "vt")
    bends: tuple[int, ...] = (0, 0, 0, 1)
    logarithmic: tuple[bool, ...] = (True, True, True, True)

    def __init__(self, smallest_amplitude_m: float, top_speed_m_s: float) -> None:
        super().__init__(smallest_amplitude_m)
        self.limits = np.vstack((self.limits, (SLOWEST_BEND * top_speed_m_s, FASTEST_BEND * top_speed_m_s)))

    def yielding(self, source: Measurement, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """See `Form.yielding`."""
        hysteretic = super().yielding(source, rows, shape[:3], slope=slope)
        argument = source.v_m_s[rows] / shape[3]
        thinning = np.tanh(argument)
        if not slope:
            return [hysteretic[0], thinning]
        return [hysteretic[0], thinning, *hysteretic[1:], -(1.0 - thinning**2) * argument / shape[3]]


def solve_bouc_wen(
    measurements: Sequence[Measurement],
    model: DamperModel,
    weighting: Weighting,
    held: frozenset[str],
    near: Mapping[str, float] | None = None,
) -> Solution:
    """Fit `normalized_bouc_wen`, `bouc_wen` or `thinning_bouc_wen`.

    Args:
        measurements: the tests.
        model: one of the three.
        weighting: which samples count, and how much.
        held: linear parameters left out, held at zero.
        near: values to start from instead of the grid.
    """
    translated = {"c0_b": "kv_b", "alpha_b": "kw_b"}
    without = frozenset(translated.get(name, name) for name in held)
    form, grid = _form_and_grid(measurements, model)
    single = [first_cycle(each) for each in measurements]
    short = Projection(form, single, weighting, without=without)
    if near is None:
        order = np.argsort([short.objective(shape) for shape in grid])[:STARTS]
        starts = [grid[k] for k in order]
    else:
        starts = [np.clip(_shape(near), form.limits[:, 0], form.limits[:, 1])]
    refined = [levenberg_marquardt(short, each, ROUGH) for each in starts]
    start = min(refined, key=lambda found: found[1].objective)[0]
    full = Projection(form, measurements, weighting, without=without)
    shape, inner = levenberg_marquardt(full, start, FINE)
    names = (*form.fixed_names, *form.yield_names)
    values = {name: float(value) for name, value in zip(names, inner.linear, strict=True)}
    values |= {"rho": float(shape[0]), "sigma": float(shape[1]), "n": LOWEST_EXPONENT + float(shape[2])}
    if isinstance(form, ThinningForm):
        values["vt"] = float(shape[3])
    share = sum(each.u_m.size for each in single) / sum(each.u_m.size for each in measurements)
    evaluations = full.evaluations + int(np.ceil(short.evaluations * share))
    met = limits_met(form.shape_names, shape, form.limits)
    if "n - 1" in met:
        met["n"] = LOWEST_EXPONENT + met.pop("n - 1")
    if model.name == "bouc_wen":
        values = to_bouc_wen(values)
    return Solution(values, inner.objective, evaluations, at_limit=met)


def _shape(values: Mapping[str, float]) -> FloatArray:
    """Shape parameters of the projected form for the values of any of the three models."""
    if "gamma" in values:
        total = values["gamma"] + values["beta"]
        rho, sigma = values["A"] * (total / values["A"]) ** (1.0 / values["n"]), values["gamma"] / total
    else:
        rho, sigma = values["rho"], values["sigma"]
    bend = [values["vt"]] if "vt" in values else []
    return np.array([rho, sigma, values["n"] - LOWEST_EXPONENT, *bend])


def _form_and_grid(measurements: Sequence[Measurement], model: DamperModel) -> tuple[BoucWenForm, list[FloatArray]]:
    amplitude = min(float(np.ptp(each.u_m)) / 2.0 for each in measurements)
    grid = [
        np.array([1.0 / (share * amplitude), sigma, n - LOWEST_EXPONENT])
        for share, sigma, n in product(YIELD_LENGTHS, SIGMAS, EXPONENTS)
    ]
    if model.name != "thinning_bouc_wen":
        return BoucWenForm(amplitude), grid
    top = max(float(np.max(np.abs(each.v_m_s))) for each in measurements)
    bends = [share * top for share in BENDS]
    return ThinningForm(amplitude, top), [np.append(shape, bend) for shape, bend in product(grid, bends)]


def to_bouc_wen(normalised: dict[str, float]) -> dict[str, float]:
    """Parameters of `bouc_wen` with A = 1 from those of `normalized_bouc_wen`, both in SI."""
    z0, n, sigma = 1.0 / normalised["rho"], normalised["n"], normalised["sigma"]
    total = z0**-n
    stiffness = normalised["kx"]
    return {
        "c0": normalised["kv"],
        "c0_b": normalised["kv_b"],
        "k0": stiffness,
        "x0": -normalised["f0"] / stiffness if stiffness != 0.0 else 0.0,
        "alpha": normalised["kw"] / z0,
        "alpha_b": normalised["kw_b"] / z0,
        "gamma": sigma * total,
        "beta": (1.0 - sigma) * total,
        "A": damper_model("bouc_wen").parameter("A").start,
        "n": n,
    }
