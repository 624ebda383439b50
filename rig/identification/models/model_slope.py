"""How the modelled force changes with each parameter, and with small errors of the motion's time, place and scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.algebraic import ColumnModel
from rig.dampers.arrays import FloatArray
from rig.dampers.current_law_model import CurrentLawModel
from rig.dampers.grey_box import GreyBoxModel
from rig.dampers.grey_regressors import ELEMENTS, SLIP, residual_force
from rig.dampers.model import DamperModel
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import Measurement

RELATIVE_STEP = 1e-4
TIME_STEP_S = 2e-6
SCALE_STEP = 1e-5
CURRENT_STEP_A = 1e-4
EXTENSION_STEP_M, SPEED_STEP_M_S, ACCELERATION_STEP_M_S2 = 1e-9, 1e-7, 1e-4


@dataclass(frozen=True)
class FittedModel:
    """A damper model, all its parameters' values (SI), and the names of those that were fitted to the tests at hand."""

    model: DamperModel
    values: Mapping[str, float]
    names: tuple[str, ...]

    def force(self, test: Measurement) -> FloatArray:
        """`modelled_force` of a measurement."""
        return modelled_force(self.model, self.values, test)

    def slopes(self, test: Measurement) -> FloatArray:
        """`parameter_slopes` of the fitted parameters."""
        return parameter_slopes(self.model, self.values, self.names, test)

    def force_and_slopes(self, test: Measurement) -> tuple[FloatArray, FloatArray]:
        """`force_and_slopes` of the fitted parameters."""
        return force_and_slopes(self.model, self.values, self.names, test)

    def time_slope(self, test: Measurement) -> FloatArray:
        """`time_slope` of a measurement."""
        return time_slope(self.model, self.values, test)


def modelled_force(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Force (N), shape (n,), that the model predicts for a measurement; eta, if missing, does not matter.

    Models with internal states run through the first cycle once before, so that they have forgotten their start.

    Raises:
        KeyError: a parameter is missing.
    """
    if isinstance(model, GreyBoxModel):
        return modelled_force(model.base, model.of_base(values), test) + residual_along(model, values, test)
    complete = dict(values)
    if "eta" in model.names:
        complete.setdefault("eta", model.parameter("eta").start)
    if model.states == 0:
        whole: FloatArray = np.empty(test.u_m.size)
        for rows in test.pieces():
            motion = (test.u_m[rows], test.v_m_s[rows], test.a_m_s2[rows], test.current_A[rows])
            whole[rows] = model.force(complete, *motion, test.dt_s)
        return whole
    from rig.dampers.kernel import force_series  # loads numba

    state, motion = model.initial_state(float(test.u_m[0])), (test.u_m, test.v_m_s, test.a_m_s2, test.current_A)
    force: FloatArray = force_series(model, model.vector(complete), state, *motion, test.dt_s, test.samples_per_cycle)
    return force


def element_states(values: Mapping[str, float], test: Measurement) -> FloatArray:
    """States of a residual's elements along a measurement, after its first cycle, (n, ELEMENTS)."""
    from rig.dampers.grey_kernel import elements_along  # loads numba

    travels = np.array([values[f"travel_{k}"] for k in range(1, ELEMENTS + 1)])
    return np.asarray(elements_along(test.u_m, travels, test.samples_per_cycle))


def residual_along(model: GreyBoxModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """The residual force (N), (n,), of a grey-box model along a measurement."""
    z = element_states(values, test) if SLIP in model.parts else np.zeros((test.u_m.size, 0))
    return residual_force(model.parts, values, test.u_m, test.v_m_s, test.current_A, z)


def without_residual(
    model: GreyBoxModel, values: Mapping[str, float], tests: Sequence[Measurement]
) -> list[Measurement]:
    """The tests with the residual's force subtracted from the measured one: what the physical model is fitted to."""
    return [replace(test, force_N=test.force_N - residual_along(model, values, test)) for test in tests]


def parameter_slopes(
    model: DamperModel, values: Mapping[str, float], names: Sequence[str], test: Measurement
) -> FloatArray:
    """Derivatives of the force with respect to `names`, shape (n, len(names)), in N per unit of each parameter.

    Raises:
        KeyError: a parameter is missing.
    """
    if isinstance(model, GreyBoxModel):  # its residual is held
        return parameter_slopes(model.base, model.of_base(values), names, test)
    if isinstance(model, ColumnModel):
        return _algebraic_slopes(model, values, names, test)
    if isinstance(model, CurrentLawModel):
        return _current_law_slopes(model, values, names, test)
    if model.slopes_along() is not None:
        return force_and_slopes(model, values, names, test)[1]
    columns = []
    for name in names:
        if name == "eta":
            columns.append(_lag_column(model, values, test))
            continue
        step = RELATIVE_STEP * max(abs(values[name]), 1e-3 * abs(model.parameter(name).start), 1e-9)
        above = modelled_force(model, {**values, name: values[name] + step}, test)
        below = modelled_force(model, {**values, name: values[name] - step}, test)
        columns.append((above - below) / (2.0 * step))
    return np.array(columns).T


def force_and_slopes(
    model: DamperModel, values: Mapping[str, float], names: Sequence[str], test: Measurement
) -> tuple[FloatArray, FloatArray]:
    """`modelled_force` and `parameter_slopes` at once: in one pass of a model that gives its slopes.

    Raises:
        KeyError: a parameter is missing.
    """
    compiled = model.slopes_along()
    if compiled is None:
        return modelled_force(model, values, test), parameter_slopes(model, values, names, test)
    motion = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A)
    state = model.initial_state(float(test.u_m[0]))
    force, every = compiled(model.vector(values), state, *motion, test.dt_s, test.samples_per_cycle)
    places = {name: place for place, name in enumerate(model.names)}
    return np.asarray(force), np.asarray(every[:, [places[name] for name in names]])


def _algebraic_slopes(
    model: ColumnModel, values: Mapping[str, float], names: Sequence[str], test: Measurement
) -> FloatArray:
    fixed = model.fixed_columns(test.u_m, test.v_m_s, test.a_m_s2, test.current_A)
    columns = dict(zip(model.fixed_names, fixed.T, strict=True))
    yielding = model.yield_shape(values, test.u_m, test.v_m_s)
    columns |= dict(zip(model.yield_names, (yielding, yielding * test.current_A), strict=True))
    if model.shape_names:
        at_zero, per_ampere = (values[name] for name in model.yield_names)
        rate = (at_zero + per_ampere * test.current_A) * (1.0 - yielding**2)
        slopes = model.argument_slopes(values, test.u_m, test.v_m_s)
        columns |= {name: rate * slope for name, slope in zip(model.shape_names, slopes, strict=True)}
    if "eta" in names:
        columns["eta"] = _lag_column(model, values, test)
    return np.array([columns[name] for name in names]).T


def _current_law_slopes(
    model: CurrentLawModel, values: Mapping[str, float], names: Sequence[str], test: Measurement
) -> FloatArray:
    """The base model's slopes at what its fluid feels, and the law's; the lag acts before the law."""
    seen = replace(test, current_A=model.law.felt_A(values, test.current_A))
    own = [name for name in names if name in model.base.names and name != "eta"]
    laws = [name for name in names if name in model.law.names]
    columns = dict(zip(own, parameter_slopes(model.base, model.of_base(values), own, seen).T, strict=True))
    columns |= dict(zip(laws, law_columns(model, values, laws, test).T, strict=True))
    if "eta" in names:
        columns["eta"] = _lag_column(model, values, test)
    return np.array([columns[name] for name in names]).T


def law_columns(
    model: CurrentLawModel, values: Mapping[str, float], names: Sequence[str], test: Measurement
) -> FloatArray:
    """Derivatives of the force with respect to parameters of the current law, shape (n, len(names)).

    Raises:
        KeyError: a parameter is missing.
    """
    columns = np.empty((test.u_m.size, len(names)))
    own = model.of_base(values)
    for k, name in enumerate(names):
        step = RELATIVE_STEP * max(abs(values[name]), 0.1)
        forces = [
            modelled_force(model.base, own, replace(test, current_A=model.law.felt_A(
                {**values, name: values[name] + signed}, test.current_A)))
            for signed in (step, -step)
        ]  # fmt: skip
        columns[:, k] = (forces[0] - forces[1]) / (2.0 * step)
    return columns


def _lag_column(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Change of the force with eta (N s), through the coil current; 0 where that was measured."""
    if test.commanded_A is None:
        return np.zeros_like(test.u_m)
    step = RELATIVE_STEP * values["eta"]
    above, below = (modelled_force(model, values, with_lag(test, values["eta"] + signed)) for signed in (step, -step))
    return (above - below) / (2.0 * step)


def time_slope(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Change of the modelled force with a shift of time, dF/dt (N/s), shape (n,)."""
    jerk = np.gradient(test.a_m_s2, test.dt_s)
    return _motion_slope(model, values, test, (test.v_m_s, test.a_m_s2, jerk), TIME_STEP_S)


def scale_slope(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Change of the modelled force with the displacement's scale (N per 1), shape (n,)."""
    return _motion_slope(model, values, test, (test.u_m, test.v_m_s, test.a_m_s2), SCALE_STEP)


def current_slope(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Change of the modelled force with the current (N/A), shape (n,)."""
    forces = [
        modelled_force(model, values, replace(test, current_A=test.current_A + signed))
        for signed in (CURRENT_STEP_A, -CURRENT_STEP_A)
    ]
    return (forces[0] - forces[1]) / (2.0 * CURRENT_STEP_A)


def unseen_force(model: DamperModel, values: Mapping[str, float], test: Measurement) -> FloatArray:
    """Change of the modelled force (N) with the motion that the samples did not resolve, shape (n,); 0 without any."""
    if test.unseen_v_m_s is None or test.unseen_a_m_s2 is None:
        return np.zeros_like(test.u_m)
    direction = (np.zeros_like(test.u_m), test.unseen_v_m_s, test.unseen_a_m_s2)
    return _motion_slope(model, values, test, direction, 1.0)


def _motion_slope(
    model: DamperModel,
    values: Mapping[str, float],
    test: Measurement,
    direction: tuple[FloatArray, FloatArray, FloatArray],
    step: float,
) -> FloatArray:
    forces = []
    for signed in (step, -step):
        motion = (test.u_m + signed * direction[0], test.v_m_s + signed * direction[1])
        forces.append(modelled_force(model, values, test.moved(*motion, test.a_m_s2 + signed * direction[2])))
    return (forces[0] - forces[1]) / (2.0 * step)


def motion_slopes(
    model: DamperModel, values: Mapping[str, float], test: Measurement
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Change of an algebraic model's force with extension (N/m), speed (N s/m), acceleration (kg), (n,) each."""
    one, none = np.ones_like(test.u_m), np.zeros_like(test.u_m)
    return (
        _motion_slope(model, values, test, (one, none, none), EXTENSION_STEP_M),
        _motion_slope(model, values, test, (none, one, none), SPEED_STEP_M_S),
        _motion_slope(model, values, test, (none, none, one), ACCELERATION_STEP_M_S2),
    )


def force_change(
    model: DamperModel,
    values: Mapping[str, float],
    test: Measurement,
    direction: tuple[FloatArray, FloatArray, FloatArray],
    before_N: FloatArray,
) -> FloatArray:
    """Change of a modelled force (N), (n,), with a small change of extension (m), speed (m/s) and acceleration."""
    moved = test.moved(test.u_m + direction[0], test.v_m_s + direction[1], test.a_m_s2 + direction[2])
    return modelled_force(model, values, moved) - before_N
