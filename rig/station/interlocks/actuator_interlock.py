"""Interlocks on the status that the controller reports; pure, no clock, no I/O."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.capabilities import Capabilities
from drivers.roles import ActuatorStatus, Command, FaultBit, Result, State
from rig.station.interlocks.finding import CONSECUTIVE, Finding
from rig.station.interlocks.motion_interlock import STILL_TOLERANCE_M, Place

MEASURED = ("position_m", "velocity_m_s")
"""What every controller measures; without a finite number of each, nothing it says about the rod is to be trusted."""
MOVING_STATES = frozenset({State.MOVING, State.RUNNING, State.FADING, State.HALTING})
FROZEN_TRAVEL_M = 0.002
FROZEN_POLLS = 2
"""So often, at later times of its clock, a frozen controller repeats a position after the LVDT has moved.

Two equal readings of a quantised register are none yet, nor two of the same instant. The first repetition may be an
answer from before the motion that the host read after the LVDT; the second was requested later.
"""
PATH_STEP_M = 0.05e-3
"""Less than this is the transducer's noise."""
OVERRUN_S = 0.07
"""Device time by which a program may outlast its own length."""
HOST_CLOCK_SHARE = 1e-3
"""By so much a controller's own time, which it does not tell, may differ from the host's."""
UNSEEN_S = 0.1
"""Device time, beside the usual age of a status: what moved and came back between two statuses farther apart than this
is not seen, so their positions prove no standstill in between."""
AT_REST_STATES = frozenset({State.HOLD, State.LOW, State.OFF})
RESTLESS_M_S = 0.02
CLOCK_MODULUS = 1 << 32

_NO_FAULT = FaultBit(0)
_FAULT_SLUGS = (
    (FaultBit.E_STOP, "estop"),
    (FaultBit.SUPPLY_PRESSURE, "supply-pressure"),
    (FaultBit.WATCHDOG, "host-silent"),
    (FaultBit.POSITION_LIMIT, "stroke-limit"),
    (FaultBit.SPEED_LIMIT, "speed-limit"),
    (FaultBit.FORCE_LIMIT, "force-limit"),
    (FaultBit.SENSOR, "feedback-lost"),
)


class ActuatorInterlock:
    """Follows the controller's status answers.

    Args (construction):
        owner_id: our lease.
        capabilities: what the actuator can do; what it cannot is not judged.
        frozen_after_ns: wall time after which an unchanged heartbeat is a fault.
        disagreement_m: how far controller position and LVDT may be apart at rest; the allowance grows with speed.
        lag_s: device time by which the two readings may differ in age.

    Attributes:
        path_m: way the rod has gone by the controller's own transducer, without that one's noise.
        leased: the lease is ours, so that its loss is a finding; without leases: no other client may command.
        frozen: the heartbeat has stood for too long: what the status says is not the present.
    """

    def __init__(
        self, owner_id: int, capabilities: Capabilities, *, frozen_after_ns: int, disagreement_m: float, lag_s: float
    ) -> None:
        self.owner_id = owner_id
        self._has_lease, self._own_clock = capabilities.lease, capabilities.clock
        self._measured = (*MEASURED, "force_N") if capabilities.force_input else MEASURED
        self.frozen_after_ns = frozen_after_ns
        self.disagreement_m = disagreement_m
        self.lag_s = lag_s
        self.status: ActuatorStatus | None = None
        self.leased = False
        self.frozen = False
        self.clock_s = 0.0
        self._beat_ns = 0
        self._held_m = math.nan
        self._repeats = 0
        self._lvdt_low_m = math.inf
        self._lvdt_high_m = -math.inf
        self._apart = 0
        self.path_m = 0.0
        self._anchor_m = self._path_anchor_m = math.nan
        self._anchor_s = 0.0
        self._program_s = math.inf
        self._program_began_s = math.nan
        self._restless = 0
        self.place = Place()
        self._shown_m: float | None = None
        self._commands = CommandWatch(acknowledged=capabilities.acknowledge)

    def expect_program(self, duration_s: float, cycles: float) -> None:
        """The program about to start lasts this long (device s) and has so many cycles, ramps included."""
        self._commands.expect_program(cycles)
        self._program_s = duration_s
        self._program_began_s = math.nan

    def check(
        self, status: ActuatorStatus, lvdt_m: float | None, lvdt_speed_m_s: float, sent: Sent
    ) -> list[Finding]:
        """Take one status answer.

        Args:
            status: the answer.
            lvdt_m: the latest fresh LVDT value, None without one.
            lvdt_speed_m_s: the LVDT's speed (m/s), NaN while unknown.
            sent: sequence and command of what was written to the controller, oldest first.

        Returns:
            What was found; the caller decides whether it matters now.
        """
        findings: list[Finding] = []
        self._follow_clock(status, findings)
        self._follow_bits(status, findings)
        if self.leased and (status.owner == self.owner_id or not self._has_lease):
            findings += self._commands.check(status, sent)
        self._follow_program(status, lvdt_m, lvdt_speed_m_s, findings)
        unknown = [name for name in self._measured if not math.isfinite(getattr(status, name))]
        if unknown:
            detail = f"the controller reports a value that is not a finite number: {', '.join(unknown)}"
            findings.append(Finding("feedback-lost", detail, status.received_ns))
        elif lvdt_m is not None:
            self._compare(status, lvdt_m, lvdt_speed_m_s, findings)
        self._follow_path(status.position_m)
        self.place.check(status.position_m)
        # Around a slow reversal the rod stays where it is for a while, though the controller moves it.
        moves = status.state in MOVING_STATES
        if moves or not abs(status.position_m - self._anchor_m) <= STILL_TOLERANCE_M:
            self._anchor_m, self._anchor_s = status.position_m, self.clock_s
        self.status = status
        return findings

    def _follow_path(self, position_m: float) -> None:
        step_m = abs(position_m - self._path_anchor_m)
        if not step_m <= PATH_STEP_M:
            self.path_m += step_m if math.isfinite(step_m) else 0.0
            self._path_anchor_m = position_m

    def restart(self) -> None:
        """Forget the past: after a reconnection nothing is compared with the status before it."""
        self.status = None
        self.frozen = False
        self._held_m = self._anchor_m = math.nan
        self._apart = 0
        self._commands.restart()

    def restart_still(self) -> None:
        """Begin the proof of standstill anew, from the next status on."""
        self._anchor_m = math.nan

    def hold_place(self) -> None:
        """Compare what follows with the position at which the rod rests now; with none while that is not known."""
        self.place.hold(self._anchor_m)

    @property
    def still_s(self) -> float:
        """Seconds of the controller's clock for which its own position has stood still."""
        return 0.0 if math.isnan(self._anchor_m) else self.clock_s - self._anchor_s

    def moving(self, still_s: float, period_s: float = 0.0) -> bool:
        """The controller moves, or its position has not stood still for long enough since it last said so.

        Args:
            still_s: enough where its state tells whether it moves.
            period_s: of what ran: a latched trip says nothing of the fade-out that goes on behind it.
        """
        if (status := self.status) is None or status.state in MOVING_STATES:
            return True
        return self.still_s < (max(still_s, period_s) if status.state == State.TRIPPED else still_s)

    def _follow_clock(self, status: ActuatorStatus, findings: list[Finding]) -> None:
        before = self.status
        if before is None:
            self._beat_ns = status.received_ns
            return
        forward_us = (status.clock_us - before.clock_us) % CLOCK_MODULUS
        if forward_us >= CLOCK_MODULUS // 2:
            detail = f"the controller's clock ran backwards, from {before.clock_us} to {status.clock_us} us"
            findings.append(Finding("actuator-reboot", detail, status.received_ns))
            self._anchor_m = math.nan
        else:
            self.clock_s += forward_us * 1e-6
            if forward_us * 1e-6 > UNSEEN_S + self.lag_s:
                self._anchor_m = math.nan
        if status.heartbeat != before.heartbeat:
            self._beat_ns = status.received_ns
        age_ms = (status.received_ns - self._beat_ns) / 1e6
        self.frozen = age_ms > self.frozen_after_ns / 1e6
        if self.frozen:
            detail = f"the controller's heartbeat was unchanged at {status.heartbeat} for {age_ms:.0f} ms"
            findings.append(Finding("actuator-frozen", detail, status.received_ns, age_ms, self.frozen_after_ns / 1e6))

    def _follow_bits(self, status: ActuatorStatus, findings: list[Finding]) -> None:
        t_ns = status.received_ns
        rest = FaultBit(status.fault_bits) if status.fault_bits else _NO_FAULT
        for bits, slug in _FAULT_SLUGS if rest is not _NO_FAULT else ():
            if rest & bits:
                detail = f"the controller reports fault bit {bits.name}"
                findings.append(Finding(slug, detail, t_ns, float(status.fault_bits)))
                rest &= ~bits
        if status.e_stop_open and not status.fault_bits & FaultBit.E_STOP:
            findings.append(Finding("estop", "the e-stop chain is open", t_ns))
        if rest or (status.state == State.TRIPPED and status.fault_bits == 0):
            names = ", ".join(bit.name or "?" for bit in FaultBit if bit & rest) or "no fault bit was reported"
            detail = f"the controller tripped: {names}"
            findings.append(Finding("controller-trip", detail, t_ns, float(status.fault_bits)))
        if not self.leased or not self._has_lease:
            return
        if status.owner not in {0, self.owner_id}:
            detail = f"the controller's lease is held by {status.owner}, expected {self.owner_id} (this host)"
            findings.append(Finding("second-master", detail, t_ns, status.owner, self.owner_id))
        elif status.owner == 0:
            findings.append(Finding("actuator-reboot", "the controller no longer holds this host's lease", t_ns))

    def _follow_program(
        self, status: ActuatorStatus, lvdt_m: float | None, lvdt_speed_m_s: float, findings: list[Finding]
    ) -> None:
        """A program ends when its cycles are done, and where the controller holds, the rod stands.

        Only an LVDT that shows another position than at the poll before says anew that the rod moves: on a host that
        is held up its last value may be from before the end of the motion.
        """
        t_ns = status.received_ns
        if status.state != State.RUNNING:
            self._program_began_s = math.nan
        elif math.isnan(self._program_began_s):
            self._program_began_s = self.clock_s
        elif self.clock_s - self._program_began_s > self._program_s + self._overrun_s():
            ran_s = self.clock_s - self._program_began_s
            detail = f"the program has been running for {ran_s:.3f} s, but its duration is {self._program_s:.3f} s"
            findings.append(Finding("stop-ignored", detail, t_ns, ran_s, self._program_s))
        restless = status.state in AT_REST_STATES and abs(lvdt_speed_m_s) > RESTLESS_M_S
        shown_m, self._shown_m = self._shown_m, lvdt_m
        if not restless:
            self._restless = 0
        elif lvdt_m is not None and lvdt_m != shown_m:
            self._restless += 1
        if self._restless >= 4 * CONSECUTIVE:
            detail = (
                f"the controller reports {State(status.state).name}, but the LVDT moves at {lvdt_speed_m_s:.3g} m/s"
            )
            findings.append(Finding("stop-ignored", detail, t_ns, lvdt_speed_m_s, RESTLESS_M_S))

    def _overrun_s(self) -> float:
        """So much longer than ordered a program may seem to run (s).

        Without a clock of the controller's own the host's is taken: they run apart, and the host sees the begin late.
        """
        return OVERRUN_S if self._own_clock else OVERRUN_S + HOST_CLOCK_SHARE * self._program_s + self.lag_s

    def _compare(self, status: ActuatorStatus, lvdt_m: float, speed_m_s: float, findings: list[Finding]) -> None:
        t_ns = status.received_ns
        if status.position_m == self._held_m:
            self._lvdt_low_m = min(self._lvdt_low_m, lvdt_m)
            self._lvdt_high_m = max(self._lvdt_high_m, lvdt_m)
            travel_m = self._lvdt_high_m - self._lvdt_low_m
            another = self.status is not None and status.clock_us != self.status.clock_us
            self._repeats += another and travel_m > FROZEN_TRAVEL_M
            if self._repeats >= FROZEN_POLLS:
                detail = (
                    f"the controller's position was unchanged at {status.position_m:.6g} m while the LVDT moved "
                    f"{travel_m:.4g} m"
                )
                findings.append(Finding("actuator-frozen", detail, t_ns, travel_m, FROZEN_TRAVEL_M))
        else:
            self._repeats = 0
            self._held_m, self._lvdt_low_m, self._lvdt_high_m = status.position_m, lvdt_m, lvdt_m
        speeds = [abs(status.velocity_m_s), 0.0 if math.isnan(speed_m_s) else abs(speed_m_s)]
        allowed_m = self.disagreement_m + max(speeds) * self.lag_s
        apart_m = abs(status.position_m - lvdt_m)
        self._apart = self._apart + 1 if apart_m > allowed_m else 0
        if self._apart >= 2 * CONSECUTIVE:
            detail = (
                f"the controller is at {status.position_m:.6g} m, the LVDT at {lvdt_m:.6g} m, allowed difference "
                f"{allowed_m:.4g} m"
            )
            findings.append(Finding("position-disagreement", detail, t_ns, apart_m, allowed_m))


SLUG = "second-master"
UNASKED = 2
"""Statuses in a row: a controller may show what it does one status before it says why."""
MOTIONS = frozenset({Command.START, Command.MOVE_TO})
STOPS = frozenset({Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF})
PRESSURES = frozenset({Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.HYDRAULICS_OFF})
STOPPING_STATES = frozenset({State.FADING, State.HALTING})
PRESSURELESS_STATES = frozenset({State.OFF, State.LOW})
CYCLE_SLACK = 1e-6

Sent = Sequence[tuple[int, int]]
"""(sequence, command) of what was written to the controller, oldest first."""


class CommandWatch:
    """Follows the controller's status while the lease is ours.

    Args (construction):
        acknowledged: the status names the last command, so that another client's shows by it.
    """

    def __init__(self, *, acknowledged: bool) -> None:
        self._acknowledged = acknowledged
        self._cycles = 0.0
        self._running = 0
        self._pressurised = False
        self._unasked = 0
        self._knocked = (0, 0)
        self._before: tuple[int, int] | None = None
        """The last command that is known and accounts for what is shown: of the time before this host, then its own."""

    def expect_program(self, cycles: float) -> None:
        """The program that is about to start has so many cycles, ramps included."""
        self._cycles = cycles

    def restart(self) -> None:
        """Forget the past: after a reconnection nothing is compared with what was seen before."""
        self._running = 0
        self._pressurised = False
        self._unasked = 0

    def check(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """Take one status that shows our lease."""
        findings = self._command(status, sent)
        if findings or status.fault_bits or status.state == State.TRIPPED:
            self._running, self._unasked = 0, 0
            return findings
        if status.e_stop_open:
            return []
        return [*self._program(status, sent), *self._doing(status, sent)]

    def _command(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        acknowledged = (status.acked_sequence, status.acked_command)
        if acknowledged in sent or (self._before is None and not sent):
            # Without a lease the first status still shows earlier requests of other clients.
            self._before = acknowledged
        if not self._acknowledged or acknowledged == self._before:
            return []
        detail = (
            f"the controller's last command is {_name(acknowledged[1])}, number {acknowledged[0]}, which this host "
            "did not send"
        )
        if status.acked_command == Command.ACQUIRE and status.result == Result.REFUSED_OWNER:
            # Another host asks whether the rig is free, and has been told that it is not: said once.
            if acknowledged == self._knocked:
                return []
            self._knocked = acknowledged
            return [Finding(SLUG, f"{detail}; it was refused", status.received_ns, warns=True)]
        return [Finding(SLUG, detail, status.received_ns, status.acked_sequence)]

    def _program(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """The program that runs is ours, and it ends with the cycles that were ordered."""
        before, self._running = self._running, status.program_id if status.state == State.RUNNING else 0
        started = _last(sent, {Command.START})
        if self._running and (self._running, int(Command.START)) != started:
            detail = f"the controller runs program {status.program_id}, which this host did not start"
            return [Finding(SLUG, detail, status.received_ns, status.program_id)]
        ended = before and before == status.program_id and status.state == State.HOLD
        whole = int(self._cycles + CYCLE_SLACK)
        if ended and not _stopped(sent) and status.cycles_done < whole:
            detail = (
                f"the program ended after {status.cycles_done} of {whole} cycles without a stop command from this host"
            )
            return [Finding(SLUG, detail, status.received_ns, status.cycles_done, whole)]
        return []

    def _doing(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """A motion that is being stopped, or a pressure that goes, was ordered here or follows a fault."""
        commanded_on = (_last(sent, PRESSURES) or (0, 0))[1] == Command.HYDRAULICS_ON
        pressureless = status.state in PRESSURELESS_STATES
        self._pressurised = commanded_on and (self._pressurised or not pressureless)
        stopping = status.state in STOPPING_STATES and not _stopped(sent)
        moving = status.state == State.MOVING and (_last(sent, MOTIONS) or (0, 0))[1] != Command.MOVE_TO
        self._unasked = self._unasked + 1 if stopping or moving or (pressureless and self._pressurised) else 0
        if self._unasked < UNASKED:
            return []
        detail = f"the controller is {State(status.state).name}, without a fault and without a command from this host"
        return [Finding(SLUG, detail, status.received_ns, status.state)]


def _last(sent: Sent, commands: frozenset[Command] | set[Command]) -> tuple[int, int] | None:
    """The newest of these commands that was sent; None when none of them was."""
    return next((command for command in reversed(sent) if command[1] in commands), None)


def _stopped(sent: Sent) -> bool:
    """A stop was sent since the last motion was asked for, or no motion was."""
    newest = _last(sent, MOTIONS | STOPS)
    return newest is None or newest[1] in STOPS


def _name(command: int) -> str:
    return Command(command).name if command in set(Command) else str(command)
