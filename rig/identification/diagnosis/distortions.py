"""What may have happened between the damper and the recording, and what the model may lack: one class each.

A distortion has a few amounts, fitted with the damper's own parameters. It moves what the damper sees (`moved`) or
changes what the sensor shows (`shown_N`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import VISCOUS, YIELD, TemperatureLaw
from rig.identification.diagnosis.stretches import Stretch
from rig.identification.models.measurement import Measurement
from rig.identification.models.temperature_effect import force_change_N


class Distortion:
    """Nothing happened: the damper alone.

    Attributes:
        start: the amounts to start from, one for each of them.
        steps: for their slopes by differences.
        limits: lowest and highest amounts, of all of them or each its own (k,).
        only_force: whether the motion that the damper sees stays as it is.
    """

    start: tuple[float, ...] = ()
    steps: tuple[float, ...] = ()
    limits: tuple[float | FloatArray, float | FloatArray] = (-np.inf, np.inf)
    only_force: bool = True

    def moved(self, part: Stretch, amounts: FloatArray) -> Measurement:
        """Motion and current that the damper sees; those of the stretch where all amounts are 0."""
        del amounts
        return part.test

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """What is recorded of the damper's force (N), shape (n,)."""
        del part, amounts
        return force_N

    def gain(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """How `shown_N` changes with the damper's force, shape (n,)."""
        del part, amounts
        return np.ones_like(force_N)


class Skew(Distortion):
    """The force is recorded later than the displacement by amounts[0] seconds."""

    steps, limits, only_force = (2e-6,), (-0.02, 0.02), False

    def __init__(self, start_s: float = 0.0) -> None:
        self.start = (start_s,)

    def moved(self, part: Stretch, amounts: FloatArray) -> Measurement:
        """The motion earlier by the skew, by its Taylor series."""
        test, jerk, s = part.test, part.jerk_m_s3, -float(amounts[0])
        return test.moved(
            test.u_m + s * (test.v_m_s + s * (test.a_m_s2 / 2.0 + s * jerk / 6.0)),
            test.v_m_s + s * (test.a_m_s2 + s * jerk / 2.0),
            test.a_m_s2 + s * jerk,
        )


class Trend(Distortion):
    """Gain and zero of the force follow something by lines: amounts[0] per 1, amounts[1] N, both per unit of it."""

    start, steps = (0.0, 0.0), (1e-4, 1e-3)

    def __init__(self, of: Callable[[Stretch], FloatArray]) -> None:
        self._of = of

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The force times its gain, and its zero."""
        return np.asarray(force_N * self.gain(part, force_N, amounts) + amounts[1] * self._of(part))

    def gain(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """1 and the trend."""
        return np.asarray(np.ones_like(force_N) + amounts[0] * self._of(part))


class TrendPerTest(Distortion):
    """The gain of the force drifts in each test by itself, from 1 at its start to 1 + amounts[k] at its end."""

    limits = (-0.9, 3.0)

    def __init__(self, tests: int) -> None:
        self.start, self.steps = (0.0,) * tests, (1e-4,) * tests

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The force times its gain."""
        return np.asarray(force_N * self.gain(part, force_N, amounts))

    def gain(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """1 and the test's own trend."""
        return np.asarray(np.ones_like(force_N) + amounts[part.index] * (part.time + 0.5))


class TemperatureEffect(Distortion):
    """Warm oil weakens viscous (amounts[0], 1/K) and yield forces (amounts[1]) about a temperature (degC)."""

    start, steps, limits = (0.0, 0.0), (1e-5, 1e-5), (-0.05, 0.05)

    def __init__(self, model: DamperModel, values: Mapping[str, float], reference_degC: float) -> None:
        self._model, self._values, self._reference_degC = model, values, reference_degC

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The force at the recorded temperatures; what they change is that of the fit's values."""
        rates = dict(zip((VISCOUS, YIELD), amounts.tolist(), strict=True))
        law = TemperatureLaw(self._reference_degC, rates)
        return np.asarray(force_N + force_change_N(self._model, self._values, law, part.test))


class Clipped(Distortion):
    """The force channel ends at amounts[0] and amounts[1] (N).

    Args:
        low_N: lower end to start from.
        high_N: upper end to start from.
        reached_N: lowest and highest force that the record certainly holds: no channel ends between these.
    """

    steps = (1e-3, 1e-3)

    def __init__(self, low_N: float, high_N: float, reached_N: tuple[float, float]) -> None:
        self.start = (min(low_N, reached_N[0]), max(high_N, reached_N[1]))
        self.limits = (np.array([-np.inf, reached_N[1]]), np.array([reached_N[0], np.inf]))

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The force between the ends."""
        del part
        return np.asarray(np.clip(force_N, float(amounts[0]), float(amounts[1])))

    def gain(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """1 between the ends, 0 beyond."""
        del part
        return np.asarray((force_N > amounts[0]) & (force_N < amounts[1]), dtype=float)


class ClippingPerTest(Distortion):
    """The force channel ends elsewhere in each test: (low, high) in N by the test's number."""

    def __init__(self, ends_N: Sequence[tuple[float, float]]) -> None:
        self._ends_N = tuple(ends_N)

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The force between the test's ends."""
        del amounts
        return np.asarray(np.clip(force_N, *self._ends_N[part.index]))

    def gain(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """1 between the ends, 0 beyond."""
        del amounts
        low, high = self._ends_N[part.index]
        return np.asarray((force_N > low) & (force_N < high), dtype=float)


class Compliance(Distortion):
    """Mounts in series give way by amounts[0] m/N under the smoothed force (N) and its rate (N/s) of each stretch."""

    start, only_force = (0.0,), False

    def __init__(self, forces: Sequence[tuple[FloatArray, FloatArray]], parts: Sequence[Stretch], most: float) -> None:
        self._forces = {id(part): force for part, force in zip(parts, forces, strict=True)}
        self.steps, self.limits = (1e-4 * most,), (0.0, most)

    def moved(self, part: Stretch, amounts: FloatArray) -> Measurement:
        """The damper's own motion."""
        force, rate = self._forces[id(part)]
        test, c = part.test, float(amounts[0])
        return test.moved(test.u_m - c * force, test.v_m_s - c * rate, test.a_m_s2)


class CurrentLaw(Distortion):
    """The force follows another current, one that bends between the least and the greatest current (A)."""

    only_force = False

    def __init__(self, low_A: float, high_A: float, bends: int) -> None:
        self._low_A, self._span_A = low_A, high_A - low_A
        self.start, self.steps = (0.0,) * bends, (1e-5,) * bends

    def moved(self, part: Stretch, amounts: FloatArray) -> Measurement:
        """The current that would do the same in the fitted model."""
        x = (part.test.current_A - self._low_A) / self._span_A
        bend = sum(amount * (2.0 * x - 1.0) ** power for power, amount in enumerate(amounts))
        return replace(part.test, current_A=part.test.current_A + self._span_A * 4.0 * x * (1.0 - x) * bend)


class Added(Distortion):
    """Forces beside the model's, each by columns (n, k) of the stretch, in N per unit of its amount."""

    def __init__(self, columns: Callable[[Stretch], FloatArray], parts: Sequence[Stretch]) -> None:
        self._columns = {id(part): columns(part) for part in parts}
        count = next(iter(self._columns.values())).shape[1]
        self.start, self.steps = (0.0,) * count, (1e-3,) * count

    def shown_N(self, part: Stretch, force_N: FloatArray, amounts: FloatArray) -> FloatArray:
        """The model's force and those beside it."""
        return np.asarray(force_N + self._columns[id(part)] @ amounts)


def by_current(part: Stretch, shapes: Sequence[FloatArray]) -> FloatArray:
    """Each shape (n,) alone and times the current (A), shape (n, 2 k)."""
    return np.column_stack([*shapes, *(shape * part.test.current_A for shape in shapes)])


def after_reversal(part: Stretch) -> FloatArray:
    """Forces that die away over 0.3, 1 and 4 mm after each reversal."""
    side = np.sign(part.test.v_m_s)
    return by_current(part, [side * np.exp(-part.since_m / length_m) for length_m in (3e-4, 1e-3, 4e-3)])


def over_speed(top_m_s: float) -> Callable[[Stretch], FloatArray]:
    """Shapes over speed that a line and one yield force do not have; `top_m_s` the greatest speed."""

    def columns(part: Stretch) -> FloatArray:
        x = part.test.v_m_s / top_m_s
        return by_current(part, [x * np.abs(x), x**3, np.tanh(20.0 * x), x**2])

    return columns


def over_stroke(most_m: float) -> Callable[[Stretch], FloatArray]:
    """Shapes over the extension that a line does not have; `most_m` the greatest extension about mid-stroke."""

    def columns(part: Stretch) -> FloatArray:
        x, side = part.test.u_m / most_m, np.sign(part.test.v_m_s)
        return by_current(part, [x**2, x**3, side * x, side * x**2])

    return columns
