"""The damper models and the parameter sets by name. A new model is a line of `CATALOGUE`, or another package's plug-in.

Models of plug-ins (entry points `mr_rig.damper_models`) are loaded when they are asked for; each brings the parameter
set `demo-NAME` of its `demonstration`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from protocols.near_miss import near_names
from rig.dampers.algebraic import AsymmetricModel, KwokModel, SymmetricModel
from rig.dampers.asymmetric_bouc_wen import AsymmetricBoucWenModel
from rig.dampers.bilinear import DigressiveBilinearModel, HystereticBiviscousModel
from rig.dampers.bouc_wen import BoucWenModel, NormalizedBoucWenModel, ThinningBoucWenModel
from rig.dampers.current_law_model import PLUS, with_law
from rig.dampers.friction import DahlModel
from rig.dampers.general_bouc_wen import GeneralizedBoucWenModel
from rig.dampers.grey_box import named_parts, with_residual
from rig.dampers.lost_motion import LostMotionModel
from rig.dampers.lugre import LuGreModel
from rig.dampers.model import DamperModel
from rig.dampers.modified_bouc_wen import ModifiedBoucWenModel
from rig.dampers.parameter import Hysteresis, ParameterSet
from rig.dampers.plastic import BinghamModel, ViscoelasticPlasticModel
from rig.dampers.published import PARAMETER_SETS as PUBLISHED
from rig.dampers.separation import MotionScale
from rig.dampers.sprung_bouc_wen import SprungBoucWenModel
from rig.dampers.thixotropic_bouc_wen import ThixotropicBoucWenModel
from rig.errors import RigError
from rig.plugins import DAMPER_MODELS, Catalogue

SIMULATED = "plausible values for the simulated rig, not a published fit"

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
    DahlModel(),
    HystereticBiviscousModel(),
    DigressiveBilinearModel(),
    AsymmetricBoucWenModel(),
    LuGreModel(),
    GeneralizedBoucWenModel(),
    SprungBoucWenModel(),
    ThixotropicBoucWenModel(),
)
"""Every model in every form; a place here is the model's `kind`, which files of simulated runs hold: append."""


ORDINARY = MotionScale(0.02, 0.5, 1.0, 0.0, 2.0, 1e-3)
"""Motion with which a plug-in's separation is checked when it is loaded."""


def model_of_plug_in(name: str, brought: object) -> DamperModel:
    """A plug-in's model: an object or a class of `DamperModel`, called as its entry point is.

    Raises:
        ValueError: it is something else.
        ModelProblem: its definition is inconsistent.
    """
    made = brought() if isinstance(brought, type) else brought
    if not isinstance(made, DamperModel):
        raise ValueError(f"got {type(made).__name__}, expected a rig.dampers.DamperModel (class or object)")
    if made.name != name:
        raise ValueError(f"got a model named {made.name!r}, expected the same name as its entry point")
    made.vector(made.demonstration)
    made.separation(ORDINARY)
    return made


MODELS: Mapping[str, DamperModel] = Catalogue(
    {model.name: model for model in CATALOGUE if model.hysteresis == "kwok"}, DAMPER_MODELS, model_of_plug_in
)
PRINTED: dict[str, DamperModel] = {model.name: model for model in CATALOGUE if model.hysteresis == "printed"}
KINDS = {(model.name, model.hysteresis): kind for kind, model in enumerate(CATALOGUE)}
"""Number of a model with its hysteresis, by which files of simulated runs name it."""
NO_KIND = -1
"""In place of that number for a plug-in's model, which such a file names by its name alone."""


def set_name(model_name: str) -> str:
    """Name of the parameter set that a model's demonstration is."""
    return "demo" if model_name == "asymmetric" else f"demo-{model_name.replace('_', '-')}"


def _demonstration(model: DamperModel) -> ParameterSet:
    return ParameterSet(set_name(model.name), model.name, model.demonstration, SIMULATED)


class _ParameterSets(Mapping[str, ParameterSet]):
    """The parameter sets by name: our own, then one of each plug-in's model, which is loaded when it is asked for."""

    def __init__(self) -> None:
        demonstrations = [_demonstration(model) for model in CATALOGUE if model.hysteresis == "kwok"]
        self._own = {values.name: values for values in (*demonstrations, *PUBLISHED)}

    def _brought(self) -> dict[str, str]:
        return {name: model for model in MODELS if (name := set_name(model)) not in self._own}

    def __getitem__(self, name: str) -> ParameterSet:
        return self._own[name] if name in self._own else _demonstration(MODELS[self._brought()[name]])

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._brought()

    def __iter__(self) -> Iterator[str]:
        return iter((*self._own, *self._brought()))

    def __len__(self) -> int:
        return len(self._own) + len(self._brought())


PARAMETER_SETS: Mapping[str, ParameterSet] = _ParameterSets()


class UnknownName(RigError):
    """No model or parameter set has this name; the message lists those there are."""


def _nearest(name: str, known: list[str]) -> str:
    close = near_names(name, known)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{', '.join(known)}{hint}"


def model(name: str, hysteresis: Hysteresis = "kwok") -> DamperModel:
    """The damper model called `name`.

    Args:
        name: key of `MODELS`; behind it, after a plus, may stand a current law (`rig.dampers.current_law`), then a
            residual (`rig.dampers.grey_box`), such as `asymmetric+saturating+grey@slip,speed`.
        hysteresis: form of the tanh argument, "kwok" (beta v + delta sgn u) or "printed" (beta (v + lambda sgn u));
            models without that term take only "kwok".

    Raises:
        UnknownName: no such model, or the model has no printed form.
        UnknownLaw: no such current law.
        UnknownPart: no such part of a residual.
        PlugInProblem: it is a plug-in's, and that cannot be used.
    """
    grey = named_parts(name)
    if grey is not None:
        base, parts = grey
        return with_residual(model(base, hysteresis), parts)
    if PLUS in name:
        base, _, law = name.partition(PLUS)
        return with_law(model(base, hysteresis), law)
    if name not in MODELS:
        raise UnknownName(f"unknown damper model {name!r}; known: {_nearest(name, list(MODELS))}")
    if hysteresis == "kwok":
        return MODELS[name]
    if hysteresis != "printed":
        raise UnknownName(f"unknown hysteresis form {hysteresis!r}; expected kwok or printed")
    if name not in PRINTED:
        raise UnknownName(
            f"{name}: this model has no printed form of the hysteresis argument; models that have one: "
            f"{', '.join(PRINTED)}"
        )
    return PRINTED[name]


def parameter_set(name: str) -> ParameterSet:
    """The parameter set called `name`; values are complete for its model.

    Raises:
        UnknownName: no such set; the message lists those there are.
        PlugInProblem: it is of a plug-in's model, and that cannot be used.
    """
    if name not in PARAMETER_SETS:
        raise UnknownName(f"unknown parameter set {name!r}; known: {_nearest(name, list(PARAMETER_SETS))}")
    return PARAMETER_SETS[name]
