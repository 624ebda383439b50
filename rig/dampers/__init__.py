"""Damper models: named parameters, equations, forces, and the compiled kernels behind them.

Pure functions of motion and current; no files, clocks, devices or fitting. The simulated plant and the identifier share
these definitions. `kernels` needs numba and is imported only by those who integrate.
"""

from rig.dampers.catalogue import MODELS, UnknownName, model, parameter_set
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter, ParameterSet

__all__ = ["MODELS", "DamperModel", "Parameter", "ParameterSet", "UnknownName", "model", "parameter_set"]
