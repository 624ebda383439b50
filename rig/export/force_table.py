"""A fit as a table of the force over speed and current, for programs that interpolate."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.export.fitted_model import FittedModel
from rig.recording.atomic_write import write_text_durably

SPEEDS, CURRENTS = 61, 11


def write_table(fitted: FittedModel, folder: Path, file: str) -> list[Path]:
    """Write F(v, I) on the sliding branch at mid-stroke, within what was tested: a row a speed, a column a current.

    The lines before the head begin with `#`: model, equation, ranges, parameters, covariance, hash of the fit.

    Args:
        fitted: the model.
        folder: where to; it is there.
        file: of the fit, for messages.

    Raises:
        FileProblem: the fit does not say what was tested.
    """
    tested = fitted.tested
    if not tested:
        raise FileProblem(file, ["the fit does not state its tested range (`tested`). Fix: run `rig identify` again"])
    low, high = tested["velocity_m_s"]
    speeds = np.linspace(low, high, SPEEDS)
    least, most = tested["current_A"]
    currents = np.linspace(least, most, CURRENTS) if most > least else np.array([least])
    forces = fitted.model.force_at(fitted.values, speeds[:, None], currents[None, :])
    lines = [*fitted.described(), "", (
        "Force (N) at mid-stroke at constant velocity, with the hysteresis in its steady state:"
    )]
    head = ["velocity_m_s", *(f"force_N at {current:.6g} A" for current in currents)]
    rows = [
        ",".join(repr(float(value)) for value in (speed, *row)) for speed, row in zip(speeds, forces, strict=True)
    ]
    path = folder / f"damper_{fitted.name}_table.csv"
    write_text_durably(path, "\n".join([*(f"# {line}".rstrip() for line in lines), ",".join(head), *rows, ""]))
    return [path]
