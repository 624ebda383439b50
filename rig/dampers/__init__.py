"""Damper models: each one object that owns its parameters, equation, kernel, slopes, and what a fit must know of it.

Pure functions of motion and current; no files, clocks, devices or fitting. The simulated plant and the identifier share
these definitions. `kernel` and `loop_curve` need numba and are imported only by those who integrate.
"""

from rig.dampers.catalogue import MODELS, PARAMETER_SETS, UnknownName, model, parameter_set
from rig.dampers.model import AlgebraicModel, DamperModel, HystereticModel
from rig.dampers.parameter import Hysteresis, ModelProblem, Parameter, ParameterSet

__all__ = [
    "MODELS",
    "PARAMETER_SETS",
    "AlgebraicModel",
    "DamperModel",
    "Hysteresis",
    "HystereticModel",
    "ModelProblem",
    "Parameter",
    "ParameterSet",
    "UnknownName",
    "model",
    "parameter_set",
]
