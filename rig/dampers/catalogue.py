"""Models and parameter sets by name."""

from __future__ import annotations

from difflib import get_close_matches

from rig.dampers.algebraic import AsymmetricModel, BinghamModel, Hysteresis, KwokModel, SymmetricModel
from rig.dampers.hysteretic import (
    BoucWenModel,
    ModifiedBoucWenModel,
    NormalizedBoucWenModel,
    ThinningBoucWenModel,
    ViscoelasticPlasticModel,
)
from rig.dampers.model import DamperModel
from rig.dampers.parameter import ParameterSet
from rig.dampers.parameter_sets import PARAMETER_SETS
from rig.errors import RigError


class UnknownName(RigError):
    """No model or parameter set has this name; the message lists those there are."""


MODELS: dict[str, DamperModel] = {
    each.name: each
    for each in (
        AsymmetricModel(),
        SymmetricModel(),
        KwokModel(),
        BinghamModel(),
        ViscoelasticPlasticModel(),
        BoucWenModel(),
        ModifiedBoucWenModel(),
        NormalizedBoucWenModel(),
        ThinningBoucWenModel(),
    )
}
PRINTED: dict[str, DamperModel] = {each.name: each for each in (AsymmetricModel("printed"), SymmetricModel("printed"))}


def _nearest(name: str, known: list[str]) -> str:
    close = get_close_matches(name, known, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{', '.join(known)}{hint}"


def model(name: str, hysteresis: Hysteresis = "kwok") -> DamperModel:
    """The damper model called `name`.

    Args:
        name: key of `MODELS`.
        hysteresis: form of the tanh argument, "kwok" (beta v + delta sgn u) or "printed" (beta (v + lambda sgn u));
            models without that term take only "kwok".

    Raises:
        UnknownName: no such model, or the model has no printed form.
    """
    if name not in MODELS:
        raise UnknownName(f"unknown damper model {name!r}; known: {_nearest(name, list(MODELS))}")
    if hysteresis == "kwok":
        return MODELS[name]
    if hysteresis != "printed":
        raise UnknownName(f"unknown hysteresis form {hysteresis!r}; known: kwok, printed")
    if name not in PRINTED:
        raise UnknownName(
            f"{name} has no printed form of the hysteresis argument; models that have: {', '.join(PRINTED)}"
        )
    return PRINTED[name]


def parameter_set(name: str) -> ParameterSet:
    """The parameter set called `name`; values are complete for its model.

    Raises:
        UnknownName: no such set; the message lists those there are.
    """
    if name not in PARAMETER_SETS:
        raise UnknownName(f"unknown parameter set {name!r}; known: {_nearest(name, list(PARAMETER_SETS))}")
    return PARAMETER_SETS[name]
