"""From sensor bytes to records: unwrapping, losses, flags, edges, nominal rate."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ring import Channel
from drivers.sample_stream import RateWatch, SampleScale, SampleStream
from protocols.frame_format import STATUS_EDGE, STATUS_OVERLOAD, STATUS_SENSOR_FAULT, FrameDecoder, encode
from protocols.line_format import LineDecoder
from protocols.quality import Quality
from protocols.sensor_format import preset

NOW = 10**12


def stream(**options: float) -> SampleStream:
    settings = {"rate_Hz": 250.0} | options
    return SampleStream(FrameDecoder(), Channel.FORCE, SampleScale(**settings))


def frames(numbers: list[int], period_us: int = 4000) -> bytes:
    return b"".join(encode(n % 100, n % 65536, n * period_us % 2**32) for n in numbers)


def test_values_become_si_by_sensitivity_and_offset() -> None:
    batch = stream(sensitivity=0.001, offset=0.25).take(encode(1250.0, 1, 5) + encode(2250.0, 2, 9), NOW)
    assert batch.records == [(NOW, 5, 1.0, 1, 1, 0), (NOW, 9, 2.0, 2, 1, 0)]


def test_a_reversed_sensor_has_both_numbers_with_the_other_sign() -> None:
    shown, shown_at_zero = [40.0, 140.0, -60.0], 40.0
    chunk = b"".join(encode(value, number, 4000 * number) for number, value in enumerate(shown))
    upright = stream(sensitivity=1.0, offset=shown_at_zero).take(chunk, NOW)
    reversed_ = stream(sensitivity=-1.0, offset=-shown_at_zero).take(chunk, NOW)
    assert [r[2] for r in upright.records] == [0.0, 100.0, -100.0]
    assert [r[2] for r in reversed_.records] == [0.0, -100.0, 100.0]


def test_a_flagged_sample_is_scaled_as_every_other() -> None:
    batch = stream(sensitivity=-2.0, offset=-10.0).take(encode(30.0, 1, 5, STATUS_OVERLOAD), NOW)
    assert [(r[2], r[5]) for r in batch.records] == [(-50.0, Quality.OVERLOAD)]


def test_counters_run_on_across_the_wrap_of_sequence_and_clock() -> None:
    # The device clock wraps after 2^32 us = 1,073,741.8 samples, the sequence every 65,536.
    numbers = list(range(1_073_700, 1_073_800))
    batch = stream().take(frames(numbers), NOW)
    first = numbers[0] % 65536
    assert [r[3] for r in batch.records] == list(range(first, first + 100))
    assert [r[1] - batch.records[0][1] for r in batch.records] == [4000 * n for n in range(100)]
    assert batch.lost == 0
    assert all(r[5] == 0 for r in batch.records)


@given(st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_every_missing_sample_is_counted_and_flagged(steps: list[int]) -> None:
    numbers = [0]
    for step in steps:
        numbers.append(numbers[-1] + step)
    flow = stream()
    batch = flow.take(frames(numbers), NOW)
    assert batch.lost == flow.counters.lost == numbers[-1] + 1 - len(numbers)
    assert [r[3] for r in batch.records] == numbers
    assert [r[5] for r in batch.records[1:]] == [Quality.GAP_BEFORE if step > 1 else 0 for step in steps]


def test_a_gap_of_several_sequence_turns_is_counted_with_the_device_clock() -> None:
    flow = stream()
    batch = flow.take(frames([10, 10 + 3 * 65536 + 5]), NOW)
    assert batch.lost == 3 * 65536 + 4
    assert batch.records[1][3] == 10 + 3 * 65536 + 5


def test_a_damaged_frame_is_one_lost_sample() -> None:
    wire = bytearray(frames([0, 1, 2]))
    wire[20] ^= 0xFF
    batch = stream().take(bytes(wire), NOW)
    assert batch.lost == 1
    assert [(r[3], r[5]) for r in batch.records] == [(0, 0), (2, Quality.GAP_BEFORE)]


def test_a_repeated_sample_is_dropped_and_counted() -> None:
    flow = stream()
    batch = flow.take(frames([0, 1, 1, 2]), NOW)
    assert [r[3] for r in batch.records] == [0, 1, 2]
    assert (flow.counters.duplicates, flow.counters.lost, flow.counters.samples) == (1, 0, 3)


def test_a_device_clock_that_runs_backwards_is_seen() -> None:
    flow = stream()
    batch = flow.take(encode(0, 1, 9000) + encode(0, 2, 5000) + encode(0, 3, 9000), NOW)
    assert [(r[1], r[5]) for r in batch.records] == [(9000, 0), (5000, Quality.GAP_BEFORE), (9000, 0)]
    assert flow.counters.clock_errors == 1


def test_a_device_clock_that_jumps_ahead_is_seen() -> None:
    flow = stream()
    batch = flow.take(encode(0, 1, 0) + encode(0, 2, 60_000_000), NOW)
    assert batch.records[1][5] == Quality.GAP_BEFORE
    assert flow.counters.clock_errors == 1


def test_a_restarted_device_loses_at_least_one_sample() -> None:
    flow = stream()
    batch = flow.take(frames([5000, 0, 1]), NOW)
    assert [(r[3], r[5]) for r in batch.records] == [(5000, 0), (0, Quality.GAP_BEFORE), (1, 0)]
    assert batch.lost == 1


@pytest.mark.parametrize(
    ("value", "status", "flag"),
    [
        (1.0, STATUS_OVERLOAD, Quality.OVERLOAD),
        (1.0, STATUS_SENSOR_FAULT, Quality.SENSOR_FAULT),
        (math.nan, 0, Quality.NOT_A_NUMBER),
        (math.inf, 0, Quality.NOT_A_NUMBER),
        (-math.inf, STATUS_OVERLOAD, Quality.OVERLOAD | Quality.NOT_A_NUMBER),
    ],
)
def test_a_bad_reading_is_flagged_and_kept(value: float, status: int, flag: Quality) -> None:
    flow = stream()
    batch = flow.take(frames([0]) + encode(value, 1, 4000, status) + frames([2]), NOW)
    assert [r[5] for r in batch.records] == [0, flag, 0]
    assert batch.lost == 0
    assert flow.counters.overloads == (1 if flag & Quality.OVERLOAD else 0)
    assert flow.counters.sensor_faults == (1 if flag & Quality.SENSOR_FAULT else 0)
    assert flow.counters.not_numbers == (1 if flag & Quality.NOT_A_NUMBER else 0)


def edge(sequence: int, latched_us: int, count: int) -> bytes:
    return encode(0.0, sequence, latched_us, STATUS_EDGE, count)


def test_edges_go_to_their_channel_with_the_latched_time() -> None:
    flow = stream()
    batch = flow.take(frames([0, 1]) + edge(1, 3900, 255) + frames([2]) + edge(2, 8100, 0) + frames([3]), NOW)
    edges = [r for r in batch.records if r[4] == Channel.FORCE_EDGE]
    assert edges == [(NOW, 3900, 0.0, 255, 40, 0), (NOW, 8100, 0.0, 256, 40, 0)]
    assert [r[3] for r in batch.records if r[4] == Channel.FORCE] == [0, 1, 2, 3]
    assert (batch.lost, flow.counters.edges, flow.counters.edges_missed) == (0, 2, 0)


def test_an_edge_behind_the_wrap_of_the_clock_stays_on_the_unwrapped_clock() -> None:
    first = encode(0, 1, 2**32 - 1000)
    batch = stream().take(first + edge(1, 500, 1) + encode(0, 2, 3000) + edge(2, 2**32 - 1, 2), NOW)
    assert [r[1] for r in batch.records] == [2**32 - 1000, 2**32 + 500, 2**32 + 3000, 2**32 - 1]


def test_missed_and_repeated_edges_are_counted() -> None:
    flow = stream()
    batch = flow.take(frames([0]) + edge(0, 10, 1) + edge(0, 10, 1) + edge(0, 30, 4), NOW)
    assert [(r[3], r[5]) for r in batch.records[1:]] == [(1, 0), (4, Quality.GAP_BEFORE)]
    assert (flow.counters.edges_missed, flow.counters.duplicates) == (2, 1)


def test_an_edge_before_the_first_sample_has_no_clock_to_stand_on() -> None:
    batch = stream().take(edge(0, 10, 1) + frames([1]), NOW)
    assert [r[4] for r in batch.records] == [Channel.FORCE]


@given(st.binary(max_size=300), st.integers(0, 300))
def test_garbage_never_crashes_and_the_stream_is_found_again(noise: bytes, at: int) -> None:
    flow = stream()
    flow.take(frames([0, 1]), NOW)
    flow.take(noise[:at], NOW)
    flow.take(noise[at:], NOW)
    batch = flow.take(frames([4, 5, 6]), NOW)
    assert [r[3] for r in batch.records][-3:] == [4, 5, 6]


def line_stream(rate_Hz: float | None) -> SampleStream:
    decoder = LineDecoder(preset("signed-decimal"))
    return SampleStream(decoder, Channel.FORCE, SampleScale(rate_Hz=rate_Hz), has_sequence=False)


def test_lines_have_no_clock_and_an_unreadable_line_is_a_lost_sample() -> None:
    flow = line_stream(None)
    batch = flow.take(b"\r\n+0000001.0 N\r\n+00000x2.0 N\r\n+0000003.0 N\r\n", NOW)
    assert batch.records == [(NOW, -1, 1.0, 1, 1, 0), (NOW, -1, 3.0, 3, 1, Quality.GAP_BEFORE)]
    assert batch.lost == 1


def test_lines_missing_against_the_rate_are_counted_and_flagged() -> None:
    flow = line_stream(100.0)
    line = b"+0000001.0 N\r\n"
    flow.take(b"\r\n" + line, NOW)
    for tenth in range(1, 10):
        assert flow.take(line * 10, NOW + tenth * 10**8).lost == 0
    late = flow.take(line * 1, NOW + 10**9)
    assert late.lost == 9
    assert late.records[0][5] == Quality.GAP_BEFORE


def test_a_rate_within_its_tolerance_loses_nothing() -> None:
    watch = RateWatch(250.0)
    assert watch.missing(0, 0) == 0
    assert watch.missing(1, 0) == 0
    assert [watch.missing(248, second * 10**9) for second in range(1, 20)] == [0] * 19
    assert watch.missing(200, 20 * 10**9) == 50


def test_what_a_line_holds_back_over_the_end_of_a_second_is_late_and_not_lost() -> None:
    watch = RateWatch(250.0)
    assert watch.missing(1, 0) == 0
    assert watch.missing(240, 970_000_000) == 0
    assert watch.missing(0, 1_000_000_000) == 0
    assert watch.missing(15, 1_020_000_000) == 0


def test_lines_found_missing_leave_a_hole_in_the_sequence_and_time_goes_on_behind_it() -> None:
    flow = line_stream(250.0)
    numbers = []
    flow.take(b"\r\n", NOW)
    for period in range(1, 1501):
        if 700 <= period < 750:
            continue
        batch = flow.take(b"+0000001.0 N\r\n", NOW + period * 4_000_000)
        numbers += [(period, record[3]) for record in batch.records]
    steps = [later[1] - earlier[1] for earlier, later in pairwise(numbers)]
    assert sum(step - 1 for step in steps) == flow.counters.lost == 50
    assert [step for step in steps if step != 1] == [51], "one hole, where it was noticed"
    noticed = steps.index(51) + 1
    assert all(number == period for period, number in numbers[noticed:]), "the count of samples is a clock again"
    assert numbers[noticed][0] - 750 < 250, "within a second"


def test_more_lines_than_half_the_sequence_may_be_missing() -> None:
    flow = line_stream(50_000.0)
    flow.take(b"\r\n+0000001.0 N\r\n", NOW)
    batch = flow.take(b"+0000001.0 N\r\n" * 2, NOW + 10**9)
    assert (batch.lost, [record[3] for record in batch.records]) == (49_998, [50_000, 50_001])


def test_a_rig_that_outruns_the_wall_is_not_counted_against_the_hosts_clock() -> None:
    decoder = LineDecoder(preset("signed-decimal"))
    flow = SampleStream(decoder, Channel.FORCE, SampleScale(rate_Hz=250.0, device_rate=20.0), has_sequence=False)
    flow.take(b"\r\n+0000001.0 N\r\n", NOW)
    assert flow.take(b"+0000001.0 N\r\n", NOW + 10**9).lost == 0
