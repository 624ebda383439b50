"""The report of a run as a PDF, by its name until 2.0; now `rig report RUN --pdf`, or `rig.document.pdf`."""

from __future__ import annotations

from pathlib import Path

from rig.errors import RigError
from rig.extras import how_to_install
from rig.recording.atomic_write import write_durably
from rig.recording.run import Run
from rig.report.document import Material, report_of


def write_pdf(report: Path) -> Path:
    """Write `report.pdf` next to the report of a run.

    Args:
        report: `report.html` in a campaign's folder, as `write_report` returns it.

    Returns:
        The PDF's path.

    Raises:
        RigError: the library for PDF is not installed.
        FileProblem: the folder is no run.
        OSError: the PDF cannot be written.
    """
    try:
        from rig.document.pdf import pdf  # loads reportlab, an extra
    except ImportError as error:
        raise RigError(f"{error.name or 'reportlab'} is not installed. Fix: {how_to_install('pdf')}") from error
    path = report.with_suffix(".pdf")
    write_durably(path, pdf(report_of(Material.of(Run.open(report.parent)))))
    return path
