"""Fit of the models that hardly separate, modified_bouc_wen and viscoelastic_plastic: all parameters at once.

Levenberg-Marquardt on the normal equations, sensitivities by differences, started from the solution of the simpler
model that each contains as a limit (Bouc-Wen with an infinitely stiff dashpot c1; Bingham without elasticity) with
several values of the rest. Starts compete on one cycle of each test; the best is finished on all samples where it comes
near the noise.

The search is bounded by evaluations, on one cycle of each test of at most `SEARCHED` samples, and no state may be
faster than the integration can follow; so its work is bounded whatever the data are, and the same on any machine.
Beside a rival that fits twice as well it is given up after the starts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from rig.dampers.algebraic import BinghamModel
from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.hysteretic import NormalizedBoucWenModel
from rig.dampers.model import DamperModel
from rig.dampers.series import force_series
from rig.identification.models.bouc_wen import LOWEST_EXPONENT, SIGMA_LIMITS, solve_bouc_wen
from rig.identification.models.measurement import Measurement, first_cycle, spaced
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import GivenUp, Solution, solve_separable

DIFFERENCE = 1e-4
ITERATIONS, FIRST_ITERATIONS = 40, 15
TOLERANCE, ROUGH = 1e-7, 1e-5  # share of the objective that a step must promise: on all samples, while searching
MOST_EVALUATIONS = 700  # of the search, on its few samples
SEARCHED = 125  # samples of a cycle that the search sees
HOPELESS = 2.0  # times a rival's root mean square error, after the starts
STIFF_DASHPOTS = (5.0, 15.0, 40.0, 120.0)  # c1 over c0
STIFFNESS_SHARE = 0.5  # k0 over k0 + k1
BENDS = ((0.5, 1.0), (0.6, 0.3))  # sigma and n - 1 beside those of the Bouc-Wen solution
LOWEST_BEND = 0.01  # of n - 1
LEAST_BEND = 2e-3  # of n - 1, below which it is at its limit
YIELD_SHARES = (0.004, 0.02, 0.1)  # deflection of the series spring at yield over the smallest amplitude
SPRING_RATIOS = (0.03, 0.5)  # k1 over k2
RETARDATIONS_S = (0.002, 0.02)  # c1 over k1
FAMILY = 4  # successive starts of which the best is refined
LONGEST_LOGARITHM = 1.0
FASTEST = 5.0  # rate of the viscoelastic element, times the sampling interval, beyond which it is rigid
LAST_ITERATIONS = 15
DESCRIBED = 4.0  # misfit over noise, in squares, beyond which more cycles of the same misfit say nothing more


@dataclass(frozen=True)
class Unknowns:
    """How a vector of unknowns becomes the model's parameters.

    Attributes:
        names: what is searched.
        logarithmic: which of them are searched by their logarithm.
        scales: sizes at which the others move.
        model: the model.
        held: parameters of the model left at zero.
    """

    names: tuple[str, ...]
    logarithmic: BoolArray
    scales: FloatArray
    model: DamperModel
    held: frozenset[str]

    def vector(self, theta: FloatArray) -> FloatArray:
        """The model's own vector."""
        natural = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, theta, 0.0)), theta * self.scales)
        found = dict(zip(self.names, natural.tolist(), strict=True))
        values = {each.name: each.start for each in self.model.parameters} | found
        if "rho" in found:
            values = _from_normalised(self.model, values, found)
        return self.model.vector({name: 0.0 if name in self.held else values[name] for name in self.model.names})

    def theta(self, values: Mapping[str, float]) -> FloatArray:
        """The unknowns of named values."""
        natural = np.array([values[name] for name in self.names])
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, natural, 1.0)), natural / self.scales)


def _from_normalised(model: DamperModel, values: dict[str, float], found: dict[str, float]) -> dict[str, float]:
    """Parameters of modified_bouc_wen from rho, sigma, n - 1 and the yield force; A stays as it is."""
    a, n = values["A"], LOWEST_EXPONENT + found["n - 1"]
    z0 = a / found["rho"]
    total = a * z0**-n
    return values | {
        "n": n,
        "gamma": found["sigma"] * total,
        "beta": (1.0 - found["sigma"]) * total,
        "alpha_a": found["kw"] / z0,
        "alpha_b": found.get("kw_b", 0.0) / z0,
        "x0": found["f1"] / found["k1"] if found["k1"] != 0.0 else 0.0,
        "eta": model.parameter("eta").start,
    }


class Sum:
    """The weighted sum of squares, its gradient and curvature; `noise_power` is what the tests' scatter leaves."""

    def __init__(self, unknowns: Unknowns, measurements: Sequence[Measurement], weighting: Weighting) -> None:
        self._unknowns = unknowns
        self._data = [(each, weighting.of(each, index)) for index, each in enumerate(measurements)]
        self._fastest_1_s = FASTEST / min(each.dt_s for each in measurements)
        noise_N = [0.0 if np.isnan(each.noise_N) else each.noise_N for each in measurements]
        self.noise_power = sum(n**2 * float(w @ w) for n, (_, w) in zip(noise_N, self._data, strict=True)) or np.inf
        self.evaluations = 0
        self.counting = sum(int(np.count_nonzero(w)) for _, w in self._data)

    def objective(self, theta: FloatArray) -> float:
        """Sum of squares; infinite where the force is not finite."""
        self.evaluations += 1
        vector, total = self._unknowns.vector(theta), 0.0
        for each, weight in self._data:
            residual = (each.force_N - self._force(vector, each)) * weight
            total += float(residual @ residual)
        return total if np.isfinite(total) else np.inf

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """J'J and J'r of the weighted residual r, by forward differences."""
        size = theta.size
        self.evaluations += size + 1
        curvature, gradient = np.zeros((size, size)), np.zeros(size)
        vectors = [self._unknowns.vector(theta + DIFFERENCE * row) for row in np.eye(size)]
        centre = self._unknowns.vector(theta)
        for each, weight in self._data:
            force = self._force(centre, each)
            moved = [(self._force(vector, each) - force) * (weight / DIFFERENCE) for vector in vectors]
            jacobian = np.column_stack(moved)
            curvature += jacobian.T @ jacobian
            gradient += jacobian.T @ ((each.force_N - force) * weight)
        return curvature, gradient

    def _force(self, vector: FloatArray, each: Measurement) -> FloatArray:
        model, motion = self._unknowns.model, (each.u_m, each.v_m_s, each.a_m_s2, each.current_A)
        state = model.initial_state(float(each.u_m[0]))
        force: FloatArray = force_series(model.kind, vector, state, *motion, each.dt_s, each.samples_per_cycle)
        return force

    def minimise(
        self, theta: FloatArray, iterations: int, tolerance: float = TOLERANCE, budget: int = MOST_EVALUATIONS
    ) -> tuple[FloatArray, float]:
        """Levenberg-Marquardt from `theta`; the best unknowns and their objective.

        Args:
            theta: where to start, shape (k,).
            iterations: at most so many.
            tolerance: it ends when a step promises less than this share of the objective,
            budget: or when so many evaluations were made, those before included.
        """
        value, damping = self.objective(theta), 1e-3
        curvature, gradient = self.slopes(theta)
        for _ in range(iterations):
            if self.evaluations >= budget:
                break
            scale = np.maximum(np.diag(curvature), 1e-12 * max(float(np.max(np.diag(curvature))), 1e-300))
            step = np.linalg.solve(curvature + damping * np.diag(scale), gradient)
            step = np.where(self._unknowns.logarithmic, np.clip(step, -LONGEST_LOGARITHM, LONGEST_LOGARITHM), step)
            if not np.all(np.isfinite(step)) or float(step @ gradient) <= tolerance * value:
                break
            found = self.objective(theta + step) if self._admissible(theta + step) else np.inf
            if found < value:
                theta, value, damping = theta + step, found, damping * 0.2
                curvature, gradient = self.slopes(theta)
            else:
                damping *= 6.0
                if damping > 1e8:
                    break
        return theta, value

    def _admissible(self, theta: FloatArray) -> bool:
        """Whether the model can be integrated: dashpots positive at every current, no rate beyond reason."""
        names = self._unknowns.model.names
        values: dict[str, float] = dict(zip(names, self._unknowns.vector(theta).tolist(), strict=True))
        currents = [float(f(each.current_A)) for each, _ in self._data for f in (np.min, np.max)]
        low, high = min(currents), max(currents)
        if "c1a" in values:
            dashpots = [values["c1a"] + values["c1b"] * amps for amps in (low, high)]
            dashpots += [
                values["c0a"] + values["c0b"] * amps + c1 for amps, c1 in zip((low, high), dashpots, strict=True)
            ]
            return (
                min(dashpots) > 0.0
                and _roll_off_rate(values, high, min(dashpots)) < self._fastest_1_s
                and SIGMA_LIMITS[0] <= values["gamma"] / (values["gamma"] + values["beta"]) <= SIGMA_LIMITS[1]
            )
        viscous = min(values["c0"] + values["c0_b"] * amps for amps in (low, high))
        yielding = min(values["fc"] + values["fc_b"] * amps for amps in (low, high))
        if viscous <= 0.0 or yielding < 0.0:
            return False
        return values["k2"] * (1.0 / values["c1"] + 1.0 / viscous) + values["k1"] / values["c1"] < self._fastest_1_s


def solve_states(
    measurements: Sequence[Measurement],
    model: DamperModel,
    weighting: Weighting,
    held: frozenset[str],
    start: Mapping[str, float] | None = None,
    rival_N: float = math.inf,
) -> Solution:
    """Fit `modified_bouc_wen` or `viscoelastic_plastic`.

    Args:
        measurements: the tests.
        model: one of the two.
        weighting: which samples count, and how much.
        held: parameters left out, held at zero.
        start: values to start from instead of the simpler model's.
        rival_N: root mean square error of another model on the same tests (N).

    Raises:
        GivenUp: the rival is so much better that nothing more is tried.
    """
    modified = model.name == "modified_bouc_wen"
    starts = (
        _modified_starts(measurements, weighting, held) if modified else _plastic_starts(measurements, weighting, held)
    )
    if start is not None:
        starts = [_normalised(start) if modified else dict(start)]
    unknowns = _unknowns(model, starts[0], held)
    single = [first_cycle(each) for each in measurements]
    short, full = (
        Sum(unknowns, [spaced(each, SEARCHED) for each in single], weighting),
        Sum(unknowns, measurements, weighting),
    )
    families = [starts[k : k + FAMILY] for k in range(0, len(starts), FAMILY)]
    thetas = [min((unknowns.theta(each) for each in family), key=short.objective) for family in families]
    share = short.counting / max(1, full.counting)
    part = MOST_EVALUATIONS // (2 * len(thetas))
    tried = [short.minimise(theta, FIRST_ITERATIONS, ROUGH, short.evaluations + part) for theta in thetas]
    best = min(tried, key=lambda found: found[1])
    reached_N = math.sqrt(best[1] / max(1, short.counting))
    if reached_N > HOPELESS * rival_N:
        raise GivenUp(
            f"{model.name}: given up after {short.evaluations} evaluations on one cycle of each test: its error, "
            f"{reached_N:.3g} N, is {reached_N / rival_N:.1f} times that of the best model before it, {rival_N:.3g} N"
        )
    theta, left = short.minimise(best[0], ITERATIONS, ROUGH)
    finish = LAST_ITERATIONS if start is None and left <= DESCRIBED * short.noise_power else 0
    theta, objective = full.minimise(theta, finish) if finish else (theta, full.objective(theta))
    at_limit = _at_limit(unknowns, theta)
    values = dict(zip(model.names, unknowns.vector(theta).tolist(), strict=True))
    evaluations = full.evaluations + int(np.ceil(short.evaluations * share))
    known = {name: value for name, value in values.items() if name != "eta"}
    return Solution(known, objective, evaluations, at_limit=at_limit)


def _at_limit(unknowns: Unknowns, theta: FloatArray) -> dict[str, float]:
    """The exponent, where it has gone to its limit."""
    if "n - 1" not in unknowns.names:
        return {}
    bend = math.exp(float(theta[unknowns.names.index("n - 1")]))
    return {"n": LOWEST_EXPONENT} if bend <= LEAST_BEND else {}


def _roll_off_rate(values: Mapping[str, float], high_A: float, dashpots: float) -> float:
    """Fastest rate (1/s) at which the roll-off of the modified Bouc-Wen model relaxes up to a current."""
    hysteretic = max(abs(values["alpha_a"]), abs(values["alpha_a"] + values["alpha_b"] * high_A)) * values["A"]
    return (hysteretic + abs(values["k0"])) / dashpots


def _unknowns(model: DamperModel, start: Mapping[str, float], held: frozenset[str]) -> Unknowns:
    positive = {"rho", "sigma", "n - 1", "c1a", "k1", "c1", "k2", "c0"}
    translated = {"alpha_b": "kw_b"}
    left_out = {translated.get(name, name) for name in held}
    modified = model.name == "modified_bouc_wen"
    signed = positive - {"k1"} if modified else positive
    names = tuple(start) if modified else tuple(name for name in model.names if name not in left_out)
    names = tuple(name for name in names if name not in left_out)
    logarithmic = np.array([name in signed for name in names])
    companions = {
        "kw_b": "kw",
        "c0b": "c0a",
        "c1b": "c1a",
        "fc_b": "fc",
        "c0_b": "c0",
        "k0": "k1",
        "f1": "kw",
        "f0": "fc",
    }
    sizes = [max(abs(start[name]), 0.3 * abs(start[companions.get(name, name)]), 1e-6) for name in names]
    return Unknowns(names, logarithmic, np.array(sizes), model, held)


def _modified_starts(
    measurements: Sequence[Measurement], weighting: Weighting, held: frozenset[str]
) -> list[dict[str, float]]:
    """The Bouc-Wen solution with a stiff dashpot in series, for several stiffnesses of it."""
    simpler = {"alpha_b": "kw_b", "c0b": "kv_b"}
    without = frozenset(simpler[name] for name in held if name in simpler)
    single = [first_cycle(each) for each in measurements]
    simple = solve_bouc_wen(single, NormalizedBoucWenModel(), weighting, without).values
    viscous = max(abs(simple["kv"]), 1e-3 * abs(simple["kw"]), 1.0)
    bends = ((min(max(simple["sigma"], 0.4), 19.0), max(simple["n"] - LOWEST_EXPONENT, LOWEST_BEND)), *BENDS)
    return [
        {
            "kw": simple["kw"], "kw_b": simple["kw_b"], "c0a": simple["kv"], "c0b": simple["kv_b"],
            "c1a": ratio * viscous, "c1b": ratio * max(simple["kv_b"], 0.0), "k0": STIFFNESS_SHARE * simple["kx"],
            "k1": (1.0 - STIFFNESS_SHARE) * simple["kx"], "f1": -simple["f0"], "rho": simple["rho"],
            "sigma": sigma, "n - 1": bend,
        }
        for (sigma, bend), ratio in product(bends, STIFF_DASHPOTS)
    ]  # fmt: skip


def _normalised(values: Mapping[str, float]) -> dict[str, float]:
    """The unknowns' names for values of modified_bouc_wen."""
    total, n = values["gamma"] + values["beta"], values["n"]
    z0 = (values["A"] / total) ** (1.0 / n)
    kept = {name: values[name] for name in ("c0a", "c0b", "c1a", "c1b", "k0", "k1")}
    shape = {"rho": values["A"] / z0, "sigma": values["gamma"] / total, "n - 1": max(n - LOWEST_EXPONENT, 1e-3)}
    force = {"kw": values["alpha_a"] * z0, "kw_b": values["alpha_b"] * z0, "f1": values["k1"] * values["x0"]}
    return force | kept | shape


def _plastic_starts(
    measurements: Sequence[Measurement], weighting: Weighting, held: frozenset[str]
) -> list[dict[str, float]]:
    """The Bingham solution with springs and a dashpot before yield, for several of each."""
    simple = solve_separable(
        [first_cycle(each) for each in measurements], BinghamModel(), weighting, held=held & {"fc_b", "c0_b"}
    ).values
    amplitude_m = min(float(np.ptp(each.u_m)) / 2.0 for each in measurements)
    mean_A = float(np.mean([np.mean(each.current_A) for each in measurements]))
    yield_N = max(abs(simple["fc"] + simple["fc_b"] * mean_A), 1.0)
    fastest_1_s = FASTEST / min(each.dt_s for each in measurements)
    starts = []
    for deflection, ratio, retardation_s in product(YIELD_SHARES, SPRING_RATIOS, RETARDATIONS_S):
        k2 = yield_N / (deflection * amplitude_m)
        starts.append(
            {
                "k1": ratio * k2, "c1": max(ratio * k2 * retardation_s, 2.5 * k2 / fastest_1_s), "k2": k2,
                "c0": max(simple["c0"], 4.0 * k2 / fastest_1_s, 1.0), "fc": max(simple["fc"], 0.0),
                "fc_b": simple["fc_b"], "c0_b": max(simple["c0_b"], 0.0), "f0": simple["f0"],
            }
        )  # fmt: skip
    return starts
