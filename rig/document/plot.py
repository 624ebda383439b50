"""A figure at the hands of a user: shown by a notebook, saved as a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.document.drawing import drawing_of
from rig.document.figure import Figure, Panels, Trace
from rig.document.svg import standalone
from rig.errors import RigError
from rig.extras import how_to_install

DPI = 192.0
"""Pixels per inch of a PNG, at 96 units of a drawing per inch."""


@dataclass(frozen=True)
class Plot:
    """A figure or its panels; a notebook shows it."""

    figure: Figure | Panels

    @property
    def figures(self) -> Sequence[Figure]:
        """The panels; of a single figure that one."""
        return self.figure.figures if isinstance(self.figure, Panels) else (self.figure,)

    @property
    def traces(self) -> Sequence[Trace]:
        """The series of all figures, with their arrays."""
        return [trace for figure in self.figures for trace in figure.traces]

    def save(self, path: Path | str, dpi: float = DPI) -> Path:
        """Write it as a file, `.svg`, `.pdf` or `.png`.

        Args:
            path: where to; its ending selects the format.
            dpi: pixels per inch of a PNG, 24 to 1200.

        Raises:
            ValueError: another kind of file, or a resolution outside these limits.
            RigError: the library for that format is not installed.
            OSError: the file cannot be written.
        """
        file, drawing = Path(path), drawing_of(self.figure)
        try:
            if file.suffix == ".svg":
                content = standalone(drawing).encode()
            elif file.suffix == ".pdf":
                from rig.document.pdf import figure_pdf  # loads ReportLab

                content = figure_pdf(drawing)
            elif file.suffix == ".png":
                from rig.document.png import png  # loads Pillow

                content = png(drawing, dpi)
            else:
                raise ValueError(f"{file.name}: got {file.suffix or 'no extension'}, expected .svg, .pdf or .png")
        except ImportError as error:
            package = "Pillow" if error.name == "PIL" else error.name
            raise RigError(f"{file.name}: {package} is not installed. Fix: {how_to_install('pdf')}") from error
        file.write_bytes(content)
        return file

    def savefig(self, path: Path | str, dpi: float = DPI) -> Path:
        """As `save`; deprecated."""
        return self.save(path, dpi)

    def _repr_svg_(self) -> str:
        return standalone(drawing_of(self.figure))
