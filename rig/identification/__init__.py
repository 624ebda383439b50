"""Identification: damper models fitted to recorded runs, how sure the result is, and the fit as a value.

Sub-rooms, each of which may import those named before it: `models` (what is fitted, and how a model is solved for),
`points` (from recorded points to measurements), `application` (what is done with a fitted model), `uncertainty` (what
is known of the result, and the fit), `diagnosis` (what explains a misfit). In addition the entries: `resampling`
(tests drawn again), `options` (what is asked of a fit), `fitting` (measurements to a fit, in stages), `runs` (tests
from anywhere to a fit, recorded runs to `fit.json`),
`selection`, `per_current`, `next_test`, the `corrections` (`series_spring`, `coil_lag`, `temperature`); every
sentence for people is made in `words`. Reads runs through `rig.recording`; writes nothing but `fit.json`. A name is
loaded when it is first asked for: a process that only fits does not load what assesses a fit.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.fits.entries import Estimate
    from rig.identification.models.measurement import Measurement
    from rig.identification.models.problem import Problem
    from rig.identification.models.projection import Weighting
    from rig.identification.models.separable import solve_separable
    from rig.identification.models.solving import Method
    from rig.identification.options import FitOptions
    from rig.identification.points.preparation import prepare
    from rig.identification.resampling import Bootstrap, bootstrap
    from rig.identification.runs import identify, identify_each, identify_run
    from rig.identification.uncertainty.fit import Fit

__all__ = [
    "Bootstrap",
    "Estimate",
    "Fit",
    "FitOptions",
    "Measurement",
    "Method",
    "Problem",
    "Weighting",
    "bootstrap",
    "identify",
    "identify_each",
    "identify_run",
    "prepare",
    "solve_separable",
]

_HOMES = {
    "Bootstrap": "rig.identification.resampling",
    "Estimate": "rig.fits.entries",
    "Fit": "rig.identification.uncertainty.fit",
    "FitOptions": "rig.identification.options",
    "Measurement": "rig.identification.models.measurement",
    "Method": "rig.identification.models.solving",
    "Problem": "rig.identification.models.problem",
    "Weighting": "rig.identification.models.projection",
    "bootstrap": "rig.identification.resampling",
    "identify": "rig.identification.runs",
    "identify_each": "rig.identification.runs",
    "identify_run": "rig.identification.runs",
    "prepare": "rig.identification.points.preparation",
    "solve_separable": "rig.identification.models.separable",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
