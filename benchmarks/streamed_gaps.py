"""What a rod does when its set-points stop for a while: gaps of 5 ms to 2 s, by cause, motion, phase and controller.

    python benchmarks/streamed_gaps.py [--preset float-drive] [--motion sine] [--cause held-up] [--gap-ms 45] ...

Station thread, interlocks, supervisor, driver and register map are the product's; the controller is the simulated one
on its plant. One fake clock drives both, without processes or sockets. Cases that differ in the gap only have the same
beginning, which runs once: each is a copy of the process from the gap on (POSIX). Reported per row: largest speed and
largest acceleration (over 1 ms) from the gap on, farthest position, number of cases beyond a limit, and the fault
codes. Limits: position of the bench, 1.1 of its acceleration, the planned speed and a servo's overshoot.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import math
import os
import pickle
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

import drivers.clock
import drivers.modbus_actuator
import rig.clock
from drivers.catalogue import make_actuator
from drivers.connection import ActuatorAddress, ActuatorConnection
from drivers.errors import Busy, DriverError, NoAnswer
from drivers.roles import ActuatorLimits, ActuatorStatus, Command, Move, Program, State, Waveform
from drivers.setpoint_generator import Setpoint
from drivers.streamed_actuator import StreamedActuator
from rig import dampers
from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.hybrid.delay_probe import Probe
from rig.hybrid.hybrid_motion import HybridMotion, HybridOrder
from rig.hybrid.motion_bounds import Bounds
from rig.hybrid.quarter_car import QuarterCar
from rig.station.hybrid_source import HybridSource, Sensors
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.motion_interlock import Place
from rig.station.safe_stop import Movement, StopPhase
from rig.station.supervisor import TICK_S, Supervisor
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.devices import motion_terms
from rig.vehicle.car import Car
from rig.vehicle.motion import CornerDamper
from rig.vehicle.road import Sweep, sweep_road
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.emulated_bench import appearing_as
from simulators.options import RigOptions, with_option
from simulators.plant.plant import MAXIMUM_STEPS, Plant
from simulators.plant.step import PISTON, VELOCITY
from simulators.registers import RegisterBank, registers_of

BENCH = Path(__file__).resolve().parents[1] / "examples" / "streamed-bench.toml"
PRESETS = ("demo-streamed", "float-drive", "delta-rmc")
CAUSES = ("held-up", "busy", "lost", "suspended", "slow")
SLOW_S = 0.025
"""So much longer a slow answer takes."""
GAPS_S = (0.005, 0.015, 0.025, 0.035, 0.045, 0.06, 0.1, 0.2, 0.33, 0.7, 2.0)
PHASES = 12
MOTION_S = 4.0
HYBRID_M_S = 0.31
"""Of the computed hybrid test, with the headroom of its plan (1.25)."""
HALF_STEP_S = 1e-5
STEADY_S = 1.5
SETTLED_S = 0.4
PROVED_S = 3.0
"""After the gap: without a stop the motion goes on for so long; a stop is awaited for so long."""
STEP_S = 0.1
ACCELERATION_SHARE = 1.1
OVERSHOOT = 1.08
"""Of the speed: a servo of 0.7 damping, where its set-point's speed changes abruptly."""


class FakeClock:
    """Host and device time: `real_ns` goes on always, the host's monotonic clock not while the machine sleeps."""

    CLOCK_BOOTTIME, CLOCK_MONOTONIC = 7, 1

    def __init__(self) -> None:
        self.real_ns = 1_000_000_000
        self.slept_ns = 0

    def monotonic_ns(self) -> int:
        """Every reading takes 200 ns."""
        self.real_ns += 200
        return self.real_ns - self.slept_ns

    def monotonic(self) -> float:
        """In s."""
        return self.monotonic_ns() * 1e-9

    def clock_gettime_ns(self, clock: int) -> int:
        """BOOTTIME goes on while the machine sleeps."""
        return self.monotonic_ns() + (self.slept_ns if clock == self.CLOCK_BOOTTIME else 0)

    def go_on(self, seconds: float) -> None:
        """Time passes."""
        self.real_ns += round(1e9 * seconds)


class Machine:
    """The simulated controller on its plant, brought up to the clock at every access, or every `tick_s`."""

    def __init__(self, clock: FakeClock, preset: str, options: Sequence[str], tick_s: float) -> None:
        given = RigOptions()
        for assignment in options:
            given = with_option(given, assignment)
        self.options = appearing_as(given, preset)
        self.plant = Plant(self.options)
        self.actuator = Actuator(self.plant, self.options.controller, DeviceClock(0.0, 0.0), lambda *_: None)
        random = np.random.default_rng(0)
        self.bank: RegisterBank = registers_of(self.actuator, self.options, random)
        self.rows: list[np.ndarray] = []
        self._clock = clock
        self._begin_ns = clock.real_ns
        self._tick_s = tick_s

    def catch_up(self) -> None:
        """Bring the plant up to the clock."""
        now_s = 1e-9 * (self._clock.real_ns - self._begin_ns)
        if self._tick_s:
            now_s = math.floor(now_s / self._tick_s) * self._tick_s
        left = round((now_s - self.plant.time_s) / self.plant.dt_s)
        while left > 0:
            steps = min(left, MAXIMUM_STEPS, 80)
            self.plant.advance(steps)
            time_s = (self.plant.first_step + 1 + np.arange(steps)) * self.plant.dt_s
            self.rows.append(np.column_stack([time_s, self.plant.out[:, [PISTON, VELOCITY]]]))
            self.actuator.tick(self.plant.time_s)
            left -= steps

    def moved(self) -> np.ndarray:
        """Time (s), position (m), velocity (m/s), one row a step of the plant."""
        return np.concatenate(self.rows)


class Link:
    """The controller's registers in place of a Modbus link; what is broken on it, and how long each trip takes."""

    device, url, stale, timeouts, is_open = "actuator", "modbus-tcp://virtual:502", 0, 0, True
    address = ActuatorAddress.parse(url)

    def __init__(self, clock: FakeClock, machine: Machine, trip_s: Callable[[], float], timeout_s: float) -> None:
        self.busy = 0
        self.is_busy = self.loses_answers = self.is_slow = False
        self._clock, self._machine, self._trip_s, self._timeout_s = clock, machine, trip_s, timeout_s

    def open(self, timeout_s: float = 0.0) -> None:
        """It is open."""

    def close(self) -> None:
        """It stays open."""

    def read(self, address: int, count: int, function: int = 3) -> list[int]:
        """Registers or coils."""
        self._there()
        words = self._machine.bank.read(address, count, {1: "coil", 2: "discrete", 4: "input"}.get(function, "holding"))
        self._back()
        assert words is not None
        return words

    def write(self, address: int, words: Sequence[int], function: int = 16) -> None:
        """Write registers; the presets without a generator write no coils."""
        del function
        self._there()
        assert self._machine.bank.write(address, list(words)) is True
        self._back()

    def exchange(
        self, read_address: int, read_count: int, write_address: int, words: Sequence[int], *, retries: int = 0
    ) -> list[int]:
        """Write, then read."""
        del retries
        self._there()
        assert self._machine.bank.write(write_address, list(words)) is True
        shown = self._machine.bank.read(read_address, read_count)
        self._back()
        assert shown is not None
        return shown

    def _there(self) -> None:
        if self.is_busy:
            self._clock.go_on(4.0 * self._trip_s())
            raise Busy(self.device, self.url, "exception 6 (busy)")
        self._clock.go_on(self._trip_s())
        self._machine.catch_up()

    def _back(self) -> None:
        if self.loses_answers:
            self._clock.go_on(self._timeout_s)
            raise NoAnswer(self.device, self.url, "no answer")
        self._clock.go_on(self._trip_s() + (SLOW_S if self.is_slow else 0.0))


class Lvdt:
    """The rod's position by the LVDT, as the actuator's thread and the supervisor ask for it; always fresh."""

    changed = True

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._anchor = (0.0, 0.0)
        self._place = Place()

    def position_m(self, now_ns: int) -> float:
        """The rod's true position (m)."""
        del now_ns
        return self._machine.plant.value("position_m")

    @property
    def speed_m_s(self) -> float:
        """The rod's true speed (m/s)."""
        return self._machine.plant.value("velocity_m_s")

    def restart_still(self) -> None:
        """Begin the proof of standstill anew."""
        self._anchor = (math.nan, 0.0)
        self._place.hold(math.nan)

    def hold_place(self) -> None:
        """Standstill is proved: the rod has to stay where it is."""
        self._place.hold(self._anchor[0])

    def left_place(self, now_ns: int) -> bool:
        """The rod is away from where its standstill was proved."""
        self._place.check(self.position_m(now_ns))
        return self._place.left

    def still_s(self, now_ns: int) -> float:
        """For so long the rod has been at rest (s)."""
        del now_ns
        position_m, time_s = self._machine.plant.value("position_m"), self._machine.plant.time_s
        if not abs(position_m - self._anchor[0]) <= 0.3e-3:
            self._anchor = (position_m, time_s)
        return time_s - self._anchor[1]


class Coil:
    """A coil at 0 A."""

    fresh_current_A, zero_within_s, falls_within_s, own_timeout_s = 0.0, 0.25, 0.0, 0.1

    def zero_now(self) -> None:
        """It is at 0 A."""


@dataclass(frozen=True)
class Case:
    """One gap in one motion.

    Attributes:
        preset: the controller's register map.
        motion: a key of `MOTIONS`.
        cause: of `CAUSES`.
        gap_s: how long no set-point is taken.
        phase: of the motion, 0 to 1 of its period, at which the gap begins.
        poll_s: period of the set-points.
        options: of the simulated rig.
        jitter_s: each poll is late by up to so much.
        again_s: so long after the gap there is another one like it; NaN: there is none.
        stop: an order to fade or halt that is given in the middle of the gap.
        tick_s: the simulated controller looks at the clock so often; 0: at every access.
        limits: text replaced in the bench file.
    """

    preset: str = "demo-streamed"
    motion: str = "sine"
    cause: str = "held-up"
    gap_s: float = 0.0
    phase: float = 0.0
    poll_s: float = 0.01
    options: tuple[str, ...] = ()
    jitter_s: float = 0.0005
    again_s: float = math.nan
    stop: Command | None = None
    tick_s: float = 0.0
    limits: tuple[tuple[str, str], ...] = ()


@dataclass
class Outcome:
    """What came of a case; rod quantities from the beginning of the gap on."""

    speed_m_s: float
    acceleration_m_s2: float
    farthest_m: float
    trip: str
    proved: bool
    state: str
    planned_m_s: float
    limits: tuple[float, float, float, float] = field(repr=False, default=(0.0, 0.0, 0.0, 0.0))
    rows: np.ndarray = field(repr=False, default_factory=lambda: np.empty((0, 3)))
    setpoints: list[tuple[float, Setpoint]] = field(repr=False, default_factory=list)

    def problems(self) -> list[str]:
        """What is beyond its limit."""
        low_m, high_m, speed_m_s, acceleration_m_s2 = self.limits
        found = []
        if not low_m <= self.farthest_m <= high_m:
            found.append(f"rod at {1e3 * self.farthest_m:.1f} mm")
        if self.speed_m_s > OVERSHOOT * min(speed_m_s, self.planned_m_s) + 0.01:
            found.append(f"{self.speed_m_s:.3f} m/s of {self.planned_m_s:.3f}")
        if self.acceleration_m_s2 > ACCELERATION_SHARE * acceleration_m_s2:
            found.append(f"{self.acceleration_m_s2:.0f} m/s^2 of {acceleration_m_s2:g}")
        if self.trip and not self.proved:
            found.append("no proof of the stop")
        return found


class Prescribed:
    """A motion given by a function of time, as a signal is."""

    def __init__(self, position: Callable[[float], float], duration_s: float) -> None:
        self._position, self._duration_s = position, duration_s
        steps = np.arange(0.0, duration_s, 1e-3)
        values = np.array([position(step) for step in steps])
        self.fastest_m_s = float(np.max(np.abs(np.diff(values)))) / 1e-3

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point; None after the end."""
        if elapsed_s > self._duration_s:
            return None
        before_s, after_s = max(0.0, elapsed_s - HALF_STEP_S), elapsed_s + HALF_STEP_S
        speed_m_s = (self._position(after_s) - self._position(before_s)) / (after_s - before_s)
        return Setpoint(self._position(elapsed_s), speed_m_s)

    def position_m(self, elapsed_s: float) -> float:
        """Position (m) at any time."""
        return self._position(min(elapsed_s, self._duration_s))


def sweep(elapsed_s: float) -> float:
    """0.5 to 3 Hz in 4 s, at 0.4 m/s, in and out over 0.5 s."""
    rate = 2.5 / MOTION_S
    frequency_Hz = 0.5 + rate * elapsed_s
    angle = 2.0 * math.pi * (0.5 + 0.5 * rate * elapsed_s) * elapsed_s
    share = min(1.0, elapsed_s / 0.5, max(0.0, MOTION_S - elapsed_s) / 0.5)
    return min(0.06, 0.4 / (2.0 * math.pi * frequency_Hz)) * share**2 * (3.0 - 2.0 * share) * math.sin(angle)


def road(elapsed_s: float) -> float:
    """Seven sines as of a road."""
    share = min(1.0, elapsed_s / 0.5, max(0.0, MOTION_S - elapsed_s) / 0.5)
    parts = ((0.020, 0.7), (0.012, 1.1), (0.010, 1.7), (0.006, 2.3), (0.004, 3.1), (0.002, 4.3), (0.001, 6.1))
    total = sum(a * math.sin(2.0 * math.pi * f * elapsed_s + 1.3 * n) for n, (a, f) in enumerate(parts))
    return share**2 * (3.0 - 2.0 * share) * total


@dataclass(frozen=True)
class Motion:
    """What moves when the gap comes.

    Attributes:
        order: a program, a move, or a computed motion's maker, given the rig.
        frequency_Hz: by which a phase is counted.
        fastest_m_s: largest planned speed; NaN: that of the computed motion.
        steady_s: from the start to phase 0.
        then: the order, given at phase 0, in which the gap comes.
        centre_m: where the rod is moved before.
    """

    order: Program | Move | Callable[[Virtual], Any]
    frequency_Hz: float
    fastest_m_s: float = math.nan
    steady_s: float = STEADY_S
    then: Command | None = None
    centre_m: float = 0.0


def hybrid(virtual: Virtual) -> HybridSource:
    """A corner of a van on a sweep, its damper on the simulated rig: delay measured, 2 s of road, return."""
    model = dampers.model("asymmetric")
    values = {name: 1200.0 if name in {"Ca_plus", "Ca_minus"} else 0.0 for name in model.names}
    car = Car.model_validate({
        "format": 1, "name": "corner", "kind": "quarter", "source": "an estimate", "body": {"mass": "600 kg"},
        "front": {
            "unsprung_mass": "90 kg", "wheel_rate": "40 kN/m", "tyre_stiffness": "220 kN/m",
            "tyre_damping": "300 N s/m",
        },
    })  # fmt: skip
    quarter = QuarterCar(car, sweep_road(Sweep(2.0, 1.0, 5.0, 20e-3, 10e-3, 0.0)), CornerDamper(model, values))
    limits, deceleration_m_s2 = virtual.config.limits, virtual.config.actuator.halt_deceleration_m_s2
    bounds = Bounds(
        0.08, limits.speed_m_s, limits.acceleration_m_s2, 5.0, 0.1, 0.08, deceleration_m_s2, 40.0, HYBRID_M_S
    )
    order = HybridOrder(quarter.part(virtual.case.poll_s), bounds, Probe(1e-3, 5.0), "model")
    plant = virtual.machine.plant
    sensors = Sensors(lambda _: plant.value("cell_force_N"), lambda _: plant.value("position_m"))
    return HybridSource(HybridMotion(order), sensors, virtual.supervisor, lambda _: None)


def sine_of(amplitude_m: float, frequency_Hz: float, cycles: float = 6.0, centre_m: float = 0.0) -> Program:
    """A sine with one cycle of ramp at each end."""
    return Program(
        Waveform.SINE, amplitude_m, frequency_Hz, centre_m, cycles=cycles, ramp_in_cycles=1.0, ramp_out_cycles=1.0
    )


SINE = sine_of(0.06, 1.5)
TRIANGLE = Program(Waveform.TRIANGLE, 0.05, 1.0, cycles=4.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
PROBED_S = Probe(1e-3, 5.0).duration_s + 0.5
MOTIONS: dict[str, Motion] = {
    "sine": Motion(SINE, 1.5, 0.5655),
    "fast-sine": Motion(sine_of(0.03, 4.1, 12.0), 4.1, 0.773),
    "triangle": Motion(TRIANGLE, 1.0, 0.2),
    "sweep": Motion(lambda _: Prescribed(sweep, MOTION_S), 1.0),
    "road": Motion(lambda _: Prescribed(road, MOTION_S), 1.0),
    "hybrid": Motion(hybrid, 1.0, HYBRID_M_S, PROBED_S + 0.5),
    "move": Motion(Move(0.07, 0.3), 4.0, 0.3, 0.05),
    "ramp": Motion(SINE, 1.5, 0.5655, 0.0),
    "fade": Motion(SINE, 1.5, 0.5655, 1.5, Command.FADE_STOP),
    "fade-triangle": Motion(TRIANGLE, 1.0, 0.2, 1.7, Command.FADE_STOP),
    "halt": Motion(lambda _: Prescribed(sweep, MOTION_S), 25.0, then=Command.HALT),
    "return": Motion(hybrid, 1.0, HYBRID_M_S, PROBED_S + 2.0),
    "off-centre": Motion(sine_of(0.045, 1.5, centre_m=0.03), 1.5, 0.4241, centre_m=0.03),
}


class Virtual:
    """The station's actuator thread and supervisor on one simulated controller, in the time of a fake clock."""

    def __init__(self, case: Case, clock: FakeClock) -> None:
        self.case = case
        self.clock = clock
        self.machine = Machine(self.clock, case.preset, case.options, case.tick_s)
        self._random = np.random.default_rng(1)
        self.config = _config(case)
        actuator = self.config.actuator
        self.link = Link(self.clock, self.machine, lambda: self._random.uniform(1e-4, 4e-4), actuator.timeout_s)
        with mock.patch.object(drivers.modbus_actuator, "ModbusLink", return_value=self.link):
            self.driver = _driver(case, self.config)
        self.setpoints: list[tuple[float, Setpoint]] = []
        self._watch_setpoints()
        self.events: list[dict[str, object]] = []
        self.supervisor = Supervisor(self.config, self.events.append, lambda _: None, lambda _: None, lambda: 0.0)
        interlock = ActuatorInterlock(
            1, self.driver.capabilities, frozen_after_ns=int(actuator.stale_after_s * 1e9),
            disagreement_m=self.config.disagreement_m, lag_s=actuator.poll_s + self.config.lvdt.stale_after_s,
        )
        lvdt: Any = Lvdt(self.machine)
        self.thread = ActuatorThread(actuator, self.driver, interlock, lvdt, self.supervisor, lambda _: None)
        self.supervisor.attach(Coil(), self.thread, lvdt, ())
        self.steps = self.thread._stream.steps  # noqa: SLF001 - the loop below is the thread's own
        self.planned_m_s = MOTIONS[case.motion].fastest_m_s
        self.begin_s = math.nan

    def _watch_setpoints(self) -> None:
        device: Any = self.driver._device  # noqa: SLF001
        follow = device.follow

        def followed(setpoint: Setpoint, counter: int | None) -> ActuatorStatus:
            self.setpoints.append((1e-9 * self.clock.real_ns, setpoint))
            return follow(setpoint, counter)

        device.follow = followed

    def now_s(self) -> float:
        """The plant's time (s)."""
        return self.machine.plant.time_s

    def run(self, seconds: float) -> None:
        """Poll and tick for so long."""
        until_ns = self.clock.real_ns + round(1e9 * seconds)
        tick_ns = self.clock.real_ns
        late_ns = 0
        while self.clock.real_ns < until_ns:
            due_ns = self.steps.next_ns + self.clock.slept_ns + late_ns
            now_ns = self.clock.real_ns
            if tick_ns <= now_ns:
                self.machine.catch_up()
                self.supervisor.beat(healthy=True)
                self.supervisor.tick(self.clock.monotonic_ns())
                tick_ns = max(tick_ns + round(1e9 * TICK_S), now_ns - 1)
            elif due_ns <= now_ns or self.thread._hurry:  # noqa: SLF001
                self.serve()
                late_ns = round(1e9 * self._random.uniform(0.0, self.case.jitter_s))
            else:
                self.clock.real_ns = min(tick_ns, due_ns, until_ns)

    def serve(self) -> None:
        """One round of the thread's loop."""
        due_ns = self.steps.next_ns
        self.thread._hurry = False  # noqa: SLF001
        try:
            self.thread._serve()  # noqa: SLF001
        except DriverError as error:
            self.thread._failed(error)  # noqa: SLF001
        if self.steps.next_ns == due_ns:
            self.steps.take(self.clock.monotonic_ns())

    def ready(self) -> None:
        """Under pressure, holding, armed."""
        driver = self.driver
        driver.open()
        driver.read_status()
        if driver.capabilities.lease:
            driver.send(Command.ACQUIRE)
        if driver.capabilities.limits_read_back:
            driver.write_limits(_limits(self.config))
        now_ns = self.clock.monotonic_ns()
        self.supervisor.host.watch(now_ns)
        self.steps.begin(now_ns)
        self.run(0.1)
        for command in (Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON):
            driver.send(command)
            self.run(0.5)
        self.run(1.0)
        self.supervisor.arm()

    def start(self) -> None:
        """Begin the motion."""
        motion = MOTIONS[self.case.motion]
        if motion.centre_m:
            self.driver.send(Command.MOVE_TO, Move(motion.centre_m, 0.1))
            self.run(1.0)
        order, period_s = motion.order, 1.0 / motion.frequency_Hz
        if isinstance(order, Program):
            self.supervisor.movement = Movement(period_s, period_s)
            self.thread.interlock.expect_program(order.all_cycles * period_s, order.all_cycles)
            self.driver.send(Command.START, order)
        elif isinstance(order, Move):
            self.driver.send(Command.MOVE_TO, order)
        else:
            computed = order(self)
            if math.isnan(self.planned_m_s):
                self.planned_m_s = computed.fastest_m_s
            limits = self.config.limits
            self.supervisor.movement = Movement(limits.speed_m_s / self.config.actuator.halt_deceleration_m_s2 + 0.1)
            self.thread.interlock.expect_program(MOTION_S + 1.0, 1.0)
            self.driver.compute(computed)
        self.begin_s = self.now_s()

    def go_to_phase(self, phase: float) -> None:
        """Run to this phase of the motion."""
        motion = MOTIONS[self.case.motion]
        if motion.then is not None and self.now_s() < self.begin_s + motion.steady_s - 1e-3:
            self.run(self.begin_s + motion.steady_s - self.now_s())
            self.order(motion.then)
        self.run(max(0.0, self.begin_s + motion.steady_s + phase / motion.frequency_Hz - self.now_s()))

    def order(self, command: Command) -> None:
        """Order a stop; one that cannot be sent is lost."""
        try:
            self.driver.send(command)
        except DriverError:
            return

    def gaps(self) -> None:
        """The gap, and what comes after it, until all is settled."""
        case = self.case
        self.gap()
        if math.isfinite(case.again_s):
            self.run(case.again_s)
            self.gap()
        after_s = 0.0
        while after_s < PROVED_S:
            self.run(STEP_S)
            after_s += STEP_S
            stop, trip = self.supervisor.stop, self.supervisor.trip
            if after_s > SETTLED_S - 1e-9 and (trip is None or (stop is not None and stop.step is StopPhase.SAFE)):
                break

    def gap(self) -> None:
        """No set-point gets through for so long, or each answer is late."""
        seconds, cause, stop = self.case.gap_s, self.case.cause, self.case.stop
        if cause in {"held-up", "suspended"}:
            self.clock.go_on(seconds)
            self.clock.slept_ns += round(1e9 * seconds) if cause == "suspended" else 0
            if stop is not None:
                self.order(stop)
        else:
            switch = {"busy": "is_busy", "lost": "loses_answers", "slow": "is_slow"}[cause]
            setattr(self.link, switch, True)
            self.run(0.5 * seconds)
            if stop is not None:
                self.order(stop)
            self.run(0.5 * seconds)
            setattr(self.link, switch, False)
        self.machine.catch_up()

    def outcome(self, from_s: float) -> Outcome:
        """What the rod did from this time on (s)."""
        stop = self.supervisor.stop
        rows = self.machine.moved()
        later = rows[rows[:, 0] >= from_s - 1e-9]
        stride = round(1e-3 / self.machine.plant.dt_s)
        gained = np.diff(later[::stride, 2]) / 1e-3
        farthest = later[np.argmax(np.abs(later[:, 1])), 1]
        limits = self.config.limits
        trip, status = self.supervisor.trip, self.thread.interlock.status
        return Outcome(
            float(np.max(np.abs(later[:, 2]))), float(np.max(np.abs(gained))), float(farthest),
            "" if trip is None else trip.slug, stop is not None and stop.step is StopPhase.SAFE,
            "" if status is None else State(status.state).name, self.planned_m_s,
            (limits.position_min_m, limits.position_max_m, limits.speed_m_s, limits.acceleration_m_s2), rows,
            self.setpoints,
        )


def _config(case: Case) -> StationConfig:
    text = BENCH.read_text(encoding="utf-8")
    for old, new in case.limits:
        text = text.replace(old, new)
    text = text.replace('poll = "10 ms"', f'poll = "{1e3 * case.poll_s:g} ms"')
    text = text.replace('register_map = "demo-streamed"', f'register_map = "{case.preset}"')
    bench = _bench(text)
    return StationConfig(
        **vars(bench.station), **vars(bench.clock), actuator=bench.actuator, ecu=bench.ecu,
        load_cell=bench.load_cell, lvdt=bench.lvdt, limits=bench.limits, ring_path="nowhere", owner_id=1,
    )


_BENCHES: dict[str, Bench] = {}


def _bench(text: str) -> Bench:
    if text not in _BENCHES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.toml"
            path.write_text(text, encoding="utf-8")
            _BENCHES[text] = Bench.load(path)
    return _BENCHES[text]


def _driver(case: Case, config: StationConfig) -> StreamedActuator:
    actuator = config.actuator
    driver = make_actuator(case.preset, ActuatorConnection(
        Link.url, timeout_s=actuator.timeout_s, owner_id=1, motion=motion_terms(config)
    ))
    assert isinstance(driver, StreamedActuator)
    return driver


def _limits(config: StationConfig) -> ActuatorLimits:
    limits, actuator = config.limits, config.actuator
    return ActuatorLimits(
        limits.position_min_m, limits.position_max_m, limits.speed_m_s, limits.acceleration_m_s2, limits.force_N,
        actuator.fade_out_cycles, actuator.halt_deceleration_m_s2, int(1e3 * actuator.watchdog_s),
    )


@contextmanager
def fake_time(clock: FakeClock) -> Iterator[None]:
    """The product reads this clock."""
    fake = SimpleNamespace(
        monotonic_ns=clock.monotonic_ns, monotonic=clock.monotonic, clock_gettime_ns=clock.clock_gettime_ns,
        CLOCK_BOOTTIME=clock.CLOCK_BOOTTIME, CLOCK_MONOTONIC=clock.CLOCK_MONOTONIC, sleep=clock.go_on,
    )
    with ExitStack() as patched:
        for module in (rig.clock, drivers.clock):
            patched.enter_context(mock.patch.object(module, "time", fake))
        yield


def outcome(case: Case) -> Outcome:
    """Run a case."""
    clock = FakeClock()
    with fake_time(clock):
        virtual = Virtual(case, clock)
        virtual.ready()
        virtual.start()
        if case.gap_s == 0.0:
            virtual.run(STEADY_S + case.phase / MOTIONS[case.motion].frequency_Hz + 1.0)
            return virtual.outcome(virtual.begin_s + 1.0 / MOTIONS[case.motion].frequency_Hz)
        virtual.go_to_phase(case.phase)
        from_s = virtual.now_s()
        virtual.gaps()
        return virtual.outcome(from_s)


def outcomes(case: Case, phases: Sequence[float], gaps: Sequence[tuple[str, float]]) -> Iterator[tuple[Case, Outcome]]:
    """Run a case at these phases, rising, with each of these gaps: cause and duration (s)."""
    clock = FakeClock()
    with fake_time(clock):
        virtual = Virtual(case, clock)
        virtual.ready()
        virtual.start()
        for phase in phases:
            virtual.go_to_phase(phase)
            for cause, gap_s in gaps:
                one = dataclasses.replace(case, cause=cause, gap_s=gap_s, phase=phase)
                yield one, _forked(virtual, one)


def _forked(virtual: Virtual, case: Case) -> Outcome:
    """What comes of a case from here on, in a copy of this process."""
    reading, writing = os.pipe()
    gc.freeze()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            virtual.case = case
            from_s = virtual.now_s()
            virtual.gaps()
            came = dataclasses.replace(virtual.outcome(from_s), rows=np.empty((0, 3)), setpoints=[])
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(came, pipe)
            os._exit(0)
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        content = pipe.read()
    os.waitpid(child, 0)
    came: Outcome = pickle.loads(content)
    return came


def main() -> None:
    """Run the table and print what is beyond limits, and the worst of each row."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--preset", choices=PRESETS, action="append")
    parser.add_argument("--motion", choices=MOTIONS, action="append")
    parser.add_argument("--cause", choices=CAUSES, action="append")
    parser.add_argument("--gap-ms", type=float, action="append")
    parser.add_argument("--phases", type=int, default=PHASES)
    parser.add_argument("--shift", type=float, default=0.0, help="of the phases, as a share of their distance")
    parser.add_argument("--poll-ms", type=float, default=10.0)
    parser.add_argument("--tick-ms", type=float, default=0.0)
    parser.add_argument("--again-ms", type=float, default=math.nan, help="time to a second gap of the same kind")
    parser.add_argument("--stop", choices=("fade", "halt"), help="order a stop in the middle of the gap")
    parser.add_argument("--option", action="append", default=[])
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    gaps_s = GAPS_S if given.gap_ms is None else [1e-3 * gap for gap in given.gap_ms]
    gaps = [(cause, gap_s) for cause in given.cause or CAUSES for gap_s in gaps_s]
    phases = [(step + given.shift) / given.phases for step in range(given.phases)]
    stop = {"fade": Command.FADE_STOP, "halt": Command.HALT, None: None}[given.stop]
    bad = total = 0
    for preset in given.preset or PRESETS:
        for motion in given.motion or MOTIONS:
            case = Case(
                preset, motion, poll_s=1e-3 * given.poll_ms, options=tuple(given.option), again_s=1e-3 * given.again_ms,
                stop=stop, tick_s=1e-3 * given.tick_ms,
            )
            rows: dict[tuple[str, float], list[Outcome]] = {}
            for one, came in outcomes(case, phases, gaps):
                rows.setdefault((one.cause, one.gap_s), []).append(came)
                total += 1
                bad += bool(came.problems())
                if given.verbose and came.problems():
                    print(f"    {one.cause} {1e3 * one.gap_s:g} ms at {one.phase:.3f}:", came.problems(), came.trip)
            for (cause, gap_s), row in rows.items():
                print(
                    f"{preset:14s} {motion:10s} {cause:10s} {1e3 * gap_s:5.0f} ms: "
                    f"{max(one.speed_m_s for one in row):.3f} m/s, "
                    f"{max(one.acceleration_m_s2 for one in row):5.1f} m/s^2, "
                    f"{1e3 * max(abs(one.farthest_m) for one in row):5.1f} mm, "
                    f"{sum(bool(one.problems()) for one in row):2d} beyond, {sorted({one.trip for one in row})}",
                    flush=True,
                )
    print(f"{bad} of {total} beyond limits")


if __name__ == "__main__":
    main()
