"""The inverse: the current that makes the damper give a wanted force, with its error band and where it ends.

A damper gives a force from an interval that motion and current limits set. `attainable` says whether the wanted force
is in it; if not, the current is the one whose force is nearest. The band of the current is the band of the force over
|dF/dI|: what 95 % of the tests' samples were off, by noise and by misfit. Where the force only follows the current
(`Kernel.held`), the wanted force's rate is asked for too, and its errors widen the band (`trajectory.amplified`). Where
it is wider than `RESOLVED` of the current's range, as around v = 0, a force says next to nothing of the current:
`resolvable` is false.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem, IdentificationFailed
from rig.fits.entries import TestedRange
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.application.prediction import with_band

if TYPE_CHECKING:
    import pandas as pd

GRID = 33  # currents between which a force is looked for
RESOLVED = 0.1  # half width of the current's band, as a share of its range, up to which the force tells the current
SPEEDS = 24  # of the control range, each way
FORCES = 41  # of the table, at each speed
LAW_STEPS = 6  # along the chord of the law between two currents of the grid
SAME = 0.01  # A: a smaller range of currents is one current


def currents_A(tested: TestedRange | None) -> FloatArray:
    """Currents of the grid (A), shape (GRID,): those that were tested.

    Raises:
        IdentificationFailed: the tests ran at one current, or the fit does not say at which.
    """
    if tested is None:
        raise IdentificationFailed(
            "no inverse: the fit does not contain the tested currents. Fix: identify the run again"
        )
    low, high = tested.current_A
    if high - low < SAME:
        raise IdentificationFailed(
            f"no inverse: every test ran at {low:.2f} A, so the dependence of the force on the current is unknown. "
            "Fix: add tests at another current"
        )
    return np.linspace(low, high, GRID)


def inverse(
    law: Law, tested: TestedRange | None, motion: Motion, target_N: FloatArray, state: FloatArray | None
) -> pd.DataFrame:
    """The current for a wanted force at every row.

    Args:
        law: the fitted model.
        tested: what its tests covered.
        motion: where; its current is not used. With a time the states follow from rest, with the currents that are
            found.
        target_N: wanted force (N), shape (n,).
        state: internal states, shape (S,) or (n, S), where there is no time.

    Returns:
        `current_A`, `low_A`, `high_A`, `force_N` (the model's at that current), `low_N`, `high_N`, `attainable`,
        `least_N` and `most_N` (what tested currents give), `gain_N_A` (dF/dI), `resolvable`, `extrapolates`, `beyond`,
        and the states.

    Raises:
        IdentificationFailed: the tests ran at one current.
        FileProblem: the model has states, and neither a time nor states were given, or states of a wrong shape.
    """
    grid = currents_A(tested)
    start = _start(law, motion, state)
    from rig.dampers.trajectory import rates_N_s  # loads numba

    dt_s = 0.0 if motion.time_s is None else motion.dt_s
    answer = solve(law, grid, start, motion, target_N, rates_N_s(target_N, dt_s))
    used = replace(motion, current_A=answer[:, 0])
    if law.at_degC is not None:
        used = replace(used, temperature_degC=np.full(answer.shape[0], law.at_degC))
    columns = {"current_A": answer[:, 0], "force_N": answer[:, 1]}
    frame = with_band(columns, used, tested)
    half_A = np.minimum(current_band_A(tested, answer, dt_s), grid[-1] - grid[0])
    unknown = np.where(frame["extrapolates"], math.nan, 0.0)
    frame.insert(1, "low_A", np.clip(answer[:, 0] - half_A, grid[0], grid[-1]) + unknown)
    frame.insert(2, "high_A", np.clip(answer[:, 0] + half_A, grid[0], grid[-1]) + unknown)
    frame["attainable"] = answer[:, 3] > 0.0
    frame["least_N"], frame["most_N"], frame["gain_N_A"] = answer[:, 4], answer[:, 5], answer[:, 2]
    frame["resolvable"] = half_A <= RESOLVED * (grid[-1] - grid[0])
    for place in range(law.model.states):
        frame[f"state_{place + 1}"] = answer[:, 8 + place]
    return frame


def solve(
    law: Law, grid: FloatArray, start: FloatArray, motion: Motion, target_N: FloatArray, rate_N_s: FloatArray
) -> FloatArray:
    """The compiled inverse: see `rig.dampers.trajectory.inverse_of`; `start` (1 or n, S) are states."""
    from rig.dampers.trajectory import inverse_of  # loads numba

    vectors, seen_A = law.vectors(grid)
    dt_s = motion.dt_s if start.shape[0] == 1 and motion.time_s is not None else 0.0
    data = (motion.u_m, motion.v_m_s, motion.a_m_s2, target_N, rate_N_s)
    answer: FloatArray = inverse_of(law.model)(vectors, grid, seen_A, start, *data, dt_s)
    if law.felt is not None:
        answer[:, 0] = _felt_as(law, grid, seen_A, answer[:, 0])
    return answer


def _felt_as(law: Law, grid: FloatArray, seen_A: FloatArray, between_A: FloatArray) -> FloatArray:
    """Currents (A) that are felt as the equation needs them, from those on straight lines between the grid's, (n,)."""
    place = np.clip(np.searchsorted(grid, between_A, side="right") - 1, 0, grid.size - 2)
    low, high = grid[place], grid[place + 1]
    rise = seen_A[place + 1] - seen_A[place]
    slope = np.divide(high - low, rise, out=np.zeros_like(rise), where=rise != 0.0)
    felt, current_A = np.interp(between_A, grid, seen_A), between_A
    for _ in range(LAW_STEPS):
        current_A = np.clip(current_A + slope * (felt - law.vectors(current_A)[1]), low, high)
    return current_A


def current_band_A(
    tested: TestedRange | None, answer: FloatArray, dt_s: float, *, causal: bool = False
) -> FloatArray:
    """Half width (A) of the current's 95 % band, shape (n,); `dt_s`, `causal`: how the force's rate was taken."""
    from rig.dampers.trajectory import amplified  # loads numba

    if tested is None:
        return np.full(answer.shape[0], math.inf)
    gain = np.abs(answer[:, 2])
    times = amplified(answer[:, 6], answer[:, 7], dt_s, causal=causal)
    return tested.band.at(answer[:, 0]) * times / np.maximum(gain, 1e-300)


def _start(law: Law, motion: Motion, state: FloatArray | None) -> FloatArray:
    """States (1 or n, S).

    Raises:
        FileProblem: see `inverse`.
    """
    count = law.model.states
    if state is not None:
        rows = np.atleast_2d(np.asarray(state, dtype=float))
        if count == 0 or rows.shape[1] != count or rows.shape[0] not in {1, motion.u_m.size}:
            raise FileProblem("state", [
                f"got shape {np.shape(state)}, expected ({count},) or (n, {count}): {law.model.name} has {count} "
                "internal states"
            ])  # fmt: skip
        if not np.all(np.isfinite(rows)):
            row, place = np.argwhere(~np.isfinite(rows))[0]
            raise FileProblem("state", [(
                f"row {row}, state_{place + 1}: got {rows[row, place]:g}, expected a finite number"
            )])
        return np.ascontiguousarray(np.broadcast_to(rows, (motion.u_m.size, count)))
    if count and motion.time_s is None:
        raise FileProblem("state", [
            f"{law.model.name} has internal states. Fix: specify `state`, as returned by `fit.simulate`, or specify "
            "`time_s` to integrate the states from rest"
        ])  # fmt: skip
    return law.model.initial_state(float(motion.u_m[0]))[None, :]


def control_range(law: Law, tested: TestedRange | None) -> pd.DataFrame:
    """What the current can do at each tested speed, sliding at mid-stroke.

    Returns:
        One row a speed (index `velocity_m_s`): `least_N`, `most_N` over the tested currents, `gain_N_A` (least |dF/dI|
        of them), `monotone` (whether every force has one current), `resolvable` (see `inverse`), `passive` (whether F v
        >= 0 at every current, the force at rest left out). `attrs["invertible_from_m_s"]`: the least speed from which
        on all rows are resolvable and monotone; None where there is none. `attrs["extrapolation"]`: that the
        temperature of the fit (`Fit.at`) lies beyond the tests, or that the force between their currents is not known;
        empty otherwise.

    Raises:
        IdentificationFailed: the tests ran at one current.
    """
    import pandas as pd

    grid, speeds, forces = _sliding_forces(law, tested)
    rest = np.array([float(_sliding(law, np.zeros(1), float(current))[0]) for current in grid])
    slopes = np.diff(forces, axis=1) / np.diff(grid)
    gain = np.min(np.abs(slopes), axis=1)
    band_N = np.max(tested.band.half_width_N) if tested is not None else math.inf
    power = (forces - rest) * speeds[:, None]
    frame = pd.DataFrame(
        {
            "least_N": np.min(forces, axis=1),
            "most_N": np.max(forces, axis=1),
            "gain_N_A": gain,
            "monotone": np.all(slopes > 0.0, axis=1) | np.all(slopes < 0.0, axis=1),
            "resolvable": band_N <= gain * RESOLVED * (grid[-1] - grid[0]),
            "passive": np.all(power >= -5e-3 * np.max(np.abs(power)), axis=1),
        },
        index=pd.Index(speeds, name="velocity_m_s"),
    )
    good = (frame["resolvable"] & frame["monotone"]).to_numpy()
    reached = np.abs(speeds[~good])
    limit = float(np.max(reached)) if reached.size else 0.0
    above = np.abs(speeds)[np.abs(speeds) > limit]
    frame.attrs["invertible_from_m_s"] = float(np.min(above)) if above.size else None
    frame.attrs["extrapolation"] = _unknown(law, tested)
    return frame


def _unknown(law: Law, tested: TestedRange | None) -> str:
    """What of a table within the tested speeds and currents lies beyond the tests all the same; empty where nothing."""
    if tested is None:
        return ""
    parts = []
    if tested.only_at_A:
        parts.append("current_A between tested currents")
    if law.at_degC is not None and tested.outside({"temperature_degC": np.array([law.at_degC])}):
        parts.append(f"temperature_degC {law.at_degC:.4g}")
    return f"outside the tested range: {', '.join(parts)}; tested: {tested.describe()}" if parts else ""


def inverse_table(law: Law, tested: TestedRange | None) -> pd.DataFrame:
    """The current over speed and force, sliding at mid-stroke, for controllers that look it up.

    Returns:
        Columns `velocity_m_s`, `force_N`, `current_A`, `low_A`, `high_A` (95 % band), `resolvable`; `FORCES` rows a
        speed, from the least to the greatest force that tested currents give there. A speed at which a force has
        several currents is left out.

    Raises:
        IdentificationFailed: the tests ran at one current.
    """
    import pandas as pd

    grid, speeds, forces = _sliding_forces(law, tested)
    parts = []
    for speed, row in zip(speeds.tolist(), forces, strict=True):
        rising = row if row[-1] > row[0] else row[::-1]
        currents = grid if row[-1] > row[0] else grid[::-1]
        if not np.all(np.diff(rising) > 0.0):
            continue
        requested = np.linspace(rising[0], rising[-1], FORCES)
        current = np.interp(requested, rising, currents)
        gain = np.interp(requested, rising, np.gradient(rising, currents))
        band_N = np.full(FORCES, math.inf) if tested is None else tested.band.at(current)
        half = np.minimum(band_N / np.maximum(np.abs(gain), 1e-300), grid[-1] - grid[0])
        parts.append(pd.DataFrame({
            "velocity_m_s": speed, "force_N": requested, "current_A": current,
            "low_A": np.clip(current - half, grid[0], grid[-1]), "high_A": np.clip(current + half, grid[0], grid[-1]),
            "resolvable": half <= RESOLVED * (grid[-1] - grid[0]),
        }))  # fmt: skip
    names = ["velocity_m_s", "force_N", "current_A", "low_A", "high_A", "resolvable"]
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=names)
    table.attrs["extrapolation"] = _unknown(law, tested)
    return table


def _sliding_forces(law: Law, tested: TestedRange | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Currents (A), (G,), tested speeds (m/s) both ways, (k,), and forces (N) there, (k, G).

    Raises:
        IdentificationFailed: the tests ran at one current.
    """
    grid = currents_A(tested)
    low, high = (0.0, 0.0) if tested is None else tested.velocity_m_s
    shares = np.arange(1, SPEEDS + 1) / SPEEDS
    speeds = np.concatenate((min(low, 0.0) * shares[::-1], max(high, 0.0) * shares))
    speeds = speeds[speeds != 0.0]
    return grid, speeds, np.array([_sliding(law, speeds, float(current)) for current in grid]).T


def _sliding(law: Law, speeds: FloatArray, current_A: float) -> FloatArray:
    """Force (N), shape (k,), at mid-stroke and constant speeds (m/s) and one current (A)."""
    vectors, seen_A = law.vectors(np.array([current_A]))
    return law.model.force_at(law.model.values(vectors[0]), speeds, float(seen_A[0]))
