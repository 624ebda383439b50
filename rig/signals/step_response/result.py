"""What is known of a response: each time is measured, or faster or slower than the limit, or not determined."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from scipy import stats

from rig.signals.arrays import FloatArray

LEVELS = (0.632, 0.90, 0.95)
"""Shares of the step whose times are stated; the first is that of a time constant, 1 - 1/e."""
LEVEL_NAMES = tuple(f"t{100 * level:.0f}" for level in LEVELS)
CONFIDENCE = 0.95
NORMAL = float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE))
"""Standard deviations of a normal variable within which this share of it lies."""


class State(StrEnum):
    """What a result is."""

    MEASURED = "measured"
    FASTER = "faster"
    SLOWER = "slower"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class TimeResult:
    """A time (s) with its standard error and 95 % interval; NaN where it is not known.

    Attributes:
        state: measured; or faster or slower than `limit_s`, or not determined.
        limit_s: the limit of what can be measured; NaN where none is reached.
    """

    value_s: float = math.nan
    std_s: float = math.nan
    low_s: float = math.nan
    high_s: float = math.nan
    state: State = State.UNKNOWN
    limit_s: float = math.nan

    @property
    def measured(self) -> bool:
        """Whether the value counts."""
        return self.state is State.MEASURED


NOT_KNOWN = TimeResult()


@dataclass(frozen=True)
class StepResponse:
    """Response to the steps of a group.

    Attributes:
        steps: number of records.
        size: mean change of the quantity at the step, with its standard error.
        noise: standard deviation of the samples about the fit; `correlation` from one sample to the next.
        order: number of lags of the fit.
        dead, lag: of the fit (s); of two lags the longer one.
        second_lag: the shorter one of two lags (s); not known with one lag, and where the response overshoots.
        overshoots: whether the response goes beyond its end, as no chain of lags does.
        fit: time to each level by the fit, (3,), from the origin of the times.
        crossing: time to each level without a model, (3,).
        read: whether the crossings count; else the window is so short that they depend on the fit more than it on
            itself.
        settling_s: mean delay of the response, the area between it and its end (s), with its standard error; NaN where
            it did not settle in the window.
        fits: whether the fit describes the records within their noise.
        scatters: whether the records scatter by more than their noise explains.
        why: why nothing could be determined; empty where something is.
    """

    steps: int
    size: float = math.nan
    size_std: float = math.nan
    noise: float = math.nan
    correlation: float = 0.0
    order: int = 1
    dead: TimeResult = NOT_KNOWN
    lag: TimeResult = NOT_KNOWN
    second_lag: TimeResult = NOT_KNOWN
    overshoots: bool = False
    fit: tuple[TimeResult, ...] = (NOT_KNOWN,) * len(LEVELS)
    crossing: tuple[TimeResult, ...] = (NOT_KNOWN,) * len(LEVELS)
    read: bool = True
    settling_s: tuple[float, float] = (math.nan, math.nan)
    fits: bool = True
    scatters: bool = False
    why: str = ""
    curve: Callable[[FloatArray], FloatArray] | None = field(default=None, compare=False, repr=False)

    def method(self, place: int) -> str:
        """Whether the time to one of `LEVELS` is that of the `crossing`, which is preferred, or of the `fit`."""
        crossing, fit = self.crossing[place], self.fit[place]
        by_fit = fit.measured and not (crossing.measured and self.read)
        return "fit" if by_fit or crossing.state is State.UNKNOWN else "crossing"

    def best(self, place: int) -> TimeResult:
        """Time to one of `LEVELS`: without a model where it can be read, else by the fit."""
        return self.fit[place] if self.method(place) == "fit" else self.crossing[place]
