"""The report of a run as a document (`rig.document`), made from recorded points and their fit.

Nothing is measured or fitted here; what is shown comes from `rig.recording`, `rig.characteristics` and
`rig.identification`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.report.document import write_report
    from rig.report.figures import figures

__all__ = ["figures", "write_report"]

_HOMES = {"figures": "rig.report.figures", "write_report": "rig.report.document"}


# Loading the report writer takes as long as a fit, whose tables need only one section.
def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
