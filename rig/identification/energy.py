"""Energy: what each test dissipated and what the model says, and whether the fitted model could drive the rod.

A damper's force apart from gas force and springs takes energy out: F v >= 0 at every speed and current. A model may be
fitted well and still not do so where no test asked it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.consistency import some
from rig.identification.fit import ErrorSummary, Passivity
from rig.identification.measurement import Measurement
from rig.identification.residuals import samples_a_cycle

FloatArray = NDArray[np.float64]

SPEEDS, CURRENTS = 24, 5
NEGLIGIBLE = 0.005  # share of the greatest power below which power put in does not matter
DIFFERENT = 0.05  # share of the measured energy by which the model's may differ
UNKNOWN_ENERGY = "energy per cycle is unknown where a stretch of every cycle has no force samples"
LONGEST_UNSEEN = 0.05  # share of a cycle over which the power may be bridged: 0.2 % of a sine's energy at the worst


def cycle_energies_J(each: Measurement, force_N: FloatArray) -> FloatArray:
    """Energy (J) that a force (N), shape (n,), takes out in each cycle, shape (k,): the area of the loop.

    `E = integral of F v dt` over one measured period. Lost samples are bridged; NaN for a cycle in which the force is
    unknown for more than `LONGEST_UNSEEN` of the period at a stretch, as where the load cell was saturated: what was
    dissipated there is not known.
    """
    period = samples_a_cycle(each.u_m)
    count = each.u_m.size
    cycles = max(1, round(count / period))
    edges = np.linspace(0.0, count, cycles + 1)
    mean_N = float(np.mean(force_N if each.usable is None else force_N[each.usable]))
    work = (force_N - mean_N) * each.v_m_s
    if each.usable is None:
        return np.diff(_summed(work, edges)) * each.dt_s * period / (count / cycles)
    known = np.flatnonzero(each.usable)
    work = np.interp(np.arange(count), known, work[known])
    energies_J = np.diff(_summed(work, edges)) * each.dt_s * period / (count / cycles)
    seen = np.concatenate(([-1], known, [count]))
    for gap in np.flatnonzero(np.diff(seen) - 1 > LONGEST_UNSEEN * period):
        energies_J[(edges[:-1] < seen[gap + 1]) & (edges[1:] > seen[gap] + 1)] = np.nan
    return energies_J


def _summed(values: FloatArray, at: FloatArray) -> FloatArray:
    """Sum of `values` (n,), which are overwritten, up to places between 0 and n, parts of a value included."""
    total = np.cumsum(values, out=values)
    whole = np.minimum(at.astype(np.int64), values.size - 1)
    before = np.where(whole > 0, total[whole - 1], 0.0)
    return np.asarray(before + (at - whole) * (total[whole] - before))


def cycle_energy_J(each: Measurement, force_N: FloatArray) -> float:
    """Energy (J) that a force (N), shape (n,), takes out in one cycle, the mean of those known; NaN where none is."""
    energies_J = cycle_energies_J(each, force_N)
    known = energies_J[np.isfinite(energies_J)]
    return float(np.mean(known)) if known.size else math.nan


def passivity(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> Passivity:
    """Passivity of the fitted model at mid-stroke, over the tested speeds and currents.

    Raises:
        KeyError: a parameter is missing.
    """
    complete = {"eta": 1.0, **values} if "eta" in model.names else dict(values)
    top = max(float(np.max(np.abs(each.v_m_s))) for each in measurements)
    speeds = np.concatenate([sign * top * np.arange(1, SPEEDS + 1) / SPEEDS for sign in (-1.0, 1.0)])
    currents = _levels(measurements)
    grid_v, grid_A = np.meshgrid(speeds, currents)
    power_W = (_sliding(model, complete, grid_v, grid_A) - _sliding(model, complete, 0.0 * grid_v, grid_A)) * grid_v
    passive = power_W >= -NEGLIGIBLE * float(np.max(np.abs(power_W)))
    if np.all(passive):
        return Passivity(1.0, "")
    row, column = np.unravel_index(int(np.argmin(power_W)), power_W.shape)
    worst = f"{-power_W[row, column]:.3g} W at {grid_v[row, column]:.3g} m/s and {grid_A[row, column]:.3g} A"
    return Passivity(float(np.mean(passive)), worst)


def _levels(measurements: Sequence[Measurement]) -> FloatArray:
    low = min(float(np.min(each.current_A)) for each in measurements)
    high = max(float(np.max(each.current_A)) for each in measurements)
    return np.linspace(low, high, CURRENTS if high > low else 1)


def _sliding(model: DamperModel, values: Mapping[str, float], v_m_s: FloatArray, current_A: FloatArray) -> FloatArray:
    """Force (N) on the sliding branch at mid-stroke; algebraic models all at once, as the mean of both sides of it."""
    if model.states:
        return model.force_at(values, v_m_s, current_A)
    zero = np.zeros(v_m_s.size)
    sides = [model.force(values, zero + side, v_m_s.ravel(), zero, current_A.ravel(), 1e-3) for side in (-1e-12, 1e-12)]
    return np.asarray(0.5 * (sides[0] + sides[1])).reshape(v_m_s.shape)


def judgements(error: ErrorSummary, found: Passivity) -> list[str]:
    """Warnings: a model that drives the rod, and tests whose energy it does not give back."""
    warnings = []
    if found.share < 1.0:
        warnings.append(
            f"the fitted model is not passive: at {100.0 * (1.0 - found.share):.0f} % of the tested speeds and "
            f"currents its force, gas force left out, drives the rod instead of damping it ({found.worst}); a "
            "simulation with it can gain energy"
        )
    off = [
        f"{each.id} {each.modelled_energy_J:.3g} J for {each.energy_J:.3g} J"
        for each in error.per_test
        if abs(each.modelled_energy_J - each.energy_J) > DIFFERENT * abs(each.energy_J)
    ]
    unknown = [each.id for each in error.per_test if math.isnan(each.energy_J)]
    if unknown:
        warnings.append(f"{UNKNOWN_ENERGY}: {some(unknown)}")
    if off:
        warnings.append(f"the model's energy per cycle differs by more than {100 * DIFFERENT:g} %: {some(off)}")
    return warnings
