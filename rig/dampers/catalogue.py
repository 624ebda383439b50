"""The damper models and the parameter sets by name. A new model is a line of `_models`."""

from __future__ import annotations

from difflib import get_close_matches

from rig.dampers.algebraic import AsymmetricModel, KwokModel, SymmetricModel
from rig.dampers.bouc_wen import BoucWenModel, NormalizedBoucWenModel, ThinningBoucWenModel
from rig.dampers.lost_motion import LostMotionModel
from rig.dampers.model import DamperModel
from rig.dampers.modified_bouc_wen import ModifiedBoucWenModel
from rig.dampers.parameter import Hysteresis, ParameterSet
from rig.dampers.plastic import BinghamModel, ViscoelasticPlasticModel
from rig.dampers.published import PARAMETER_SETS as PUBLISHED
from rig.errors import RigError

SIMULATED = "plausible values for the simulated rig; not a published fit"

CATALOGUE: tuple[DamperModel, ...] = (
    AsymmetricModel(),
    AsymmetricModel("printed"),
    SymmetricModel(),
    SymmetricModel("printed"),
    KwokModel(),
    BinghamModel(),
    ViscoelasticPlasticModel(),
    BoucWenModel(),
    ModifiedBoucWenModel(),
    NormalizedBoucWenModel(),
    ThinningBoucWenModel(),
    LostMotionModel(),
)
"""Every model in every form; a place here is the model's `kind`, which files of simulated runs hold: append."""

MODELS: dict[str, DamperModel] = {model.name: model for model in CATALOGUE if model.hysteresis == "kwok"}
PRINTED: dict[str, DamperModel] = {model.name: model for model in CATALOGUE if model.hysteresis == "printed"}
KINDS = {(model.name, model.hysteresis): kind for kind, model in enumerate(CATALOGUE)}
"""Number of a model with its hysteresis, by which files of simulated runs name it."""


def _demonstration(model: DamperModel) -> ParameterSet:
    name = "demo" if model.name == "asymmetric" else f"demo-{model.name.replace('_', '-')}"
    return ParameterSet(name, model.name, model.demonstration, SIMULATED)


PARAMETER_SETS: dict[str, ParameterSet] = {
    values.name: values for values in (*(_demonstration(model) for model in MODELS.values()), *PUBLISHED)
}


class UnknownName(RigError):
    """No model or parameter set has this name; the message lists those there are."""


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
