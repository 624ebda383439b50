"""What is asked of a fit, as one value."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from protocols.near_miss import meant
from rig.dampers import Hysteresis
from rig.dampers.current_law import AFFINE
from rig.dampers.grey_box import GREY, named_parts
from rig.identification.models.solving import SEPARABLE, Method
from rig.jobs.workers import HERE, Workers
from rig.matrix.corrections import CORRECTIONS, SETTINGS, Correction
from rig.test_point import TestPoint

if TYPE_CHECKING:
    from rig.identification.points.inputs import Tests
    from rig.recording.recorded_point import RecordedPoint

ALL, FEW = "all", "few"
"""Several models compared; with `rig.dampers.grey_box.GREY` those of "few", and the best with a residual."""


@dataclass(frozen=True)
class DeclaredErrors:
    """Standard uncertainties that the data themselves do not show.

    Attributes:
        force_gain: relative error of the force's scale (1).
        displacement_gain: relative error of the displacement's scale (1).
    """

    force_gain: float = 0.0
    displacement_gain: float = 0.0


@dataclass(frozen=True)
class Allowance:
    """What a test may ask of the machine and the specimen.

    Attributes:
        amplitude_m: largest amplitude (m).
        speed_m_s: largest speed (m/s).
        acceleration_m_s2: largest acceleration (m/s^2).
        force_N: largest force (N).
        current_A: largest current (A).
        source: where these limits come from, in words.
        feasible: the plan's verdict on a point; None where there is no bench.
    """

    amplitude_m: float
    speed_m_s: float
    acceleration_m_s2: float
    force_N: float
    current_A: float
    source: str
    feasible: Callable[[TestPoint], bool] | None = None


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit and of further computations; `identify` also accepts each as a keyword.

    Attributes:
        model: a name in `rig.dampers.MODELS`, with a current law or without (`asymmetric+saturating`), "few" to
            compare `FEW_MODELS`, or "all" to compare every one. "grey" compares those of "few" and adds a residual to
            the best one if it predicts tests left out better; "all" does so too, and `NAME+grey` for one model.
        method: "separable", one of the papers' algorithms, or a `Method` with its settings.
        holdout: tests left out of the fit and used to validate it: a filter such as "waveform=triangle" on the tests,
            or others; of motion without cycles also "last 30 %" of the time of each test.
        hysteresis: form of the tanh models' argument.
        declared: scale and position errors to include in the intervals.
        profile: parameters whose profile likelihood is computed; True or "nonlinear" among them: all nonlinear ones.
        current: how parameters depend on the current: "affine", in one fit; or one fit for each current with
            "per-current-affine", "per-current-polynomial" (quadratic) or "per-current-lagrange" relations.
        current_law: what the fluid feels of the current: "affine" (the current itself), "saturating", "polynomial",
            "per-current" (a table over the tested currents), or "all": those laws of the model, or of the best model,
            compared as models are.
        allowance: what the next test may ask of the machine; by default what a run's own bench and matrix allow, or
            what was tested.
        campaign: further points of the same campaigns, neither fitted nor held out: they contain information on the
            sensors' delays.
        diagnose: look for what explains the misfit; None: where the model is not adequate. Units and signs are checked
            in any case.
        bootstrap: number of bootstrap draws, for intervals that include misfit (`rig.identification.bootstrap`).
        unseen: "pairs": leave-one-motion-out cross-validation of the model.
        workers: run independent parts of the work: compared models, bootstrap samples, motions of a cross-validation
            (`rig.jobs.choice.workers_for`). The result does not depend on them.
        on_progress: called with a line of text before each model is fitted and each comparison.
        corrections: setting of each correction that is requested (`rig.matrix.corrections`). As keywords:
            `series_spring=True` looks for a spring in series with the damper, and fits the damper behind it;
            `temperature_law=` fits how warm oil weakens the damper, where a temperature was recorded: rates of the
            "viscous" parameters, the "yield" parameters, one "common" rate, or "both".
    """

    model: str = "asymmetric"
    method: str | Method = SEPARABLE
    holdout: str | Tests | None = None
    hysteresis: Hysteresis = "kwok"
    declared: DeclaredErrors | None = None
    profile: bool | Sequence[str] = False
    current: str = AFFINE
    current_law: str = AFFINE
    allowance: Allowance | None = None
    campaign: Sequence[RecordedPoint] = ()
    diagnose: bool | None = None
    bootstrap: int = 0
    unseen: str | None = None
    workers: Workers = HERE
    on_progress: Callable[[str], None] | None = None
    corrections: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, options: FitOptions | None, changes: Mapping[str, Any]) -> FitOptions:
        """The options with some of them changed; corrections by their own names.

        Raises:
            TypeError: there is no such option.
        """
        options = options or cls()
        own, requested = {one.name for one in fields(cls)}, dict(options.corrections)
        unknown = [name for name in changes if name not in own and name not in SETTINGS]
        if unknown:
            known = sorted(own | SETTINGS.keys())
            raise TypeError("\n".join(f"fit options: got {name!r}; {meant(name, known)}" for name in unknown))
        requested |= {name: value for name, value in changes.items() if name in SETTINGS}
        given = {name: value for name, value in changes.items() if name in own}
        requested = {name: value for name, value in requested.items() if value != SETTINGS[name]}
        return replace(options, **{"corrections": requested, **given})

    @property
    def how(self) -> Method:
        """The method with its settings."""
        return self.method if isinstance(self.method, Method) else Method(self.method)

    def setting(self, correction: str) -> Any:  # noqa: ANN401 - a switch, one of the choices, or a number in SI
        """What is requested of a correction."""
        return self.corrections.get(correction, SETTINGS[correction])

    @property
    def applied(self) -> tuple[Correction, ...]:
        """The corrections that are made."""
        return tuple(one for one in CORRECTIONS if not one.requestable or one.name in self.corrections)

    @property
    def several(self) -> bool:
        """Whether several models are compared."""
        return self.model in {ALL, FEW, GREY}

    @property
    def grey(self) -> bool:
        """Whether a residual of the chosen model is requested."""
        return self.model in {ALL, GREY} or named_parts(self.model) is not None

    @property
    def one_model_only(self) -> bool:
        """Whether these options go with one model, and not with a comparison of several."""
        return self.how.name != SEPARABLE or self.current != AFFINE or bool(self.corrections)

    def report(self, line: str) -> None:
        """Report progress."""
        if self.on_progress is not None:
            self.on_progress(line)
