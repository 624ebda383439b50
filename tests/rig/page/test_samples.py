"""What browsers are sent of the ring: the recorded values, and loops that are the motion's."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from rig.page.samples import Frames, thinned
from rig.recording.ring_records import RECORD_DTYPE

FORCE, DISPLACEMENT, STATE = 1, 2, 23
OVERLOAD = 1


def records(*rows: tuple[int, int, float, int, int, int]) -> bytes:
    return np.array(list(rows), RECORD_DTYPE).tobytes()


def unpacked(frame: bytes) -> tuple[float, float, dict[int, list[tuple[float, float]]]]:
    """By hand, from the layout as documented."""
    kind, blocks, base, now = struct.unpack_from("<IIdd", frame, 0)
    assert kind == 1
    place, series = 24, {}
    for _ in range(blocks):
        channel, zero, count = struct.unpack_from("<HHI", frame, place)
        assert zero == 0
        times = struct.unpack_from(f"<{count}f", frame, place + 8)
        values = struct.unpack_from(f"<{count}f", frame, place + 8 + 4 * count)
        series[channel] = [(base + time, value) for time, value in zip(times, values, strict=True)]
        place += 8 + 8 * count
    assert place == len(frame)
    return base, now, series


def test_a_frame_is_the_bytes_that_its_layout_says() -> None:
    frame = Frames(1.0, 250.0).frame(records((2_000_000_000, -1, 4.0, 7, STATE, 0)), 2.5)
    head = bytes.fromhex("01000000 01000000 0000000000000040 0000000000000440".replace(" ", ""))
    assert frame == head + bytes.fromhex("1700 0000 01000000 00000000 00008040".replace(" ", ""))


def test_values_are_the_rings_to_float32_and_lost_ones_are_left_out() -> None:
    values = [123.4567, -0.001, float("nan"), 5e3, 9999.0]
    flags = [0, 0, 0, 0, OVERLOAD]
    rows = [(10**9 + 4_000_000 * n, 4000 * n, value, n, FORCE, flags[n]) for n, value in enumerate(values)]
    _, _, series = unpacked(Frames(1.0, 250.0).frame(records(*rows), 1.1))
    assert [value for _, value in series[FORCE]] == [float(np.float32(value)) for value in (123.4567, -0.001, 5e3)]


def test_nothing_new_is_a_frame_of_its_time_alone() -> None:
    assert unpacked(Frames(1.0, 250.0).frame(b"", 7.25)) == (7.25, 7.25, {})


def test_device_times_are_put_on_the_hosts_clock_by_the_soonest_arrival() -> None:
    late_ns = [3_000_000, 0, 9_000_000, 1_000_000]
    rows = [(50 * 10**9 + 4_000_000 * n + late, 4000 * n, 1.0, n, FORCE, 0) for n, late in enumerate(late_ns)]
    _, _, series = unpacked(Frames(1.0, 250.0).frame(records(*rows), 50.1))
    assert [time for time, _ in series[FORCE]] == pytest.approx([50.0, 50.004, 50.008, 50.012], abs=1e-6)


@pytest.mark.parametrize(("rate", "sensor_Hz"), [(1.0, 250.0), (20.0, 250.0), (1.0, 10_000.0)])
def test_a_loop_is_displacement_its_slope_and_the_force_of_the_same_moment(rate: float, sensor_Hz: float) -> None:
    frames, points = Frames(rate, sensor_Hz), []
    amplitude_m, frequency_Hz, damping = 0.02, 1.0, 2000.0
    omega = 2.0 * math.pi * frequency_Hz
    speed_m_s = amplitude_m * omega
    a_frame = round(sensor_Hz / 10.0)
    for first in range(0, 40 * a_frame if rate * sensor_Hz < 1e4 else 8 * a_frame, a_frame):
        rows = []
        for n in range(first, first + a_frame):
            time_s, device_us = n / sensor_Hz, round(n * 1e6 / sensor_Hz)
            host_ns = int(100e9 + time_s / rate * 1e9)
            rows.append((host_ns, device_us, amplitude_m * math.sin(omega * time_s), n, DISPLACEMENT, 0))
            rows.append((host_ns, device_us + 77, damping * speed_m_s * math.cos(omega * time_s), n, FORCE, 0))
        _, _, series = unpacked(frames.frame(records(*rows), rows[-1][0] * 1e-9))
        if 201 in series:
            points += [(x[0], x[1], v[1], f[1]) for x, v, f in zip(series[201], series[202], series[203], strict=True)]
    assert len(points) > 900
    for host_s, x_m, v_m_s, force_N in points:
        time_s = (host_s - 100.0) * rate
        assert x_m == pytest.approx(amplitude_m * math.sin(omega * time_s), abs=3e-5)
        assert v_m_s == pytest.approx(amplitude_m * omega * math.cos(omega * time_s), abs=6e-4)
        assert force_N == pytest.approx(damping * v_m_s, abs=4.0)


def test_a_loop_stays_whole_on_a_rig_that_is_slower_than_requested_and_whose_samples_come_when_they_may() -> None:
    requested, rate, frame_s = 10.0, 6.0, 0.04
    frames, points = Frames(requested, 250.0), []
    omega, damping, amplitude_m = 2.0 * math.pi, 2000.0, 0.02
    draw = np.random.default_rng(3)
    sent = {DISPLACEMENT: 0, FORCE: 0}
    for number in range(1, 200):
        rows = []
        for channel in (DISPLACEMENT, FORCE):  # each channel's newest samples wait somewhere for up to half a frame
            until = int(rate * (number * frame_s - draw.uniform(0.0, 0.5 * frame_s)) * 250.0)
            for n in range(sent[channel], until):
                time_s = n / 250.0
                value = amplitude_m * math.sin(omega * time_s)
                if channel == FORCE:
                    value = damping * amplitude_m * omega * math.cos(omega * time_s)
                epoch_us = 0 if channel == DISPLACEMENT else 7_000_000
                rows.append((int((50.0 + number * frame_s) * 1e9), 4000 * n + epoch_us, value, n, channel, 0))
            sent[channel] = max(sent[channel], until)
        _, _, series = unpacked(frames.frame(records(*rows), 50.0 + number * frame_s))
        if 201 in series and number > 50:
            points += [(x[0], v[1], f[1]) for x, v, f in zip(series[201], series[202], series[203], strict=True)]
    times = [time_s for time_s, _, _ in points]
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] - times[0] == pytest.approx(149 * frame_s * rate / requested, rel=0.05)
    peak_N = damping * amplitude_m * omega
    assert len(points) > 7000
    assert max(abs(force_N - damping * v_m_s) for _, v_m_s, force_N in points) < 0.15 * peak_N


def test_force_that_stays_away_makes_no_loop_and_no_heap() -> None:
    frames = Frames(1.0, 250.0)
    for first in range(0, 100_000, 1000):
        rows = records(*((10**9 + 4_000_000 * n, -1, 0.001, n, DISPLACEMENT, 0) for n in range(first, first + 1000)))
        assert 201 not in unpacked(frames.frame(rows, 1.0))[2]
    assert len(frames._loop._x[0]) < 2000


def test_thinning_keeps_every_peak() -> None:
    time = np.arange(10_000) / 250.0
    value = np.sin(time)
    value[4321], value[77] = 50.0, -60.0
    kept_t, kept = thinned(time, value)
    assert len(kept) <= 40
    assert max(kept) == 50.0
    assert min(kept) == -60.0
    assert np.all(np.diff(kept_t) > 0)
