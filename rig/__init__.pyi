"""Types of the names that `rig` loads when they are first used."""

from rig.characteristics import characterise as characterise
from rig.comparison import compare as compare
from rig.errors import RigError as RigError
from rig.identification.options import FitOptions as FitOptions
from rig.identification.runs import identify as identify
from rig.identification.uncertainty.fit import Fit as Fit
from rig.identification.uncertainty.fit import load_fit as load_fit
from rig.recording.loading import load as load
from rig.recording.recorded_point import RecordedPoint as RecordedPoint
from rig.recording.run import Run as Run
from rig.report import write_report as write_report

__version__: str
