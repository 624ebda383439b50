"""A fit as a small JSON file: model, equation and parameters, for programs that want no more of it."""

from __future__ import annotations

import json
from pathlib import Path

from rig.fits.fit_record import FitRecord
from rig.fits.plain import plain
from rig.recording.atomic_write import write_text_durably

OF_A_PARAMETER = ("value", "unit", "low", "high", "identifiable")


def write_values(fit: FitRecord, path: Path) -> Path:
    """Write the model, its equation, whether it fits, where it was tested, and the parameters.

    Of each parameter its value (SI), unit and 95 % interval; the keys are those of `fit.json`.

    Args:
        fit: the fit.
        path: where to.
    """
    content = plain({
        "model": fit.model, "equation": fit.form, "hysteresis": fit.hysteresis, "method": fit.method,
        "adequate": fit.adequate, "tested": fit.tested,
        "parameters": {
            name: {part: getattr(entry, part) for part in OF_A_PARAMETER} for name, entry in fit.parameters.items()
        },
    })  # fmt: skip
    write_text_durably(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return path
