"""The figures of a run's report as files, one each."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

from rig.recording.run import Run


def write_figures(run: Run, folder: Path, ending: str) -> list[Path]:
    """Write every figure of `rig.report.figures`, its name with `-` for signs that file names should not have.

    Args:
        run: the campaign.
        folder: where to; it is there.
        ending: `.svg`, `.png` or `.pdf`.

    Raises:
        FileProblem: the campaign's `fit.json` is not a fit.
        RigError: the library for PNG and PDF is not installed.
    """
    from rig.report.figures import figures  # loads numba

    made: dict[str, Path] = {}
    for name, figure in figures(run).items():
        plain = re.sub(r"[^\w.+]+", "-", name)
        free = next(place for number in count(1) if (place := plain + f"-{number}" * (number > 1)) not in made)
        made[free] = figure.save(folder / f"{free}{ending}")
    return list(made.values())
