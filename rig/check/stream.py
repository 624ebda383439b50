"""The records of one channel over a few seconds of rest: rate, jitter, lateness, losses, noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FEWEST = 10
WITHIN = 0.99
"""Share of the values that a lateness is stated for."""
BIN_EDGES_MS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(frozen=True)
class Stream:
    """What a channel's records show; NaN where too few came.

    Attributes:
        count: records.
        rate_Hz: values a second of the device's clock, of the host's where the device has none.
        lateness_s: by how much each arrived later than the fastest one, (n,).
        jitter_s: standard deviation of the intervals of the device's clock, else of the arrivals.
        lost: sequence numbers left out.
        not_numbers: values that are not finite.
        noise: standard deviation of the values, SI.
        step: least difference of two values, SI; NaN where all are equal.
        mean: of the values, SI.
    """

    count: int
    rate_Hz: float
    lateness_s: NDArray[np.float64]
    jitter_s: float
    lost: int
    not_numbers: int
    noise: float
    step: float
    mean: float

    @property
    def latency_ms(self) -> float | None:
        """Lateness of all but one in a hundred (ms)."""
        return within_ms(self.lateness_s)


def stream_of(records: NDArray[Any], device_rate: float = 1.0) -> Stream:
    """What the records (n,) of one channel show, oldest first.

    Args:
        records: of `RECORD_DTYPE`.
        device_rate: device seconds in one second of the host's clock.
    """
    values = records["value"].astype(np.float64)
    finite = values[np.isfinite(values)]
    host_s = 1e-9 * (records["host_ns"] - records["host_ns"][:1]).astype(np.float64)
    numbers = records["sequence"].astype(np.int64)
    steps = np.diff(numbers) % (1 << 32)
    clocked = len(records) >= FEWEST and bool(np.all(records["device_us"] >= 0))
    device_s = 1e-6 * (records["device_us"] - records["device_us"][:1]).astype(np.float64)
    if not clocked or device_s[-1] <= 0.0:
        clocked, device_s = False, host_s * device_rate
    enough = len(records) >= FEWEST and device_s[-1] > 0.0
    counted = np.concatenate(([0], np.cumsum(steps))) if len(records) else np.zeros(0)
    different = np.unique(finite)
    return Stream(
        count=len(records),
        rate_Hz=float((len(records) - 1) / device_s[-1]) if enough else math.nan,
        lateness_s=_lateness(device_s if clocked else counted, host_s) if enough else np.zeros(0),
        jitter_s=float(np.std(np.diff(device_s if clocked else host_s))) if enough else math.nan,
        lost=int(np.sum(np.maximum(steps - 1, 0))),
        not_numbers=len(values) - len(finite),
        noise=float(np.std(finite)) if len(finite) else math.nan,
        step=float(np.min(np.diff(different))) if len(different) > 1 else math.nan,
        mean=float(np.mean(finite)) if len(finite) else math.nan,
    )


def _lateness(clock: NDArray[np.float64], host_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much each value arrived later than the fastest, both clocks laid over each other by a straight line."""
    slope, at_zero = np.polyfit(clock, host_s, 1)
    late_s = host_s - (slope * clock + at_zero)
    return np.asarray(late_s - np.min(late_s))


def within_ms(times_s: NDArray[np.float64]) -> float | None:
    """The time (ms) within which all but one in a hundred lie; None where there are too few."""
    return 1e3 * float(np.quantile(times_s, WITHIN)) if len(times_s) >= FEWEST else None


def histogram(times_s: NDArray[np.float64]) -> list[list[float | int | None]]:
    """Counts of times (s): pairs of a bin's upper edge (ms; None: above all) and how many lie in it."""
    edges = np.concatenate(([-np.inf], BIN_EDGES_MS, [np.inf]))
    counts, _ = np.histogram(1e3 * times_s, edges)
    return [[edge, int(count)] for edge, count in zip((*BIN_EDGES_MS, None), counts, strict=True)]
