"""The watch over the load train, fed with records of a cycling rig."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.ring import Channel
from rig.campaign.execution.observer import LoadTrainWatch
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.load_train import Cycle, LoadTrain, Samples, difference

RATE_HZ = 250.0
PERIOD_S = 0.5
FORCE_CLOCK_US = 7_000_000
Force = Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


def friction(t_s: NDArray[np.float64], x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return 400.0 * np.tanh(v_m_s / 0.02) + 500.0 * v_m_s


def rig(
    cycles: int, force: Force = friction, amplitude_m: Callable[[NDArray[np.float64]], Any] = lambda t_s: 0.02,
    lost: slice = slice(0, 0),
) -> NDArray[Any]:
    """Records of a rig that cycles at 2 Hz; the force sensor's clock is its own."""
    t_s = np.arange(round(cycles * PERIOD_S * RATE_HZ) + 5) / RATE_HZ
    omega = 2 * np.pi / PERIOD_S
    x_m = amplitude_m(t_s) * np.sin(omega * t_s)
    v_m_s = amplitude_m(t_s) * omega * np.cos(omega * t_s)
    noise = np.random.default_rng(1).normal(0.0, 5.0, len(t_s))
    rows = []
    for k, (at_s, x, f) in enumerate(zip(t_s, x_m, force(t_s, x_m, v_m_s) + noise, strict=True)):
        us = round(1e6 * at_s)
        if k % 125 == 0:
            count = 250 + k // 125
            rows.append((us, FORCE_CLOCK_US + us, 0.0, count, Channel.FORCE_EDGE, 0))
            rows.append((us, us, 0.0, count, Channel.DISPLACEMENT_EDGE, 0))
            rows.append((us, us, float(count % 65536), count, Channel.PULSE, 0))
        if k not in range(*lost.indices(len(t_s))):
            rows.append((us, FORCE_CLOCK_US + us, f, k, Channel.FORCE, 0))
        rows.append((us, us, x, k, Channel.DISPLACEMENT, 0))
    return np.array(rows, RECORD_DTYPE)


def watched(records: NDArray[Any], chunk: int = 40) -> tuple[str | None, int]:
    """What the watch says, and after how many records."""
    watch = LoadTrainWatch()
    for begin in range(0, len(records), chunk):
        cause = watch.watch(RecordBlock(records[begin : begin + chunk]))
        if cause is not None:
            return cause, begin + chunk
    return None, len(records)


@pytest.mark.parametrize("chunk", [1, 40, 5000])
def test_equal_cycles_say_nothing(chunk: int) -> None:
    assert watched(rig(12), chunk) == (None, len(rig(12)))


def test_a_loose_joint_is_seen_at_the_end_of_its_first_cycle() -> None:
    def loose(t_s: NDArray[np.float64], x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        dead = (t_s > 3.0) & (np.abs(x_m) > 0.018)
        return np.where(dead, 0.0, friction(t_s, x_m, v_m_s))

    records = rig(12, loose)
    cause, seen = watched(records)
    assert cause is not None
    assert "per cycle" in cause
    assert records["host_ns"][seen - 1] < 3.6e6


def test_a_cracked_part_shows_in_the_peak_and_the_work() -> None:
    def cracked(t_s: NDArray[np.float64], x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return friction(t_s, x_m, v_m_s) * np.where(t_s > 3.0, 0.85, 1.0)

    assert watched(rig(12, cracked))[0] is not None


def test_a_damper_that_warms_slowly_says_nothing() -> None:
    def warming(t_s: NDArray[np.float64], x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return friction(t_s, x_m, v_m_s) * (1.0 - 0.02 * t_s)

    assert watched(rig(20, warming))[0] is None


def test_ramps_are_not_compared_with_full_cycles() -> None:
    assert watched(rig(12, amplitude_m=lambda t_s: 0.02 * np.clip(t_s / 1.5, 0.0, 1.0)))[0] is None


def test_a_commanded_change_of_the_current_starts_the_comparison_anew() -> None:
    def stepped(t_s: NDArray[np.float64], x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return friction(t_s, x_m, v_m_s) * np.where(t_s > 3.0, 1.5, 1.0)

    records = rig(14, stepped)
    step = np.array([(3_000_000, -1, 1.5, 0, Channel.COMMANDED_CURRENT, 0)], RECORD_DTYPE)
    at = int(np.searchsorted(records["host_ns"], 3_000_000))
    assert watched(records)[0] is not None
    assert watched(np.concatenate((records[:at], step, records[at:])))[0] is None


def test_edges_that_are_missing_never_stop_the_watch() -> None:
    records = rig(12)
    missing = (records["channel"] == Channel.DISPLACEMENT_EDGE) & (records["sequence"] % 4 == 0)
    assert watched(records[~missing])[0] is None


def test_where_in_a_cycle_its_few_samples_are_taken_is_no_change() -> None:
    usual = Cycle(0.02, 250e3, 300.0, 2.0, 1 / 62, 1e-4, 1 / 62)
    assert difference(replace(usual, quiet=4 / 62), usual) is None
    assert difference(replace(usual, quiet=9 / 62), usual) is not None


def test_the_first_cycle_after_the_ramp_may_still_settle_and_later_ones_may_not() -> None:
    """At 25 Hz, 0.2 mm and 1 A the servo's first cycle had 95 % of the fundamental and 15 % less work: a false stop."""
    phases = np.arange(80) / 80
    turns, noise = 2.0 * np.pi * phases, np.random.default_rng(2)

    def cycle(fundamental_mm: float, third_mm: float, lag_deg: float) -> tuple[Samples, Samples]:
        x_m = 1e-3 * (fundamental_mm * np.sin(turns) - third_mm * np.sin(3.0 * turns))
        force_N = 256.0 * np.sin(turns + np.radians(lag_deg)) + noise.normal(0.0, 5.0, 80)
        return Samples(phases, force_N, 4e4), Samples(phases, x_m + noise.normal(0.0, 4e-6, 80), 4e4)

    first, settled, cracked = (0.1825, 0.0125, 46.8), (0.195, 0.0, 54.0), (0.195, 0.0, 38.0)

    def cause(*cycles: tuple[float, float, float]) -> list[str | None]:
        train = LoadTrain()
        return [train.change(*cycle(*motion), None) for motion in cycles]

    assert cause(first, settled, settled, settled) == [None] * 4
    assert cause(settled, cracked)[1] is not None
    assert cause(first, settled, settled, (0.1825, 0.0125, 38.0))[3] is not None
