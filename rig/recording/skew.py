"""What a sensor's delay is, given what its bench file declares and what its own signal shows against the controller's.

A declared delay is nearly always right, within the tolerance of its filter, and now and then forgotten or wrong
altogether. So the delay beyond the declared one has several explanations, weighed against each other by Bayes' rule for
what was measured: `N(0, tolerance^2)` with probability 0.96, `N(0, (0.5 ms)^2)` and `N(0, (5 ms)^2)` with 0.02 each. A
measurement that agrees with the declaration leaves the declared value and its tolerance; one far off takes its place;
between them the answer is a mixture, and its standard deviation says so; a weak one leaves the doubt it leaves.

What nobody could measure keeps the tolerance of a delay that was stated: who wrote it down vouches for it. A delay that
the bench file does not state at all is vouched for by nobody, and as uncertain as the mixture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

DELAY_TOLERANCE = 0.05
"""Relative standard deviation of a declared group delay: tolerance of the filter's corner frequency."""
SMALLEST_TOLERANCE_S = 2e-6
FORGOTTEN = ((0.02, 0.5e-3), (0.02, 5e-3))
"""Probability and scale (s) of delays that nobody declared: another filter setting, a digital filter, a gateway."""


@dataclass(frozen=True)
class Delay:
    """A delay beyond the declared one: mean and standard deviation (s); `checked`: it was measured, however well."""

    value_s: float
    std_s: float
    checked: bool


def tolerance_s(declared_s: float | None) -> float:
    """Standard deviation (s) of a declared delay (s); None is a delay of 0 that nobody declared."""
    return max(DELAY_TOLERANCE * (0.0 if declared_s is None else declared_s), SMALLEST_TOLERANCE_S)


def undeclared(tolerance: float, measured_s: float | None, measured_std_s: float, *, stated: bool = True) -> Delay:
    """The delay beyond the declared one.

    Args:
        tolerance: standard deviation of the declaration (s), more than 0.
        measured_s: delay beyond the declared one by the signals (s); None when it could not be measured.
        measured_std_s: its standard deviation (s).
        stated: whether the bench file states a delay, be it 0.
    """
    chances = ((1.0 - sum(share for share, _ in FORGOTTEN), tolerance), *FORGOTTEN)
    if measured_s is None:
        doubt_s = math.sqrt(sum(share * width**2 for share, width in chances))
        return Delay(0.0, tolerance if stated else doubt_s, checked=False)
    logs, means, variances = [], [], []
    for share, width in chances:
        total = width**2 + measured_std_s**2
        logs.append(math.log(share) - 0.5 * math.log(total) - 0.5 * measured_s**2 / total)
        means.append(measured_s * width**2 / total)
        variances.append(width**2 * measured_std_s**2 / total)
    weights = [math.exp(each - max(logs)) for each in logs]
    weights = [each / sum(weights) for each in weights]
    mean = sum(weight * each for weight, each in zip(weights, means, strict=True))
    square = sum(weight * (v + m**2) for weight, v, m in zip(weights, variances, means, strict=True))
    return Delay(mean, math.sqrt(max(square - mean**2, 0.0)), checked=True)


def pooled(measurements: Iterable[tuple[float, float]]) -> tuple[float, float] | None:
    """Weighted mean and standard deviation (s) of measurements (value, standard deviation) of one delay.

    The deviation is widened when the measurements scatter more than they say. None without any.
    """
    known = [(value, std) for value, std in measurements if std > 0.0]
    if not known:
        return None
    weights = [1.0 / std**2 for _, std in known]
    mean = sum(weight * value for weight, (value, _) in zip(weights, known, strict=True)) / sum(weights)
    chi = sum(weight * (value - mean) ** 2 for weight, (value, _) in zip(weights, known, strict=True))
    widening = max(1.0, chi / (len(known) - 1)) if len(known) > 1 else 1.0
    return mean, math.sqrt(widening / sum(weights))
