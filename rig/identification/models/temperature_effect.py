"""What a test's recorded temperature does to the modelled force, beside the force at the reference temperature."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import TemperatureLaw
from rig.identification.models.measurement import Measurement


def force_change_N(
    model: DamperModel, values: Mapping[str, float], law: TemperatureLaw, test: Measurement
) -> FloatArray:
    """Force (N), (n,), at the recorded temperatures less that at the reference; 0 where none was recorded.

    Models with internal states run through the first cycle once before, at its temperatures.

    Raises:
        KeyError: a parameter is missing.
    """
    if test.temperature_degC is None or not any(law.rates.values()):
        return np.zeros(test.u_m.size)
    from rig.dampers.trajectory import trajectory_of  # loads numba

    complete = dict(values)
    if "eta" in model.names:
        complete.setdefault("eta", model.parameter("eta").start)
    warm = test.samples_per_cycle if model.states else 0
    once = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A, filled(test.temperature_degC, law.reference_degC))
    u_m, v_m_s, a_m_s2, current_A, degC = (np.concatenate((part[:warm], part), dtype=float) for part in once)
    run, start = trajectory_of(model), model.initial_state(float(u_m[0]))
    forces = [
        run(vectors, start, u_m, v_m_s, a_m_s2, current_A, test.dt_s)[0][warm:]
        for vectors in (law.vectors(model, complete, degC), model.vector(complete)[None, :])
    ]
    return np.asarray(forces[0] - forces[1])


def filled(temperature_degC: FloatArray, reference_degC: float) -> FloatArray:
    """Temperatures (n,) whose gaps are bridged by straight lines; the reference where nothing is known."""
    known = np.flatnonzero(np.isfinite(temperature_degC))
    if not known.size:
        return np.full(temperature_degC.size, reference_degC)
    return np.interp(np.arange(temperature_degC.size), known, temperature_degC[known])
