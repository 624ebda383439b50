"""What a set of tests cannot determine, whatever their noise: decided from the tests, before anything is fitted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.dampers.model import DamperModel
from rig.identification.models.coil import needs_lag
from rig.identification.models.measurement import Measurement
from rig.identification.remarks import Remark, say
from rig.signals.test_set import CurrentLevels, CurrentReading, current_levels

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of a changing current, which stand for its levels
SAME_FREQUENCY = 0.02  # relative difference of the longest and the shortest cycle up to which there is one frequency
ALMOST_SINE = 0.1  # the same at one frequency, where only harmonics tell them apart (a rounded triangle: 0.8)
PROPORTIONAL = 1e-4  # share of the acceleration that displacement does not explain, below which m and K are one
ONE_SPEED = 2e-3  # share of the velocity that its sign does not explain, below which C and Fy are one


@dataclass
class Undetermined:
    """What the tests cannot determine.

    Attributes:
        held: parameters left out of the fit, held at zero.
        fixed: parameters left out of the fit, held at their start, each with those whose values are for this choice.
        reasons: for every parameter that cannot be identified, why, and what test would help.
    """

    held: set[str] = field(default_factory=set)
    fixed: dict[str, tuple[str, ...]] = field(default_factory=dict)
    reasons: dict[str, Remark] = field(default_factory=dict)

    def free(self, names: Iterable[str]) -> list[str]:
        """Those of `names` that a fit determines: neither held nor fixed."""
        return [name for name in names if name not in self.held and name not in self.fixed]


def examine(model: DamperModel, measurements: Sequence[Measurement]) -> Undetermined:
    """What the set of tests leaves undetermined, whatever their noise."""
    undetermined = Undetermined()
    if not needs_lag(measurements) and "eta" in model.names:
        undetermined.reasons["eta"] = say("no-current-step", name="eta")
    _scale(model, undetermined)
    _current(model, measurements, undetermined)
    _inertia(model, measurements, undetermined)
    _speed(model, measurements, undetermined)
    for name in undetermined.held:
        undetermined.reasons[name] = say("held", name=name, reason=undetermined.reasons[name])
    return undetermined


def _scale(model: DamperModel, undetermined: Undetermined) -> None:
    """A parameter that only scales others: they are known for one choice of it only."""
    for by, scaled in model.redundant.items():
        undetermined.fixed[by] = scaled
        for name in (by, *scaled):
            value = model.parameter(by).start
            undetermined.reasons[name] = say("redundant", name=name, by=by, scaled=", ".join(scaled), value=value)


def _current(model: DamperModel, measurements: Sequence[Measurement], undetermined: Undetermined) -> None:
    tested = levels_of(measurements)
    levels = len(tested)
    for parameter in model.parameters:
        needed = parameter.power + 1
        if parameter.power > 1 and levels < needed:
            undetermined.held.add(parameter.name)
            reason = say("few-currents", name=parameter.name, needed=needed, levels=levels)
            undetermined.reasons[parameter.name] = reason
    _lower_powers(model, undetermined, without_current=tested.zero is not None)
    if levels > 1:
        return
    (mean_A,), without = tested.values_A, tested.zero is not None
    for parameter in model.parameters:
        name, base = parameter.name, parameter.at_zero
        if parameter.power != 1 or (name in model.apart_at_one_current and not without):
            continue
        undetermined.held.add(name)
        if without:
            undetermined.reasons[name] = say("no-current", name=name)
            continue
        undetermined.reasons[name] = say("one-current", name=name, base=base, mean_A=mean_A)
        undetermined.reasons[base] = say("sum-at-one-current", name=name, base=base, mean_A=mean_A)


def _lower_powers(model: DamperModel, undetermined: Undetermined, *, without_current: bool) -> None:
    """Beside powers of the current that are left out the lower ones are known for that choice only.

    What a parameter is at zero current is known where a test ran without current.
    """
    for base in {parameter.at_zero for parameter in model.parameters if parameter.name in undetermined.held} - {""}:
        powers = [parameter.name for parameter in model.parameters if parameter.at_zero == base]
        left_out = ", ".join(name for name in powers if name in undetermined.held)
        for name in (*powers, *(() if without_current else (base,))):
            undetermined.reasons.setdefault(name, say("lower-power", name=name, left_out=left_out))


def only_at(model: DamperModel, measurements: Sequence[Measurement]) -> tuple[float, ...]:
    """The tested currents (A), where the force is known at these alone: powers of the current are left out.

    Empty where the tests have currents enough for the model, so that its law holds between them.
    """
    tested = levels_of(measurements)
    if all(parameter.power < 2 or len(tested) > parameter.power for parameter in model.parameters):
        return ()
    return tested.values_A


def levels_of(measurements: Sequence[Measurement]) -> CurrentLevels:
    """The currents at which a model is tested: of tests whose current changes throughout, quantiles of it."""
    readings: list[CurrentReading] = []
    for test in measurements:
        reading = test.current
        if reading is not None:
            readings.append(reading)
        else:
            readings += [CurrentReading(float(value)) for value in np.quantile(test.current_A, QUANTILES)]
    return current_levels(readings)


def _inertia(model: DamperModel, measurements: Sequence[Measurement], undetermined: Undetermined) -> None:
    stiffness = model.of_term("stiffness")
    if not model.of_term("inertia") or not stiffness:
        return
    one = _one_frequency(measurements)
    proportional = _unlike(measurements) <= (ALMOST_SINE if one else PROPORTIONAL)
    if not proportional and not one:
        return
    if not proportional:
        undetermined.reasons["m"] = say("harmonics-only", name="m", stiffness=stiffness[0])
        return
    undetermined.reasons["m"] = say("one-frequency", name="m", stiffness=stiffness[0])
    undetermined.held.add("m")
    undetermined.reasons[stiffness[0]] = say("difference-at-one-frequency", name=stiffness[0], stiffness=stiffness[0])


def _one_frequency(measurements: Sequence[Measurement]) -> bool:
    """Whether all cycles last as long.

    A second harmonic of the motion, or the corners of a triangle, would tell inertia and stiffness apart in a perfect
    recording; their acceleration is known far too badly for that.
    """
    lasting = [test.cycles_last_s for test in measurements if not math.isnan(test.cycles_last_s[0])]
    if not lasting:
        return False
    return max(high for _, high in lasting) <= (1.0 + SAME_FREQUENCY) * min(low for low, _ in lasting)


def _unlike(measurements: Sequence[Measurement]) -> float:
    """Share of the acceleration that displacement does not explain; 1 where either is missing."""
    cross = sum(float(test.a_m_s2 @ test.u_m) for test in measurements)
    power_a = sum(float(test.a_m_s2 @ test.a_m_s2) for test in measurements)
    power_u = sum(float(test.u_m @ test.u_m) for test in measurements)
    return 1.0 - cross * cross / (power_a * power_u) if power_a > 0.0 and power_u > 0.0 else 1.0


def _speed(model: DamperModel, measurements: Sequence[Measurement], undetermined: Undetermined) -> None:
    viscous, yielding = model.of_term("viscous"), model.of_term("yield")
    if not viscous or not yielding or model.speeds_tell_yield:
        return
    speed = sum(float(np.sum(np.abs(test.v_m_s))) for test in measurements)
    power = sum(float(test.v_m_s @ test.v_m_s) for test in measurements)
    count = sum(test.v_m_s.size for test in measurements)
    if power <= 0.0 or 1.0 - speed * speed / (power * count) > ONE_SPEED:
        return
    for name in (*viscous, *yielding):
        undetermined.reasons.setdefault(name, say("one-speed", name=name))
