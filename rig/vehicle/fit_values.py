"""A damper's model and parameters from a `fit.json`, with every reason why there are none; loads no compiler."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig import dampers
from rig.dampers import DamperModel
from rig.errors import FileProblem, RigError
from rig.fit_file import FIX, read_fit

COIL = "eta"
"""Rate of the coil's lag, which many tests cannot tell."""


@dataclass(frozen=True)
class FitValues:
    """What a fit says of a damper.

    Attributes:
        model: the fitted one.
        values: complete parameters, SI; of one that the fit does not name (the coil's lag) its usual value.
        content: the whole object of the file.
        sha256: of the file (hex).
    """

    model: DamperModel
    values: Mapping[str, float]
    content: Mapping[str, Any]
    sha256: str


def fit_values(path: Path) -> FitValues:
    """Model and parameters of a fit.

    Raises:
        FileProblem: no such file, no fit, a model that is not known here, or parameters without a value: each.
    """
    read = read_fit(path)
    fit, entries = read.content, read.content["parameters"]
    try:
        model = dampers.model(str(fit["model"]), fit.get("hysteresis") or "kwok")
    except RigError as error:
        raise FileProblem(str(read.file), [f"model: {error}", FIX]) from error
    problems = [*_without_value(model, entries, fit)]
    if problems:
        raise FileProblem(str(read.file), problems)
    values = {name: float(value) for name, value in _written(model, entries).items()}
    return FitValues(model, values, fit, read.sha256)


def _written(model: DamperModel, entries: Mapping[str, Any]) -> dict[str, Any]:
    """Each parameter's value as the file has it, None where it has none; the coil's lag its usual one there."""
    written = {name: (entries.get(name) or {}).get("value") for name in model.names}
    return {
        name: model.parameter(name).start if value is None and name == COIL else value
        for name, value in written.items()
    }


def _without_value(model: DamperModel, entries: Mapping[str, Any], fit: Mapping[str, Any]) -> Iterator[str]:
    """The parameters that have none."""
    written = _written(model, entries)
    missing = [name for name, value in written.items() if value is None]
    if missing:
        current = fit.get("current")
        one_each = isinstance(current, Mapping) and str(current.get("dependence")).startswith("per-current")
        way = "; it holds one fit for each current: identify again with --current affine" if one_each else ""
        yield f"no value for {', '.join(missing)}{way}"
