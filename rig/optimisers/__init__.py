"""Optimisers: the papers' algorithms, vectorised over the population, and the bounded least squares that fits use.

They know bounds, an objective and a budget: numbers in, numbers out. What may not live here: a damper model, a
recording, a file; nothing but numpy, SciPy, the standard library, `rig.errors` and `rig.plugins` is imported. A name is
loaded when it is first asked for: a fit by least squares does not load the algorithms.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.optimisers.evaluation import Objective
    from rig.optimisers.methods import METHODS, make_algorithm, minimise
    from rig.optimisers.search import Progress, Result, SearchError

__all__ = ["METHODS", "Objective", "Progress", "Result", "SearchError", "make_algorithm", "minimise"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = "methods" if name in {"METHODS", "make_algorithm", "minimise"} else "search"
    value = getattr(import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value
