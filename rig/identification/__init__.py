"""Fitting damper models to recorded runs: problems, methods, uncertainty, selection, and the fit as a value.

Reads runs through `rig.recording`; writes nothing but `fit.json`. The published optimisers live in `algorithms`.
A name is loaded when it is first asked for, so that a process that only fits does not load what judges a fit.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.identification.fit import Estimate, Fit
    from rig.identification.fitting import identify, identify_run
    from rig.identification.measurement import Measurement
    from rig.identification.preparation import prepare
    from rig.identification.problem import Problem
    from rig.identification.projection import Weighting
    from rig.identification.separable import solve_separable
    from rig.identification.solving import Method

__all__ = [
    "Estimate",
    "Fit",
    "Measurement",
    "Method",
    "Problem",
    "Weighting",
    "identify",
    "identify_run",
    "prepare",
    "solve_separable",
]

_HOMES = {
    "Estimate": "fit",
    "Fit": "fit",
    "Measurement": "measurement",
    "Method": "solving",
    "Problem": "problem",
    "Weighting": "projection",
    "identify": "fitting",
    "identify_run": "fitting",
    "prepare": "preparation",
    "solve_separable": "separable",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
