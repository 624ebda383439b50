"""The parameters of a fitted residual, which people read in one line; `fit.json` lists them all."""

from __future__ import annotations

from collections.abc import Mapping

from rig.dampers.grey_regressors import PARTS, RANGE, TRAVELS, weight_names
from rig.document.numbers import number
from rig.fits.entries import Estimate

WEIGHTS = frozenset(weight_names(PARTS))
RESIDUAL = WEIGHTS.union(RANGE, TRAVELS)
"""Names of all parameters that a residual can have; no physical model uses them."""


def of_physics(estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The estimates of the physical model's parameters."""
    return {name: one for name, one in estimates.items() if name not in RESIDUAL}


def residual_line(estimates: Mapping[str, Estimate]) -> str:
    """The residual in one line; empty for a fit without one."""
    weights = {name: abs(float(one)) for name, one in estimates.items() if name in WEIGHTS}
    if not weights:
        return ""
    parts = ", ".join(part for part in PARTS if any(name.startswith(f"g_{part}_") for name in weights))
    largest = max(weights, key=lambda name: weights[name])
    ridge = f", ridge penalty {float(estimates['ridge']):.3g}" if "ridge" in estimates else ""
    return (
        f"Residual ({parts}): {len(weights)} weights without intervals, largest {number(weights[largest], 3)} N "
        f"({largest}){ridge}; fit.json lists them. The intervals of the other parameters are for this residual."
    )
