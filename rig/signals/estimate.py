"""A measured value with its standard deviation: pooling, comparing, and writing it with as many digits as it has."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

PROBABLE = 2.0
"""Standard deviations."""
OUTLYING = 6.0
"""Standard deviations."""
MOST_OUTLYING = 1.0 / 3.0


@dataclass(frozen=True)
class Estimate:
    """A value and its standard deviation."""

    value: float
    std: float

    @property
    def known(self) -> bool:
        """Whether it says anything."""
        return math.isfinite(self.value) and math.isfinite(self.std) and self.std >= 0.0

    @property
    def signed(self) -> str:
        """`+5.00 +- 0.08`."""
        return f"{self._rounded:+.{self._places}f} +- {self.std:.{self._places}f}"

    @property
    def plain(self) -> str:
        """`2.00 +- 0.08`, a minus where there is one."""
        return f"{self._rounded:.{self._places}f} +- {self.std:.{self._places}f}"

    @property
    def alone(self) -> str:
        """The value without its deviation, with no more digits than that lets be known."""
        return f"{self._rounded:.{self._places}f}"

    @property
    def _rounded(self) -> float:
        """The value as far as its deviation lets it be known, never a minus zero."""
        return round(self.value, self._places) + 0.0

    @property
    def _places(self) -> int:
        """Decimal places that show the deviation to two digits."""
        if not math.isfinite(self.std) or self.std <= 0.0:
            return 2
        return min(6, max(0, 1 - math.floor(math.log10(self.std))))

    def times(self, factor: float) -> Estimate:
        """The same in another unit, or over a span."""
        return Estimate(self.value * factor, abs(factor) * self.std if math.isfinite(self.std) else math.inf)

    def widened(self, floor: float) -> Estimate:
        """The same with at least so much doubt."""
        return Estimate(self.value, math.hypot(self.std, floor))

    def beyond(self, nominal: float, tolerance: float, k: float) -> bool:
        """Whether it certainly differs from the nominal value, and very probably by more than a tolerance.

        Args:
            nominal: what it should be.
            tolerance: what it may differ by.
            k: standard deviations that make a difference certain.
        """
        apart = abs(self.value - nominal)
        return self.known and apart > tolerance + PROBABLE * self.std and apart > k * self.std



def pooled(estimates: Iterable[Estimate]) -> Estimate | None:
    """Weighted mean, its deviation widened when the estimates scatter more than they say; None without any."""
    known = [estimate for estimate in estimates if estimate.known and estimate.std > 0.0]
    if not known:
        return None
    weights = [estimate.std**-2 for estimate in known]
    mean = math.fsum(w * estimate.value for w, estimate in zip(weights, known, strict=True)) / math.fsum(weights)
    chi = math.fsum(w * (estimate.value - mean) ** 2 for w, estimate in zip(weights, known, strict=True))
    widening = max(1.0, chi / (len(known) - 1)) if len(known) > 1 else 1.0
    return Estimate(mean, math.sqrt(widening / math.fsum(weights)))


def outlying(estimates: Mapping[str, Estimate]) -> frozenset[str]:
    """Names of the estimates that are certainly not of what most of the others are of; none among fewer than three.

    A property of an instrument does not change from point to point: an estimate far from the weighted median of all is
    a failed one, unless there are many of them.
    """
    known = {name: estimate for name, estimate in estimates.items() if estimate.known and estimate.std > 0.0}
    if len(known) < 3:
        return frozenset()
    ordered = sorted(known.values(), key=lambda estimate: estimate.value)
    half = 0.5 * math.fsum(1.0 / estimate.std for estimate in ordered)
    reached, median = 0.0, ordered[-1]
    for estimate in ordered:
        reached += 1.0 / estimate.std
        if reached >= half:
            median = estimate
            break
    far = {
        name for name, estimate in known.items()
        if abs(estimate.value - median.value) > OUTLYING * math.hypot(estimate.std, median.std)
    }
    return frozenset(far) if len(far) <= MOST_OUTLYING * len(known) else frozenset()
