"""Forecast of force and heat of a point: from a named parameter set, from a stated bound, or unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from rig.matrix.assumed_damper import AssumedDamper
from rig.matrix.sections import Specimen
from rig.signals.record import STEP_S
from rig.test_point import TestPoint

Forecast = Callable[[TestPoint], tuple[float | None, float | None]]
"""Largest force (N) and energy turned to heat over the whole program (J); None where unknown."""

STEPS_A_CYCLE = 400
EVERY = 2
"""Samples of a record, of which the force is computed."""


def forecaster(specimen: Specimen) -> Forecast:
    """The best forecast the specimen's section allows; a point that brings its own keeps that.

    Equal motions, of which an endurance test has thousands, are computed once.
    """
    of_waveforms = _of_waveforms(specimen)

    @cache
    def of_motion(point: TestPoint) -> tuple[float | None, float | None]:
        own = point.forecast
        if own is not None:
            return own.force_N, own.energy_J + _coil_J(point, specimen)
        return _of_program(point, of_waveforms) if point.current_programmed else of_waveforms(point)

    return lambda point: of_motion(point.without_name)


def _of_program(point: TestPoint, at_constant_current: Forecast) -> tuple[float | None, float | None]:
    """Of a current program: the largest force of its currents, and the energy by the time at each of them."""
    ends_s = (*point.steps_s[1:], max(point.motion_s, point.steps_s[-1]))
    held_s: dict[float, float] = {}
    for current_A, begin_s, end_s in zip(point.steps_A, point.steps_s, ends_s, strict=True):
        held_s[current_A] = held_s.get(current_A, 0.0) + end_s - begin_s
    of_currents = {current_A: at_constant_current(replace(point, current_A=current_A)) for current_A in held_s}
    forces_N = [force_N for force_N, _ in of_currents.values() if force_N is not None]
    if len(forces_N) < len(of_currents):
        return None, None
    energy_J = sum((of_currents[name][1] or 0.0) * time_s for name, time_s in held_s.items()) / sum(held_s.values())
    return max(forces_N), energy_J


def _of_waveforms(specimen: Specimen) -> Forecast:
    if specimen.assumed is not None:
        return _from_prior(specimen, specimen.assumed)
    bound_N = specimen.max_force_N
    if bound_N is None:
        return lambda _point: (None, None)

    def bounded(point: TestPoint) -> tuple[float | None, float | None]:
        way_m = 4.0 * point.amplitude_m * _full_cycles(point)
        if point.record_samples is not None:
            way_m = point.amplitude_m * float(np.sum(np.abs(np.diff(point.record_samples.shape))))
        return bound_N, bound_N * way_m + _coil_J(point, specimen)

    return bounded


def _full_cycles(point: TestPoint) -> float:
    """Cycles of full amplitude that dissipate as much as the program: a linear ramp counts a third (work ~ A^2)."""
    return point.cycles + (point.ramp_in_cycles + point.ramp_out_cycles) / 3.0


def _coil_J(point: TestPoint, specimen: Specimen) -> float:
    """Heat of the coil over the program, I^2 R t (J); nothing when the resistance is not given."""
    return point.current_A**2 * (specimen.coil_resistance_ohm or 0.0) * point.motion_s


def _from_prior(specimen: Specimen, prior: AssumedDamper) -> Forecast:
    damper = prior.model

    def predicted(point: TestPoint) -> tuple[float | None, float | None]:
        if point.record_samples is not None:
            u, v, a = point.record_samples.motion(point.amplitude_m, EVERY)
            force_N = damper.force(prior.values, u, v, a, point.current_A, EVERY * STEP_S)
            work_J = float(np.sum(force_N * v)) * EVERY * STEP_S
            return float(np.max(np.abs(force_N))), work_J + _coil_J(point, specimen)
        # Two cycles; the second counts, because models with memory start at rest.
        dt_s = 1.0 / (point.frequency_Hz * STEPS_A_CYCLE)
        phase = (np.arange(2 * STEPS_A_CYCLE) + 0.5) / STEPS_A_CYCLE
        u, v, a = point.shape.motion(phase, point.amplitude_m, point.frequency_Hz)
        force_N = damper.force(prior.values, u, v, a, point.current_A, dt_s)[STEPS_A_CYCLE:]
        cycle_J = float(np.sum(force_N * v[STEPS_A_CYCLE:]) * dt_s)
        return float(np.max(np.abs(force_N))), cycle_J * _full_cycles(point) + _coil_J(point, specimen)

    return predicted
