"""Plants that no damper model of the library describes: their campaigns, and motions that no fit has seen.

Each is a damper of the library's kind (viscous force, elastic-plastic yield force that grows with the current) with one
effect that the library does not have:

    slips      friction by Maxwell slips: eight elastic-plastic elements whose travels span 0.05 to 8 mm
    gas        a gas spring: polytropic pressure behind the piston, 1.6 times as stiff compressed as extended
    eddy       a drag by eddy currents in the piston, I^2 c v / (1 + (v / v0)^2)
    remanence  iron that keeps 0.12 A of its magnetisation: a play of the current. Earlier tests magnetised it, so
               tests at 0 A have the force of 0.12 A, and all others that of 0.12 A less than theirs
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.identification import Measurement

RATE_Hz, FINER, CYCLES = 250.0, 8, 3
TRAVEL_m = 0.4e-3  # over which the yield force reverses
MOTIONS = ((0.004, 0.5), (0.004, 2.5), (0.012, 0.5), (0.012, 2.0), (0.025, 1.0))  # amplitude (m), frequency (Hz)
CURRENTS_A = (0.0, 0.5, 1.0, 2.0)
UNSEEN_MOTIONS = ((0.008, 1.0), (0.018, 1.5), (0.006, 3.0))
UNSEEN_CURRENTS_A = (0.0, 0.75, 1.5)
Force = Callable[[FloatArray, FloatArray, float], FloatArray]
"""Of extension (m), velocity (m/s) and current (A): the force (N)."""


def stop(u_m: FloatArray, travel_m: float) -> FloatArray:
    """Elastic-plastic element of travel `travel_m` along a motion, from -1 to 1 (Prandtl 1928)."""
    state, out = 0.0, np.empty_like(u_m)
    for k, step in enumerate(np.diff(u_m, prepend=u_m[0])):
        state = min(1.0, max(-1.0, state + step / travel_m))
        out[k] = state
    return out


def ordinary(u: FloatArray, v: FloatArray, current: float) -> FloatArray:
    """What all of them have: viscous and yield force (N), both affine in the current."""
    return (500.0 + 60.0 * current) * v + (40.0 + 230.0 * current) * stop(u, TRAVEL_m) - 150.0 + 300.0 * u


def slips(u: FloatArray, v: FloatArray, current: float) -> FloatArray:
    """Friction by Maxwell slips."""
    travels = np.geomspace(0.05e-3, 8e-3, 8)
    friction = sum(stop(u, travel) for travel in travels) / travels.size
    return (500.0 + 60.0 * current) * v + (60.0 + 230.0 * current) * friction - 150.0


def gas(u: FloatArray, v: FloatArray, current: float) -> FloatArray:
    """A gas spring of 60 mm of gas column."""
    return ordinary(u, v, current) + 400.0 * ((1.0 + u / 0.06) ** -1.3 - 1.0) * -1.0


def eddy(u: FloatArray, v: FloatArray, current: float) -> FloatArray:
    """A drag that falls again beyond 0.06 m/s."""
    return ordinary(u, v, current) + 1500.0 * current**2 * v / (1.0 + (v / 0.06) ** 2)


PLANTS: dict[str, Force] = {"slips": slips, "gas": gas, "eddy": eddy, "remanence": ordinary}


def felt_A(currents_A: Sequence[float], width_A: float) -> list[float]:
    """What iron with a play of half width `width_A` feels of a sequence of currents (A)."""
    felt, out = width_A, []  # magnetised by earlier tests
    for current_A in currents_A:
        felt = min(current_A + width_A, max(current_A - width_A, felt))
        out.append(felt)
    return out


def campaign(
    name: str, motions: Sequence[tuple[float, float]], currents_A: Sequence[float], seed: int = 0
) -> list[Measurement]:
    """Tests of a plant, each motion at all currents, with noise of 0.3 % of each test's peak."""
    random, tests = np.random.default_rng((seed, 7)), []
    sequence = [(motion, current) for motion in motions for current in currents_A]
    felt = felt_A([current for _, current in sequence], 0.12 if name == "remanence" else 0.0)
    for ((amplitude_m, frequency_Hz), current_A), inside_A in zip(sequence, felt, strict=True):
        cycle, rate = round(RATE_Hz / frequency_Hz), 2.0 * np.pi * frequency_Hz
        t = np.arange(-2 * cycle * FINER, CYCLES * cycle * FINER) / (FINER * RATE_Hz)
        u, v = amplitude_m * np.sin(rate * t), amplitude_m * rate * np.cos(rate * t)
        force_N = PLANTS[name](u, v, inside_A)
        u, v, force_N = (each[2 * cycle * FINER :: FINER] for each in (u, v, force_N))
        noise_N = 3e-3 * float(np.max(np.abs(force_N)))
        tests.append(
            Measurement(
                id=f"p{len(tests) + 1:03d}", u_m=u, v_m_s=v, a_m_s2=-(rate**2) * u,
                force_N=force_N + random.normal(0.0, noise_N, u.size), current_A=np.full(u.size, current_A),
                dt_s=1.0 / RATE_Hz, amplitude_m=amplitude_m, frequency_Hz=frequency_Hz, nominal_current_A=current_A,
                noise_N=noise_N, samples_per_cycle=cycle,
            )
        )  # fmt: skip
    return tests
