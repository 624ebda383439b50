"""The papers' algorithms, vectorised over the population: numbers in, numbers out.

Here live the searches that need only an objective's values (and `hybrid`, which adds local least squares), the budget
and archive they share, and the evaluation of populations on any executor. What may not live here: damper models,
recordings, files.
"""

from rig.identification.algorithms.registry import METHODS, make_algorithm, minimise
from rig.identification.algorithms.search import Objective, Progress, Result, SearchError

__all__ = ["METHODS", "Objective", "Progress", "Result", "SearchError", "make_algorithm", "minimise"]
