"""The coil's lag as a correction: its current where only the command was recorded, eta where current steps show it."""

from __future__ import annotations

from dataclasses import replace

import rig.dampers
from rig.fits.entries import Estimate
from rig.identification.fit_state import FitState
from rig.identification.models.coil import find_lag, needs_lag, with_lag
from rig.identification.models.solving import Method, Refit
from rig.identification.models.undetermined import examine
from rig.identification.options import FitOptions
from rig.identification.uncertainty.covariance import quantile

ETA = "eta"


def refuse(options: FitOptions) -> None:
    """The coil's lag goes with everything."""


def prepare(state: FitState) -> FitState:
    """The tests with the coil's own current, where any of them stepped a current that was not measured."""
    if not needs_lag(state.fitted):
        return state
    eta_1_s = _found_lag(state)
    state = state.corrected(lambda tests: [with_lag(test, eta_1_s) for test in tests])
    return replace(state, held={**state.held, ETA: eta_1_s})


def complete(state: FitState) -> FitState:
    """The fit with the rate that was found, by the force model or by current steps."""
    if ETA in state.held:
        state = state.with_parts(corrections={"coil_eta_1_s": state.held[ETA]})
    return state if state.known.lag is None or ETA not in state.so_far.parameters else _of_steps(state)


def _found_lag(state: FitState) -> float:
    """Eta (1/s) with the requested model if that is algebraic, else with the asymmetric one: it is the coil's alone."""
    state.options.report("identifying the coil lag from current steps")
    model = next((model for model in state.models if model.states == 0), rig.dampers.model("asymmetric", "kwok"))
    refit = Refit(model, Method(weight=state.options.how.weight), examine(model, state.fitted))
    return find_lag(state.fitted, lambda tests: refit(tests).objective)


def _of_steps(state: FitState) -> FitState:
    """The fit with eta from the current steps in place of an eta that loops at constant current cannot show."""
    fit, lag = state.so_far, state.known.lag
    if lag is None:
        return state
    together = quantile(len(fit.identifiable) + 1) * lag.std_1_s
    low, high = lag.interval_1_s
    eta = Estimate(
        value=lag.eta_1_s,
        unit=fit.parameters[ETA].unit,
        low=low,
        high=high,
        simultaneous_low=lag.eta_1_s - together,
        simultaneous_high=lag.eta_1_s + together,
        standard_error=lag.std_1_s,
    )
    note = (
        f"eta: identified from {lag.steps} current steps (commanded vs. measured current), independently of the force "
        "model"
    )
    if lag.in_motion:
        note += f"; {lag.in_motion} of them at constant velocity (response tests)"
    notes = (*fit.notes, note)
    if lag.behind_s is not None:
        value_s, std_s = lag.behind_s
        notes += (
            f"force: follows the measured coil current with a mean delay of {1e3 * value_s:.2g} +- {1e3 * std_s:.1g} "
            "ms (response tests), which eta does not contain",
        )
    return state.with_parts(parameters={**fit.parameters, ETA: eta}, uncertainty={"notes": notes})
