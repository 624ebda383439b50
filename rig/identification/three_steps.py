"""Zhu's three steps on a whole campaign: each test apart, then its parameters against the current.

The steps themselves (`algorithms.zhu_three_step`) know one test at one constant current. Over several, kv and kw are
lines in the current (least squares); kx, f0, rho, sigma and n, which the model does not let depend on it, are means and
medians over the tests.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.identifiability import SAME_CURRENT_A
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force
from rig.identification.projection import Weighting
from rig.identification.separable import Solution
from rig.identification.zhu_three_step import NormalizedBoucWenFit, identify

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
        raise IdentificationFailed(f"zhu_three_step identifies {MODEL} only, not {model.name}: add `--model {MODEL}`")
    found: list[NormalizedBoucWenFit] = []
    currents_A, refused = [], []
    for each in measurements:
        try:
            found.append(identify(*(array[each.scored] for array in (each.u_m, each.v_m_s, each.force_N))))
            currents_A.append(float(np.mean(each.current_A)))
        except IdentificationFailed as error:
            refused.append(f"{each.id}: {error}")
    if not found:
        raise IdentificationFailed("; ".join(refused))
    affine = "kw_b" not in held
    if affine and max(currents_A) - min(currents_A) <= SAME_CURRENT_A:
        raise IdentificationFailed(
            f"zhu_three_step works at {currents_A[0]:.2f} A only, where kw and kw_b, kv and kv_b cannot be told apart "
            f"({'; '.join(refused)}); hold the tests at other currents out, or use separable"
        )
    values = {
        "kx": _mean(found, "kx"),
        **_line("kv", found, currents_A, affine=affine),
        **_line("kw", found, currents_A, affine=affine),
        "f0": _mean(found, "f0"),
        **{name: float(np.median([getattr(each, name) for each in found])) for name in ("rho", "sigma", "n")},
    }
    objective = 0.0
    for index, each in enumerate(measurements):
        residual = (each.force_N - modelled_force(model, values, each)) * weighting.of(each, index)
        objective += float(residual @ residual)
    return Solution(values, objective, sum(each.evaluations for each in found))


def _mean(found: Sequence[NormalizedBoucWenFit], name: str) -> float:
    return float(np.mean([getattr(each, name) for each in found]))


def _line(
    name: str, found: Sequence[NormalizedBoucWenFit], currents_A: Sequence[float], *, affine: bool
) -> dict[str, float]:
    """Value at zero current and per ampere by least squares; the mean alone where the current never changed."""
    if not affine:
        return {name: _mean(found, name), f"{name}_b": 0.0}
    per_ampere, at_zero = np.polyfit(currents_A, [getattr(each, name) for each in found], 1)
    return {name: float(at_zero), f"{name}_b": float(per_ampere)}
