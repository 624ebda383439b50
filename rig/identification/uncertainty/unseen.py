"""Errors of tests foretold from the others, as values of the fit: each amplitude and frequency in its turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.identification.uncertainty.fit_file import plain, record


@dataclass(frozen=True)
class UnseenTest:
    """One test, by a fit that has not seen its pair.

    Attributes:
        id: the test's id.
        amplitude_m: of its pair (m).
        frequency_Hz: of its pair (Hz).
        current_A: commanded current (A).
        rmse_N: root mean square error (N).
        nrmse_percent_of_peak: 100 rmse / max|F - mean F|.
    """

    id: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    rmse_N: float
    nrmse_percent_of_peak: float


@dataclass(frozen=True)
class UnseenPair:
    """One amplitude and frequency at all currents, foretold from the other pairs.

    Attributes:
        amplitude_m: amplitude (m).
        frequency_Hz: frequency (Hz).
        tests: number of its tests.
        nrmse_percent_of_peak: mean of their relative errors.
        r_squared: share of their force's variance that is explained.
    """

    amplitude_m: float
    frequency_Hz: float
    tests: int
    nrmse_percent_of_peak: float
    r_squared: float


@dataclass(frozen=True)
class Unseen:
    """All tests, each by a fit of the same model that has not seen its pair.

    Attributes:
        split: "leave-one-pair-out".
        nrmse_percent_of_peak: mean over all tests of their relative errors.
        per_pair: one entry a pair, by amplitude and frequency.
        per_test: one entry a test.
    """

    split: str
    nrmse_percent_of_peak: float
    per_pair: tuple[UnseenPair, ...]
    per_test: tuple[UnseenTest, ...]

    @classmethod
    def from_json(cls, entry: Mapping[str, Any] | None) -> Unseen | None:
        """The inverse of `to_json`; None where there is none."""
        if entry is None:
            return None
        pairs = tuple(record(UnseenPair, one) for one in entry["per_pair"])
        return record(cls, entry, per_pair=pairs, per_test=tuple(record(UnseenTest, one) for one in entry["per_test"]))

    def to_json(self) -> dict[str, Any]:
        """Plain types, no NaN or infinity (null instead)."""
        pairs, tests = ([plain(one) for one in some] for some in (self.per_pair, self.per_test))
        return {**plain(self), "per_pair": pairs, "per_test": tests}
