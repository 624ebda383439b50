"""Coil current where only its command was recorded: eta of equation (9) is then found with the force model.

For a given eta the coil current follows exactly from the command, held from sample to sample, and every model is fitted
as with a measured current. So eta is one more outer dimension: a logarithmic scan, because the objective has plateaus
where the coil is much slower or much faster than the tests, then golden section about the best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.identification.models.measurement import Measurement

SMALLEST_STEP_A = 0.05  # change of the command below which a test says nothing of the lag
SLOWEST_1_S = 0.3
SCANNED = 16
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
NARROW = 1e-5  # relative width of eta at which the search ends


def needs_lag(measurements: Sequence[Measurement]) -> bool:
    """Whether any test stepped a current that was commanded and not measured."""
    return any(test.commanded_A is not None for test in measurements)


def with_lag(test: Measurement, eta_1_s: float) -> Measurement:
    """The measurement with the coil current that follows its command at rate eta; itself where it was measured."""
    return test if test.commanded_A is None else replace(test, current_A=coil_current(test, eta_1_s))


def coil_current(test: Measurement, eta_1_s: float) -> FloatArray:
    """Coil current (A), shape (n,), by equation (9) from the command, with its history before the kept cycles."""
    from rig.identification.models.kernels import lagged_current  # loads numba

    commanded = test.current_A if test.commanded_A is None else test.commanded_A
    before = test.commanded_before_A
    if before is None or before.size == 0:
        start: FloatArray = lagged_current(commanded, float(test.current_A[0]), eta_1_s, test.dt_s)
        return start
    whole: FloatArray = lagged_current(np.concatenate((before, commanded)), float(before[0]), eta_1_s, test.dt_s)
    return whole[before.size :]


def find_lag(measurements: Sequence[Measurement], objective: Callable[[list[Measurement]], float]) -> float:
    """The eta (1/s) with the least objective.

    Args:
        measurements: the tests.
        objective: least sum of squares of the model on measurements whose coil current is given.
    """

    def cost(logarithm: float) -> float:
        return objective([with_lag(test, math.exp(logarithm)) for test in measurements])

    fastest = 1.0 / min(test.dt_s for test in measurements)
    scanned = np.linspace(math.log(SLOWEST_1_S), math.log(fastest), SCANNED)
    costs = [cost(float(logarithm)) for logarithm in scanned]
    best = int(np.argmin(costs))
    low, high = float(scanned[max(best - 1, 0)]), float(scanned[min(best + 1, SCANNED - 1)])
    inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    value = [cost(place) for place in inner]
    while high - low > NARROW:
        if value[0] < value[1]:
            high, inner, value = inner[1], [inner[1] - GOLDEN * (inner[1] - low), inner[0]], [math.nan, value[0]]
            value[0] = cost(inner[0])
        else:
            low, inner, value = inner[0], [inner[1], inner[0] + GOLDEN * (high - inner[0])], [value[1], math.nan]
            value[1] = cost(inner[1])
    return math.exp(0.5 * (low + high))
