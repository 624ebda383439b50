"""A fitted model's equation as text, with its numbers and units."""

from __future__ import annotations

from collections.abc import Mapping

from rig.fits.relation import CurrentRelations
from rig.fits.residual_weights import RESIDUAL

DIGITS = 5


def formula(form: str, values: Mapping[str, tuple[float | None, str]], current: CurrentRelations | None = None) -> str:
    """The equation, then every value with its unit.

    Args:
        form: the model's equation.
        values: parameter name to value (SI) and unit; None is a value that is not known. Those of a residual are not
            stated.
        current: relations to the current I (A) of parameters fitted at each current alone.
    """
    if current is not None:
        parts = [f"{name} = {relation}" for name, relation in current.relations.items()]
        return f"{form}; here {', '.join(parts)} (SI units, I in A, without higher-order terms in I)" if parts else form
    known = [
        _assigned(name, value, unit)
        for name, (value, unit) in values.items() if value is not None and name not in RESIDUAL
    ]  # fmt: skip
    unknown = [name for name, (value, _) in values.items() if value is None]
    text = f"{form}; with {', '.join(known)}" if known else form
    return f"{text}; unknown: {', '.join(unknown)}" if unknown else text


def _assigned(name: str, value: float, unit: str) -> str:
    return f"{name} = {value:.{DIGITS}g}{'' if unit == '1' else ' ' + unit}"
