"""Optimisers: the papers' algorithms, vectorised over the population, and the bounded least squares that fits use.

They know bounds, an objective and a budget: numbers in, numbers out. What may not live here: a damper model, a
recording, a file; nothing but numpy, SciPy, the standard library and `rig.errors` is imported.
"""

from rig.optimisers.methods import METHODS, make_algorithm, minimise
from rig.optimisers.search import Objective, Progress, Result, SearchError

__all__ = ["METHODS", "Objective", "Progress", "Result", "SearchError", "make_algorithm", "minimise"]
