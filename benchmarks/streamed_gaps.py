"""What a rod does when its set-points stop for a while: gaps of 5 ms to 2 s, by cause, motion, phase and controller.

    python benchmarks/streamed_gaps.py [--preset float-drive] [--motion sine] [--cause held-up] [--gap-ms 45] ...

Station thread, interlocks, supervisor, driver and register map are the product's; the controller is the simulated one
on its plant. One fake clock drives both, without processes or sockets: a case takes about 0.3 s. Reported per row:
largest speed and largest acceleration (over 1 ms) from the gap on, farthest position, number of cases beyond a limit,
and the fault codes. Limits: position of the bench, 1.1 of its acceleration, the planned speed and a servo's overshoot.
"""

from __future__ import annotations

import argparse
import math
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
from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.safe_stop import Movement, StopPhase
from rig.station.supervisor import TICK_S, Supervisor
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.devices import motion_terms
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.options import RigOptions, with_option
from simulators.plant.plant import MAXIMUM_STEPS, Plant
from simulators.plant.step import PISTON, VELOCITY
from simulators.registers import RegisterBank
from simulators.worn_bench import appearing_as
from simulators.worn_registers import registers_of

BENCH = Path(__file__).resolve().parents[1] / "examples" / "streamed-bench.toml"
PRESETS = ("demo-streamed", "float-drive", "delta-rmc")
CAUSES = ("held-up", "busy", "lost", "suspended")
GAPS_S = (0.005, 0.015, 0.025, 0.035, 0.045, 0.06, 0.1, 0.2, 0.33, 0.7, 2.0)
PHASES = 12
MOTION_S = 4.0
HALF_STEP_S = 1e-5
STEADY_S = 1.5
SETTLED_S = 1.2
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
        self.is_busy = self.loses_answers = False
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
        self._clock.go_on(self._trip_s())


class Lvdt:
    """The rod's position by the LVDT, as the actuator's thread and the supervisor ask for it; always fresh."""

    changed = True

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._anchor = (0.0, 0.0)

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

    def still_s(self, now_ns: int) -> float:
        """For so long the rod has been at rest (s)."""
        del now_ns
        position_m, time_s = self._machine.plant.value("position_m"), self._machine.plant.time_s
        if not abs(position_m - self._anchor[0]) <= 0.3e-3:
            self._anchor = (position_m, time_s)
        return time_s - self._anchor[1]


class Coil:
    """A coil at 0 A."""

    fresh_current_A, zero_within_s, falls_within_s = 0.0, 0.25, 0.0

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


MOTIONS: dict[str, tuple[Any, float, float]] = {
    "sine": (Program(Waveform.SINE, 0.06, 1.5, cycles=6.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0), 1.5, 0.5655),
    "fast-sine": (Program(Waveform.SINE, 0.03, 4.1, cycles=12.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0), 4.1, 0.773),
    "triangle": (Program(Waveform.TRIANGLE, 0.05, 1.0, cycles=4.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0), 1.0, 0.2),
    "sweep": (lambda: Prescribed(sweep, MOTION_S), 1.0, math.nan),
    "road": (lambda: Prescribed(road, MOTION_S), 1.0, math.nan),
    "move": (Move(0.07, 0.3), 4.0, 0.3),
}
"""Order, frequency by which a phase is counted (Hz), largest planned speed (m/s)."""


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
        judge = ActuatorInterlock(
            1, self.driver.capabilities, frozen_after_ns=int(actuator.stale_after_s * 1e9),
            disagreement_m=self.config.disagreement_m, lag_s=actuator.poll_s + self.config.lvdt.stale_after_s,
        )
        lvdt: Any = Lvdt(self.machine)
        self.thread = ActuatorThread(actuator, self.driver, judge, lvdt, self.supervisor, lambda _: None)
        self.supervisor.attach(Coil(), self.thread, lvdt, ())
        self.steps = self.thread._stream.steps  # noqa: SLF001 - the loop below is the thread's own

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

    def start(self) -> float:
        """Begin the motion; its planned speed (m/s)."""
        order, frequency_Hz, fastest_m_s = MOTIONS[self.case.motion]
        period_s = 1.0 / frequency_Hz
        if isinstance(order, Program):
            self.supervisor.movement = Movement(period_s, period_s)
            self.thread.judge.expect_program(order.all_cycles * period_s, order.all_cycles)
            self.driver.send(Command.START, order)
        elif isinstance(order, Move):
            self.driver.send(Command.MOVE_TO, order)
        else:
            motion: Prescribed = order()
            fastest_m_s = motion.fastest_m_s
            limits = self.config.limits
            self.supervisor.movement = Movement(limits.speed_m_s / self.config.actuator.halt_deceleration_m_s2 + 0.1)
            self.thread.judge.expect_program(MOTION_S, 1.0)
            self.driver.compute(motion)
        return fastest_m_s

    def gap(self) -> None:
        """No set-point gets through for so long."""
        seconds, cause = self.case.gap_s, self.case.cause
        if cause == "held-up":
            self.clock.go_on(seconds)
        elif cause == "suspended":
            self.clock.go_on(seconds)
            self.clock.slept_ns += round(1e9 * seconds)
        else:
            switch = "is_busy" if cause == "busy" else "loses_answers"
            setattr(self.link, switch, True)
            self.run(seconds)
            setattr(self.link, switch, False)
        self.machine.catch_up()


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
        planned_m_s = virtual.start()
        begin_s = virtual.now_s()
        _, frequency_Hz, _ = MOTIONS[case.motion]
        steady_s = 0.05 if case.motion == "move" else STEADY_S
        virtual.run(steady_s + case.phase / frequency_Hz)
        from_s = begin_s + (1.0 / frequency_Hz if case.gap_s == 0.0 else steady_s + case.phase / frequency_Hz)
        if case.gap_s:
            virtual.gap()
            virtual.run(SETTLED_S)
        else:
            virtual.run(1.0)
        stop = virtual.supervisor.stop
        rows = virtual.machine.moved()
    later = rows[rows[:, 0] >= from_s - 1e-9]
    stride = round(1e-3 / virtual.machine.plant.dt_s)
    gained = np.diff(later[::stride, 2]) / 1e-3
    farthest = later[np.argmax(np.abs(later[:, 1])), 1]
    limits = virtual.config.limits
    trip, status = virtual.supervisor.trip, virtual.thread.judge.status
    return Outcome(
        float(np.max(np.abs(later[:, 2]))), float(np.max(np.abs(gained))), float(farthest),
        "" if trip is None else trip.slug, stop is not None and stop.step is StopPhase.SAFE,
        "" if status is None else State(status.state).name, planned_m_s,
        (limits.position_min_m, limits.position_max_m, limits.speed_m_s, limits.acceleration_m_s2), rows,
        virtual.setpoints,
    )


def main() -> None:
    """Run the table and print what is beyond limits, and the worst of each row."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--preset", choices=PRESETS, action="append")
    parser.add_argument("--motion", choices=MOTIONS, action="append")
    parser.add_argument("--cause", choices=CAUSES, action="append")
    parser.add_argument("--gap-ms", type=float, action="append")
    parser.add_argument("--phases", type=int, default=PHASES)
    parser.add_argument("--poll-ms", type=float, default=10.0)
    parser.add_argument("--tick-ms", type=float, default=0.0)
    parser.add_argument("--option", action="append", default=[])
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    gaps_s = GAPS_S if given.gap_ms is None else [1e-3 * gap for gap in given.gap_ms]
    bad = total = 0
    for preset in given.preset or PRESETS:
        for motion in given.motion or MOTIONS:
            for cause in given.cause or CAUSES:
                for gap_s in gaps_s:
                    worst: list[Outcome] = []
                    for step in range(given.phases):
                        one = outcome(Case(
                            preset, motion, cause, gap_s, step / given.phases, 1e-3 * given.poll_ms,
                            tuple(given.option), tick_s=1e-3 * given.tick_ms,
                        ))
                        worst.append(one)
                        total += 1
                        bad += bool(one.problems())
                        if given.verbose and one.problems():
                            print("   ", step, one.problems(), one.trip, one.state)
                    broken = sum(bool(one.problems()) for one in worst)
                    print(
                        f"{preset:14s} {motion:10s} {cause:10s} {1e3 * gap_s:5.0f} ms: "
                        f"{max(one.speed_m_s for one in worst):.3f} m/s, "
                        f"{max(one.acceleration_m_s2 for one in worst):5.1f} m/s^2, "
                        f"{1e3 * max(abs(one.farthest_m) for one in worst):5.1f} mm, "
                        f"{broken:2d} beyond, {sorted({one.trip for one in worst})}", flush=True,
                    )
    print(f"{bad} of {total} beyond limits")


if __name__ == "__main__":
    main()
