"""Three-step identification of the normalised Bouc-Wen model from one loop (Zhu et al., whom paper 2 compares with).

    F = kx u + kv v + kw w + f0,   w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n]

Where the loop is saturated w = sgn v, so there

    1. kx, kv, kw, f0 follow by linear least squares from F = kx u + kv v + kw sgn v + f0;
    2. with w = (F - kx u - kv v - f0) / kw, the slope dw/du at w = 0 is rho;
    3. on the transitions from reversal to saturation, sigma and n follow by nonlinear least squares between
       the measured w and the equation integrated over u from the reversal.

Which samples are saturated is first taken from the speed (above `SATURATED_SPEED` of its peak) and then, rho being
known, from the travel since the last reversal (more than `SATURATED_TRAVEL` / rho); the three steps are done twice.

The steps know one test at one constant current. Over several, kv and kw are lines in the current (least squares); kx,
f0, rho, sigma and n, which the model does not let depend on it, are means and medians over the tests.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import Solution
from rig.identification.models.undetermined import levels_of

SATURATED_SPEED = 0.6
SATURATED_TRAVEL = 5.0
CENTRAL_W = 0.3
FEWEST_SAMPLES = 20


@dataclass(frozen=True)
class NormalizedBoucWenFit:
    """Parameters of the normalised Bouc-Wen model at one current.

    Attributes:
        kx: Stiffness, N/m.
        kv: Viscous damping, N s/m.
        kw: Hysteretic force, N.
        f0: Offset, N.
        rho: 1/m.
        sigma: Shape, dimensionless.
        n: Sharpness, dimensionless.
        rmse_w: Root mean square error of w on the transitions.
        evaluations: Integrations of the transitions spent in step 3.
    """

    kx: float
    kv: float
    kw: float
    f0: float
    rho: float
    sigma: float
    n: float
    rmse_w: float
    evaluations: int


def identify(displacement_m: FloatArray, velocity_m_s: FloatArray, force_N: FloatArray) -> NormalizedBoucWenFit:
    """Identify the normalised Bouc-Wen model from one test at constant current.

    Args:
        displacement_m: Shape (n,), extension about mid-stroke, at least one cycle.
        velocity_m_s: Shape (n,).
        force_N: Shape (n,).

    Returns:
        The seven parameters.

    Raises:
        IdentificationFailed: Too few samples on a saturated branch or around w = 0, or no hysteretic force at all.
    """
    saturated = np.abs(velocity_m_s) >= SATURATED_SPEED * np.max(np.abs(velocity_m_s))
    kx, kv, kw, f0 = saturated_branch(displacement_m, velocity_m_s, force_N, saturated)
    for _ in range(2):
        w = (force_N - kx * displacement_m - kv * velocity_m_s - f0) / kw
        rho = slope_at_zero(displacement_m, velocity_m_s, w)
        travel = travel_since_reversal(displacement_m, velocity_m_s)
        kx, kv, kw, f0 = saturated_branch(displacement_m, velocity_m_s, force_N, travel > SATURATED_TRAVEL / rho)
    w = (force_N - kx * displacement_m - kv * velocity_m_s - f0) / kw
    rho = slope_at_zero(displacement_m, velocity_m_s, w)
    sigma, n, rmse_w, evaluations = transition_shape(displacement_m, velocity_m_s, w, rho)
    return NormalizedBoucWenFit(kx, kv, kw, f0, rho, sigma, n, rmse_w, evaluations)


def saturated_branch(
    displacement_m: FloatArray, velocity_m_s: FloatArray, force_N: FloatArray, saturated: BoolArray
) -> tuple[float, float, float, float]:
    """Step 1: linear least squares of F = kx u + kv v + kw sgn v + f0 where w = sgn v.

    Args:
        displacement_m: Shape (n,).
        velocity_m_s: Shape (n,).
        force_N: Shape (n,).
        saturated: Shape (n,): samples to use.

    Returns:
        kx (N/m), kv (N s/m), kw (N), f0 (N).

    Raises:
        IdentificationFailed: Too few such samples on either side, or kw is not positive.
    """
    rebound, jounce = saturated & (velocity_m_s > 0), saturated & (velocity_m_s < 0)
    if min(rebound.sum(), jounce.sum()) < FEWEST_SAMPLES:
        raise IdentificationFailed(
            f"zhu_three_step: got {rebound.sum()} saturated samples in rebound and {jounce.sum()} in compression, "
            f"expected {FEWEST_SAMPLES} or more in each. Fix: record a larger amplitude or more cycles"
        )
    u, v = displacement_m[saturated], velocity_m_s[saturated]
    columns = np.column_stack([u, v, np.sign(v), np.ones_like(u)])
    kx, kv, kw, f0 = np.linalg.lstsq(columns, force_N[saturated], rcond=None)[0]
    if not kw > 0.0:
        raise IdentificationFailed(f"zhu_three_step: kw = {kw:.4g} N is not positive: the loop shows no hysteresis")
    return float(kx), float(kv), float(kw), float(f0)


def slope_at_zero(displacement_m: FloatArray, velocity_m_s: FloatArray, w: FloatArray) -> float:
    """Step 2: rho = dw/du at w = 0, by a parabola through the samples with |w| below `CENTRAL_W`.

    Args:
        displacement_m: Shape (n,).
        velocity_m_s: Shape (n,).
        w: Shape (n,): measured hysteretic variable.

    Returns:
        rho, 1/m: median over the crossings of w = 0.

    Raises:
        IdentificationFailed: No crossing has at least three samples.
    """
    central = np.abs(w) < CENTRAL_W
    edges = np.flatnonzero(np.diff(np.concatenate([[False], central, [False]]).astype(np.int8)))
    slopes = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        span = slice(first, last)
        if last - first < 3 or np.ptp(np.sign(velocity_m_s[span])) > 0:
            continue
        fit = np.polynomial.Polynomial.fit(displacement_m[span], w[span], 2 if last - first > 4 else 1)
        crossing = displacement_m[span][np.argmin(np.abs(w[span]))]
        slopes.append(float(fit.deriv()(crossing)))
    if not slopes:
        raise IdentificationFailed("zhu_three_step: no zero crossing of w has three samples. Fix: increase the "
            "sample rate")
    return float(np.median(slopes))


def travel_since_reversal(displacement_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Distance from the last reversal, zero before the first one.

    Args:
        displacement_m: Shape (n,).
        velocity_m_s: Shape (n,).

    Returns:
        Shape (n,), m.
    """
    turned = np.flatnonzero(np.diff(np.sign(velocity_m_s)) != 0) + 1
    last = np.zeros(len(displacement_m), dtype=np.int64)
    last[turned] = turned
    last = np.maximum.accumulate(last)
    return np.where(last > 0, np.abs(displacement_m - displacement_m[last]), 0.0)


def transition_shape(
    displacement_m: FloatArray, velocity_m_s: FloatArray, w: FloatArray, rho: float
) -> tuple[float, float, float, int]:
    """Step 3: sigma and n by least squares of w on the transition branches.

    Args:
        displacement_m: Shape (n,).
        velocity_m_s: Shape (n,).
        w: Shape (n,): measured hysteretic variable.
        rho: Slope at w = 0, 1/m.

    Returns:
        sigma, n, root mean square error of w, integrations spent.

    Raises:
        IdentificationFailed: The recording has no complete transition.
    """
    from scipy.optimize import least_squares  # only this step needs SciPy

    turned = np.flatnonzero(np.diff(np.sign(velocity_m_s)) != 0) + 1
    reach = SATURATED_TRAVEL / rho
    branches = []
    for first, last in itertools.pairwise(turned):
        near = np.abs(displacement_m[first:last] - displacement_m[first]) <= reach
        if near.sum() >= 5:
            branches.append(np.arange(first, first + int(near.sum())))
    if not branches:
        raise IdentificationFailed(
            "zhu_three_step: no transition after a reversal has five samples. Fix: increase the sample rate"
        )

    def error(shape: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                integrated_w(displacement_m[branch], float(w[branch[0]]), rho, float(shape[0]), float(shape[1]))
                - w[branch]
                for branch in branches
            ]
        )

    solution = least_squares(error, np.array([1.0, 1.5]), bounds=([0.5, 1.0], [20.0, 20.0]), x_scale="jac")
    rmse_w = float(np.sqrt(np.mean(solution.fun**2)))
    return float(solution.x[0]), float(solution.x[1]), rmse_w, int(solution.nfev) * 3


def integrated_w(displacement_m: FloatArray, w_first: float, rho: float, sigma: float, n: float) -> FloatArray:
    """Hysteretic variable along a monotone branch: dw/du = rho [1 - (sigma sgn(v w) + 1 - sigma) |w|^n], Heun's method.

    Args:
        displacement_m: Shape (n,), monotone.
        w_first: Value at the first sample.
        rho: 1/m.
        sigma: Shape.
        n: Sharpness, at least 1.

    Returns:
        Shape (n,).
    """
    direction = 1.0 if displacement_m[-1] >= displacement_m[0] else -1.0

    def slope(value: float) -> float:
        along = 1.0 if direction * value > 0.0 else -1.0
        power: float = min(abs(value), 2.0) ** n
        return rho * (1.0 - (sigma * along + 1.0 - sigma) * power)

    steps = np.diff(displacement_m)
    w = np.empty(len(displacement_m))
    w[0] = w_first
    for k, step in enumerate(steps):
        parts = max(1, int(np.ceil(abs(rho * step) / 0.1)))
        value, part = float(w[k]), step / parts
        for _ in range(parts):
            first = slope(value)
            value += 0.5 * part * (first + slope(value + part * first))
        w[k + 1] = value
    return w


MODEL = "normalized_bouc_wen"


def solve_three_steps(
    model: DamperModel, measurements: Sequence[Measurement], weighting: Weighting, held: frozenset[str]
) -> Solution:
    """Fit `normalized_bouc_wen` by Zhu's three steps.

    Args:
        model: the normalised Bouc-Wen model.
        measurements: the tests, each at constant current.
        weighting: for the objective that is reported; the method itself knows no weights.
        held: parameters that the tests cannot determine, held at zero.

    Raises:
        IdentificationFailed: another model, or too few tests on which the three steps work: none, or all at one current
            of several; the message says why for each.
    """
    if model.name != MODEL:
        raise IdentificationFailed(
            f"zhu_three_step: got model {model.name}, expected {MODEL}. Fix: add `--model {MODEL}`"
        )
    fits: list[NormalizedBoucWenFit] = []
    currents_A, refused, fitted = [], [], []
    for test in measurements:
        try:
            fits.append(identify(*(array[test.scored] for array in (test.u_m, test.v_m_s, test.force_N))))
            fitted.append(test)
            currents_A.append(float(np.mean(test.current_A)))
        except IdentificationFailed as error:
            refused.append(f"{test.id}: {error}")
    if not fits:
        raise IdentificationFailed("; ".join(refused))
    affine = "kw_b" not in held
    if affine and len(levels_of(fitted)) == 1:
        raise IdentificationFailed(
            f"zhu_three_step succeeds only at {currents_A[0]:.2f} A, where kw is not separable from kw_b, nor kv from "
            f"kv_b ({'; '.join(refused)}). Fix: use the tests at other currents for validation, or use separable"
        )
    values = {
        "kx": _mean(fits, "kx"),
        **_line("kv", fits, currents_A, affine=affine),
        **_line("kw", fits, currents_A, affine=affine),
        "f0": _mean(fits, "f0"),
        **{name: float(np.median([getattr(fit, name) for fit in fits])) for name in ("rho", "sigma", "n")},
    }
    objective = 0.0
    for index, test in enumerate(measurements):
        residual = (test.force_N - modelled_force(model, values, test)) * weighting.of(test, index)
        objective += float(residual @ residual)
    return Solution(values, objective, sum(fit.evaluations for fit in fits))


def _mean(fits: Sequence[NormalizedBoucWenFit], name: str) -> float:
    return float(np.mean([getattr(fit, name) for fit in fits]))


def _line(
    name: str, fits: Sequence[NormalizedBoucWenFit], currents_A: Sequence[float], *, affine: bool
) -> dict[str, float]:
    """Value at zero current and per ampere by least squares; the mean alone where the current never changed."""
    if not affine:
        return {name: _mean(fits, name), f"{name}_b": 0.0}
    per_ampere, at_zero = np.polyfit(currents_A, [getattr(fit, name) for fit in fits], 1)
    return {name: float(at_zero), f"{name}_b": float(per_ampere)}
