"""Fitting damper models to recorded runs: problems, methods, uncertainty, selection, and the fit as a value.

Reads runs through `rig.recording`; writes nothing but `fit.json`. The published optimisers live in `algorithms`.
"""

from rig.identification.fit import Estimate, Fit
from rig.identification.identify import identify, identify_run
from rig.identification.measurement import Measurement
from rig.identification.preparation import prepare
from rig.identification.problem import Problem
from rig.identification.solving import Method

__all__ = ["Estimate", "Fit", "Measurement", "Method", "Problem", "identify", "identify_run", "prepare"]
