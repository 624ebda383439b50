"""A serial sensor: its filter, its clock, its imperfections, its frames. No ports.

From the plant's slice to bytes: low-pass, sampling at the instants of the sensor's own clock with jitter, gain, offset,
noise, resolution, saturation at range; then frames in order of their time, edge frames among the samples; then the
latency of the line, with bursts in which everything waits and arrives together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.frame_format import STATUS_EDGE, STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from simulators.clock import DeviceClock
from simulators.conditioner import LARGEST_JITTER, amplify, condition, limit, sampling
from simulators.delay_line import DelayLine
from simulators.emulated_format import writer
from simulators.frame_writer import FrameWriter
from simulators.frames import encode_frames, encode_lines, encode_samples
from simulators.line_writer import LineWriter
from simulators.options import SensorOptions

FloatArray = NDArray[np.float64]
Bytes = NDArray[np.uint8]
SPIKE_EVERY_S = 0.25
SPIKE_SHARE = 0.6
SINGLE_SPIKES = 3
SPIKE_SAMPLES = 5
"""The first spikes are one sample each; those that follow stay for so many."""
GAP_EVERY_S = 0.2
GAP_SAMPLES = 3
NAN_EVERY_S = 0.2
GARBLED_SHARE = 0.02
_NOTHING: FloatArray = np.zeros(0)
_NO_DRAWS: FloatArray = np.zeros((0, 2))


@dataclass
class SensorFaults:
    """What is broken in the sensor or on its line."""

    stuck: bool = False
    saturated: bool = False
    sensor_fault: bool = False
    spikes: bool = False
    not_a_number: bool = False
    gaps: bool = False
    time_backwards: bool = False
    garbage: bool = False
    wrong_baud: bool = False
    zero_offset: float = 0.0


class Sensor:
    """One sensor's logic; `sample` is fed every slice of the plant and returns the bytes that leave the device.

    Attributes:
        faults: switches of the fault injectors.
        samples: how many samples have been taken.
        frame_size: bytes of one frame or line.
        requests: of a sensor that is asked: simulated times (s) of the requests in the slice to come, NaN for one that
            the next sample of its own clock answers; None for one that sends by itself.
    """

    def __init__(self, options: SensorOptions, clock: DeviceClock, random: np.random.Generator, start_s: float) -> None:
        self.options = options
        self.clock = clock
        self.faults = SensorFaults()
        self.samples = 0
        self.edges = 0
        self.frame_size = 16 if options.format == "frame16" else 13 + len(options.unit)
        self._writer: LineWriter | FrameWriter | None = None
        self.requests: list[float] | None = None
        if not isinstance(options.format, str):
            zero = options.wire_zero
            self._writer = writer(options.format, zero - options.range, zero + options.range)
            self.frame_size = self._writer.size
            self.requests = [] if options.format.exchange.request else None
        self._random, self._line_random = random.spawn(2)
        self._period_us = 1e6 / options.rate_Hz
        self._tick = math.ceil(clock.unwrapped_us(start_s) / self._period_us)
        self._filter = np.zeros(4)
        self._delay: DelayLine | None = None
        self._started = False
        self._first_faulty: dict[str, int] = {}
        self._last_value = math.nan
        self._waiting: Bytes = np.zeros((0, self.frame_size), np.uint8)
        self._release_s: FloatArray = np.zeros(0)
        self._burst_s = self._next_burst(start_s)

    def sample(
        self,
        signal: FloatArray,
        start_s: float,
        dt_s: float,
        pulses_s: list[float],
        current_A: FloatArray | None = None,
    ) -> bytes:
        """Sample one slice.

        Args:
            signal: the measured quantity (SI) at `start_s + dt_s`, `start_s + 2 dt_s` ..., shape (n,).
            start_s: simulated time before the first value (s).
            dt_s: plant step (s).
            pulses_s: simulated times (s) of the controller's pulses in this slice.
            current_A: the coil's current at the same instants, shape (n,), for crosstalk; None where there is none.

        Returns:
            The bytes that leave the line up to the slice's end: whole frames, unless a fault damages them.
        """
        if not self._started and len(signal):
            self._filter[:] = (signal[0], 0.0, signal[0], signal[0])
            self._delay = DelayLine(self.options.skew_s, dt_s)
            self._started = True
        if self._delay is not None and self.options.skew_s > 0.0:
            signal = self._delay.delayed(signal)
        end_s = start_s + len(signal) * dt_s
        options = self.options
        draws, device_us, nominal_s, times_s = self._instants(end_s)
        value = np.empty(len(times_s)) if len(times_s) else _NOTHING
        signal = np.ascontiguousarray(signal)  # as in `ControllerInput.take`
        condition(signal, dt_s, 2.0 * math.pi * options.bandwidth_Hz, self._filter, start_s, times_s, value)
        if len(value) or pulses_s:
            status = self._imperfect(value, draws, self._disturbance(times_s, start_s, dt_s, current_A))
            if len(value) and nominal_s[-1] >= options.numbers_until_s:
                value[nominal_s >= options.numbers_until_s] = math.nan
            self._queue(*self._encode(value, status, device_us, nominal_s, pulses_s))
        return self._damage(self._released(end_s))

    def _instants(self, end_s: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Draws (n, 2), device clock (us), nominal and true times (s), each (n,), of the slice's samples."""
        first, clock, requests = self._tick, self.clock, self.requests
        if requests and math.isfinite(requests[0]):
            times_s = np.array(requests)
            requests.clear()
            draws = self._random.standard_normal((len(times_s), 2))
            return draws, np.array([clock.unwrapped_us(time_s) for time_s in times_s]), times_s, times_s
        count = self._count_due(end_s)
        if requests is not None:
            first, count = first + max(0, count - len(requests)), min(count, len(requests))
            del requests[:count]
        if not count:
            return _NO_DRAWS, _NOTHING, _NOTHING, _NOTHING
        draws = self._random.standard_normal((count, 2))
        clocks = np.empty((3, count))
        sampling(first, self._period_us, clock.offset_us, 1e6 + clock.ppm, self.options.jitter_s, draws, clocks)
        return draws, clocks[0], clocks[1], clocks[2]

    def _disturbance(
        self, times_s: FloatArray, start_s: float, dt_s: float, current_A: FloatArray | None
    ) -> FloatArray:
        """What creeps or is induced into the signal at the sampling times (n,), wire unit, shape (n,) or (0,)."""
        options = self.options
        if not (options.drift_per_s or options.hum or options.crosstalk_per_A):
            return _NOTHING
        added = options.drift_per_s * times_s + options.hum * np.sin(2.0 * math.pi * options.hum_Hz * times_s)
        if options.crosstalk_per_A and current_A is not None and len(current_A):
            steps_s = start_s + dt_s * np.arange(1, len(current_A) + 1)
            added += options.crosstalk_per_A * np.interp(times_s, steps_s, current_A)
        return np.asarray(added)

    def _count_due(self, end_s: float) -> int:
        """How many of the sensor clock's ticks have their sample, jitter included, before `end_s`; they are taken."""
        latest_s = end_s - LARGEST_JITTER * self.options.jitter_s
        after = math.floor(self.clock.unwrapped_us(latest_s) / self._period_us) + 1
        count = max(0, after - self._tick)
        self._tick += count
        return count

    def _imperfect(self, value: FloatArray, draws: FloatArray, disturbance: FloatArray) -> NDArray[np.uint8]:
        """Clean SI values (n,) become wire values in place; returns their status bits (n,).

        Args:
            value: filtered values (n,).
            draws: unit noise, in the first of two columns.
            disturbance: shape (n,), wire unit, or empty.
        """
        options, faults = self.options, self.faults
        scale = (-1.0 if options.reversed else 1.0) * options.gain * options.wire_per_si
        bias = options.offset + faults.zero_offset
        amplify(value, draws, disturbance, scale, options.noise, bias, options.resolution, options.clip)
        if faults.stuck and len(value):
            value[:] = self._last_value if math.isfinite(self._last_value) else value[0]
        if faults.saturated:
            value[:] = math.inf
        if faults.spikes:
            value[self._spiked(len(value))] += SPIKE_SHARE * options.range
        status: NDArray[np.uint8] = limit(
            value, options.range, STATUS_OVERLOAD, STATUS_SENSOR_FAULT if faults.sensor_fault else 0
        )
        if len(value):
            self._last_value = float(value[-1])
        if faults.not_a_number:
            every = max(1, round(NAN_EVERY_S * options.rate_Hz))
            value[self._numbers("not_a_number", len(value)) % every == 0] = math.nan
        return status

    def _spiked(self, count: int) -> NDArray[np.bool_]:
        """Mask (count,) of the samples in spikes."""
        every = max(SPIKE_SAMPLES + 1, round(SPIKE_EVERY_S * self.options.rate_Hz))
        spike, sample = np.divmod(self._numbers("spikes", count), every)
        return np.asarray(sample < np.where(spike < SINGLE_SPIKES, 1, SPIKE_SAMPLES))

    def _numbers(self, fault: str, count: int) -> NDArray[np.int64]:
        """Numbers (count,) of the samples to come, 0 for the first one with this fault."""
        return self.samples + np.arange(count) - self._first_faulty.setdefault(fault, self.samples)

    def _encode(
        self,
        value: FloatArray,
        status: NDArray[np.uint8],
        device_us: FloatArray,
        time_s: FloatArray,
        pulses_s: list[float],
    ) -> tuple[Bytes, FloatArray]:
        """Frames (n, size) and the simulated times (n,) they are finished at."""
        count, keep, latches = len(value), None, bool(pulses_s) and self.options.latches_edges
        if self.options.format == "frame16" and not (latches or self.faults.gaps or self.faults.time_backwards):
            self.samples += count
            return encode_samples(status, self.edges, self.samples - count, device_us, value), time_s
        sequence = np.arange(self.samples, self.samples + count)
        if self.faults.gaps:
            every = max(GAP_SAMPLES + 1, round(GAP_EVERY_S * self.options.rate_Hz))
            keep = self._numbers("gaps", count) % every >= GAP_SAMPLES
        self.samples += count
        if self.options.format != "frame16":
            kept = slice(None) if keep is None else keep
            return self._written(value, status, sequence, np.floor(device_us).astype(np.int64))[kept], time_s[kept]
        stamp_us = np.floor(device_us).astype(np.int64)
        if self.faults.time_backwards:
            stamp_us = np.where(self._backwards(sequence), stamp_us - 50_000, stamp_us)
        columns = [status, np.array([self.edges]).repeat(count), sequence, stamp_us]
        if latches:
            value, time_s, columns, keep = self._with_edges(value, time_s, columns, keep, pulses_s)
        if keep is not None:
            columns, value, time_s = [column[keep] for column in columns], value[keep], time_s[keep]
        return encode_frames(*columns, value), time_s

    def _written(
        self, value: FloatArray, status: NDArray[np.uint8], sequence: NDArray[np.int64], stamp_us: NDArray[np.int64]
    ) -> Bytes:
        """Lines or frames (n, size) of a format that is not our own frame."""
        if self._writer is None:
            return encode_lines(value, self.options.unit)
        if not len(value):
            return np.zeros((0, self.frame_size), np.uint8)
        return self._writer(value + self.options.wire_zero, status, sequence, stamp_us)

    def _backwards(self, sequence: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.equal(sequence % max(2, round(GAP_EVERY_S * self.options.rate_Hz)), 1)

    def _with_edges(
        self,
        value: FloatArray,
        time_s: FloatArray,
        columns: list[NDArray[Any]],
        keep: NDArray[np.bool_] | None,
        pulses_s: list[float],
    ) -> tuple[FloatArray, FloatArray, list[NDArray[Any]], NDArray[np.bool_] | None]:
        """The same columns with an edge frame put in for every pulse; its sequence repeats the last sample's."""
        for pulse_s in pulses_s:
            columns[1][time_s >= pulse_s] += 1
        at = np.searchsorted(time_s, pulses_s)
        first = self.samples - len(value)
        stamps = [math.floor(self.clock.unwrapped_us(pulse_s)) for pulse_s in pulses_s]
        counts = [self.edges + 1 + i for i in range(len(pulses_s))]
        inserted = [[STATUS_EDGE] * len(pulses_s), counts, [max(0, first + int(i) - 1) for i in at], stamps]
        columns = [np.insert(column, at, new) for column, new in zip(columns, inserted, strict=True)]
        self.edges += len(pulses_s)
        keep = None if keep is None else np.insert(keep, at, True)
        return np.insert(value, at, 0.0), np.insert(time_s, at, pulses_s), columns, keep

    def _next_burst(self, after_s: float) -> float:
        """When the line next holds everything back (simulated s)."""
        if self.options.burst_rate_Hz <= 0:
            return math.inf
        return after_s + float(self._line_random.exponential(1.0 / self.options.burst_rate_Hz))

    def _queue(self, frames: Bytes, finished_s: FloatArray) -> None:
        """Put frames on the line: latency for each, bursts for those inside one, never overtaking."""
        if not len(frames):
            return
        release_s = finished_s + self.options.latency_s
        while self._burst_s <= finished_s[-1]:
            held = (finished_s >= self._burst_s) & (finished_s < self._burst_s + self.options.burst_s)
            release_s[held] = np.maximum(release_s[held], self._burst_s + self.options.burst_s)
            if finished_s[-1] < self._burst_s + self.options.burst_s:
                break
            self._burst_s = self._next_burst(self._burst_s + self.options.burst_s)
        self._waiting = np.concatenate((self._waiting, frames)) if len(self._waiting) else frames
        joined = np.concatenate((self._release_s, release_s)) if len(self._release_s) else release_s
        self._release_s = np.maximum.accumulate(joined)

    def _released(self, now_s: float) -> bytes:
        count = int(self._release_s.searchsorted(now_s, side="right")) if len(self._release_s) else 0
        if not count:
            return b""
        rows = self._waiting[:count]
        data = rows.tobytes() if self._writer is None else self._writer.joined(rows)
        self._waiting, self._release_s = self._waiting[count:], self._release_s[count:]
        return data

    def _damage(self, data: bytes) -> bytes:
        """Line faults: flipped and lost bytes, or every byte garbled as by a wrong baud rate."""
        if not data or not (self.faults.garbage or self.faults.wrong_baud):
            return data
        raw = np.frombuffer(data, np.uint8).copy()
        if isinstance(self._writer, FrameWriter) and self._writer.is_on_CAN:
            return self._damaged_messages(raw.reshape(-1, self.frame_size))
        if self.faults.wrong_baud:
            return self._line_random.integers(0, 256, len(raw), dtype=np.uint8).tobytes()
        hit = self._line_random.random(len(raw)) < GARBLED_SHARE
        raw[hit] ^= self._line_random.integers(1, 256, int(hit.sum()), dtype=np.uint8)
        lost = self._line_random.random(len(raw)) < GARBLED_SHARE / 4.0
        return raw[~lost].tobytes()

    def _damaged_messages(self, rows: Bytes) -> bytes:
        """Damage frames on CAN: wrong lengths or missing frames, because CAN controllers discard damaged frames."""
        if self.faults.wrong_baud:
            return b""
        hit = self._line_random.random(len(rows)) < GARBLED_SHARE * rows.shape[1]
        rows[hit, 0] //= 2
        return rows.tobytes()
