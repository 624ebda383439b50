"""What the station would have put into the ring for one sine point, from a known truth with its own clocks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.ring import Channel, RingWriter
from rig.recording.layout import PointContext, SensorContext
from rig.recording.ring_records import RECORD_DTYPE
from rig.test_point import TestPoint


@dataclass(frozen=True)
class SyntheticRig:
    """One sine test point of a linear damper, `F = damping v + stiffness u`, sampled by devices with their own clocks.

    All times in seconds of the controller's clock unless named otherwise; latencies are seconds from sample to arrival.
    """

    amplitude_m: float = 0.02
    frequency_Hz: float = 1.0
    current_A: float = 0.5
    cycles: int = 4
    rate_Hz: float = 250.0
    force_ppm: float = 80.0
    displacement_ppm: float = -120.0
    force_offset_s: float = 17.25
    displacement_offset_s: float = 903.5
    force_latency_s: float = 0.0035
    displacement_latency_s: float = 0.0015
    jitter_s: float = 0.001
    edges: bool = True
    device_clocks: bool = True
    lost: tuple[int, ...] = ()
    noise_N: float = 0.0
    seed: int = 1
    damping: float = 2000.0
    stiffness: float = 5000.0

    @property
    def start_s(self) -> float:
        """Controller clock when the programme starts."""
        return 100.0

    @property
    def length_s(self) -> float:
        """Duration of the programme with one ramp cycle on each side."""
        return (self.cycles + 2) / self.frequency_Hz

    def phase(self, time_s: np.ndarray) -> np.ndarray:
        return np.clip((time_s - self.start_s) * self.frequency_Hz, 0.0, self.cycles + 2.0)

    def envelope(self, time_s: np.ndarray) -> np.ndarray:
        phase = self.phase(time_s)
        return np.clip(np.minimum(phase, self.cycles + 2.0 - phase), 0.0, 1.0)

    def displacement(self, time_s: np.ndarray) -> np.ndarray:
        return self.amplitude_m * self.envelope(time_s) * np.sin(2 * np.pi * self.phase(time_s))

    def force(self, time_s: np.ndarray) -> np.ndarray:
        step = 1e-5
        velocity = (self.displacement(time_s + step) - self.displacement(time_s - step)) / (2 * step)
        return self.damping * velocity + self.stiffness * self.displacement(time_s)

    def sensor(self, channel: Channel) -> np.ndarray:
        rng = np.random.default_rng((self.seed, int(channel)))
        is_force = channel == Channel.FORCE
        ppm, offset = (self.force_ppm, self.force_offset_s) if is_force else (
            self.displacement_ppm, self.displacement_offset_s)
        latency = self.force_latency_s if is_force else self.displacement_latency_s
        count = int((self.length_s + 1.0) * self.rate_Hz)
        local_s = offset + np.arange(count) / self.rate_Hz
        time_s = self.start_s - 0.5 + (local_s - offset) / (1 + 1e-6 * ppm) + (0.0 if is_force else 0.0013)
        records = np.zeros(count, RECORD_DTYPE)
        records["host_ns"] = np.round(1e9 * np.maximum.accumulate(
            time_s + latency + self.jitter_s * rng.exponential(1.0, count)))
        records["device_us"] = np.floor(1e6 * local_s) if self.device_clocks else -1
        records["value"] = self.force(time_s) if is_force else self.displacement(time_s)
        if is_force:
            records["value"] += self.noise_N * rng.standard_normal(count)
        records["sequence"] = (np.arange(count) + 4294967000) % (1 << 32)
        records["channel"] = channel
        if is_force and self.lost:
            keep = np.setdiff1d(np.arange(count), self.lost)
            after = np.flatnonzero(np.diff(keep) > 1) + 1
            records = records[keep]
            records["flags"][after] = 4
        return records

    def local_us(self, channel: Channel, time_s: np.ndarray) -> np.ndarray:
        is_force = channel == Channel.FORCE
        ppm, offset = (self.force_ppm, self.force_offset_s) if is_force else (
            self.displacement_ppm, self.displacement_offset_s)
        start = self.start_s - 0.5 + (0.0 if is_force else 0.0013)
        return np.floor(1e6 * (offset + (time_s - start) * (1 + 1e-6 * ppm)))

    def pulses(self) -> list[np.ndarray]:
        number = np.arange(self.cycles + 3)
        time_s = self.start_s + number / self.frequency_Hz
        counted = 65530 + number
        found = []
        for channel, clock_us, value, sequence, late in (
            (Channel.PULSE, np.floor(1e6 * time_s), counted % 65536, counted, 0.008),
            (Channel.FORCE_EDGE, self.local_us(Channel.FORCE, time_s), 0 * counted, counted % 256 + 256, 0.004),
            (Channel.DISPLACEMENT_EDGE, self.local_us(Channel.DISPLACEMENT, time_s), 0 * counted, counted % 256, 0.002),
        ):
            if channel != Channel.PULSE and not self.edges:
                continue
            records = np.zeros(len(number), RECORD_DTYPE)
            records["host_ns"], records["device_us"] = np.round(1e9 * (time_s + late)), clock_us
            records["value"], records["channel"] = value, channel
            # Edge counts are unwrapped by the station from the first one it saw.
            records["sequence"] = sequence[0] + number
            found.append(records)
        return found

    def status(self, channel: Channel, value: float, rate_Hz: float, clock_offset_s: float, seed: int) -> np.ndarray:
        rng = np.random.default_rng((self.seed, seed))
        time_s = self.start_s - 0.6 + np.arange(int((self.length_s + 1.2) * rate_Hz)) / rate_Hz
        records = np.zeros(len(time_s), RECORD_DTYPE)
        arrival_s = time_s + 0.0003 + 2e-4 * rng.exponential(1.0, len(time_s))
        records["host_ns"] = np.round(1e9 * np.maximum.accumulate(arrival_s))
        records["device_us"] = np.floor(1e6 * (time_s + clock_offset_s))
        records["value"], records["channel"] = value, channel
        return records

    def records(self) -> np.ndarray:
        """Everything the ring would have seen, in the order of arrival."""
        temperature = self.status(Channel.COIL_TEMPERATURE, 25.0, 10.0, 0.0, 3)
        temperature["device_us"] = -1
        parts = [
            self.sensor(Channel.FORCE), self.sensor(Channel.DISPLACEMENT), *self.pulses(),
            self.status(Channel.POSITION, 0.0, 100.0, 0.0, 1),
            self.status(Channel.COIL_CURRENT, self.current_A, 100.0, -42.0, 2), temperature,
        ]
        records = np.concatenate(parts)
        return records[np.argsort(records["host_ns"], kind="stable")]

    def context(self, **changes: object) -> PointContext:
        """The journal's header for this point."""
        fields: dict = {
            "point": TestPoint(
                "p001", "sine", self.amplitude_m, self.frequency_Hz, self.current_A, self.cycles, ramp_in_cycles=1.0,
                ramp_out_cycles=1.0, centre_m=0.0, repeat=1, rest_s=0.0,
            ),
            "sensors": {
                "force": SensorContext("load_cell", self.rate_Hz, range_SI=10_000.0, serial_number="LC-1"),
                "displacement": SensorContext("lvdt", self.rate_Hz, range_SI=0.1, serial_number="LVDT-1"),
            },
            "mid_stroke_m": 0.0, "simulated": True, "provenance": {"bench": "synthetic"},
        }
        return PointContext(**{**fields, **changes})

    def play(self, path: Path) -> RingWriter:
        """A ring into which `records` can be put with `write`."""
        return RingWriter(path, 1 << 16)


def put(ring: RingWriter, records: np.ndarray) -> None:
    """Append records to a ring as the station does."""
    ring.append([tuple(record) for record in records.tolist()])


def with_controller_record(rig: SyntheticRig, force_lag_s: float) -> np.ndarray:
    """The rig's records, the controller's own position and force among them; force lags by `force_lag_s` more."""
    late = rig.sensor(Channel.FORCE)
    time_s = rig.start_s - 0.5 + np.arange(len(late)) / rig.rate_Hz / (1 + 1e-6 * rig.force_ppm)
    late["value"] = rig.force(time_s - force_lag_s)
    position, coarse = (rig.status(channel, 0.0, 100.0, 0.0, 1) for channel in (Channel.POSITION, 32))
    clock_s = position["device_us"] * 1e-6
    noise = np.random.default_rng(rig.seed).standard_normal((2, len(clock_s)))
    position["value"] = rig.displacement(clock_s) + 10e-6 * noise[0]
    coarse["value"] = rig.force(clock_s) + 10.0 * noise[1]
    others = rig.records()
    others = others[~np.isin(others["channel"], (1, 20))]
    records = np.concatenate((late, position, coarse, others))
    return records[np.argsort(records["host_ns"], kind="stable")]
