"""Which parameters these tests can determine, decided from what was tested, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.dampers.algebraic import TanhModel
from rig.dampers.model import DamperModel
from rig.identification.coil import needs_lag
from rig.identification.leftover import pieces_of
from rig.identification.measurement import Measurement
from rig.identification.projection import Weighting
from rig.identification.residuals import cycle_times_s
from rig.identification.rivals import rivals
from rig.identification.uncertainty import Information

FloatArray = NDArray[np.float64]

SAME_CURRENT_A = 0.03
SAME_FREQUENCY = 0.02  # relative difference of the longest and the shortest cycle up to which there is one frequency
NEARLY_SINE = 0.1  # the same at one frequency, where only harmonics tell them apart (a rounded triangle: 0.8)
PROPORTIONAL = 1e-4  # share of the acceleration that displacement does not explain, below which m and K are one
ONE_SPEED = 2e-3  # share of the velocity that its sign does not explain, below which C and Fy are one

DEGENERATE = 0.03  # share of its possible energy that the yield force takes out, below which the tanh is sgn(u)
STRAIGHT = 0.15  # largest tanh up to which it is a straight line: its bend is then below 1 %

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
class Findings:
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


def examine(model: DamperModel, measurements: Sequence[Measurement]) -> Findings:
    """What the set of tests leaves undetermined, whatever their noise."""
    found = Findings()
    if not needs_lag(measurements):
        _lag(model, found)
    _scale(model, found)
    _current(model, measurements, found)
    _inertia(model, measurements, found)
    _speed(model, measurements, found)
    for name in found.held:
        found.reasons[name] += "; taken as 0 here"
    return found


def _lag(model: DamperModel, found: Findings) -> None:
    if "eta" in model.names:
        found.reasons["eta"] = (
            "eta cannot be found: every test held its current constant over the kept cycles; add a current step"
        )


def _scale(model: DamperModel, found: Findings) -> None:
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


def _current(model: DamperModel, measurements: Sequence[Measurement], found: Findings) -> None:
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


def _inertia(model: DamperModel, measurements: Sequence[Measurement], found: Findings) -> None:
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
        for each, found in times if found.size or each.samples_per_cycle > 0
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


def _speed(model: DamperModel, measurements: Sequence[Measurement], found: Findings) -> None:
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


def explain(
    model: DamperModel,
    found: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> dict[str, str]:
    """Reasons for parameters that the fitted model's own slopes cannot tell apart, or that another shape leaves open.

    Args:
        model: the fitted model.
        found: what is known of its parameters at `values`.
        values: the fit (SI).
        measurements: the tests of the fit.
        weighting: the weights of the fit.
    """
    reasons = {}
    for name, partners in found.partners.items():
        if not partners:
            reasons[name] = f"{name} cannot be found: it has no effect on the force in these tests"
        else:
            reasons[name] = f"{name} cannot be told from {', '.join(partners)} in these tests"
    if isinstance(model, TanhModel):
        reasons |= _tanh(model, found, values, measurements, weighting)
    return reasons


def _tanh(
    model: TanhModel,
    found: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> dict[str, str]:
    """Reasons where the tanh is as good as something simpler: sgn(u), a sign function, or a straight line."""
    share, largest = _yield_use(model, values, measurements)
    viscous = [name for name in VISCOUS if name in model.names]
    if abs(share) < DEGENERATE:
        text = (
            f"cannot be told: the hysteresis is degenerate, {model.shape_names[1]} outweighs every speed, so that the "
            "tanh follows sgn(u) and the yield force dissipates nothing; only its height is known"
        )
        return {name: f"{name} {text}" for name in (*model.shape_names, *model.yield_names)}
    if largest < STRAIGHT:
        text = (
            f"cannot be told: the tanh is a straight line here (at most {largest:.2g}), so that yield and viscous "
            "force are one; add faster tests"
        )
        return {name: f"{name} {text}" for name in (*model.shape_names, *model.yield_names, *viscous)}
    steep, bent = rivals(model, found, values, measurements, weighting)
    if not steep:
        return {}
    if bent:
        text = (
            "cannot be told: at these speeds a steep tanh and a bent one, with other yield and viscous forces, fit "
            "alike; add other speeds or a sine"
        )
        return {name: f"{name} {text}" for name in (*model.shape_names, *model.yield_names, *viscous)}
    text = (
        "cannot be found: the tanh is saturated at nearly all samples, towards or away from mid-stroke, so it "
        "hardly changes the force; the yield force is only a sign function there"
    )
    return {name: f"{name} {text}" for name in model.shape_names}


def degenerate(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> list[str]:
    """A warning where the tanh follows sgn(u), as with the printed lambda of 1.41 m/s: a yield force without loss."""
    if not isinstance(model, TanhModel):
        return []
    if abs(_yield_use(model, values, measurements)[0]) >= DEGENERATE:
        return []
    offset = model.shape_names[1]
    return [
        f"degenerate hysteresis: {offset} = {values[offset]:.3g} outweighs beta v at every tested speed, so that the "
        "yield force follows the side of mid-stroke, sgn(u), and not the motion, and dissipates nothing; check the "
        "mid-stroke, or fit another model"
    ]


def _yield_use(
    model: TanhModel, values: Mapping[str, float], measurements: Sequence[Measurement]
) -> tuple[float, float]:
    """Energy that the yield force takes out as a share of what it would with the speed's sign; its greatest shape."""
    taken = most = largest = 0.0
    for each in measurements:
        for _, piece in pieces_of(model, each):
            yielding = model.yield_shape(values, piece.u_m, piece.v_m_s)
            power = yielding * piece.v_m_s
            taken += float(np.sum(power))
            most += float(np.sum(np.abs(power)))
            largest = max(largest, float(np.max(np.abs(yielding))))
    return (taken / most if most > 0.0 else 1.0), largest
