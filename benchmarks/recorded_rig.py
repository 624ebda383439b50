"""The simulated rig recorded in one process: the plant, clocks and sensors of `simulators`, without sockets.

Physics, sensors' frames, their decoder, the controller's status and the arrival order are the simulated rig's own; only
the wires between the processes are left out. A point takes a fraction of a second: hundreds of settings are possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.ring import Channel
from drivers.roles import Input, ProgramPhase
from drivers.sample_stream import SampleScale, SampleStream
from protocols.frame_format import FrameDecoder
from rig.recording.conversion.conversion import build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import PointContext, SensorContext
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.test_point import TestPoint
from simulators.clock import DeviceClock
from simulators.conditioner import group_delay_s
from simulators.options import RigOptions
from simulators.plant.plant import Plant
from simulators.plant.records import EVENT_PULSE, MODE_MOVE, MODE_PROGRAM
from simulators.plant.step import CURRENT, DISPLACEMENT, FORCE
from simulators.sensor import Sensor

BOOT_NS = 10**15
SETTLING_S = 0.8
POLL_S = 0.010
MOVE_SPEED_M_S = 0.05


@dataclass(frozen=True)
class Truth:
    """What the plant did: controller clock (s), force (N) and displacement (m), (n,) at the plant's steps."""

    controller_s: np.ndarray
    force_N: np.ndarray
    displacement_m: np.ndarray


@dataclass
class RecordedRig:
    """A rig whose points are recorded one after the other.

    Attributes:
        options: the rig.
        speed: rate of its clocks against the wall, which sets how often it is polled.
        seed: of clocks, noise and latencies.
        wake_up_s: mean delay of the host before it stamps what has arrived (wall s).
        declares_input_delay: the bench says that the controller's own inputs can be relied on.
        declared_delays_s: what the bench says of the sensors' delays; None: their filters' true group delay.
        poll_s: period of the host's polls (wall s).
    """

    options: RigOptions
    speed: float = 1.0
    seed: int = 0
    wake_up_s: float = 1e-4
    declares_input_delay: bool = True
    declared_delays_s: tuple[float, float] | None = None
    poll_s: float = POLL_S

    def __post_init__(self) -> None:
        self.random = np.random.default_rng((self.seed, 77))
        self.plant = Plant(self.options)
        draws = iter(self.random.spawn(8))
        controller = self.options.controller
        self.clock = DeviceClock.drawn(controller.clock_offset_us, controller.clock_ppm, next(draws))
        self.ecu_clock = DeviceClock.drawn(math.nan, math.nan, next(draws))
        self.sensors, self.streams = [], []
        for options, channel, scale in (
            (self.options.load_cell, Channel.FORCE, 1.0), (self.options.lvdt, Channel.DISPLACEMENT, 1e-3),
        ):
            clock = DeviceClock.drawn(options.clock_offset_us, options.clock_ppm, next(draws))
            self.sensors.append(Sensor(options, clock, next(draws), 0.0))
            self.streams.append(SampleStream(
                FrameDecoder(), channel, SampleScale(scale, rate_Hz=options.rate_Hz, device_rate=self.speed),
            ))
        self.pulses = 0
        self.pulse_us = 0.0
        self._arrived_ns: dict[int, int] = {}

    def run_point(self, point: dict[str, Any], folder: Path) -> tuple[RecordedPoint, Truth]:
        """Run one sine or triangle point, record, align, judge and write it; returns it read back, and the truth."""
        records, truth = self.run_program(point)
        content = JournalContent("", records, end={"stopped_by": None, "lost_records": 0})
        file, _ = build(content, self.context(point))
        path = folder / f"{point['id']}.h5"
        write_file(path, file)
        return RecordedPoint.open(path), truth

    def run_program(self, point: dict[str, Any]) -> tuple[np.ndarray, Truth]:
        """Move to a point's centre and run its program; returns the ring's records, by arrival, and the truth."""
        self.plant.order(
            pressure=2, mode=MODE_MOVE, target_m=point["centre_m"], move_speed_m_s=MOVE_SPEED_M_S,
            coil_A=point["current_A"], position_min_m=-1.0, position_max_m=1.0,
            speed_max_m_s=9.0, acceleration_max_m_s2=1e4, force_max_N=1e6, following_error_max_m=1.0,
        )
        self._advance(SETTLING_S)
        records: list[Any] = []
        truth: list[np.ndarray] = []
        self._advance(0.2, records, truth)
        for name in ("program_step", "phase_cycles", "cycles_done"):
            self.plant.state[name] = 0
        whole = point["cycles"] + point["ramp_in_cycles"] + point["ramp_out_cycles"]
        self.plant.order(
            mode=MODE_PROGRAM, waveform=1 if point["waveform"] == "triangle" else 0, amplitude_m=point["amplitude_m"],
            frequency_Hz=point["frequency_Hz"], centre_m=point["centre_m"], full_cycles=point["cycles"],
            ramp_in_cycles=point["ramp_in_cycles"], ramp_out_cycles=point["ramp_out_cycles"],
        )
        # The host's polls know nothing of the program's beginning: it lies anywhere between two of them.
        self._slice(int(self.random.integers(1, self._poll_steps + 1)), records, truth)
        self._advance(whole / point["frequency_Hz"] + 0.2, records, truth)
        found = np.array(records, RECORD_DTYPE)
        return found[np.argsort(found["host_ns"], kind="stable")], Truth(*np.concatenate(truth).T)

    def context(self, point: dict[str, Any]) -> PointContext:
        """What the bench file and the matrix say of a point."""
        cell, lvdt = self.options.load_cell, self.options.lvdt
        delays = self.declared_delays_s or (group_delay_s(cell.bandwidth_Hz), group_delay_s(lvdt.bandwidth_Hz))
        inputs_s = group_delay_s(self.plant.position_input.options.bandwidth_Hz)
        return PointContext(
            point=TestPoint(**point),
            sensors={
                "force": SensorContext("load_cell", cell.rate_Hz, delays[0], cell.range, "N"),
                "displacement": SensorContext("lvdt", lvdt.rate_Hz, delays[1], 1e-3 * lvdt.range, "m"),
            },
            device_rate=self.speed, controller_delay_s=inputs_s if self.declares_input_delay else None,
            mid_stroke_m=0.0, simulated=True, provenance={"bench_hash": str(self.seed)},
        )

    @property
    def _poll_steps(self) -> int:
        """Steps of the plant from one poll to the next."""
        return max(1, round(self.poll_s * self.speed / self.plant.dt_s))

    def _advance(self, seconds: float, records: list[Any] | None = None, truth: list[np.ndarray] | None = None) -> None:
        """Advance the plant, poll by poll; keep what arrives where a list is given."""
        for _ in range(math.ceil(seconds / (self._poll_steps * self.plant.dt_s))):
            self._slice(self._poll_steps, records, truth)

    def _slice(self, steps: int, records: list[Any] | None, truth: list[np.ndarray] | None) -> None:
        """Advance the plant by so many steps and poll."""
        start_s = self.plant.time_s
        pulses = [time_s for time_s, kind, _ in self.plant.advance(steps) if kind == EVENT_PULSE]
        out, now_s = self.plant.out, self.plant.time_s
        for sensor, stream, column in zip(self.sensors, self.streams, (FORCE, DISPLACEMENT), strict=True):
            self._receive(sensor, stream, out[:, column], out[:, CURRENT], start_s, pulses, records)
        if pulses:
            self.pulses += len(pulses)
            self.pulse_us = self.clock.unwrapped_us(pulses[-1])
        if records is not None:
            self._status(now_s, records)
        if truth is not None:
            time_s = start_s + self.plant.dt_s * np.arange(1, len(out) + 1)
            controller_s = 1e-6 * (self.clock.offset_us + (1e6 + self.clock.ppm) * time_s)
            truth.append(np.column_stack((controller_s, out[:, FORCE], out[:, DISPLACEMENT])))

    def _receive(
        self, sensor: Sensor, stream: SampleStream, signal: np.ndarray, current_A: np.ndarray, start_s: float,
        pulses: list[float], records: list[Any] | None,
    ) -> None:
        """Bytes of a slice in pieces of 2 wall milliseconds, each stamped when it has arrived."""
        piece = max(1, round(0.002 * self.speed / self.plant.dt_s))
        for first in range(0, len(signal), piece):
            part = signal[first : first + piece]
            begin_s = start_s + first * self.plant.dt_s
            end_s = begin_s + len(part) * self.plant.dt_s
            due = [time_s for time_s in pulses if time_s <= end_s or first + piece >= len(signal)]
            pulses = [time_s for time_s in pulses if time_s not in due]
            data = sensor.sample(part, begin_s, self.plant.dt_s, due, current_A[first : first + piece])
            if data:
                # A port gives its bytes in their order, however late the host looks.
                arrival_ns = max(self._host_ns(end_s), self._arrived_ns.get(id(stream), 0))
                self._arrived_ns[id(stream)] = arrival_ns
                batch = stream.take(data, arrival_ns)
                if records is not None:
                    records.extend(tuple(record) for record in batch.records)

    def _status(self, now_s: float, records: list[Any]) -> None:
        host_ns = self._host_ns(now_s)
        device_us = math.floor(self.clock.unwrapped_us(now_s))
        position_m, force_N = (given.read(self.random) for given in (self.plant.position_input, self.plant.force_input))
        ecu_us = math.floor(self.ecu_clock.unwrapped_us(now_s))
        current_A = self.plant.value("current_A") + self.options.coil.current_noise_A * self.random.standard_normal()
        records += [
            (host_ns, device_us, position_m, 0, Channel.POSITION, 0),
            (host_ns, device_us, force_N, 0, Channel.CONTROLLER_FORCE, 0),
            (host_ns, ecu_us, current_A, 0, Channel.COIL_CURRENT, 0),
            (host_ns, -1, self.plant.value("coil_degC"), 0, Channel.COIL_TEMPERATURE, 0),
            (host_ns, device_us, float(self._phase()), 0, Channel.PHASE, 0),
            (host_ns, device_us, self.plant.value("setpoint_m") - self.plant.value("position_m"), 0,
             Channel.SERVO_ERROR, 0),
            (host_ns, device_us, float(Input.VALVE_SATURATED) if self.plant.value("saturated") else 0.0, 0,
             Channel.INPUTS, 0),
        ]
        if self.pulses:
            records.append((host_ns, math.floor(self.pulse_us), self.pulses % 65536, self.pulses, Channel.PULSE, 0))

    def _phase(self) -> ProgramPhase:
        command, done = self.plant.command, self.plant.value("phase_cycles")
        if int(command["mode"][0]) != MODE_PROGRAM:
            return ProgramPhase.IDLE
        ramp_in = float(command["ramp_in_cycles"][0])
        if done < ramp_in:
            return ProgramPhase.RAMP_IN
        full = done < ramp_in + float(command["full_cycles"][0])
        return ProgramPhase.FULL_AMPLITUDE if full else ProgramPhase.RAMP_OUT

    def _host_ns(self, time_s: float) -> int:
        return BOOT_NS + round(1e9 * (time_s / self.speed + self.random.exponential(self.wake_up_s)))
