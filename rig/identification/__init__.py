"""Identification: damper models fitted to recorded runs, how sure the result is, and the fit as a value.

Sub-rooms, each of which may import those named before it: `models` (what is fitted, and how a model is solved for),
`points` (from recorded points to measurements), `application` (what is done with a fitted model), `uncertainty`
(what is known of the result, and the fit), `diagnosis` (what explains a misfit). Beside them the entries: `bootstrap`
(tests drawn again), `fitting` (measurements to a fit), `runs` (recorded runs to `fit.json`), `selection`,
`per_current`, `series_spring`, `next_test`; every sentence for people is made in `words`. Reads runs through
`rig.recording`; writes nothing but `fit.json`. A name is loaded when it is first asked for: a process that only fits
does not load what assesses a fit.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.identification.bootstrap import Bootstrap, bootstrap
    from rig.identification.fitting import identify
    from rig.identification.models.measurement import Measurement
    from rig.identification.models.problem import Problem
    from rig.identification.models.projection import Weighting
    from rig.identification.models.separable import solve_separable
    from rig.identification.models.solving import Method
    from rig.identification.points.preparation import prepare
    from rig.identification.runs import identify_run
    from rig.identification.uncertainty.fit import Fit
    from rig.identification.uncertainty.fit_entries import Estimate

__all__ = [
    "Bootstrap",
    "Estimate",
    "Fit",
    "Measurement",
    "Method",
    "Problem",
    "Weighting",
    "bootstrap",
    "identify",
    "identify_run",
    "prepare",
    "solve_separable",
]

_HOMES = {
    "Bootstrap": "bootstrap",
    "Estimate": "uncertainty.fit_entries",
    "Fit": "uncertainty.fit",
    "Measurement": "models.measurement",
    "Method": "models.solving",
    "Problem": "models.problem",
    "Weighting": "models.projection",
    "bootstrap": "bootstrap",
    "identify": "fitting",
    "identify_run": "runs",
    "prepare": "points.preparation",
    "solve_separable": "models.separable",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = import_module(f"{__name__}.{_HOMES[name]}")
    if _HOMES[name] in _HOMES:  # the module is called like what is offered of it
        globals()[_HOMES[name]] = getattr(home, _HOMES[name])
    value = getattr(home, name)
    globals()[name] = value
    return value
