"""The report of a run: one self-contained HTML file that a person reads, made from recorded points and their fit.

Nothing is measured, judged or fitted here; what is shown comes from `rig.recording` and `rig.identification`.
"""

from rig.report.document import write_report
from rig.report.figures import figures

__all__ = ["figures", "write_report"]
