"""Results of recorded runs made again by this version, next to the originals, with the changes and their causes.

The originals are only read. Aligning, evaluating, measuring and fitting are done by the rooms below.
"""

from rig.reanalysis.reanalysis import ReanalysisOptions, reanalyse, reanalyse_each
from rig.reanalysis.result import Reanalysis

__all__ = ["Reanalysis", "ReanalysisOptions", "reanalyse", "reanalyse_each"]
