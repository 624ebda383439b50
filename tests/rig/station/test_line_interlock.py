"""Damaged frames on a sensor's line, and clocks that do not keep time."""

import math
import random

import pytest

from rig.station.interlocks.line_interlock import BLOCK_NS, ClockWatch, LineInterlock, drift

MS = 1_000_000


def found(interlock: LineInterlock, *reads: tuple[int, int]) -> list[bool | None]:
    """For each read: None without a finding, else whether it only warns."""
    found = [interlock.check(good, damaged, 0) for good, damaged in reads]
    return [findings[0].warns if findings else None for findings in found]


def test_one_damaged_frame_warns_and_three_of_twenty_five_stop() -> None:
    interlock = LineInterlock("load_cell", 250.0)
    assert found(interlock, (10, 0), (4, 1), (4, 1), (4, 1)) == [None, True, True, False]


def test_damage_of_long_ago_counts_no_more() -> None:
    interlock = LineInterlock("load_cell", 250.0)
    assert found(interlock, (4, 1), (4, 1), *[(5, 0)] * 6, (4, 1)) == [True, True, *[None] * 6, True]


def test_at_10_kHz_a_tenth_of_the_last_thousand_frames_stops() -> None:
    interlock = LineInterlock("load_cell", 10_000.0)
    assert found(interlock, *[(90, 9)] * 10, (80, 20)) == [*[True] * 10, False]


def test_damage_without_any_good_frame_is_left_to_the_silence() -> None:
    assert found(LineInterlock("load_cell", 250.0), (0, 30)) == [True]


def watch(ppm: float, seconds: float, *, leap_s: float = 0.0, device_rate: float = 1.0) -> ClockWatch:
    """A clock watched over samples of 4 ms that arrive up to 3 ms late; at half time it may leap."""
    made, random_ms = ClockWatch(device_rate), random.Random(4)
    for n in range(int(seconds * 250)):
        host_s = 0.004 * n
        device_s = host_s * (1 + ppm * 1e-6) - (leap_s if host_s > seconds / 2 else 0.0)
        made.take(int(1e9 * (5.0 + host_s)) + int(random_ms.uniform(0, 3 * MS)), int(1e6 * device_s))
    return made


@pytest.mark.parametrize("ppm", [500.0, -500.0, 0.0])
def test_rate_of_a_clock_is_found_within_a_few_seconds(ppm: float) -> None:
    assert watch(ppm, 14.0).ppm == pytest.approx(ppm, abs=60.0)


def test_a_leap_of_the_clock_is_no_rate() -> None:
    assert watch(0.0, 20.0, leap_s=0.2).ppm == pytest.approx(0.0, abs=60.0)


def test_nothing_is_reported_too_early_nor_of_a_clock_that_does_not_run_at_the_walls_rate() -> None:
    assert math.isnan(watch(500.0, 8.0).ppm)
    assert math.isnan(watch(500.0, 30.0, device_rate=5.0).ppm)


def test_a_silence_is_not_taken_for_a_block() -> None:
    made = ClockWatch(1.0)
    assert [made.take(t_ns, 0) for t_ns in (BLOCK_NS, 2 * BLOCK_NS - 1, 2 * BLOCK_NS, 9 * BLOCK_NS)] == [
        False, False, True, False,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ppm", "reference_ppm", "tells"),
    [(500.0, 0.0, True), (-500.0, 0.0, True), (500.0, 480.0, False), (200.0, 0.0, False), (500.0, math.nan, False)],
)
def test_only_a_clock_apart_from_the_controllers_drifts(ppm: float, reference_ppm: float, tells: bool) -> None:
    assert [finding.slug for finding in drift("lvdt", ppm, reference_ppm, 0)] == ["clock-drift"] * tells
