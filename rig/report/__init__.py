"""The report of a run as a document (`rig.document`), made from recorded points and their fit.

Nothing is measured or fitted here; what is shown comes from `rig.recording`, `rig.characteristics` and
`rig.identification`.
"""

from rig.report.document import write_report
from rig.report.figures import figures

__all__ = ["figures", "write_report"]
