"""What a sensor's delay is, given what the bench file declares and what the signals show against the controller's.

Five delays are behind what is seen: those of force and displacement sensor, and on the controller's side one that its
two inputs share and one of each input alone. Only differences show: the force lags its input by `force - shared -
force input`, the displacement by `displacement - shared - position input`; the skew is `force - displacement`. Each of
the five is either as declared, within the tolerance of a filter, or forgotten: then it is longer by anything between
0.2 and 26 ms (a ladder of normal distributions, even over the logarithm), or shorter by part of what was declared, but
never less than nothing at all. That no delay is negative is what tells a late input from a late sensor. At most two of
the five are forgotten, and not two that hide each other. Bayes' rule weighs these hypotheses for what was measured.

The *estimate* is theirs, and it trusts: one declared sensor delay in a thousand is wrong, so a weak loop never moves
it. The *stated* deviation ignores declarations: it is the root mean square distance of the estimate from what the
signals alone leave open (at most `NOTHING_KNOWN_S`). Where they cannot tell it is milliseconds, and says so.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from rig.signals.arrays import FloatArray

DELAY_TOLERANCE = 0.05
"""Relative standard deviation of a declared group delay: tolerance of the filter's corner frequency."""
SMALLEST_TOLERANCE_S = 2e-6
FORGOTTEN = 0.001
"""Share of declared sensor delays that are wrong."""
UNSTATED = 0.04
"""... of sensor delays that the bench file does not state."""
INPUT_FORGOTTEN = 0.02
"""... of the delays of the controller's inputs."""
NOTHING_KNOWN_S = 10e-3
"""Standard deviation of a delay of which nothing is known: about that of the ladder."""
SHORTEST_S, LONGEST_S, STEP = 0.2e-3, 26e-3, 1.5
"""The ladder of forgotten delays: each rung has a quarter of its height for a standard deviation."""
UNSTATED_SHARED, UNSTATED_INPUT = (2e-3, 4e-3), (1e-3, 1e-3)
"""Mean and standard deviation (s) of the inputs' delays where the bench file states none: together, and each alone."""
COMPLIANCE_STD_m_N = 1e-7
"""Of a load train about which nothing is known: 10 kN/mm."""
UNVOUCHED_S = 0.7e-3
"""Standard deviation of a delay that is not declared and cannot be compared with anything."""
PAIRS = ((0, 1), (0, 4), (1, 3), (2, 3), (2, 4), (3, 4))
"""Which two of the delays may be forgotten at once: not two that compensate each other, which cannot be detected."""
CONFIRMS_S = 0.5e-3
"""Standard deviation up to which a lag confirms a declaration; force and displacement apart by 1 ms open a loop."""
DOUBTED = 2.58
"""Standard deviations by which the signals contradict an estimate (1 of 100 true ones)."""
CONFIDENT = 1.959964
"""Standard deviations of a 95 % interval."""


@dataclass(frozen=True)
class Delay:
    """A delay beyond the declared one: mean and standard deviation (s); `checked`: the signals confirm or correct it.

    They do where they show it, by themselves, to `CONFIRMS_S` or better; else it is as declared, not checked.
    """

    value_s: float
    std_s: float
    checked: bool


@dataclass(frozen=True)
class Seen:
    """What the signals show of one sensor: by how much it lags its input beyond what is declared of both (s).

    `lag_s` is None where there is an input, but it says nothing; `input` is False where there is none at all.
    `declared_s` is the sensor's declared delay (s), None where the bench file states none.
    """

    declared_s: float | None
    lag_s: float | None = None
    lag_std_s: float = math.inf
    input: bool = True


@dataclass(frozen=True)
class Skew:
    """Force and displacement sensor's delays beyond the declared ones, and what they leave uncertain of the skew.

    Attributes:
        force: delay beyond the declared one.
        displacement: the same.
        std_s: standard deviation of force minus displacement (s), as stated: if declarations are not trusted.
        trusted_std_s: the same if the declarations are trusted.
        measured_s: force minus displacement by the signals alone (s); None where they show nothing.
        interval_s: its 95 % interval by the likelihood alone, whatever was declared of the sensors (s).
        doubted: the signals contradict the estimate, though not certainly enough to correct it; `trusted_std_s` is then
            `std_s`.
    """

    force: Delay
    displacement: Delay
    std_s: float
    trusted_std_s: float
    measured_s: float | None = None
    interval_s: tuple[float, float] | None = None
    doubted: bool = False

    @property
    def state(self) -> str:
        """`doubted`, `checked`, or `declared`: as the bench file states it, not checked."""
        return "doubted" if self.doubted else "checked" if self.checked else "declared"

    @property
    def value_s(self) -> float:
        """By how much force lagged displacement beyond the declared delays (s)."""
        return self.force.value_s - self.displacement.value_s

    @property
    def checked(self) -> bool:
        """Whether the signals show both delays well enough, against inputs that may be relied on."""
        return self.force.checked and self.displacement.checked


def tolerance_s(declared_s: float | None) -> float:
    """Standard deviation (s) of a declared delay (s); None is a delay of 0 that is not declared."""
    return max(DELAY_TOLERANCE * (0.0 if declared_s is None else declared_s), SMALLEST_TOLERANCE_S)


def weighed_alone_s(declared_s: float | None) -> float:
    """Standard deviation (s) of a sensor's declared delay that nothing can be compared with."""
    return tolerance_s(declared_s) if declared_s is not None else UNVOUCHED_S


def at_likely_compliance(
    lag_s: float, lag_std_s: float, compliance: float | None, compliance_std: float, coupling: float,
) -> tuple[float, float]:
    """A lag and its standard deviation (s), once the load train is known to be as stiff as load trains are.

    Args:
        lag_s: found together with the compliance, s.
        lag_std_s: its standard deviation, s.
        compliance: m/N; None where it was not fitted.
        compliance_std: its standard deviation, m/N.
        coupling: covariance of the two, s m/N.
    """
    if compliance is None:
        return lag_s, lag_std_s
    variance = compliance_std**2 + COMPLIANCE_STD_m_N**2
    left = max(lag_std_s**2 - coupling**2 / variance, 0.0)
    return lag_s - coupling * compliance / variance, math.sqrt(left)


def weighed(force: Seen, displacement: Seen, input_s: float | None) -> Skew:
    """The delays of both sensors by everything that is known.

    Args:
        force: what the load cell shows against the controller's force input.
        displacement: what the displacement sensor shows against the controller's position.
        input_s: declared delay of the controller's inputs (s); None where the bench file states none.
    """
    both = (force, displacement)
    if not any(seen.input for seen in both):
        return _unseen(both)
    space = _hypotheses(force.declared_s, displacement.declared_s, input_s)
    shares = [FORGOTTEN if seen.declared_s is not None else UNSTATED for seen in both]
    logs, means, covariances = space.given(both)
    logs = logs + space.logs(*shares)
    weights = np.exp(logs - np.max(logs))
    weights /= np.sum(weights)
    values = weights @ means
    trusted = np.einsum("h,hij->ij", weights, covariances) + (weights[:, None] * (means - values)).T @ (means - values)
    input_std_s = tolerance_s(input_s) if input_s is not None else UNSTATED_INPUT[1]
    delays = [
        Delay(float(value), _stated(value, seen, input_std_s), input_s is not None and _confirms(seen, input_std_s))
        for value, seen in zip(values.tolist(), both, strict=True)
    ]
    trusted_s = math.sqrt(max(float(trusted[0, 0] + trusted[1, 1] - 2.0 * trusted[0, 1]), 0.0))
    if force.lag_s is None or displacement.lag_s is None:
        std_s = math.hypot(delays[0].std_s, delays[1].std_s)
        return Skew(delays[0], delays[1], std_s, std_s if _unstated(both) else trusted_s)
    measured_s = force.lag_s - displacement.lag_s
    left_s = math.hypot(force.lag_std_s, displacement.lag_std_s, input_std_s, input_std_s)
    std_s = min(math.hypot(measured_s - delays[0].value_s + delays[1].value_s, left_s), NOTHING_KNOWN_S)
    interval_s = (measured_s - CONFIDENT * left_s, measured_s + CONFIDENT * left_s)
    doubted = abs(measured_s - delays[0].value_s + delays[1].value_s) > DOUBTED * left_s
    used_s = std_s if doubted or _unstated(both) else trusted_s
    return Skew(delays[0], delays[1], std_s, used_s, measured_s, interval_s, doubted)


def _confirms(seen: Seen, input_std_s: float) -> bool:
    return seen.lag_s is not None and math.hypot(seen.lag_std_s, input_std_s) <= CONFIRMS_S


def _stated(value_s: float, seen: Seen, input_std_s: float) -> float:
    """Root mean square distance (s) of a sensor's delay from what its signal leaves open."""
    if not seen.input:
        return weighed_alone_s(seen.declared_s)
    if seen.lag_s is None:
        return NOTHING_KNOWN_S
    return min(math.hypot(seen.lag_s - value_s, seen.lag_std_s, input_std_s), NOTHING_KNOWN_S)


def _unstated(both: Sequence[Seen]) -> bool:
    return any(seen.declared_s is None for seen in both)


def _unseen(both: Sequence[Seen]) -> Skew:
    """Without any input: a declared delay is vouched for by who declared it, one that is not declared has no source."""
    delays = [Delay(0.0, _stated(0.0, seen, 0.0), checked=False) for seen in both]
    std_s = math.hypot(delays[0].std_s, delays[1].std_s)
    return Skew(delays[0], delays[1], std_s, std_s)


def _ladder() -> FloatArray:
    count = int(math.log(LONGEST_S / SHORTEST_S) / math.log(STEP)) + 1
    return np.asarray(SHORTEST_S * STEP ** np.arange(count))


@dataclass(frozen=True)
class _Space:
    """The hypotheses (h,): means and variances of the five delays (h, 5), which of them are forgotten, log shares."""

    means: FloatArray
    variances: FloatArray
    forgotten: FloatArray
    shares: FloatArray

    def logs(self, force_share: float, displacement_share: float) -> FloatArray:
        """Logarithm of each hypothesis' probability (h,), for shares of forgotten force and displacement delays."""
        chances = np.array([force_share, displacement_share, *(3 * [INPUT_FORGOTTEN])])
        return np.asarray(self.forgotten @ (np.log(chances) - np.log1p(-chances)) + self.shares)

    def given(self, both: Sequence[Seen]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log likelihoods (h,), and means (h, 2) and covariances (h, 2, 2) of the sensors' delays after measuring."""
        force, displacement, shared, force_input, position_input = self.variances.T
        # What says nothing is a measurement with a standard deviation of a thousand seconds.
        noise = [seen.lag_std_s**2 if seen.lag_s is not None else 1e6 for seen in both]
        a, b = force + shared + force_input + noise[0], displacement + shared + position_input + noise[1]
        determinant = a * b - shared**2
        rest_f = (both[0].lag_s or 0.0) - (self.means[:, 0] - self.means[:, 2] - self.means[:, 3])
        rest_x = (both[1].lag_s or 0.0) - (self.means[:, 1] - self.means[:, 2] - self.means[:, 4])
        to_f, to_x = (b * rest_f - shared * rest_x) / determinant, (a * rest_x - shared * rest_f) / determinant
        logs = -0.5 * (rest_f * to_f + rest_x * to_x + np.log(determinant))
        means = np.column_stack((self.means[:, 0] + force * to_f, self.means[:, 1] + displacement * to_x))
        covariances = np.empty((len(logs), 2, 2))
        covariances[:, 0, 0] = force - force**2 * b / determinant
        covariances[:, 1, 1] = displacement - displacement**2 * a / determinant
        covariances[:, 0, 1] = covariances[:, 1, 0] = force * displacement * shared / determinant
        return logs, means, covariances


@cache
def _hypotheses(force_s: float | None, displacement_s: float | None, input_s: float | None) -> _Space:
    """Every hypothesis of which delays are as declared and which are forgotten, for what is declared of them (s)."""
    bases = [(0.0, tolerance_s(force_s)), (0.0, tolerance_s(displacement_s))]
    if input_s is None:
        bases += [UNSTATED_SHARED, UNSTATED_INPUT, UNSTATED_INPUT]
    else:
        bases += 3 * [(0.0, tolerance_s(input_s))]
    declared = (force_s, displacement_s, input_s, input_s, input_s)
    rungs = [_rungs(delay_s) for delay_s in declared]
    means, variances, forgotten, shares = [], [], [], []
    for which in ((), *((at,) for at in range(5)), *PAIRS):
        for chosen in itertools.product(*(rungs[at] for at in which)):
            parts = list(bases)
            for at, rung in zip(which, chosen, strict=True):
                parts[at] = rung
            means.append([mean for mean, _ in parts])
            variances.append([std**2 for _, std in parts])
            forgotten.append([float(at in which) for at in range(5)])
            shares.append(-sum(math.log(len(rungs[at])) for at in which))
    return _Space(np.array(means), np.array(variances), np.array(forgotten), np.array(shares))


def _rungs(declared_s: float | None) -> list[tuple[float, float]]:
    """Mean and standard deviation (s) of each kind of forgotten delay, beyond the declared one."""
    rungs = [(float(height), 0.25 * float(height)) for height in _ladder()]
    if declared_s is not None and declared_s >= SHORTEST_S:
        rungs.append((-0.5 * declared_s, 0.2 * declared_s))
    return rungs


def pooled(measurements: Iterable[tuple[float, float]]) -> tuple[float, float] | None:
    """Weighted mean and standard deviation (s) of measurements (value, standard deviation) of one delay.

    The deviation is widened when the measurements scatter more than they say. None without any.
    """
    known = [(value, std) for value, std in measurements if 0.0 < std < math.inf]
    if not known:
        return None
    weights = [1.0 / std**2 for _, std in known]
    mean = sum(weight * value for weight, (value, _) in zip(weights, known, strict=True)) / sum(weights)
    chi = sum(weight * (value - mean) ** 2 for weight, (value, _) in zip(weights, known, strict=True))
    widening = max(1.0, chi / (len(known) - 1)) if len(known) > 1 else 1.0
    return mean, math.sqrt(widening / sum(weights))
