"""The regressors of a residual: functions of states that the physics defines, whose weighted sum is a force.

`rig.dampers.grey_box` states the equation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rig.dampers.arrays import FloatArray

SLIP, SPEED, STROKE = "slip", "speed", "stroke"
PARTS = (SLIP, SPEED, STROKE)
ELEMENTS = 6
BENDS = (0.03, 0.1, 0.3)  # of the top speed, over which the speed's regressors saturate
FADES = 0.2  # of half a tested range beyond its end, within which the residual falls to 0
POWERS = 4  # functions of the current: 1, y, y^2, ((1 - y) / 2)^4
OF_CURRENT = ("", " times y", " times y^2", " times ((1 - y) / 2)^4")
REGRESSORS: Mapping[str, tuple[str, ...]] = {
    SLIP: tuple(f"z{k}{power}" for k in range(1, ELEMENTS + 1) for power in ("", "^3")),
    SPEED: ("s", "s^3", *(f"s over {bend:g}" for bend in BENDS)),
    STROKE: ("1", "r", "r^2", "r^3", "r^4"),
}
RANGE = ("u_mid", "u_half", "v_top", "i_mid", "i_half", "ridge")
TRAVELS = tuple(f"travel_{k}" for k in range(1, ELEMENTS + 1))


def weight_names(parts: Sequence[str]) -> tuple[str, ...]:
    """Names of the weights, (regressor, function of the current) in the kernel's order."""
    names = [f"g_{part}_{k}" for part in parts for k in range(1, len(REGRESSORS[part]) + 1)]
    return tuple(f"{name}{suffix}" for name in names for suffix in ("", "y", "yy", "low"))


def fades(position: FloatArray) -> FloatArray:
    """1 where a position, in halves of the tested range from its middle, is inside; 0 from `FADES` beyond, (n,)."""
    return np.clip((1.0 + FADES - np.abs(position)) / FADES, 0.0, 1.0)


def regressors(
    parts: Sequence[str], values: Mapping[str, float], u: FloatArray, v: FloatArray, current: FloatArray, z: FloatArray
) -> FloatArray:
    """The columns whose sum with the weights is the residual force, shape (n, weights).

    Args:
        parts: parts of the residual.
        values: the ranges, by name (SI).
        u: extension about mid-stroke (m), shape (n,).
        v: velocity (m/s), shape (n,).
        current: coil current (A), shape (n,).
        z: states of the elements, shape (n, ELEMENTS); not used without `slip`.
    """
    r, s = (u - values["u_mid"]) / values["u_half"], v / values["v_top"]
    y = (current - values["i_mid"]) / values["i_half"]
    inside = fades(r) * fades(s) * fades(y)
    y = np.clip(y, -1.0, 1.0)
    functions = (np.ones_like(y), y, y * y, (0.5 * (1.0 - y)) ** 4)
    columns: list[FloatArray] = []
    for part in parts:
        if part == SLIP:
            columns += [column for k in range(ELEMENTS) for column in (z[:, k], z[:, k] ** 3)]
        elif part == SPEED:
            columns += [s, s**3, *(s / np.hypot(s, bend) for bend in BENDS)]
        else:
            columns += [np.ones_like(r), r, r * r, r**3, r**4]
    return np.column_stack([inside * column * function for column in columns for function in functions])


def residual_force(
    parts: Sequence[str], values: Mapping[str, float], u: FloatArray, v: FloatArray, current: FloatArray, z: FloatArray
) -> FloatArray:
    """The residual force (N), shape (n,); see `regressors`."""
    return np.asarray(
        regressors(parts, values, u, v, current, z) @ np.array([values[name] for name in weight_names(parts)])
    )
