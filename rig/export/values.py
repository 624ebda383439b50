"""A fit as a small JSON file: model, equation and parameters, for programs that want no more of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.recording.atomic_write import write_text_durably

DESCRIBED = ("model", "equation", "hysteresis", "method", "adequate", "tested")
OF_A_PARAMETER = ("value", "unit", "low", "high", "identifiable")


def write_values(fit: Mapping[str, Any], path: Path) -> Path:
    """Write the model, its equation, whether it fits, where it was tested, and the parameters.

    Of each parameter its value (SI), unit and 95 % interval.

    Args:
        fit: of `fit.json`; what it does not say is left out.
        path: where to.
    """
    content = {name: fit[name] for name in DESCRIBED if name in fit}
    content["parameters"] = {
        name: {part: entry[part] for part in OF_A_PARAMETER if part in entry}
        for name, entry in fit["parameters"].items()
    }
    write_text_durably(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return path
