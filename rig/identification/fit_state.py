"""What travels through the stages of a fit: the tests as the model sees them, what is known so far, the fit."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Protocol, Self, cast

from rig.dampers.model import DamperModel
from rig.identification.models.measurement import Measurement
from rig.identification.models.solving import Candidate
from rig.identification.options import FitOptions
from rig.identification.points.inputs import FitInputs
from rig.identification.uncertainty.fit import Fit
from rig.matrix.corrections import Correction


@dataclass(frozen=True)
class FitState:
    """The state of a fit between two stages.

    Attributes:
        options: what is asked of the fit.
        known: the tests as they were measured, and what else the recordings contain.
        models: the models to be fitted.
        laws: current laws to compare the chosen model with; a single one is part of the model.
        fitted: tests to fit, as corrected so far.
        held_out: held-out tests, as corrected so far.
        warnings: what was found before the fit.
        held: parameters whose values a correction has found already, by name (SI).
        found: what the first stage of a correction found for its second one, by its name.
        chosen: the recommended model with its solution; None before it is fitted, or with a fit for each current.
        fit: the fit; None before.
        described: tests to fit and held-out ones as measured, set by `complete` of a correction whose effect is part of
            the completed fit's force (a temperature law): errors, tested range and bootstrap then refer to them. None,
            where the fit describes the damper without the effect: they refer to the corrected tests.
        started_s: `time.perf_counter()` at the start (s).
    """

    options: FitOptions
    known: FitInputs
    models: tuple[DamperModel, ...]
    laws: tuple[str, ...]
    fitted: list[Measurement]
    held_out: list[Measurement]
    warnings: tuple[str, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    found: Mapping[str, Any] = field(default_factory=dict)
    chosen: Candidate | None = None
    fit: Fit | None = None
    described: tuple[list[Measurement], list[Measurement]] | None = None
    started_s: float = field(default_factory=time.perf_counter)

    @property
    def so_far(self) -> Fit:
        """The fit.

        Raises:
            ValueError: no model was fitted yet.
        """
        if self.fit is None:
            raise ValueError(
                "corrections: this stage requires a fitted model, but no model was fitted before this stage. Fix: "
                "place the stage after the fit"
            )
        return self.fit

    def corrected(self, correct: Callable[[Sequence[Measurement]], Sequence[Measurement]]) -> Self:
        """The state with a correction applied to the tests to fit and to the held-out ones.

        Args:
            correct: from tests to the same tests, corrected, in the same order.
        """
        return replace(self, fitted=list(correct(self.fitted)), held_out=list(correct(self.held_out)))

    def with_found(self, correction: str, found: object) -> Self:
        """The state with what a correction's first stage found."""
        return replace(self, found={**self.found, correction: found})

    def with_parts(
        self,
        *,
        corrections: Mapping[str, Any] | None = None,
        evaluation: Mapping[str, Any] | None = None,
        uncertainty: Mapping[str, Any] | None = None,
        **changes: Any,  # noqa: ANN401 - fields of the fit
    ) -> Self:
        """The state with a fit some of whose fields, and fields of its parts, are changed."""
        fit = self.so_far
        changes["corrections"] = replace(fit.corrections, **(corrections or {}))
        changes["evaluation"] = replace(fit.evaluation, **(evaluation or {}))
        changes["uncertainty"] = replace(fit.uncertainty, **(uncertainty or {}))
        return replace(self, fit=replace(fit, **changes))

    def fitted_as(self, fit: Fit, chosen: Candidate | None = None) -> Self:
        """The state after the model was fitted, with the time that it took."""
        wall_s = time.perf_counter() - self.started_s
        return replace(self, chosen=chosen, fit=replace(fit, solver=replace(fit.solver, wall_s=wall_s)))


class Stages(Protocol):
    """The module of a correction: its stages are functions of the state that return it."""

    def refuse(self, options: FitOptions) -> None:
        """Refuse options that this correction does not go with; called before anything is computed.

        Raises:
            IdentificationFailed: one of these.
        """

    def prepare(self, state: FitState) -> FitState:
        """Before the model is fitted: tests corrected by `FitState.corrected`, and what was found for the model."""

    def complete(self, state: FitState) -> FitState:
        """After the model is fitted: the fit with what was found."""


def stages_of(correction: Correction) -> Stages:
    """The stages of a correction; its module is loaded here."""
    return cast("Stages", import_module(correction.home))
