"""Interlocks on what the devices say about themselves: controller status, ECU status; pure, no clock, no I/O."""

from __future__ import annotations

import math
from collections.abc import Callable

from protocols.actuator import ActuatorStatus, FaultBit, Input, State
from protocols.ecu import CoilStatus, CoilTemperature, EcuFault
from rig.station.command_watch import CommandWatch, Sent
from rig.station.interlocks import CONSECUTIVE, STILL_TOLERANCE_M, Finding

MEASURED = ("position_m", "velocity_m_s", "force_N")
"""What the controller measures; without a finite number of each, nothing it says about the rod is to be trusted."""
MOVING_STATES = frozenset({State.MOVING, State.RUNNING, State.FADING, State.HALTING})
FROZEN_TRAVEL_M = 0.002
FROZEN_POLLS = 2
"""So often, at later times of its clock, the controller repeats a position that is frozen: two equal readings of a
quantised register are none yet, nor two of the same instant.
"""
PATH_STEP_M = 0.05e-3
"""Less than this is the transducer's noise."""
OVERRUN_S = 0.07
"""Device time by which a program may outlast its own length."""
AT_REST_STATES = frozenset({State.HOLD, State.LOW, State.OFF})
RESTLESS_M_S = 0.02
CLOCK_MODULUS = 1 << 32
CONSEQUENCE_NS = 50_000_000
CONSEQUENCES = EcuFault.UNDERVOLTAGE | EcuFault.COMMAND_TIMEOUT
"""What the ECU reports when the fault is elsewhere."""
STATUS_MS = 10
UNTOLD_STATUSES = 50
"""Status frames (`STATUS_MS` each on the ECU's clock) without a temperature: five of the temperature's periods."""

_FAULT_SLUGS = (
    (FaultBit.E_STOP, "estop"),
    (FaultBit.SUPPLY_PRESSURE, "supply-pressure"),
    (FaultBit.WATCHDOG, "host-silent"),
    (FaultBit.POSITION_LIMIT, "stroke-limit"),
    (FaultBit.SPEED_LIMIT, "speed-limit"),
    (FaultBit.FORCE_LIMIT, "force-limit"),
    (FaultBit.SENSOR, "feedback-lost"),
)
_ECU_SLUGS = (
    (EcuFault.OPEN | EcuFault.SHORT, "coil-open-short"),
    (EcuFault.OVER_TEMPERATURE | EcuFault.UNDERVOLTAGE, "ecu-overtemp"),
    (EcuFault.RESTARTED, "ecu-restart"),
    (EcuFault.COMMAND_TIMEOUT | EcuFault.COMMAND_CHECK, "ecu-command"),
)


class ControllerJudge:
    """Follows the controller's status answers.

    Args (construction):
        owner_id: our lease.
        frozen_after_ns: wall time after which an unchanged heartbeat is a fault.
        disagreement_m: how far controller position and LVDT may be apart at rest; the allowance grows with speed.
        lag_s: device time by which the two readings may differ in age.

    Attributes:
        path_m: way the rod has gone by the controller's own transducer, without that one's noise.
        leased: the lease is ours, so that its loss is a finding.
        frozen: the heartbeat has stood for too long: what the status says is not the present.
    """

    def __init__(self, owner_id: int, *, frozen_after_ns: int, disagreement_m: float, lag_s: float) -> None:
        self.owner_id = owner_id
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
        self._commands = CommandWatch()

    def expect_program(self, duration_s: float, cycles: float) -> None:
        """The program about to start lasts this long (device s) and has so many cycles, ramps included."""
        self._commands.expect_program(cycles)
        self._program_s = duration_s
        self._program_began_s = math.nan

    def judge(
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
        if self.leased and status.owner == self.owner_id:
            findings += self._commands.judge(status, sent)
        self._follow_program(status, lvdt_speed_m_s, findings)
        unknown = [name for name in MEASURED if not math.isfinite(getattr(status, name))]
        if unknown:
            detail = f"controller's {', '.join(unknown)} not a finite number"
            findings.append(Finding("feedback-lost", detail, status.received_ns))
        elif lvdt_m is not None:
            self._compare(status, lvdt_m, lvdt_speed_m_s, findings)
        self._follow_path(status.position_m)
        if not abs(status.position_m - self._anchor_m) <= STILL_TOLERANCE_M:
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

    @property
    def still_s(self) -> float:
        """Seconds of the controller's clock for which its own position has stood still."""
        return 0.0 if math.isnan(self._anchor_m) else self.clock_s - self._anchor_s

    def moving(self, still_s: float) -> bool:
        """The controller moves, by its state or because its position has not stood still for `still_s`."""
        return self.status is None or self.status.state in MOVING_STATES or self.still_s < still_s

    def _follow_clock(self, status: ActuatorStatus, findings: list[Finding]) -> None:
        before = self.status
        if before is None:
            self._beat_ns = status.received_ns
            return
        forward_us = (status.clock_us - before.clock_us) % CLOCK_MODULUS
        if forward_us >= CLOCK_MODULUS // 2:
            detail = f"controller clock fell back from {before.clock_us} to {status.clock_us} us"
            findings.append(Finding("actuator-reboot", detail, status.received_ns))
            self._anchor_m = math.nan
        else:
            self.clock_s += forward_us * 1e-6
        if status.heartbeat != before.heartbeat:
            self._beat_ns = status.received_ns
        age_ms = (status.received_ns - self._beat_ns) / 1e6
        self.frozen = age_ms > self.frozen_after_ns / 1e6
        if self.frozen:
            detail = f"controller heartbeat has stood at {status.heartbeat} for {age_ms:.0f} ms"
            findings.append(Finding("actuator-frozen", detail, status.received_ns, age_ms, self.frozen_after_ns / 1e6))

    def _follow_bits(self, status: ActuatorStatus, findings: list[Finding]) -> None:
        t_ns = status.received_ns
        rest = FaultBit(status.fault_bits)
        for bits, slug in _FAULT_SLUGS:
            if rest & bits:
                findings.append(Finding(slug, f"controller fault bit {bits.name}", t_ns, float(status.fault_bits)))
                rest &= ~bits
        if not status.inputs & Input.E_STOP_CLOSED and not status.fault_bits & FaultBit.E_STOP:
            findings.append(Finding("estop", "e-stop chain open", t_ns))
        if rest or (status.state == State.TRIPPED and status.fault_bits == 0):
            names = ", ".join(bit.name or "?" for bit in FaultBit if bit & rest) or "no bit named"
            findings.append(Finding("controller-trip", f"controller tripped: {names}", t_ns, float(status.fault_bits)))
        if not self.leased:
            return
        if status.owner not in {0, self.owner_id}:
            detail = f"controller's lease is held by {status.owner}, ours is {self.owner_id}"
            findings.append(Finding("second-master", detail, t_ns, status.owner, self.owner_id))
        elif status.owner == 0:
            findings.append(Finding("actuator-reboot", "controller no longer knows our lease", t_ns))

    def _follow_program(self, status: ActuatorStatus, lvdt_speed_m_s: float, findings: list[Finding]) -> None:
        """A program ends when its cycles are done, and where the controller holds, the rod stands."""
        t_ns = status.received_ns
        if status.state != State.RUNNING:
            self._program_began_s = math.nan
        elif math.isnan(self._program_began_s):
            self._program_began_s = self.clock_s
        elif self.clock_s - self._program_began_s > self._program_s + OVERRUN_S:
            ran_s = self.clock_s - self._program_began_s
            detail = f"the program has run for {ran_s:.3f} s, it lasts {self._program_s:.3f} s"
            findings.append(Finding("stop-ignored", detail, t_ns, ran_s, self._program_s))
        restless = status.state in AT_REST_STATES and abs(lvdt_speed_m_s) > RESTLESS_M_S
        self._restless = self._restless + 1 if restless else 0
        if self._restless >= 4 * CONSECUTIVE:
            detail = f"the controller says {State(status.state).name}, the LVDT moves at {lvdt_speed_m_s:.3g} m/s"
            findings.append(Finding("stop-ignored", detail, t_ns, lvdt_speed_m_s, RESTLESS_M_S))

    def _compare(self, status: ActuatorStatus, lvdt_m: float, speed_m_s: float, findings: list[Finding]) -> None:
        t_ns = status.received_ns
        if status.position_m == self._held_m:
            self._repeats += self.status is not None and status.clock_us != self.status.clock_us
            self._lvdt_low_m = min(self._lvdt_low_m, lvdt_m)
            self._lvdt_high_m = max(self._lvdt_high_m, lvdt_m)
            travel_m = self._lvdt_high_m - self._lvdt_low_m
            if travel_m > FROZEN_TRAVEL_M and self._repeats >= FROZEN_POLLS:
                detail = (
                    f"controller position stands at {status.position_m:.6g} m while the LVDT moved {travel_m:.4g} m"
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
            detail = f"controller at {status.position_m:.6g} m, LVDT at {lvdt_m:.6g} m, allowed {allowed_m:.4g} m apart"
            findings.append(Finding("position-disagreement", detail, t_ns, apart_m, allowed_m))


class EcuJudge:
    """Follows the ECU's status and temperature frames."""

    def __init__(self, current_limit_A: float, coil_temperature_limit_degC: float) -> None:
        self.current_limit_A = current_limit_A
        self.coil_temperature_limit_degC = coil_temperature_limit_degC
        self.controller_polls: Callable[[], int] = lambda: 0
        self._boot_count: int | None = None
        self._untold = 0
        self._consequence: tuple[int, int] | None = None

    def judge_status(self, status: CoilStatus, t_ns: int) -> list[Finding]:
        """Take one CoilStatus that arrived at `t_ns` (host monotonic)."""
        self._untold += 1
        faults = status.faults
        if faults & CONSEQUENCES and self._controller_may_know(t_ns):
            faults &= ~CONSEQUENCES
        elif not faults & CONSEQUENCES:
            self._consequence = None
        findings = [
            Finding(slug, f"ECU fault {EcuFault(faults & int(bits)).name}", t_ns, float(faults))
            for bits, slug in _ECU_SLUGS
            if faults & int(bits)
        ]
        if abs(status.current_A) > self.current_limit_A:
            detail = f"coil current {status.current_A:.3f} A, allowed {self.current_limit_A:.3f} A"
            findings.append(Finding("overcurrent", detail, t_ns, status.current_A, self.current_limit_A))
        return findings

    def _controller_may_know(self, t_ns: int) -> bool:
        """The controller is heard first, for it names the cause: two more polls, or `CONSEQUENCE_NS`.

        An opened e-stop chain takes the ECU's supply too, and a silent host stops feeding both; the ECU is at 0 A by
        itself meanwhile.
        """
        polls = self.controller_polls()
        if self._consequence is None:
            self._consequence = polls, t_ns
        first_poll, since_ns = self._consequence
        return polls < first_poll + 2 and t_ns - since_ns < CONSEQUENCE_NS

    def judge_temperature(self, temperature: CoilTemperature, t_ns: int) -> list[Finding]:
        """Take one CoilTemperature that arrived at `t_ns` (host monotonic)."""
        self._untold = 0
        findings: list[Finding] = []
        limit = self.coil_temperature_limit_degC
        if temperature.coil_degC > limit:
            detail = f"coil at {temperature.coil_degC:.1f} degC, allowed {limit:.1f} degC"
            findings.append(Finding("coil-temperature", detail, t_ns, temperature.coil_degC, limit))
        if self._boot_count is not None and temperature.boot_count != self._boot_count:
            detail = f"ECU boot count went from {self._boot_count} to {temperature.boot_count}"
            findings.append(Finding("ecu-restart", detail, t_ns, temperature.boot_count, self._boot_count))
        self._boot_count = temperature.boot_count
        return findings

    def judge_temperature_age(self, t_ns: int) -> list[Finding]:
        """Temperatures that stay away, by the statuses that came meanwhile; call it once a read's frames are judged."""
        if self._untold <= UNTOLD_STATUSES:
            return []
        age_ms, allowed_ms = STATUS_MS * self._untold, STATUS_MS * UNTOLD_STATUSES
        detail = f"ecu: no coil temperature for {age_ms} ms of its clock, allowed {allowed_ms} ms"
        return [Finding("ecu-silent", detail, t_ns, age_ms / 1e3, allowed_ms / 1e3)]
