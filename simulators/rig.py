"""The simulated rig: plant, devices and transports in one asyncio loop."""

from __future__ import annotations

import asyncio
import dataclasses
import gc
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.roles import State
from protocols.binary_format import BinaryFormat, Registers
from rig.clock import monotonic_ns
from rig.dampers.catalogue import KINDS, NO_KIND
from simulators import bench
from simulators.actuator import Actuator
from simulators.bench import Addresses, actuator_timeout_s, bench_text, least_stale_s, poll_ms, waits_for_host
from simulators.can_sensor_port import CanSensorPort
from simulators.channel import Channel
from simulators.clock import DeviceClock, ServedTime
from simulators.ecu import Ecu
from simulators.emulated_bench import actuator_lines
from simulators.emulated_ecu import DEMO_ECU, EmulatedEcuFiles
from simulators.faulty import Undo
from simulators.injection import INJECTORS, VARIANTS
from simulators.modbus_box import ModbusBox
from simulators.modbus_server import LinkFaults, ModbusServer
from simulators.named_port import NamedPort
from simulators.options import RigOptions, SensorOptions
from simulators.output_module import SimulatedOutput
from simulators.pace import Backpressure, Pace
from simulators.plant import step as plant_step
from simulators.plant.plant import MAXIMUM_STEPS
from simulators.plant.records import EVENT_PULSE, EVENT_TRIP
from simulators.plant.transfer import plant_of
from simulators.registers import registers_of
from simulators.schedule import BY_ID, ScheduledFault
from simulators.sensor import Sensor
from simulators.serial_port import CAPACITY, SensorPort, open_port
from simulators.shared_clock import SharedClock
from simulators.slcan_bus import SlcanBus
from simulators.supply import simulated_supply
from simulators.truth import About, Attribute, Truth

TICK_S = 0.002
HOLDING_S = 0.0005
LONGEST_SLICE_S = 0.02
"""A rig that is held up for longer (wall s) takes what arrives as if it came then."""
"""While the clock waits for a reader, it looks so often whether it has read."""
BEHIND_S = 0.003
"""What a device sends in so much wall time may wait to be read above speed 1; below, half of what a port holds."""
FEWEST_FRAMES = 4
CAN_LINES_BYTES_S = 2700.0
"""Bytes of the ECU's lines in one second of its clock; those of sensors on the bus are added."""
SENSOR_LINE_BYTES = 27
"""Bytes of one sensor frame on the bus."""
BUS_BYTES = 512
POLLS_LATE = 2.5
IDLE_S = 0.5
STANDSTILL_M_S = 5e-4
NO_CURRENT_A = 0.05
REAL_TIME_PRIORITY = 20
NO_FAULTS = LinkFaults()
LATE_SHARE = 1.5
"""A late answer comes after this many of the host's time-outs."""


@dataclass(frozen=True)
class RunOptions:
    """How a simulated rig runs, beside what it is made of (`RigOptions`)."""

    speed: float = 1.0
    seed: int = 0
    ports: str = "pty"
    actuator: str = "tcp"
    supply: str | Mapping[str, Any] = ""
    by_hand: str = ""
    """The coil's current by a supply in place of the ECU; by hand: the pressure while its knob is turned."""
    supply_line: str = ""
    """`SensorOptions.line` of the Modbus sensors whose device contains the analogue output."""
    auxiliary: int = 0
    auxiliaries: tuple[SensorOptions, ...] = ()
    """Auxiliary channels that are not all alike, in place of so many of `RigOptions.auxiliary`."""
    truth: Path | None = None
    exit_when_idle: bool = False
    emulated_ecu: EmulatedEcuFiles = DEMO_ECU
    """What describes the current ECU."""
    drop_unread: bool = False
    """The ports drop what the host has not read in time, as real ones do; the rig's clock does not wait."""
    faults: tuple[ScheduledFault, ...] = ()


class SimulatedRig:
    """Everything between the physics and the open sockets.

    Attributes:
        plant, actuator, bank, ecu, bus, modbus, channels: the parts; fault injectors reach into them.
        addresses: where the sockets are, after `open`.
        first_cycle_s: simulated time at which the first program began (s), None before.
    """

    def __init__(self, options: RigOptions, run: RunOptions) -> None:
        self.options = options
        self.run_options = run
        self.plant = plant_of(options)
        self.truth = Truth(run.truth, self.plant, options.truth_rate_Hz) if run.truth is not None else None
        self._draws = iter(np.random.default_rng(run.seed).spawn(24))
        controller, coil = options.controller, options.coil
        self.actuator = Actuator(
            self.plant, controller,
            DeviceClock.drawn(controller.clock_offset_us, controller.clock_ppm, next(self._draws)), self.note,
        )
        self.bank = registers_of(self.actuator, options, next(self._draws))
        self.ecu = Ecu(
            self.plant, coil, options.damper.ambient_degC,
            DeviceClock.drawn(coil.clock_offset_us, coil.clock_ppm, next(self._draws)), next(self._draws), self.note,
            run.emulated_ecu.load(),
        )
        self.bus = SlcanBus(self.ecu.receive)
        if self.ecu.wire.requested:
            self.bus.listeners.append(self._hear_request)
        self.supply = simulated_supply(self.ecu, run.supply, coil.serial_number)
        rtu = run.actuator == "rtu"
        self.modbus = ModbusServer(
            self.bank, controller.device_id, rtu=rtu, pty=rtu and run.ports != "socket",
            before_access=self._catch_up if not controller.generator else lambda: None,
        )
        self.channels: list[Channel] = []
        self._can_bytes_s = CAN_LINES_BYTES_S
        self._boxes: list[tuple[tuple[str, bool], ModbusBox]] = []
        self.first_cycle_s: float | None = None
        self._names: tempfile.TemporaryDirectory[str] | None = None
        self.every_tick: list[Callable[[], None]] = []
        self._pending_faults = list(run.faults)
        self._undoings: list[tuple[float, str, Undo]] = []
        self._served = ServedTime()
        self._shared: SharedClock | None = None
        self._shared_path: Path | None = None
        self._pace = Pace(run.speed, self.plant.dt_s, TICK_S, MAXIMUM_STEPS)
        self.actuator.arrival_s = self._arrival_s
        self._backpressure = Backpressure()
        self._waited_s = self._busy_s = self._before_s = 0.0
        self._faulty = False
        self._goes_on = self._behind = False
        self._stopping = False
        self._parent = os.getppid()
        self._idle_since_ns = -1

    def warm_up(self) -> None:
        """Compile, or load from the cache, everything the loop calls, before any clock runs."""
        self.plant.advance(1)
        options = SensorOptions(rate_Hz=self.options.plant_rate_Hz)
        sensor = Sensor(options, DeviceClock(0.0, 0.0), np.random.default_rng(0), 0.0)
        for signal in (np.zeros(16), np.zeros((16, 2))[:, 0]):
            sensor.sample(signal, 0.0, self.plant.dt_s, [])

    async def open(self) -> Addresses:
        """Open every socket and port; returns where they are.

        Raises:
            OSError: a socket cannot be had.
        """
        await self.modbus.open()
        await self.bus.open()
        kind, options = self.run_options.ports, self.options
        self._add("load_cell", options.load_cell, plant_step.FORCE, kind)
        self._add("lvdt", options.lvdt, plant_step.DISPLACEMENT, kind)
        auxiliaries = (options.auxiliary,) * self.run_options.auxiliary
        for number, auxiliary in enumerate(self.run_options.auxiliaries or auxiliaries, start=1):
            self._add(f"auxiliary_{number}", auxiliary, plant_step.DISPLACEMENT, kind)
        await self._open_supply()
        self._inject_due()
        urls = [channel.port.url for channel in self.channels]
        supply_url = "" if self.supply is None else self.supply.url
        return Addresses(self.modbus.url, self.bus.port, urls[0], urls[1], urls[2:], supply_url)

    def share_clock(self, path: Path, addresses: Addresses) -> None:
        """From now on the rig's clock waits for the processes that watch it, and they read it in this file.

        Raises:
            OSError: it cannot be made.
        """
        self._shared = SharedClock(path, addresses.listed, monotonic_ns(), fast=self.run_options.speed > 1.0)
        self._shared_path = path

    def bench(self, addresses: Addresses, real_time: bool) -> str:
        """The text of the bench file.

        Time limits are those of the hardware when this rig runs in real time with real-time rights; otherwise they are
        widened, the ECU's own command time-out with them, since every answer then waits for other processes.

        Args:
            addresses: the open ports.
            real_time: whether this process has real-time priority at speed 1.
        """
        speed = self.run_options.speed
        relaxed = not real_time or speed > 1.0
        waits = waits_for_host(speed, self._shared_path)
        self.modbus.late_s = LATE_SHARE * actuator_timeout_s(self.run_options.actuator == "rtu", relaxed, waits)
        stale_s = least_stale_s(relaxed, waits)
        if relaxed:
            self.ecu.command_timeout_s = max(self.ecu.command_timeout_s, stale_s)
        source, controller = self._source_lines(addresses, stale_s), actuator_lines(self.options.controller)
        return bench_text(self.options, addresses, speed, relaxed, source, controller, self._shared_path)

    def _source_lines(self, addresses: Addresses, stale_s: float) -> list[str]:
        """The table of the coil's current source."""
        run, number = self.run_options, self.options.coil.serial_number
        if run.supply:
            return bench.supply_lines(self.options, addresses.supply_url, run.speed, run.supply, run.by_hand)
        return bench.ecu_lines(addresses, stale_s, number, run.emulated_ecu)

    async def run(self) -> None:
        """Run until `stop`, or (with `exit_when_idle`) standstill after the parent is gone."""
        loop = asyncio.get_running_loop()
        gc.freeze()
        deadline_s = loop.time()
        while not self._stopping:
            ran = self.tick()
            deadline_s = max(deadline_s + (TICK_S if ran or self._unhurried else HOLDING_S), loop.time())
            await asyncio.sleep(deadline_s - loop.time())

    def stop(self) -> None:
        """End `run` at its next tick."""
        self._stopping = True

    async def close(self) -> None:
        """Hang up on everyone and complete the truth file.

        Raises:
            OSError: the truth file cannot be written.
        """
        await self.modbus.close()
        self.bus.close()
        if self.supply is not None:
            await self.supply.close()
        for channel in self.channels:
            channel.port.close()
        if self._names is not None:
            self._names.cleanup()
        if self._shared is not None:
            self._shared.close()
        if self.truth is not None:
            self.truth.finish(About(self._test(), self._quality(), self._provenance()))

    @property
    def _unhurried(self) -> bool:
        """While its clock waits, the rig looks no more often than it ticks: the processor is for those it waits for."""
        return self._shared is not None and self.run_options.speed <= 1.0

    def _hear_request(self, number: int, data: bytes, remote: bool) -> None:
        """A frame that may request a message of the ECU."""
        speed = self.run_options.speed
        self.ecu.request(number, data, remote=remote, answers=1 if speed <= 1.0 else math.ceil(2.0 * speed))

    def note(self, code: str, text: str, time_s: float | None = None) -> None:
        """Log to the truth file, if there is one."""
        if self.truth is not None:
            self.truth.note(code, text, time_s)

    def tick(self) -> bool:
        """Judge what runs on wall time, then bring simulated time up to where it should be, unless a reader is behind.

        Returns:
            Whether the clock went on; it waits for readers for a bounded time.
        """
        now_ns, shared = monotonic_ns(), self._shared
        host_is_late = shared is not None and self._look(shared, now_ns)
        rig_ns = now_ns if shared is None else shared.now_ns
        before_s, ran_s = self._served.now_s, self._served.tick(now_ns)
        served_s = ran_s if shared is None else shared.elapsed_s
        self._inject_due()
        self.actuator.tick(served_s)
        self.ecu.tick(served_s)
        if self.supply is not None:
            self.supply.tick(served_s)
        for action in self.every_tick:
            action()
        step = self.plant.step
        behind = self._behind = not self.run_options.drop_unread and self._readers_are_behind(now_ns, served_s)
        if shared is not None:
            shared.go_on(waiting=host_is_late or behind)
        if host_is_late or behind:
            self._waited_s += ran_s - before_s
            if shared is None and self.run_options.speed > 1.0:
                self._pace.hold(now_ns, step)
            self._goes_on = False
            return False
        self._goes_on = True
        if steps := self._pace.due(rig_ns, step):
            self.advance(steps)
        if self.run_options.exit_when_idle:
            self._leave_when_idle(now_ns)
        return True

    def _look(self, shared: SharedClock, now_ns: int) -> bool:
        """Bring the clock up to now; whether it must wait for the host. A faulty link's delays are the rig's own."""
        return shared.look(now_ns, setpoints=self.modbus.faults == NO_FAULTS)

    def _rig_ns(self) -> int:
        """The clock by which simulated time runs, now (ns): it may wait for the host."""
        return monotonic_ns() if self._shared is None else self._shared.at(monotonic_ns())

    def _arrival_s(self) -> float:
        """Simulated time of what arrives now (s): up to a slice after the plant's."""
        ahead_s = self._pace.ahead_s(self._rig_ns(), self.plant.step)
        return self.plant.time_s + min(ahead_s, LONGEST_SLICE_S * self.run_options.speed)

    def _catch_up(self) -> None:
        """Bring simulated time up to now: a rod that follows set-points follows them, and is read, between two ticks.

        Else a set-point would count from the last tick: up to a tick too far ahead, by another part of it each time.
        """
        if self._shared is not None:
            self._goes_on = not (self._look(self._shared, monotonic_ns()) or self._behind)
            self._shared.go_on(waiting=not self._goes_on)
        # A clock that waits for this very request is not passed: up to it the physics are owed.
        runs = self._goes_on if self._shared is None else not self._behind
        if runs and (steps := self._pace.due(self._rig_ns(), self.plant.step)):
            self.advance(steps)

    def _readers_are_behind(self, now_ns: int, served_s: float) -> bool:
        """Whether simulated time should wait for a client that reads a sensor, the bus or the controller."""
        speed, pressure, shared = self.run_options.speed, self._backpressure, self._shared
        fast = speed > 1.0 or shared is not None
        behind, patience_s = False, self._patience_s(now_ns)
        for channel in self.channels:
            frame, port = channel.sensor.frame_size, channel.port
            due = max(FEWEST_FRAMES * frame, BEHIND_S * speed * channel.sensor.options.rate_Hz * frame)
            behind |= pressure.waits_for(port, due if fast else CAPACITY // 2, patience_s)
            if speed > 1.0 and channel.sensor.requests is not None:
                channel.hear(now_ns, 0.0, 0.0, speed)
                behind |= pressure.waits_for(channel, 0, patience_s)
            port.waits = port.read_once and not pressure.given_up(port)
        for client in self.bus.clients:
            due = max(BUS_BYTES, BEHIND_S * speed * self._can_bytes_s)
            behind |= pressure.waits_for(client, due if fast else CAPACITY, patience_s)
        polled = fast and not self._faulty if shared is None else shared.watched
        if polled and self.actuator.owner:
            rtu = self.run_options.actuator == "rtu"
            poll_s = poll_ms(self.options.controller, rtu, speed) * 1e-3
            allowed_s = POLLS_LATE * poll_s if shared is None else poll_s + TICK_S + shared.allowed_s
            behind |= pressure.waits_for_poll(served_s - self.bank.polled_s, allowed_s, patience_s)
        return behind

    def _patience_s(self, now_ns: int) -> float:
        """Wall time in which readers could have read (s): the rig had its turn, and so had the host's processes."""
        shared, ran_s = self._shared, self._served.now_s
        if shared is not None and self._backpressure.waiting and shared.busy(now_ns):
            self._busy_s += ran_s - self._before_s
        self._before_s = ran_s
        return ran_s - self._busy_s

    def advance(self, steps: int) -> None:
        """Run the physics for `steps` and send what the devices make of them."""
        start_s = self.plant.time_s
        pulses_s: list[float] = []
        for time_s, kind, value in self.plant.advance(steps):
            if kind == EVENT_PULSE:
                pulses_s.append(time_s)
                self.actuator.pulsed(time_s)
                if self.first_cycle_s is None:
                    self.first_cycle_s = time_s
            elif kind == EVENT_TRIP:
                self.note("TRIP", f"limit bit {int(value)}", time_s)
        now_ns, end_s, out, dt_s = monotonic_ns(), self.plant.time_s, self.plant.out, self.plant.dt_s
        current_A = out[:, plant_step.CURRENT]
        for channel in self.channels:
            channel.hear(now_ns, start_s, end_s, self.run_options.speed)
            data = channel.sensor.sample(out[:, channel.column], start_s, dt_s, pulses_s, current_A)
            if data:
                channel.port.write(data, channel.sensor.frame_size)
        if self.supply is None:
            self.bus.send(self.ecu.frames())
        if self.first_cycle_s is None:
            self.first_cycle_s = self.actuator.turned_s
        if self.truth is not None:
            self.truth.slice()

    def channel(self, name: str) -> Channel:
        """The sensor channel of that name.

        Raises:
            KeyError: there is none.
        """
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(f"unknown sensor {name!r}; known: {', '.join(channel.name for channel in self.channels)}")

    def summary(self) -> str:
        """One line for the end: simulated time and what was dropped."""
        drops = ", ".join(f"{name} {count}" for name, count in self._quality().items())
        return f"simulated {self.plant.time_s:.1f} s; {drops}"

    def _add(self, name: str, options: SensorOptions, column: int, kind: str) -> None:
        clock = DeviceClock.drawn(options.clock_offset_us, options.clock_ppm, next(self._draws))
        sensor = Sensor(options, clock, next(self._draws), self.plant.time_s)
        by_id, speed, layout = f"{options.serial_number}-{name}", options.baudrate, options.format
        port: SensorPort
        if isinstance(layout, BinaryFormat) and layout.can is not None:
            port = CanSensorPort(self.bus, layout, layout.can)
            self._can_bytes_s += options.rate_Hz * SENSOR_LINE_BYTES
        elif isinstance(layout, BinaryFormat) and layout.registers is not None:
            port = self._box(options, layout.registers, kind).add(layout, layout.registers)
        else:
            port = NamedPort(self._ports_folder(), by_id, speed) if kind == BY_ID else open_port(kind, speed)
        self.channels.append(Channel(name, sensor, port, column))

    def _box(self, options: SensorOptions, registers: Registers, kind: str) -> ModbusBox:
        """Device for these registers: one on the sensor's line on which they are unused, or a new device."""
        mine = (options.line, registers.rtu)
        for key, box in self._boxes:
            if key == mine and box.has_room(registers):
                return box
        port = open_port(kind if registers.rtu else "socket", options.baudrate)
        box = ModbusBox(port, rtu=registers.rtu, clocked=self.run_options.speed == 1.0)
        self._boxes.append((mine, box))
        return box

    async def _open_supply(self) -> None:
        """Open the simulated supply; an analogue output joins the sensors' device if its registers are unused."""
        supply, line = self.supply, self.run_options.supply_line
        if isinstance(supply, SimulatedOutput):
            for (of, _), box in self._boxes:
                if of == line and box.can_host(supply):
                    supply.is_hosted_by(box.address)
                    box.output = supply
                    return
        if supply is not None:
            await supply.open()

    def _ports_folder(self) -> Path:
        if self._names is None:
            self._names = tempfile.TemporaryDirectory(prefix="simulated-rig-by-id-")
        return Path(self._names.name)

    def _inject_due(self) -> None:
        """Switch on the faults whose time has come: at once without a time, else counted from the first cycle."""
        for fault in list(self._pending_faults):
            began_s = math.inf if self.first_cycle_s is None else self.first_cycle_s
            if fault.after_s is not None and self.plant.time_s < began_s + fault.after_s:
                continue
            self._pending_faults.remove(fault)
            self._faulty = True
            self.note("FAULT", fault.name)
            undo = (VARIANTS if fault.variant else INJECTORS)[fault.name](self)
            if undo is not None and fault.lasts_s < math.inf:
                self._undoings.append((self.plant.time_s + fault.lasts_s, fault.name, undo))
        for undoing in [due for due in self._undoings if due[0] <= self.plant.time_s]:
            self._undoings.remove(undoing)
            self.note("FAULT_ENDS", undoing[1])
            undoing[2]()

    def _leave_when_idle(self, now_ns: int) -> None:
        """Stop once the parent is gone and the rig has stood still without current for a while."""
        moving = abs(self.plant.value("velocity_m_s")) > STANDSTILL_M_S
        moving = moving or self.actuator.motion_state in {State.MOVING, State.RUNNING, State.FADING, State.HALTING}
        stays_on = self.supply is not None and self.supply.stays_on
        powered = abs(self.plant.value("current_A")) > NO_CURRENT_A and not stays_on
        if moving or powered or os.getppid() == self._parent:
            self._idle_since_ns = now_ns
        elif now_ns - self._idle_since_ns > IDLE_S * 1e9:
            self.stop()

    def _test(self) -> dict[str, Attribute]:
        plant = self.plant
        parameters = {f"parameter_{name}": value for name, value in plant.values.items()}
        return {
            "damper_model": plant.model.name,
            "damper_kind": KINDS.get((plant.model.name, plant.model.hysteresis), NO_KIND),
            "parameter_names": list(plant.values),
            **parameters,
            "coil_eta": float(plant.constants["coil_eta_1_s"][0]),
            "specimen": self.options.specimen.serial_number,
            "mid_stroke_m": self.options.specimen.mid_stroke_m,
            "faults": [str(fault) for fault in self.run_options.faults],
        }

    def _quality(self) -> dict[str, Attribute]:
        drops: dict[str, Attribute] = {
            f"dropped_{channel.name}": channel.port.dropped_frames for channel in self.channels
        }
        unheard = sum(channel.port.unheard_frames for channel in self.channels)
        drops |= {"unheard_frames": unheard, "dropped_can": self.bus.dropped_frames}
        return drops | {"waited_s": round(self._waited_s, 3)}

    def _provenance(self) -> dict[str, Attribute]:
        clocks: dict[str, Attribute] = {}
        devices = {"controller": self.actuator.clock, "ecu": self.ecu.clock}
        devices |= {channel.name: channel.sensor.clock for channel in self.channels}
        for name, clock in devices.items():
            clocks[f"clock_offset_us_{name}"] = clock.offset_us
            clocks[f"clock_ppm_{name}"] = clock.ppm
        return {
            "seed": self.run_options.seed, "speed": self.run_options.speed,
            "options": repr(dataclasses.asdict(self.options)),
            **clocks,
        }


def take_real_time_priority(speed: float) -> bool:
    """Ask for real-time scheduling at speed 1, when the machine has the right; True when it was given."""
    if speed > 1.0 or not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    except OSError:
        return False
    return True
