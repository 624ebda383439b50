"""What a set of tests cannot determine, whatever their noise: decided from the tests, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.dampers.model import DamperModel
from rig.identification.models.coil import needs_lag
from rig.identification.models.measurement import Measurement, cycle_times_s

SAME_CURRENT_A = 0.03
SAME_FREQUENCY = 0.02  # relative difference of the longest and the shortest cycle up to which there is one frequency
NEARLY_SINE = 0.1  # the same at one frequency, where only harmonics tell them apart (a rounded triangle: 0.8)
PROPORTIONAL = 1e-4  # share of the acceleration that displacement does not explain, below which m and K are one
ONE_SPEED = 2e-3  # share of the velocity that its sign does not explain, below which C and Fy are one
#: Parameters per ampere, and the value at zero current that each belongs to.
PER_AMPERE: Mapping[str, str] = {
    "Fyb": "Fya",
    "Cb": "Ca",
    "Cb_plus": "Ca_plus",
    "Cb_minus": "Ca_minus",
    "Kb": "Ka",
    "c_b": "c",
    "k_b": "k",
    "alpha_b": "alpha",
    "fc_b": "fc",
    "c0_b": "c0",
    "kv_b": "kv",
    "kw_b": "kw",
    "c0b": "c0a",
    "c1b": "c1a",
    "kt_b": "kt",
}
#: Parameters of higher powers of the current, and how many different currents they need.
CURRENTS_NEEDED: Mapping[str, int] = {"kw_c": 3, "kt_c": 3, "kw_d": 4, "kt_d": 4}
STIFFNESS = ("Ka", "Kb", "k", "k_b")
VISCOUS = ("Ca", "Cb", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus", "c", "c_b", "c0", "c0_b")
YIELD = ("Fya", "Fyb", "alpha", "alpha_b", "fc", "fc_b", "beta", "delta", "lambda")


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
    reasons: dict[str, str] = field(default_factory=dict)

    def free(self, names: Iterable[str]) -> list[str]:
        """Those of `names` that a fit determines: neither held nor fixed."""
        return [name for name in names if name not in self.held and name not in self.fixed]


def examine(model: DamperModel, measurements: Sequence[Measurement]) -> Undetermined:
    """What the set of tests leaves undetermined, whatever their noise."""
    found = Undetermined()
    if not needs_lag(measurements):
        _lag(model, found)
    _scale(model, found)
    _current(model, measurements, found)
    _inertia(model, measurements, found)
    _speed(model, measurements, found)
    for name in found.held:
        found.reasons[name] += "; taken as 0 here"
    return found


def _lag(model: DamperModel, found: Undetermined) -> None:
    if "eta" in model.names:
        found.reasons["eta"] = (
            "eta cannot be found: every test held its current constant over the kept cycles; add a current step"
        )


def _scale(model: DamperModel, found: Undetermined) -> None:
    """A scales z, and alpha, beta, gamma with it; they are known for one choice of A only."""
    if "A" not in model.names:
        return
    scaled = tuple(name for name in model.names if name in {"alpha", "alpha_a", "alpha_b", "beta", "gamma"})
    found.fixed["A"] = scaled
    for name in ("A", *scaled):
        found.reasons[name] = (
            f"{name} cannot be told alone: A only scales alpha, beta and gamma; the values given are for A = "
            f"{model.parameter('A').start:g} "
            "(normalized_bouc_wen has no such freedom)"
        )


def _current(model: DamperModel, measurements: Sequence[Measurement], found: Undetermined) -> None:
    low = min(float(np.min(each.current_A)) for each in measurements)
    high = max(float(np.max(each.current_A)) for each in measurements)
    levels = _levels([float(np.mean(each.current_A)) for each in measurements])
    for name, needed in CURRENTS_NEEDED.items():
        if name in model.names and levels < needed:
            found.held.add(name)
            found.reasons[name] = (
                f"{name} cannot be found: it needs tests at {needed} different currents, and there are {levels}"
            )
    if high - low > SAME_CURRENT_A:
        return
    mean_A = 0.5 * (low + high)
    for name in model.names:
        base = PER_AMPERE.get(name, "alpha_a" if name == "alpha_b" else "")
        base = "alpha_a" if name == "alpha_b" and "alpha_a" in model.names else base
        if base not in model.names:
            continue
        found.held.add(name)
        if abs(mean_A) <= SAME_CURRENT_A:
            found.reasons[name] = (
                f"{name} cannot be found: every test ran without current; add tests at another current"
            )
            continue
        together = f"{base} + {name} I"
        found.reasons[name] = (
            f"{name} cannot be told from {base}: every test ran at {mean_A:.2f} A; add tests at another current"
        )
        found.reasons[base] = (
            f"only {together} is known, at I = {mean_A:.2f} A, where every test ran; the value given is that sum"
        )


def _levels(currents_A: Sequence[float]) -> int:
    """How many of the currents differ."""
    ordered = np.sort(currents_A)
    return 1 + int(np.count_nonzero(np.diff(ordered) > SAME_CURRENT_A))


def _inertia(model: DamperModel, measurements: Sequence[Measurement], found: Undetermined) -> None:
    stiffness = [name for name in STIFFNESS if name in model.names]
    if "m" not in model.names or not stiffness:
        return
    one = _one_frequency(measurements)
    proportional = _unlike(measurements) <= (NEARLY_SINE if one else PROPORTIONAL)
    if not proportional and not one:
        return
    found.reasons["m"] = (
        f"m is not separately identifiable from {stiffness[0]}: every test ran at one frequency, where inertia and "
        "stiffness are proportional; add another frequency"
    )
    if not proportional:
        found.reasons["m"] += f" (harmonics alone tell it here; it stays in the fit, so that {stiffness[0]} is right)"
        return
    found.held.add("m")
    found.reasons[stiffness[0]] = (
        f"only {stiffness[0]} - m (2 pi f)^2 is known: every test ran at one frequency; the value given is that "
        "difference; add another frequency"
    )


def _one_frequency(measurements: Sequence[Measurement]) -> bool:
    """Whether all cycles last as long.

    A second harmonic of the motion, or the corners of a triangle, would tell inertia and stiffness apart in a perfect
    recording; their acceleration is known far too badly for that. A test of which a single cycle is left shows no two
    crossings; its cycle lasts as long as it does.
    """
    times = [(each, cycle_times_s(each)) for each in measurements]
    lasting = [
        np.quantile(found if found.size else [each.samples_per_cycle * each.dt_s], (0.05, 0.95))
        for each, found in times
        if found.size or each.samples_per_cycle > 0
    ]
    if not lasting:
        return False
    return bool(max(each[1] for each in lasting) <= (1.0 + SAME_FREQUENCY) * min(each[0] for each in lasting))


def _unlike(measurements: Sequence[Measurement]) -> float:
    """Share of the acceleration that displacement does not explain; 1 where either is missing."""
    cross = sum(float(each.a_m_s2 @ each.u_m) for each in measurements)
    power_a = sum(float(each.a_m_s2 @ each.a_m_s2) for each in measurements)
    power_u = sum(float(each.u_m @ each.u_m) for each in measurements)
    return 1.0 - cross * cross / (power_a * power_u) if power_a > 0.0 and power_u > 0.0 else 1.0


def _speed(model: DamperModel, measurements: Sequence[Measurement], found: Undetermined) -> None:
    viscous = [name for name in VISCOUS if name in model.names]
    yielding = [name for name in YIELD if name in model.names]
    if not viscous or not yielding:
        return
    speed = sum(float(np.sum(np.abs(each.v_m_s))) for each in measurements)
    power = sum(float(each.v_m_s @ each.v_m_s) for each in measurements)
    count = sum(each.v_m_s.size for each in measurements)
    if power <= 0.0 or 1.0 - speed * speed / (power * count) > ONE_SPEED:
        return
    for name in (*viscous, *yielding):
        found.reasons.setdefault(
            name,
            f"{name} cannot be found: every test ran at one speed, where viscous and yield force are one; add another "
            "speed or a sine",
        )
