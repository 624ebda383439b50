"""Judges of samples: what trips, what is only flagged, and after how many samples."""

from __future__ import annotations

import math
import random

import pytest

from drivers.ring import Channel, Record
from protocols.quality import Quality
from rig.station.interlocks.channel_interlock import ChannelInterlock, ChannelLimits
from rig.station.interlocks.motion_interlock import MotionInterlock

PERIOD_US = 4000


def record(number: int, value: float, flags: int = 0) -> Record:
    return (number * 4_000_000, number * PERIOD_US, value, number, int(Channel.FORCE), flags)


def force_interlock(spike_jump: float = 5000.0) -> ChannelInterlock:
    limits = ChannelLimits(low=-5000.0, high=5000.0, span=10_000.0, spike_jump=spike_jump, unit="N")
    return ChannelInterlock("load_cell", "force-limit", limits)


def motion_of(positions_m: list[float], interlock: MotionInterlock) -> list[str]:
    return [finding.slug for i, x in enumerate(positions_m) for finding in interlock.check([record(i, x)])]


@pytest.mark.parametrize("beyond_N", [5000.1, -5000.1])
def test_first_sample_beyond_a_limit_trips(beyond_N: float) -> None:
    interlock = force_interlock()
    assert interlock.check([record(0, beyond_N * 0.9)])[1] == []
    (finding,) = interlock.check([record(1, beyond_N)])[1]
    assert finding.slug == "force-limit"
    assert finding.value == beyond_N
    assert finding.limit == math.copysign(5000.0, beyond_N)
    assert finding.t_ns == 4_000_000


def test_crossing_inside_a_batch_names_the_crossing_sample() -> None:
    interlock = force_interlock()
    found = interlock.check([record(0, 4000.0), record(1, 4990.0), record(2, 5100.0), record(3, 4000.0)])[1]
    assert [finding.t_ns for finding in found] == [8_000_000]


def test_single_spike_is_flagged_and_does_not_trip() -> None:
    interlock = force_interlock(spike_jump=3000.0)
    records, findings = interlock.check([record(0, 100.0), record(1, 9000.0), record(2, 120.0)])
    assert [bool(r[5] & Quality.SPIKE) for r in records] == [False, True, False]
    assert [(finding.slug, finding.warns) for finding in findings] == [("sensor-spike", True)]
    assert interlock.last_value == 120.0


def test_over_lost_samples_a_large_change_is_no_spike_but_its_limits_hold() -> None:
    interlock = force_interlock(spike_jump=3000.0)
    interlock.check([record(0, -2000.0)])
    after = [record(40, 2000.0, int(Quality.GAP_BEFORE)), record(41, 2010.0), record(42, 2020.0)]
    records, findings = interlock.check(after)
    assert [finding.slug for finding in findings] == ["sample-gap"]
    assert records == after
    beyond = interlock.check([record(80, -5100.0, int(Quality.GAP_BEFORE))])[1]
    assert [finding.slug for finding in beyond] == ["sample-gap", "force-limit"]


def test_three_spikes_in_a_row_trip_at_the_third() -> None:
    interlock = force_interlock(spike_jump=3000.0)
    interlock.check([record(0, 100.0)])
    found = [[(f.slug, f.warns) for f in interlock.check([record(i, 9000.0)])[1]] for i in range(1, 4)]
    assert found[:2] == [[("sensor-spike", True)]] * 2
    assert found[2] == [("sensor-spike", False), ("force-limit", False)]


def test_saturation_trips_at_the_third_sample_in_a_row_and_starts_over_after_a_good_one() -> None:
    interlock = ChannelInterlock("aux", "sensor-saturated", ChannelLimits(low=-1e9, high=1e9, span=10.0))
    overloaded = int(Quality.OVERLOAD)
    flags = [overloaded, overloaded, 0, overloaded, overloaded, overloaded]
    found = [bool(interlock.check([record(i, 1.0, flag)])[1]) for i, flag in enumerate(flags)]
    assert found == [False, False, False, False, False, True]


def test_a_value_that_repeats_is_an_amplifiers_end_only_where_nothing_greater_or_less_was_ever_shown() -> None:
    interlock = force_interlock()
    interlock.check([record(0, 7.0)])
    assert not interlock.at_extreme, "a channel that has shown one value only has no extremes"
    interlock.check([record(1, -200.0), record(2, 350.0)])
    assert interlock.at_extreme
    interlock.check([record(3, 120.0), record(4, 120.0)])
    assert not interlock.at_extreme
    interlock.check([record(5, -200.0)])
    assert interlock.at_extreme


def test_value_at_the_end_of_the_span_counts_as_saturated() -> None:
    interlock = ChannelInterlock("aux", "sensor-saturated", ChannelLimits(low=-10.0, high=10.0, span=10.0))
    assert [f.slug for f in interlock.check([record(i, -10.0) for i in range(3)])[1]] == ["sensor-saturated"]


def test_not_a_number_is_a_warning_and_hides_no_crossing_in_the_same_batch() -> None:
    interlock = force_interlock()
    nan = record(0, math.nan, int(Quality.NOT_A_NUMBER))
    slugs = [f.slug for f in interlock.check([nan, record(1, 5001.0), nan])[1]]
    assert slugs == ["sensor-nan", "force-limit", "sensor-nan"]


def test_gap_is_reported_and_the_sample_behind_it_is_still_evaluated() -> None:
    interlock = force_interlock()
    slugs = [f.slug for f in interlock.check([record(7, 6000.0, int(Quality.GAP_BEFORE))])[1]]
    assert slugs == ["sample-gap", "force-limit"]


def test_findings_do_not_depend_on_how_the_stream_is_cut_into_batches() -> None:
    rng = random.Random(1)
    values = [rng.uniform(-5200, 5200) for _ in range(400)]
    stream = [record(i, value) for i, value in enumerate(values)]
    whole = force_interlock(20_000.0).check(stream)[1]
    interlock, pieces, at = force_interlock(20_000.0), [], 0
    while at < len(stream):
        size = rng.randint(1, 17)
        pieces += interlock.check(stream[at : at + size])[1]
        at += size
    assert pieces == whole
    assert [f.value for f in whole] == [v for v in values if abs(v) > 5000.0]


def test_speed_just_below_the_limit_does_not_trip_on_sensor_noise() -> None:
    rng = random.Random(2)
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    positions = [0.8 * i * PERIOD_US * 1e-6 + rng.gauss(0.0, 5e-6) for i in range(5000)]
    assert motion_of(positions, interlock) == []
    assert interlock.speed_m_s == pytest.approx(0.8, rel=0.01)


def test_speed_beyond_the_limit_is_found_at_the_third_window_and_for_as_long_as_it_lasts() -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    found = [[f.slug for f in interlock.check([record(i, 1.0 * i * PERIOD_US * 1e-6)])] for i in range(8)]
    assert found[:5] == [[]] * 5
    assert found[5:] == [["speed-limit"]] * 3


def test_one_spike_in_the_displacement_does_not_trip_the_speed_limit() -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    positions = [0.0] * 20
    positions[10] = 0.05
    assert motion_of(positions, interlock) == []


def test_standstill_is_measured_on_the_sensors_clock_and_ends_with_motion() -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.02] * 51, interlock)
    assert interlock.still_s == pytest.approx(0.2)
    interlock.check([record(51, 0.0204)])
    assert interlock.still_s == 0.0


def test_slow_creep_is_not_standstill() -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    longest_s = 0.0
    for i in range(1000):
        interlock.check([record(i, 0.01 * i * PERIOD_US * 1e-6)])
        longest_s = max(longest_s, interlock.still_s)
    assert longest_s < 0.05


@pytest.mark.parametrize(
    ("moved_m", "left_after"),
    [([0.0025] * 5, 3), ([-0.0025] * 5, 3), ([0.0019] * 5, None), ([0.05, 0.05, 0.0] * 3, None)],
)
def test_a_rod_has_left_its_place_when_three_samples_in_a_row_are_two_millimetres_away(
    moved_m: list[float], left_after: int | None
) -> None:
    """Slow creep too, which leaves standstill unproved at no time; a gap in the samples forgets nothing."""
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.02] * 51, interlock)
    interlock.hold_place()
    left = []
    for i, way_m in enumerate(moved_m):
        interlock.check([record(100 + i, 0.02 + way_m)])
        left.append(interlock.place.left)
    assert (left.index(True) + 1 if any(left) else None) == left_after


@pytest.mark.parametrize(("missing", "still_s"), [(4, 0.22), (25, 0.0)])
def test_what_was_not_seen_between_two_samples_is_no_standstill(missing: int, still_s: float) -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.02] * 51, interlock)
    interlock.check([record(51 + missing, 0.02)])
    assert interlock.still_s == pytest.approx(still_s)


def test_clock_that_falls_back_restarts_the_proof_of_standstill() -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.0] * 100, interlock)
    interlock.check([record(3, 0.0)])
    assert interlock.still_s == 0.0


class Interrupted(MotionInterlock):
    """A sample is judged by the reader's thread just after the first thing that the supervisor's thread forgets."""

    between: Record | None = None

    def __setattr__(self, name: str, value: object) -> None:
        super().__setattr__(name, value)
        sample, self.__dict__["between"] = self.between, None
        if sample is not None:
            self.check([sample])


@pytest.mark.parametrize("at_m", [0.02, 0.05])
def test_a_sample_in_the_middle_of_a_restart_does_not_end_the_proof_of_standstill_for_good(at_m: float) -> None:
    interlock = Interrupted(0.88, rate_Hz=250.0)
    motion_of([0.02] * 51, interlock)
    interlock.__dict__["between"] = record(51, at_m)
    interlock.restart_still()
    for i in range(52, 103):
        interlock.check([record(i, at_m)])
    assert interlock.still_s == pytest.approx(0.2, abs=0.005)


@pytest.mark.parametrize(("steps_m", "changed"), [(1e-6, True), (0.0, False)], ids=["noise", "one value"])
def test_what_has_changed_is_counted_from_the_begin_of_the_proof_of_standstill(steps_m: float, changed: bool) -> None:
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.01 * i for i in range(20)], interlock)
    assert interlock.changed
    interlock.restart_still()
    assert not interlock.changed
    interlock.check([record(20 + i, 0.02 + steps_m * (i % 2)) for i in range(100)])
    assert interlock.still_s > 0.3
    assert interlock.changed is changed


def test_a_fine_channel_that_repeats_one_value_says_nothing_and_a_coarse_one_may() -> None:
    for step, nothing in ((0.0, False), (1e-6, True)):
        interlock = ChannelInterlock("lvdt", "stroke-limit", ChannelLimits(low=-0.1, high=0.1, span=0.12, unit="m"))
        interlock.check([record(i, 0.01 + step * (i % 7)) for i in range(300)])
        assert not interlock.says_nothing(20)
        interlock.check([record(300 + i, 0.012) for i in range(30)])
        assert interlock.says_nothing(20) is nothing


@pytest.mark.parametrize(("value_m", "flags"), [(0.12, 0), (0.0, Quality.OVERLOAD), (0.0, Quality.SENSOR_FAULT)])
def test_a_channel_at_its_end_or_with_a_fault_says_nothing(value_m: float, flags: int) -> None:
    interlock = ChannelInterlock("lvdt", "stroke-limit", ChannelLimits(low=-1.0, high=1.0, span=0.12, unit="m"))
    interlock.check([record(i, value_m + 1e-6 * i, int(flags)) for i in range(3)])
    assert interlock.says_nothing(1000)


def test_an_lvdt_without_measurements_shows_neither_speed_nor_standstill() -> None:
    """Saturated samples keep coming while the rod may move: the last speed before them says nothing any more."""
    interlock = MotionInterlock(0.88, rate_Hz=250.0)
    motion_of([0.1e-3 * i for i in range(60)], interlock)
    assert interlock.speed_m_s == pytest.approx(0.025, rel=0.01)
    assert not interlock.blind
    interlock.check([record(60 + i, 0.1, int(Quality.OVERLOAD)) for i in range(20)])
    assert interlock.blind
    assert math.isnan(interlock.speed_m_s)
    interlock.check([record(80 + i, 0.012) for i in range(200)])
    assert not interlock.blind
    assert interlock.still_s > 0.5
