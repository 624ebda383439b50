"""How a parameter depends on the current: affine, polynomial and Lagrange relations, each with its error shown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel


@dataclass(frozen=True)
class Relation:
    """A polynomial of the current.

    Attributes:
        kind: `affine`, `polynomial` or `lagrange`.
        coefficients: Lowest power first, in the parameter's unit per A^k.
        rms: Root mean square residual at the currents it was fitted on (zero for Lagrange).
        rms_left_out: The same at each current when the relation is fitted without it; nan with too few currents. It
            is the honest measure: an interpolating polynomial has no residual and may still swing between its points.
    """

    kind: str
    coefficients: tuple[float, ...]
    rms: float
    rms_left_out: float = math.nan

    def at(self, current_A: float | FloatArray) -> FloatArray:
        """Value at a current.

        Args:
            current_A: A, any shape.

        Returns:
            Same shape, in the parameter's unit.
        """
        return np.asarray(np.polynomial.polynomial.polyval(current_A, np.array(self.coefficients)))

    def __str__(self) -> str:
        terms = [
            f"{value:.4g}" + ("" if k == 0 else " I" if k == 1 else f" I^{k}")
            for k, value in enumerate(self.coefficients)
        ]
        return " + ".join(terms).replace("+ -", "- ")


@dataclass(frozen=True)
class CurrentRelations:
    """How the parameters of fits at single currents depend on the current.

    Attributes:
        dependence: "per-current-affine", "per-current-polynomial" or "per-current-lagrange".
        currents_A: the fitted currents, rising.
        relations: parameter name to its relation.
        ranges: parameter name to the lowest and highest fitted value (SI).
    """

    dependence: str
    currents_A: tuple[float, ...] = ()
    relations: Mapping[str, Relation] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def values_at(self, model: DamperModel, current_A: float) -> dict[str, float]:
        """The model's values (SI) at a current (A); terms per ampere are zero, because the current is taken as zero."""
        values = {parameter.name: 0.0 for parameter in model.parameters if parameter.name != "eta"}
        for name, relation in self.relations.items():
            value = float(relation.at(current_A))
            low, high = self.ranges[name]
            values[name] = value if model.parameter(name).linear else min(max(value, low), high)
        return values


def relations(current_A: FloatArray, values: FloatArray, degree: int = 2) -> list[Relation]:
    """Affine, polynomial and Lagrange relations through per-current values.

    Args:
        current_A: Shape (n,), different currents, at least two.
        values: Shape (n,).
        degree: Degree of the polynomial, lowered to n - 1 where there are too few currents.

    Returns:
        Three relations; Lagrange is the polynomial of degree n - 1 through every point.

    Raises:
        ValueError: Fewer than two currents, or two that are equal.
    """
    if len(current_A) < 2 or len(np.unique(current_A)) < len(current_A):
        raise ValueError(
            f"relation to current: got currents {list(current_A)}, expected at least two different currents"
        )
    highest = len(current_A) - 1
    kinds = {"affine": 1, "polynomial": min(degree, highest), "lagrange": highest}
    return [_relation(kind, current_A, values, power) for kind, power in kinds.items()]


def lagrange(current_A: FloatArray, values: FloatArray) -> FloatArray:
    """Coefficients of the polynomial through every point, by Lagrange's basis.

    L(I) = sum_j y_j prod_(k != j) (I - I_k) / (I_j - I_k)

    Args:
        current_A: Shape (n,), all different.
        values: Shape (n,).

    Returns:
        Shape (n,), lowest power first.
    """
    total = np.zeros(len(current_A))
    for j, value in enumerate(values):
        others = np.delete(current_A, j)
        basis = np.polynomial.polynomial.polyfromroots(others) if len(others) else np.ones(1)
        total += value * basis / np.prod(current_A[j] - others)
    return total


def _relation(kind: str, current_A: FloatArray, values: FloatArray, power: int) -> Relation:
    coefficients = _fitted(kind, current_A, values, power)
    residual = np.polynomial.polynomial.polyval(current_A, coefficients) - values
    left_out = []
    for j in range(len(current_A)):
        keep = np.arange(len(current_A)) != j
        if keep.sum() >= 2:
            without = _fitted(kind, current_A[keep], values[keep], min(power, int(keep.sum()) - 1))
            left_out.append(float(np.polynomial.polynomial.polyval(current_A[j], without) - values[j]))
    rms_left_out = float(np.sqrt(np.mean(np.square(left_out)))) if left_out else float("nan")
    return Relation(kind, tuple(float(c) for c in coefficients), float(np.sqrt(np.mean(residual**2))), rms_left_out)


def _fitted(kind: str, current_A: FloatArray, values: FloatArray, power: int) -> FloatArray:
    if kind == "lagrange":
        return lagrange(current_A, values)
    return np.asarray(np.polynomial.polynomial.polyfit(current_A, values, power))
