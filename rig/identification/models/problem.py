"""The fitting problem: measurements, a model and a weight, seen by any optimiser as a function of a vector.

Parameters that the tests cannot tell are held (`FixedParameters`), so that a search has none of them to find.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rig.dampers import MODELS, Hysteresis
from rig.dampers import model as damper_model
from rig.dampers.algebraic import ColumnModel, general_coefficients
from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.identification.models.coil import coil_current
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force

Weight = Literal["v", "1"]

UNACCEPTABLE = 1e12  # residual of a sample whose modelled force is not finite


class Problem:
    """Equation (12): f(s) = sum(((Fexp - F(s)) w)^2) over all samples of all measurements, w = v or 1.

    Attributes:
        measurements: the tests.
        model: the damper model.
        weight: "v" as in the paper, or "1".
        lag: whether eta is one of the unknowns; the coil current then follows the commanded one by equation (9).
        names: names of the unknowns, in the vector's order (SI).

    Raises:
        ValueError: no measurements, an unknown weight, or eta is asked of a model that has none.
    """

    def __init__(
        self,
        measurements: Sequence[Measurement],
        model: str | DamperModel = "asymmetric",
        weight: Weight = "v",
        hysteresis: Hysteresis = "kwok",
        *,
        lag: bool = False,
    ) -> None:
        if not measurements:
            raise ValueError("measurements: got none, expected at least one test")
        if weight not in {"v", "1"}:
            raise ValueError(f"weight: got {weight!r}, expected 'v' or '1'")
        self.measurements = tuple(measurements)
        self.model = model if isinstance(model, DamperModel) else damper_model(model, hysteresis)
        if lag and "eta" not in self.model.names:
            having = ", ".join(name for name, other in MODELS.items() if "eta" in other.names)
            raise ValueError(f"lag: {self.model.name} has no parameter eta; models with eta: {having}")
        self.weight = weight
        self.lag = lag
        self.names = tuple(name for name in self.model.names if lag or name != "eta")
        self._joined = self._join() if isinstance(self.model, ColumnModel) else None
        self._weights = [self._weight_squared(test) for test in self.measurements]

    @property
    def n_parameters(self) -> int:
        """Length of the vector."""
        return len(self.names)

    @property
    def bounds(self) -> FloatArray:
        """Admissible range of each unknown, shape (p, 2)."""
        return np.array([(self.model.parameter(name).low, self.model.parameter(name).high) for name in self.names])

    @property
    def start(self) -> FloatArray:
        """A sensible first guess, shape (p,)."""
        return np.array([self.model.parameter(name).start for name in self.names])

    def values(self, vector: FloatArray | Sequence[float]) -> dict[str, float]:
        """A vector by parameter name.

        Raises:
            ValueError: the vector's length is not `n_parameters`.
        """
        return {name: float(value) for name, value in zip(self.names, vector, strict=True)}

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values by name as a vector, shape (p,).

        Raises:
            KeyError: a name is missing.
        """
        return np.array([float(values[name]) for name in self.names])

    def objective(self, vector: FloatArray | Sequence[float]) -> float:
        """f(s) of one candidate, shape (p,); infinity where the model's force is not finite.

        Raises:
            ValueError: the vector's length is not `n_parameters`.
        """
        return float(self.batch(np.asarray(vector, dtype=float)[None, :])[0])

    __call__ = objective

    def batch(self, population: FloatArray) -> FloatArray:
        """f(s) of candidates of shape (N, p), shape (N,).

        Raises:
            ValueError: the second dimension is not `n_parameters`.
        """
        candidates = np.ascontiguousarray(population, dtype=float)
        if candidates.ndim != 2 or candidates.shape[1] != self.n_parameters:
            raise ValueError(
                f"population: got shape {candidates.shape}, expected (N, {self.n_parameters}): {', '.join(self.names)}"
            )
        if self.lag:
            return np.array([self._lagged(candidate) for candidate in candidates])
        if self._joined is None:
            return self._hysteretic_batch(candidates, self.measurements)
        return self._algebraic_batch(self._general(candidates), *self._joined)

    def residuals(self, vector: FloatArray | Sequence[float]) -> FloatArray:
        """Weighted residuals (Fexp - F) w of one candidate, shape (n,); their squares sum to `objective`.

        Where the model's force is not finite, a residual is too large for any local search to accept.

        Raises:
            ValueError: the vector's length is not `n_parameters`.
        """
        values = self.values(vector)
        parts = []
        for test, squared in zip(self.measurements, self._weights, strict=True):
            source = _behind_coil(test, values["eta"]) if self.lag else test
            if source is None:
                parts.append(np.full(test.u_m.size, UNACCEPTABLE))
                continue
            parts.append((test.force_N - modelled_force(self.model, values, source)) * np.sqrt(squared))
        joined = np.concatenate(parts)
        return np.where(np.isfinite(joined), joined, UNACCEPTABLE)

    def _algebraic_batch(self, general: FloatArray, *data: FloatArray) -> FloatArray:
        from rig.identification.models.kernels import tanh_objective  # loads numba

        total: FloatArray = tanh_objective(general, *data)
        return np.where(np.isfinite(total), total, np.inf)

    def _lagged(self, candidate: FloatArray) -> float:
        eta_1_s = float(candidate[self.names.index("eta")])
        lagged = [_behind_coil(test, eta_1_s) for test in self.measurements]
        sources = [test for test in lagged if test is not None]
        if len(sources) < len(lagged):
            return math.inf
        if self._joined is None:
            return float(self._hysteretic_batch(candidate[None, :], sources)[0])
        general = self._general(candidate[None, :])
        total = 0.0
        for test, weight in zip(sources, self._weights, strict=True):
            data = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.force_N, weight)
            total += float(self._algebraic_batch(general, *data)[0])
        return total

    def _hysteretic_batch(self, candidates: FloatArray, sources: Sequence[Measurement]) -> FloatArray:
        from rig.dampers.kernel import series_of  # loads numba
        from rig.identification.models.kernels import weighted_squares  # loads numba

        series = series_of(self.model)
        full = np.ones((candidates.shape[0], len(self.model.parameters)))
        full[:, [self.model.names.index(name) for name in self.names]] = candidates
        total = np.zeros(candidates.shape[0])
        for test, weight in zip(sources, self._weights, strict=True):
            state = self.model.initial_state(float(test.u_m[0]))
            motion = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s, test.samples_per_cycle)
            total += [weighted_squares(test.force_N, series(vector, state, *motion), weight) for vector in full]
        return total

    def _general(self, candidates: FloatArray) -> FloatArray:
        """Candidates in the 12 coefficients shared by the algebraic models, shape (N, 12).

        Raises:
            TypeError: the model has internal states.
        """
        if not isinstance(self.model, ColumnModel):
            raise TypeError(f"{self.model.name} has internal states, so its force has no closed form")
        return general_coefficients(self.model, self.names, candidates)

    def _weight_squared(self, test: Measurement) -> FloatArray:
        squared = test.v_m_s**2 if self.weight == "v" else np.ones_like(test.v_m_s)
        return np.where(test.scored, test.recorded_each * squared, 0.0)

    def _join(self) -> tuple[FloatArray, ...]:
        """Motion, current, force and squared weight of all measurements end to end."""
        columns = ("u_m", "v_m_s", "a_m_s2", "current_A", "force_N")
        joined = [np.concatenate([getattr(test, name) for test in self.measurements]) for name in columns]
        return (*joined, np.concatenate([self._weight_squared(test) for test in self.measurements]))


def _behind_coil(test: Measurement, eta_1_s: float) -> Measurement | None:
    """The measurement with the coil current that follows its command at rate eta; None where that is not finite."""
    current_A = coil_current(test, eta_1_s)
    return replace(test, current_A=current_A) if np.all(np.isfinite(current_A)) else None


class FixedParameters:
    """Equation (12) as a function of a problem's other parameters.

    Attributes:
        problem: the whole problem.
        names: names of the free parameters, in the vector's order.
    """

    def __init__(self, problem: Problem, fixed: Mapping[str, float], scale: float = 1.0) -> None:
        """Hold some parameters.

        Args:
            problem: the whole problem.
            fixed: values (SI) of those that are held; names the problem does not have are ignored.
            scale: factor on the objective.
        """
        self.problem = problem
        self.names = tuple(name for name in problem.names if name not in fixed)
        self._free = [problem.names.index(name) for name in self.names]
        self._whole = np.array([fixed.get(name, 0.0) for name in problem.names])
        self._scale = scale

    @property
    def n_parameters(self) -> int:
        """Number of free parameters p."""
        return len(self.names)

    @property
    def bounds(self) -> FloatArray:
        """Admissible range of each free parameter, shape (p, 2)."""
        return np.asarray(self.problem.bounds[self._free])

    @property
    def start(self) -> FloatArray:
        """A sensible first guess of the free parameters, shape (p,)."""
        return np.asarray(self.problem.start[self._free])

    def whole(self, population: FloatArray) -> FloatArray:
        """Vectors of the problem, shape (N, all parameters), for free parameters of shape (N, p)."""
        vectors = np.tile(self._whole, (len(population), 1))
        vectors[:, self._free] = population
        return vectors

    def batch(self, population: FloatArray) -> FloatArray:
        """Values of candidates of shape (N, p), shape (N,).

        Raises:
            ValueError: the second dimension is not `n_parameters`.
        """
        return np.asarray(self._scale * self.problem.batch(self.whole(population)))

    def residuals(self, vector: FloatArray) -> FloatArray:
        """Residuals of one candidate, shape (n,), whose squares sum to its value; the vector has shape (p,).

        Raises:
            ValueError: the vector's length is not `n_parameters`.
        """
        return np.asarray(math.sqrt(self._scale) * self.problem.residuals(self.whole(vector[None, :])[0]))


def unmirrored(values: Mapping[str, float]) -> dict[str, float]:
    """The same force with a positive beta: tanh is odd, so beta, delta and the yield force may change signs together.

    Args:
        values: Parameters by name; those of a model without tanh come back as they are. In the printed form,
            beta (v + lambda sgn u), lambda keeps its sign.

    Returns:
        Parameters by name.
    """
    of_tanh = {"beta", "Fya"} <= values.keys() or {"beta", "delta", "alpha"} <= values.keys()
    if not of_tanh or values["beta"] >= 0.0:
        return dict(values)
    turned = {"beta", "delta", "Fya", "Fyb", "alpha", "alpha_b"}
    return {name: -value if name in turned else value for name, value in values.items()}
