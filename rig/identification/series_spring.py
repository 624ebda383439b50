"""A spring in series with the damper: mounts and fixtures that give way, so that the damper moves less than the rod.

The damper's extension is u - F/k, its velocity v - F'/k. F is the measured force, made smooth and differentiable by the
harmonics of its whole cycles that stand out of the noise; the acceleration stays the rod's, because inertia is the
smallest term. The compliance c = 1/k is the one that leaves the least squares when the model is fitted to the motion so
corrected: a search in one dimension from c = 0 to the compliance that would take `LARGEST_SHARE` of the stroke.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.fits.entries import SeriesSpring
from rig.identification.fit_state import FitState
from rig.identification.models.measurement import Measurement, first_cycle
from rig.identification.models.solving import SQUARES, Method, Refit
from rig.identification.models.undetermined import examine
from rig.identification.options import FitOptions
from rig.identification.uncertainty.covariance import quantile
from rig.signals.derivatives import harmonic

LARGEST_SHARE = 0.3
TOLERANCE = 1e-3  # of the compliance
CURVATURE_STEP = 0.02  # of the compliance
SMOOTHING = 0.02  # relative standard error from the corners that the smoothed force lacks (0.4 to 2.3 % off in tests)
SEEN = 3.0  # standard errors of the compliance from which there is a spring


SPRING = "series_spring"


def refuse(options: FitOptions) -> None:
    """Refuse a comparison of models.

    Raises:
        IdentificationFailed: several models are requested.
    """
    if options.several:
        raise IdentificationFailed("series spring: needs one model. Fix: name one model, such as `asymmetric`")


def prepare(state: FitState) -> FitState:
    """The spring, and the damper's own motion in all tests.

    Raises:
        IdentificationFailed: the force of a test cannot be differentiated, or the model cannot be fitted.
    """
    spring = find_spring(state.models[0], state.fitted, state.options.how)
    state = state.with_found(SPRING, spring)
    if spring.stiffness_N_m is None:
        return state
    compliance_m_N = 1.0 / spring.stiffness_N_m
    return state.corrected(lambda tests: ComplianceCorrection(tests).by(compliance_m_N))


def complete(state: FitState) -> FitState:
    """The fit with the spring, whose interval the residuals widen."""
    widening = max((residual.widening for residual in state.so_far.residual_parts), default=1.0)
    return state.with_parts(corrections={"series": state.found[SPRING].widened(widening, quantile() * SMOOTHING)})


class ComplianceCorrection:
    """Tests whose motion can be corrected for any compliance.

    Raises:
        IdentificationFailed: the force of a test cannot be differentiated.
    """

    def __init__(self, tests: Sequence[Measurement]) -> None:
        self._tests = tuple(tests)
        self._forces = [_smooth_force(test) for test in tests]

    @property
    def forces(self) -> list[tuple[FloatArray, FloatArray]]:
        """Smooth force (N) and its rate (N/s) of each test, shape (n,) each."""
        return self._forces

    def by(self, compliance_m_N: float) -> list[Measurement]:
        """The tests with the damper's own motion behind a spring of this compliance (m/N)."""
        return [
            replace(test, u_m=test.u_m - compliance_m_N * force, v_m_s=test.v_m_s - compliance_m_N * rate)
            for test, (force, rate) in zip(self._tests, self._forces, strict=True)
        ]

    @property
    def largest_m_N(self) -> float:
        """The compliance (m/N) that takes `LARGEST_SHARE` of the stroke in the test that leaves the least room."""
        return LARGEST_SHARE * min(
            float(np.ptp(test.u_m)) / max(float(np.ptp(force)), 1e-9)
            for test, (force, _) in zip(self._tests, self._forces, strict=True)
        )


def _smooth_force(test: Measurement) -> tuple[FloatArray, FloatArray]:
    """Force (N) and its rate (N/s), shape (n,) each.

    Raises:
        IdentificationFailed: the cycles are unknown.
    """
    if test.samples_per_cycle < 1:
        raise IdentificationFailed(f"{test.id}: its cycles are unknown, so its force cannot be differentiated")
    time_s: FloatArray = np.arange(test.u_m.size, dtype=np.float64) * test.dt_s
    fit = harmonic(time_s, np.where(test.scored, test.force_N, np.nan), 1.0 / (test.samples_per_cycle * test.dt_s))
    force, rate, _ = fit.at(time_s)
    return force, rate


def find_spring(model: DamperModel, tests: Sequence[Measurement], method: Method) -> SeriesSpring:
    """The spring that explains the tests best with this model.

    Its interval comes from the curvature of the sum of squares along the compliance, all parameters following, as if
    the residual were white; see `SeriesSpring.widened`.

    Raises:
        IdentificationFailed: the force of a test cannot be differentiated, the model cannot be fitted, or the loss is
            not that of least squares.
    """
    from scipy.optimize import minimize_scalar

    if method.loss != SQUARES:
        raise IdentificationFailed(f"series spring: needs least squares, got loss {method.loss!r}")
    corrected, refit = ComplianceCorrection(tests), Refit(model, method, examine(model, tests))
    counted = first_cycle if model.states > 0 else _whole

    def left(compliance: float) -> float:
        return refit([counted(test) for test in corrected.by(compliance)]).objective

    largest = corrected.largest_m_N
    rigid = left(0.0)
    minimum = minimize_scalar(left, bounds=(0.0, largest), method="bounded", options={"xatol": TOLERANCE * largest})
    if float(minimum.fun) >= rigid:
        return SeriesSpring(None, None, None)
    best, step = float(minimum.x), CURVATURE_STEP * largest
    low, high = max(0.0, best - step), best + step
    curvature = 2.0 * _second_difference((low, left(low)), (best, float(minimum.fun)), (high, left(high)))
    samples = sum(counted(test).u_m.size for test in tests)
    if curvature <= 0.0:
        return SeriesSpring(1.0 / best, None, None)
    error = math.sqrt(2.0 * float(minimum.fun) / samples / curvature)
    if best < SEEN * error:
        return SeriesSpring(None, None, None)
    softest, stiffest = best + quantile() * error, best - quantile() * error
    return SeriesSpring(1.0 / best, 1.0 / softest, 1.0 / stiffest)


def _whole(test: Measurement) -> Measurement:
    return test


def _second_difference(low: tuple[float, float], middle: tuple[float, float], high: tuple[float, float]) -> float:
    """Divided second difference of three points (x, y)."""
    first = (middle[1] - low[1]) / (middle[0] - low[0])
    second = (high[1] - middle[1]) / (high[0] - middle[0])
    return (second - first) / (high[0] - low[0])
