from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from protocols import frame_format
from protocols.line_format import LineDecoder
from protocols.sensor_format import preset
from simulators.clock import DeviceClock
from simulators.conditioner import group_delay_s
from simulators.frames import encode_frames, encode_lines
from simulators.options import LVDT, SensorOptions
from simulators.sensor import Sensor

DT_S = 1 / 8000
QUIET = {"noise": 0.0, "resolution": 0.0, "jitter_s": 0.0, "burst_rate_Hz": 0.0, "latency_s": 0.0}


def sensor(clock: DeviceClock | None = None, **changes: float) -> Sensor:
    options = replace(SensorOptions(), **{**QUIET, **changes})
    return Sensor(options, clock or DeviceClock(0.0, 0.0), np.random.default_rng(3), 0.0)


def run(
    device: Sensor, signal: np.ndarray, slice_steps: int = 16, pulses_s: Sequence[float] = ()
) -> tuple[bytes, list[int]]:
    """Feed a long signal slice by slice; returns the bytes and, per slice, how many had left by its end."""
    data, left = b"", []
    for first in range(0, len(signal), slice_steps):
        start_s = first * DT_S
        part = signal[first : first + slice_steps]
        inside = [pulse for pulse in pulses_s if start_s < pulse <= start_s + len(part) * DT_S]
        data += device.sample(np.asarray(part, float), start_s, DT_S, inside)
        left.append(len(data))
    return data, left


def decode(data: bytes) -> tuple[list[frame_format.Reading], frame_format.FrameDecoder]:
    decoder = frame_format.FrameDecoder()
    readings = decoder.feed(data)
    return readings, decoder


def test_vectorised_frames_equal_the_protocols_own_bytes() -> None:
    random = np.random.default_rng(1)
    n = 500
    status, edge = random.integers(0, 256, n, np.uint8), random.integers(0, 256, n)
    sequence, device_us = random.integers(0, 1 << 40, n), random.integers(0, 1 << 40, n)
    value = random.normal(0, 1e4, n)
    raw = encode_frames(status, edge, sequence, device_us, value)
    for i in range(n):
        expected = frame_format.encode(
            float(np.float32(value[i])), int(sequence[i]) % 65536, int(device_us[i]) % 2**32, int(status[i]),
            int(edge[i]),
        )
        assert raw[i].tobytes() == expected


def test_a_frame_built_by_hand() -> None:
    raw = encode_frames(np.array([1], np.uint8), np.array([2]), np.array([3]), np.array([4]), np.array([1.5]))
    assert raw.tobytes()[:14] == bytes.fromhex("a55a 01 02 0300 04000000 0000c03f")


def test_lines_are_signed_decimal() -> None:
    lines = encode_lines(np.array([1234.5, -0.04, 7.0]), "N").tobytes()
    assert lines == b"+0001234.5 N\r\n-0000000.0 N\r\n+0000007.0 N\r\n"


def test_samples_come_at_the_rate_of_the_sensors_own_clock() -> None:
    data, _ = run(sensor(DeviceClock(5e6, 1000.0)), np.zeros(80_000))
    readings, decoder = decode(data)
    assert len(readings) == pytest.approx(2500 * 1.001, abs=1)
    assert decoder.skipped_bytes == 0
    assert set(np.diff([reading[1] for reading in readings]).tolist()) == {4000}
    assert set(np.diff([reading[0] for reading in readings]).tolist()) == {1}
    assert abs(readings[0][1] - 5_000_000) <= 4000


def test_the_stream_does_not_depend_on_the_slices() -> None:
    signal = 100 * np.sin(np.arange(16_000) * 0.01)
    streams = [run(sensor(noise=5.0, jitter_s=2e-6), signal, steps)[0] for steps in (16, 97, 8000)]
    assert streams[0] == streams[1] == streams[2]


def test_the_filter_delays_a_ramp_by_its_group_delay() -> None:
    ramp = 1000.0 * np.arange(1, 16_001) * DT_S
    device = sensor()
    readings, _ = decode(run(device, ramp)[0])
    late = readings[-1]
    assert late[2] == pytest.approx(1000.0 * (late[1] * 1e-6 - group_delay_s(1000.0)), abs=1e-2)
    assert group_delay_s(1000.0) == pytest.approx(0.225e-3, rel=1e-3)


def test_noise_offset_gain_and_resolution_are_what_the_options_say() -> None:
    readings, _ = decode(run(sensor(noise=5.0, resolution=0.5, offset=12.0, gain=1.01), np.full(160_000, 100.0))[0])
    values = np.array([reading[2] for reading in readings])
    assert values.mean() == pytest.approx(113.0, abs=0.3)
    assert values.std() == pytest.approx(5.0, rel=0.05)
    assert np.all(values * 2 == np.round(values * 2))


def test_the_lvdt_speaks_millimetres() -> None:
    device = Sensor(LVDT, DeviceClock(0, 0), np.random.default_rng(0), 0.0)
    readings, _ = decode(run(device, np.full(8000, 0.0123))[0])
    assert np.mean([reading[2] for reading in readings]) == pytest.approx(12.3, abs=0.005)


def test_beyond_its_range_it_clips_and_flags() -> None:
    readings, _ = decode(run(sensor(range=500.0), np.full(8000, 900.0))[0])
    assert all(reading[2] == 500.0 and reading[3] & frame_format.STATUS_OVERLOAD for reading in readings)


def test_an_edge_frame_carries_the_pulse_in_the_sensors_clock() -> None:
    pulses = [0.2501, 0.5002, 0.7503]
    clock = DeviceClock(1e6, 40.0)
    readings, _ = decode(run(sensor(clock), np.zeros(8000), 16, pulses)[0])
    edges = [reading for reading in readings if reading[3] & frame_format.STATUS_EDGE]
    assert [edge[1] for edge in edges] == [clock.wrapped_us(pulse) for pulse in pulses]
    assert [edge[4] for edge in edges] == [1, 2, 3]
    for edge in edges:
        before = readings[readings.index(edge) - 1]
        assert edge[0] == before[0]
        assert edge[2] == 0.0
    samples = [reading for reading in readings if not reading[3] & frame_format.STATUS_EDGE]
    assert set(np.diff([sample[0] for sample in samples]).tolist()) == {1}
    assert samples[-1][4] == 3


def test_latency_holds_bytes_back() -> None:
    device = sensor(latency_s=0.02)
    _, left = run(device, np.zeros(8000), 80)
    assert left[0] == 0
    assert left[1] == 16


def test_a_burst_holds_frames_and_lets_them_go_together_in_order() -> None:
    device = sensor(burst_rate_Hz=5.0, burst_s=0.1)
    data, left = run(device, np.zeros(80_000), 80)
    readings, _ = decode(data)
    assert set(np.diff([reading[0] for reading in readings]).tolist()) == {1}
    arrivals = np.diff(left)
    assert arrivals.max() >= 20 * 16
    assert len(readings) >= 2470


@pytest.mark.parametrize("rate_Hz", [250.0, 10_000.0])
def test_same_seed_same_bytes(rate_Hz: float) -> None:
    signal = np.sin(np.arange(8000) * 0.01)
    first, second = (run(sensor(noise=1.0, burst_rate_Hz=3.0, rate_Hz=rate_Hz), signal)[0] for _ in range(2))
    assert first == second


def faulty(**switches: float) -> tuple[list[frame_format.Reading], frame_format.FrameDecoder]:
    device = sensor(noise=1.0)
    head, _ = run(device, np.full(4000, 50.0))
    for name, value in switches.items():
        setattr(device.faults, name, value)
    tail = b"".join(device.sample(np.full(80, 50.0), 0.5 + i * 0.01, DT_S, []) for i in range(100))
    return decode(head + tail)


def test_a_stuck_sensor_repeats_its_last_value() -> None:
    readings, _ = faulty(stuck=True)
    assert len({reading[2] for reading in readings[-200:]}) == 1


def test_a_saturated_sensor_shows_its_rail() -> None:
    readings, _ = faulty(saturated=True)
    assert readings[-1][2] == 10e3
    assert readings[-1][3] & frame_format.STATUS_OVERLOAD


def test_spikes_stand_alone_at_first_and_stay_for_some_samples_later() -> None:
    values = np.array([reading[2] for reading in faulty(spikes=True)[0]])
    high = np.flatnonzero(values > 5000)
    assert np.diff(high).tolist()[:7] == [62, 62, 62, 1, 1, 1, 1]


def test_a_line_without_a_number_is_no_reading() -> None:
    lines = encode_lines(np.array([1.5, math.nan, 2.5]), "N").tobytes()
    decoder = LineDecoder(preset("signed-decimal"))
    assert [reading[2] for reading in decoder.feed(b"\r\n" + lines)] == [1.5, 2.5]
    assert decoder.bad_frames == 1


def test_not_a_number_is_sent_as_such() -> None:
    values = np.array([reading[2] for reading in faulty(not_a_number=True)[0]])
    assert 3 <= np.isnan(values).sum() <= 6


def test_a_gap_skips_sequence_numbers() -> None:
    steps = np.diff([reading[0] for reading in faulty(gaps=True)[0]])
    assert set(steps.tolist()) == {1, 4}


def test_time_can_run_backwards() -> None:
    steps = np.diff([reading[1] for reading in faulty(time_backwards=True)[0]])
    assert (steps < 0).any()


def test_garbage_damages_frames_but_not_all() -> None:
    readings, decoder = faulty(garbage=True)
    assert 126 < len(readings) < 360
    assert decoder.skipped_bytes > 100


def test_a_wrong_baud_rate_leaves_no_valid_frame() -> None:
    readings, _ = faulty(wrong_baud=True)
    assert len(readings) <= 126


def test_an_untared_sensor_is_off_by_its_zero() -> None:
    readings, _ = faulty(zero_offset=500.0)
    assert np.mean([reading[2] for reading in readings[-200:]]) == pytest.approx(550.0, abs=1.0)


def test_an_undeclared_skew_delays_the_quantity_and_not_its_stamp() -> None:
    ramp = 1000.0 * np.arange(1, 16_001) * DT_S
    plain, late = (decode(run(sensor(skew_s=skew_s), ramp)[0])[0][-1] for skew_s in (0.0, 2.03e-3))
    assert late[1] == plain[1]
    assert plain[2] - late[2] == pytest.approx(2.03, abs=1e-2)


def test_an_amplifier_clips_without_remark_so() -> None:
    readings, _ = decode(run(sensor(clip=50.0), np.full(8_000, 80.0))[0])
    assert readings[-1][2] == pytest.approx(50.0)
    assert readings[-1][3] & frame_format.STATUS_OVERLOAD == 0


def test_a_sensor_may_latch_no_edges() -> None:
    readings, _ = decode(run(sensor(latches_edges=False), np.zeros(8_000), pulses_s=(0.3, 0.6))[0])
    assert not any(reading[3] & frame_format.STATUS_EDGE for reading in readings)


def test_numbers_can_end_while_frames_go_on() -> None:
    readings, _ = decode(run(sensor(numbers_until_s=0.5), np.full(8000, 7.0))[0])
    values = [reading[2] for reading in readings]
    assert len(values) == pytest.approx(250, abs=2)
    assert values[:125] == [7.0] * 125
    assert all(math.isnan(value) for value in values[125:])
