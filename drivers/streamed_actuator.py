"""An actuator without a function generator: the host makes its motion and streams it, a set-point with every poll.

`StreamedActuator` stands between the station and the device's driver, a `SetpointFollower`, and is the whole role
`drivers.roles.Actuator`: moves, programs, fades and halts are made by a `SetpointGenerator`; everything else goes to
the device. What it shows is the device's own status with the motion that is streamed: state, phase, cycles, program.

The device holds by itself until the first motion, from then on it follows, at rest too. It follows no more once its
pressure is lowered, it has tripped, or it was halted by a command of its own; the next motion begins where the rod is.

A set-point leaves only if the rod can reach it (`SetpointGuard`). What was sent and not acknowledged counts as not
taken, nor does what was acknowledged without its counter by a device that repeats counters. After a time without a
set-point that was taken:

    up to 1.6 periods, and     the motion goes on
    6 ms after the period
    up to `longest_gap_s`      the rod is measured first; the set-points lead from there back to the motion
    longer                     the motion has ended: the rod is measured and braked from where it is, at its speed

A moving rod that was measured over a trip longer than the first of these times counts as not measured: meanwhile the
device may have stopped it, and a set-point at the speed it had then would set it in motion again.

The last command in the device's status is the streamed motion's, unless another client's has come since. A stop by
another client ends the motion like a gap.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Protocol, runtime_checkable

from drivers import clock
from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import LinkKind, MotionTerms
from drivers.errors import Busy, DriverError, RequestRefused
from drivers.origins import ChannelOrigin, Origins, origins_of
from drivers.ring import Channel
from drivers.roles import (
    Actuator,
    ActuatorIdentity,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    Move,
    Program,
    Result,
    State,
)
from drivers.servo_lag import ServoLag
from drivers.setpoint_generator import ComputedMotion, RodLimits, Setpoint, SetpointGenerator
from drivers.setpoint_guard import SetpointGuard
from drivers.setpoint_lead import SetpointLead
from protocols.errors import LocalProtocolError

SENT_KEPT = 64
FEWEST_SETPOINTS = 20
"""In a cycle: with fewer its shape is no longer the one that was asked for."""
GENERATED = frozenset({Command.MOVE_TO, Command.START, Command.FADE_STOP, Command.HALT})
"""Commands that are set-points here; a halt only where the device has none of its own."""
STOPS = frozenset({Command.FADE_STOP, Command.HALT})
HOLDING = frozenset({State.HOLD, State.MOVING, State.RUNNING})
"""States of a device that goes where it is told."""
IN_MOTION = frozenset({State.MOVING, State.RUNNING, State.FADING, State.HALTING})
REGULAR_PERIODS = 1.6
LATEST_S = 0.006
"""A set-point that comes later after the last one than this many periods, or than a period and this time (wall s), is
sent only after the rod was measured: meanwhile the device has gone on at the last speed, or held the last position, and
only the rod shows which."""
LOOKS_APART_PERIODS = (0.5, 2.5)
"""Between two looks whose difference is a speed: noise is no speed, nor is the mean of one and a standstill."""
RESTS_M = 1e-3
"""A rod at rest that is farther from the set-point it was to hold is held where it is; one that goes no farther during
the trip that measures it is at rest."""
RESTING_POLLS, RESTING_M = 4, 1e-4
"""A rod is at rest when the positions of so many polls are no farther apart."""


@runtime_checkable
class SetpointFollower(Actuator, Protocol):
    """The driver of a device that follows set-points.

    A driver whose device takes positions without a speed, and stops at each one, says so by an attribute `takes_speed`
    that is False. It is optional: drivers are recognised by the methods below, and a plug-in may not have it.
    """

    def knows(self, command: Command) -> bool:
        """Whether the device has this command itself."""

    def follow(self, setpoint: Setpoint, watchdog_counter: int | None) -> ActuatorStatus:
        """Send a set-point, once, and read the status; in one trip where the device allows it.

        Args:
            setpoint: where to be (m) and how fast to go on (m/s).
            watchdog_counter: a changed number feeds the watchdog; None: it is not fed by this.
        """


class StreamedActuator:
    """A set-point follower as an actuator that moves, runs programs, fades and halts; one owner thread.

    Args:
        device: the device's driver; it streams set-points and has no generator.
        terms: how fades and halts end, the rate of the device's time, the limits of set-points.

    Attributes:
        sent: sequence and command of the last commands, oldest first; those that became set-points too.
        last: the set-point sent last; None while the device holds by itself.
        broken_off: the motion was not continued after a gap; until the rod is measured no set-point is sent, and each
            is sent from where the rod is until the device takes one.
        breaks: motions that were not continued after a gap, so far.
        gap_s: the last such gap (wall s).
        taken_m: the set-point that the device itself showed in answer to it (m); NaN where it shows none.
    """

    def __init__(self, device: SetpointFollower, terms: MotionTerms) -> None:
        self.sent: deque[tuple[int, int]] = deque(maxlen=SENT_KEPT)
        self.last: Setpoint | None = None
        self.taken_m = math.nan
        self.broken_off = False
        self.breaks = 0
        self.gap_s = 0.0
        self._device = device
        self._rate = terms.device_rate
        limits = RodLimits(terms.position_min_m, terms.position_max_m, terms.speed_m_s, terms.acceleration_m_s2)
        self._source = SetpointGenerator(
            0.0, halt_deceleration_m_s2=terms.halt_deceleration_m_s2, fade_out_cycles=terms.fade_out_cycles,
            limits=limits,
        )
        self._period_s = terms.period_s * terms.device_rate
        self._longest_gap_s = terms.longest_gap_s * terms.device_rate
        self._regular_s = min(REGULAR_PERIODS * self._period_s, self._period_s + LATEST_S * terms.device_rate)
        self._guard = SetpointGuard(limits, self._period_s)
        self._lag = ServoLag()
        self._lead = None if getattr(device, "takes_speed", True) else SetpointLead(limits, self._period_s)
        self._seen: tuple[float, float] | None = None
        self._fastest_m_s = math.inf
        self._counters: tuple[int | None, int | None] = (None, None)
        self._lost = False
        self._following = False
        self._refused = False
        self._stopped = self._withheld = False
        self._polled_m: deque[float] = deque(maxlen=RESTING_POLLS)
        self._made: tuple[int, int] | None = None
        self._answered = self._known = (0, 0)
        self._count = 0
        self._program_id = 0
        self._rest_m = math.nan
        self._state: int = State.OFF
        self._own = device.capabilities
        self._capabilities = replace(self._own, phase=True)
        self._silence_stops = self._own.watchdog is WatchdogKind.TIMEOUT

    @property
    def capabilities(self) -> Capabilities:
        """What the device can do; the phase of a program is known here."""
        own = self._device.capabilities
        if own is not self._own:
            self._own, self._capabilities = own, replace(own, phase=True)
        return self._capabilities

    @property
    def origins(self) -> Origins:
        """The device's channels, and what is known of the motion because it is streamed from here."""
        device = origins_of(self._device)
        motion = ChannelOrigin("station", "value = taken from the motion streamed by this host, while the device "
            "follows this motion")
        own = dict.fromkeys((Channel.PHASE, Channel.CYCLES_DONE), motion)
        own[Channel.STATE] = motion._replace(from_wire="; else ".join(
            [motion.from_wire, *([device[Channel.STATE].from_wire] if Channel.STATE in device else [])]
        ))
        if Channel.SETPOINT not in device:
            own[Channel.SETPOINT] = ChannelOrigin("station", "value = set-point sent by this host")
            own[Channel.SERVO_ERROR] = ChannelOrigin("station", "value = set-point sent by this host - position")
        return {**device, **own}

    @property
    def link_kind(self) -> LinkKind:
        """What the connection is made of."""
        return self._device.link_kind

    @property
    def is_open(self) -> bool:
        """The connection stands, as far as is known."""
        return self._device.is_open

    @property
    def stale(self) -> int:
        """Answers to other requests that were thrown away."""
        return self._device.stale

    @property
    def busy(self) -> int:
        """"Busy" answers that were asked again."""
        return self._device.busy

    @property
    def halts_itself(self) -> bool:
        """The device halts by a command of its own, whatever becomes of the stream."""
        return self._device.knows(Command.HALT)

    @property
    def in_motion(self) -> bool:
        """The set-points that are being streamed move."""
        return self._following and self._source.state in IN_MOTION

    @property
    def rod_moves(self) -> bool:
        """The set-points move, or the rod, a slow one, has yet to come to rest where they ended."""
        return self.in_motion or (self._following and not self._rests())

    @property
    def silent_s(self) -> float:
        """Time since the last set-point that the device took (s of its time); 0 while none are streamed."""
        return self._now_s() - self._guard.taken_s if self._following else 0.0

    def look_for_gap(self) -> None:
        """A motion for which no set-point was taken for too long has ended: the rod is braked from where it is."""
        silent_s = self.silent_s
        if self._period_s > 0.0 and self.in_motion and silent_s > self._longest_gap_s and not self.broken_off:
            self.broken_off = True
            self.breaks, self.gap_s = self.breaks + 1, silent_s / self._rate

    def open(self) -> None:
        """Open the connection."""
        self._device.open()

    def close(self) -> None:
        """Close the connection; the device holds, or its watchdog stops it."""
        self._device.close()

    def read_identity(self) -> ActuatorIdentity:
        """Who the device is."""
        return self._device.read_identity()

    def read_limits(self) -> ActuatorLimits:
        """The limits that the device holds."""
        return self._device.read_limits()

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write the device's limits and watchdog."""
        self._device.write_limits(limits)

    def write_table(self, values_m: list[float]) -> None:
        """Table waveforms are not made here.

        Raises:
            LocalProtocolError: always.
        """
        raise LocalProtocolError(f"a table of {len(values_m)} values cannot be streamed here")

    def read_status(self) -> ActuatorStatus:
        """The status, and the next set-point while the device follows; the watchdog is not fed.

        Nothing is sent to a device whose watchdog any write feeds, nor after one that it refused.
        """
        if not self._following or self._silence_stops or self._refused:
            return self._shown(self._device.read_status())
        return self._follow(None)

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status, with the next set-point while the device follows."""
        self._counters = (self._counters[1], watchdog_counter)
        if not self._following:
            return self._shown(self._device.exchange(watchdog_counter))
        return self._follow(watchdog_counter)

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        """Begin, fade or halt a motion of set-points, or send the device's own command.

        Returns:
            The command's sequence number.

        Raises:
            LocalProtocolError: the device does not hold, something moves already, or the order makes no sense.
            DriverError: the device cannot be reached or refuses.
        """
        if command not in GENERATED or (command is Command.HALT and self._device.knows(command)):
            return self._pass_on(command, order)
        now_s = self._now_s()
        if isinstance(order, Move):
            self._engage()
            self._source.move(order, now_s)
        elif isinstance(order, Program):
            self._engage()
            self._source.start(order, now_s)
            self._program_id = self._count + 1
        elif command in STOPS:
            self._stop(command, now_s)
        else:
            raise LocalProtocolError(f"{command.name} needs an order")
        return self._counted(command)

    def _stop(self, command: Command, now_s: float) -> None:
        """Fade or halt; after a gap neither goes on from the motion: the rod is measured and braked."""
        self._stopped = True
        self.look_for_gap()
        if self.broken_off:
            return
        if command is Command.FADE_STOP:
            self._source.fade(now_s)
        else:
            self._source.halt(now_s)

    def compute(self, motion: ComputedMotion) -> int:
        """Begin a motion that is computed as it goes, as `send` begins a program.

        Returns:
            The command's sequence number.

        Raises:
            LocalProtocolError: the device does not hold, or something moves already.
        """
        now_s = self._now_s()
        self._engage()
        self._source.compute(motion, now_s)
        self._program_id = self._count + 1
        return self._counted(Command.START)

    def _counted(self, command: Command) -> int:
        self._count = self._count % 0xFFFF + 1
        self._made, self._known = (self._count, int(command)), self._answered
        self.sent.append(self._made)
        return self._count

    def _pass_on(self, command: Command, order: Move | Program | None) -> int:
        """Have the device itself carry out a command; it follows no set-points after one that moves or resets it."""
        sequence = self._device.send(command, order)
        if command not in {Command.ACQUIRE, Command.RELEASE}:
            self._release()
        self._made = None
        self.sent.append((sequence, int(command)))
        return sequence

    def _engage(self) -> None:
        """Follow from where the rod is held.

        Raises:
            LocalProtocolError: it is not held there.
        """
        if self._state not in HOLDING or not math.isfinite(self._rest_m):
            raise LocalProtocolError("set-points were sent although the device does not hold its position (state "
                f"{self._state})")
        if not self._following or self._withheld or self.silent_s > self._longest_gap_s > 0.0:
            self._source.rest(self._rest_m)
            self._guard.begin(Setpoint(self._rest_m, 0.0), self._now_s())
            if self._lead is not None:
                self._lead.begin(self._rest_m)
            self._following, self.broken_off = True, False
        self._stopped = self._withheld = False

    def _release(self) -> None:
        """The device is on its own: what it was to do is over."""
        self._following = self._refused = self.broken_off = self._stopped = self._withheld = False
        self._seen = None
        self.last, self.taken_m = None, math.nan
        self._source.rest(self._rest_m if math.isfinite(self._rest_m) else 0.0)

    def _follow(self, watchdog_counter: int | None) -> ActuatorStatus:
        """One step of the stream.

        Raises:
            RequestRefused: the device does not take it; unless it was busy, the next one is sent when its watchdog is
                fed again.
            DriverError: it cannot be reached.
        """
        self.look_for_gap()
        if self._withholds():
            feeds = watchdog_counter is not None and not self._silence_stops
            return self._shown(self._device.exchange(watchdog_counter or 0) if feeds else self._device.read_status())
        if self.broken_off or self.silent_s > self._regular_s > 0.0:
            request_s = self._now_s()
            status = self._shown(self._device.read_status())
            if not self._following or not self._measure(status, request_s):
                return status
        now_s = self._now_s()
        setpoint = self._going_on(self._source.at(now_s), now_s)
        braking = self._source.state is State.HALTING
        if math.isfinite(self._source.fastest_m_s):  # not known of a halt and a hold, which are no faster than before
            self._fastest_m_s = self._source.fastest_m_s
        setpoint = self._guard.reachable(setpoint, now_s, self._fastest_m_s, braking=braking)
        self.last, self.taken_m = setpoint, math.nan
        status, took = self._sent(setpoint, now_s, watchdog_counter)
        self._refused = False
        if took:
            self.broken_off = False
            self._guard.taken(setpoint, now_s)
        self._lag.add(setpoint, status.position_m)
        self.taken_m = status.setpoint_m
        return self._shown(status)

    def _withholds(self) -> bool:
        """After a stop, no set-point goes to a rod that rests elsewhere: the last ones were not taken, the next may be.

        Nor, after a gap, to one that is not known to rest, unless set-points feed the watchdog. The device itself holds
        the rod. The next motion begins where it does.
        """
        if self._stopped and not self._withheld and not self.in_motion:
            if not self._rests():
                return self.silent_s > self._regular_s > 0.0 and not self._silence_stops
            self._withheld = abs(max(self._polled_m) - self._source.last.position_m) > RESTS_M
        return self._withheld

    def _rests(self) -> bool:
        """The rod is at rest, by its last positions."""
        polled_m = self._polled_m
        return len(polled_m) == RESTING_POLLS and max(polled_m) - min(polled_m) < RESTING_M

    def _sent(self, setpoint: Setpoint, now_s: float, watchdog_counter: int | None) -> tuple[ActuatorStatus, bool]:
        """Send a set-point, as the device takes it.

        Returns:
            The status, and whether the device took the set-point as far as it shows.

        Raises:
            RequestRefused: the device does not take it.
            DriverError: it cannot be reached.
        """
        lead = self._lead
        sent = setpoint if lead is None else lead.sent(setpoint, now_s, self._fastest_m_s)
        try:
            status = self._device.follow(sent, watchdog_counter)
        except DriverError as error:
            if isinstance(error, RequestRefused):
                self._refused = not isinstance(error, Busy)
            if lead is not None:
                lead.lost(sent.position_m)  # the device may have taken it, and refused the read that follows
            raise
        took = self._took(status, fed=watchdog_counter is not None)
        if lead is not None and took:
            lead.taken(sent.position_m, now_s)
        elif lead is not None:
            lead.lost(sent.position_m)
        return status, took

    def _took(self, status: ActuatorStatus, *, fed: bool) -> bool:
        """Whether the device took a set-point that it acknowledged: it repeats its counter, or yet the one before.

        Without a counter (`fed` is False) as the last one with a counter.
        """
        if fed and self._device.capabilities.echo:
            self._lost = status.watchdog_echo not in self._counters
        return not self._lost

    def _measure(self, status: ActuatorStatus, request_s: float) -> bool:
        """After a gap: go on, or brake, from where the rod is; False while that is not known.

        Args:
            status: as the device showed it.
            request_s: when that was requested (s of the device's time).
        """
        if not self.in_motion:
            held_m, now_s = self._source.last.position_m, self._now_s()
            # After a stop the rod may have been proved to stand still: nothing sets it in motion again.
            if abs(status.position_m - held_m) > (RESTING_M if self._stopped else RESTS_M):
                self._source.rest(status.position_m)
            self._guard.measured(self._source.last, now_s, catch_up=False)
            if self._lead is not None:
                self._lead.measured(self._source.last)
            return math.isfinite(status.position_m)
        rod, now_s = self._rod(status, request_s), self._now_s()
        if rod is None:
            return False
        old_s = now_s - request_s
        if old_s > self._regular_s > 0.0 and abs(rod.velocity_m_s) * old_s > RESTS_M:
            return False
        if self.broken_off:
            self._source.halt_from(rod, now_s)
        self._guard.measured(rod, now_s, catch_up=not self.broken_off)
        if self._lead is not None:
            self._lead.measured(rod)
        return True

    def _rod(self, status: ActuatorStatus, request_s: float) -> Setpoint | None:
        """The set-point that a rod follows which is where this status shows it, at its speed; None while not known."""
        position_m, velocity_m_s = status.position_m, status.velocity_m_s
        if not self._device.capabilities.speed:
            # A speed that is a difference of positions is the mean over the gap: a second look is needed.
            seen_s, before = 0.5 * (request_s + self._now_s()), self._seen
            apart_s = math.inf if before is None else seen_s - before[0]
            soonest_s, latest_s = (share * self._period_s for share in LOOKS_APART_PERIODS)
            if before is None or apart_s > latest_s > 0.0:
                self._seen = (seen_s, position_m)
                return None
            if apart_s < soonest_s or apart_s <= 0.0:
                return None
            velocity_m_s = (position_m - before[1]) / apart_s
        if not (math.isfinite(position_m) and math.isfinite(velocity_m_s)):
            return None
        self._seen = None
        return self._lag.setpoint_of(position_m, velocity_m_s)

    def _going_on(self, target: Setpoint, now_s: float) -> Setpoint:
        """The set-point with the mean speed of the coming period: going on at it, the device meets the next one."""
        if self._period_s == 0.0 or not self.in_motion:
            return target
        ahead_m = self._source.ahead(now_s + self._period_s)
        if ahead_m is None:
            return target
        return Setpoint(target.position_m, (ahead_m - target.position_m) / self._period_s)

    def _shown(self, status: ActuatorStatus) -> ActuatorStatus:
        """The device's status with the motion that is streamed to it."""
        self._polled_m.append(status.position_m)
        self._state = status.state
        held_m = status.position_m if math.isnan(status.setpoint_m) else status.setpoint_m
        if math.isfinite(held_m):
            self._rest_m = held_m
        if status.state not in HOLDING and self._following:
            self._release()
        changed: dict[str, float] = {}
        of_another = self._is_of_another(status)
        if self._made is not None and not of_another:
            changed = {"acked_sequence": self._made[0], "acked_command": self._made[1], "result": Result.DONE}
        if not self._following:
            return status._replace(**changed) if changed else status  # type: ignore[arg-type]  # by field name
        source, last = self._source, self.last
        running = source.state in {State.RUNNING, State.FADING}
        changed |= {
            "state": State.HALTING if self.broken_off else source.state, "phase": source.phase,
            "cycles_done": source.cycles_done, "program_id": self._program_id if running else 0,
        }
        if math.isnan(status.setpoint_m) and last is not None:
            changed |= {"setpoint_m": last.position_m, "servo_error_m": last.position_m - status.position_m}
        return status._replace(**changed)  # type: ignore[arg-type]  # by field name

    def _is_of_another(self, status: ActuatorStatus) -> bool:
        """The device's last command came from another client since the motion was made.

        One that stops the device ends the motion: the rod is measured and braked from where it is.
        """
        before, self._answered = self._answered, (status.acked_sequence, status.acked_command)
        if self._answered == self._known or self._answered in self.sent:
            return False
        stops = status.acked_command in STOPS and status.result == Result.DONE
        if stops and self._answered != before and self.in_motion:
            self.broken_off = True
        return True

    def _now_s(self) -> float:
        """The host's clock that goes on while the machine is suspended (s of the device's time)."""
        return clock.elapsed_ns() * 1e-9 * self._rate


def as_actuator(driver: Actuator, terms: MotionTerms) -> Actuator:
    """A driver as the station uses it: one that only follows set-points becomes a whole actuator."""
    can = driver.capabilities
    if can.streamed_setpoints and not can.generator and isinstance(driver, SetpointFollower):
        return StreamedActuator(driver, terms)
    return driver
