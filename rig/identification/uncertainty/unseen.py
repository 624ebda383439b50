"""Errors of tests foretold from the others, as values of the fit: each amplitude and frequency in its turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.identification.uncertainty.fit_entries import mean_within
from rig.identification.uncertainty.fit_file import number, plain, record


@dataclass(frozen=True)
class UnseenTest:
    """One test, by a fit that has not seen its pair.

    Attributes:
        id: the test's id.
        amplitude_m: of its pair (m).
        frequency_Hz: of its pair (Hz).
        current_A: the level of current to which it belongs (A).
        rmse_N: root mean square error (N).
        nrmse_percent_of_peak: 100 rmse / max|F - mean F|.
        beyond: the quantities in which it lies beyond the other pairs' data (`velocity_m_s`, `current_A` ...); empty:
            it lies within. None: a file that does not tell.
    """

    id: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    rmse_N: float
    nrmse_percent_of_peak: float
    beyond: tuple[str, ...] | None = None


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

    @property
    def within_nrmse_percent_of_peak(self) -> float | None:
        """Mean over the tests that lie within the other pairs' data; None where none is known to."""
        return mean_within([(test.nrmse_percent_of_peak, test.beyond) for test in self.per_test])

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
        tests = [one | {"beyond": None if one["beyond"] is None else list(one["beyond"])} for one in tests]
        within = {"within_nrmse_percent_of_peak": number(self.within_nrmse_percent_of_peak)}
        return {**plain(self), **within, "per_pair": pairs, "per_test": tests}
