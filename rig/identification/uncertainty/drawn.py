"""What a fit keeps of tests drawn again (`rig.identification.bootstrap`): intervals, and some of the draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.identification.uncertainty.covariance import CONFIDENCE, quantile

PREDICTED = 200  # draws of which predictions are made, and that a file keeps
TAIL = 0.5 * (1.0 - CONFIDENCE)


@dataclass(frozen=True)
class DrawnInterval:
    """One parameter over the draws, in its unit: 95 % interval and standard error."""

    low: float
    high: float
    standard_error: float


@dataclass(frozen=True)
class Drawn:
    """Tests drawn again, and what each draw gave.

    Attributes:
        count: how many draws.
        tests: how many tests were drawn from.
        widening: factor on the spread of the draws, for so few tests.
        parameters: fitted parameter to its interval.
        draws: fitted parameter to its values (SI) in the first draws, `PREDICTED` at most.
    """

    count: int
    tests: int
    widening: float
    parameters: Mapping[str, DrawnInterval]
    draws: Mapping[str, tuple[float, ...]]

    def to_json(self) -> dict[str, Any]:
        """Key `bootstrap` of `rig identify --json`."""
        intervals = {name: vars(interval) for name, interval in self.parameters.items()}
        draws = {name: list(values) for name, values in self.draws.items()}
        return {"count": self.count, "tests": self.tests, "widening": self.widening, "parameters": intervals,
                "draws": draws}  # fmt: skip

    @classmethod
    def from_json(cls, entry: Mapping[str, Any] | None) -> Drawn | None:
        """The inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: the entry is not what `to_json` gives.
        """
        if entry is None:
            return None
        intervals = {name: DrawnInterval(**one) for name, one in entry["parameters"].items()}
        draws = {name: tuple(map(float, values)) for name, values in entry["draws"].items()}
        return cls(int(entry["count"]), int(entry["tests"]), float(entry["widening"]), intervals, draws)


def intervals_of(values: FloatArray, draws: FloatArray, tests: int, widening: float) -> tuple[FloatArray, ...]:
    """Lower ends, upper ends and standard errors, (p,) each, about `values` (p,) of draws (count, p)."""
    low, middle, high = np.quantile(draws, [TAIL, 0.5, 1.0 - TAIL], axis=0)
    spread = np.std(draws, axis=0, ddof=1) * widening * quantile() / quantile(1, tests - 1.0)
    return values - widening * (middle - low), values + widening * (high - middle), spread


def drawn_of(names: tuple[str, ...], values: FloatArray, draws: FloatArray, tests: int, widening: float) -> Drawn:
    """What a file keeps of draws (count, p) of the parameters `names` with the fitted `values` (p,)."""
    ends = np.column_stack(intervals_of(values, draws, tests, widening)).tolist()
    kept = draws[:PREDICTED].T.tolist()
    return Drawn(
        draws.shape[0], tests, widening,
        {name: DrawnInterval(*row) for name, row in zip(names, ends, strict=True)},
        {name: tuple(row) for name, row in zip(names, kept, strict=True)},
    )  # fmt: skip
