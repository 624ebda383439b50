"""A figure at the hands of a user: shown by a notebook, saved as a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.document.drawing import drawing_of
from rig.document.figure import Figure, Panels, Trace
from rig.document.svg import standalone


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

    def save(self, path: Path | str) -> Path:
        """Write it as a file, `.svg` or `.pdf`.

        Raises:
            ValueError: another kind of file.
            OSError: the file cannot be written.
        """
        file, drawing = Path(path), drawing_of(self.figure)
        if file.suffix == ".svg":
            file.write_text(standalone(drawing), encoding="utf-8")
        elif file.suffix == ".pdf":
            from rig.document.pdf import figure_pdf  # loads ReportLab

            file.write_bytes(figure_pdf(drawing))
        else:
            raise ValueError(f"{file.name}: got {file.suffix or 'no ending'}, expected .svg or .pdf")
        return file

    def savefig(self, path: Path | str) -> Path:
        """As `save`; deprecated."""
        return self.save(path)

    def _repr_svg_(self) -> str:
        return standalone(drawing_of(self.figure))
