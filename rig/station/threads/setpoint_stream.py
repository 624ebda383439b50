"""Timing of the actuator thread's polls, and the set-point of each poll.

Steps lie on a grid that does not drift: a late step does not shift the following ones, and a step that is overtaken by
the next one is omitted.
"""

from __future__ import annotations

from dataclasses import replace

from drivers.clock import setpoint_due
from drivers.roles import Actuator, ActuatorStatus
from drivers.streamed_actuator import StreamedActuator
from rig.bench.settings import ActuatorConfig
from rig.faults.matrix import REACTIONS
from rig.station.events import setpoints_event
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.setpoint_interlock import SetpointInterlock
from rig.station.supervisor import Supervisor


class PollSteps:
    """The instants at which the thread polls.

    Args (construction):
        period_ns: from one to the next.
        on_grid: a step that was missed is left out, and the next one is due when it always was; else polls that took
            too long follow each other at once.

    Attributes:
        next_ns: when the next one is due.
    """

    def __init__(self, period_ns: int, *, on_grid: bool) -> None:
        self.next_ns = 0
        self._period_ns = period_ns
        self._on_grid = on_grid

    def begin(self, now_ns: int) -> None:
        """The first is due now."""
        self.next_ns = now_ns

    def take(self, now_ns: int) -> int | None:
        """A poll is made: so much (ns) after it was due; None where none was due yet."""
        late_ns = now_ns - self.next_ns
        if late_ns < 0:
            return None
        if self._on_grid:
            self.next_ns += self._period_ns * (1 + late_ns // self._period_ns)
        else:
            self.next_ns = max(self.next_ns + self._period_ns, now_ns)
        return late_ns


class SetpointStream:
    """An actuator's set-points, counted and judged, on its thread; of one with a generator of its own: nothing.

    Args (construction):
        driver: the actuator.
        config: its settings.
        supervisor: is told what was found, and the counts after every motion.
    """

    def __init__(self, driver: Actuator, config: ActuatorConfig, supervisor: Supervisor) -> None:
        self._driver = driver if isinstance(driver, StreamedActuator) else None
        self._supervisor = supervisor
        self._moved = False
        self._breaks = 0
        self._trouble: Finding | None = None
        self.steps = PollSteps(int(config.poll_s * 1e9), on_grid=self._driver is not None)
        rate = supervisor.config.device_rate
        self._longest_gap_s = config.longest_setpoint_gap_s
        self._interlock = SetpointInterlock(config.poll_s, config.late_setpoint_s, rate)

    @property
    def may_feed(self) -> bool:
        """The watchdog may be fed: not while set-points are lost and nothing but the watchdog stops the device."""
        return self._driver is None or not self._interlock.lost or self._driver.halts_itself

    def sending(self, now_ns: int) -> None:
        """A poll begins: what is found is reported before its set-point is sent."""
        late_ns, driver = self.steps.take(now_ns), self._driver
        if driver is None:
            return
        driver.look_for_gap()
        # Due now: a simulated rig's clock waits while this exchange is held up by load, so that set-point and answer
        # are at the times that they are taken for.
        setpoint_due(now_ns if driver.rod_moves else None)
        self._report_break(driver, now_ns)
        if driver.last is None or (driver.in_motion and not self._moved):
            self._interlock.restart()
        elif driver.in_motion and late_ns is not None:
            self._supervisor.report(self._interlock.sent(late_ns * 1e-9, now_ns))

    def _report_break(self, driver: StreamedActuator, now_ns: int) -> None:
        """A motion that was not continued after a gap stops the rig."""
        if driver.breaks == self._breaks:
            return
        self._breaks = driver.breaks
        # The cause first: the machine slept, or this process was held up.
        self._supervisor.host.awake(now_ns)
        self._supervisor.report(self._supervisor.watchdogs.machine(now_ns))
        silent = self._interlock.silent(driver.gap_s, self._longest_gap_s, now_ns)
        if self._trouble is not None and REACTIONS[self._trouble.slug].stop is not None:
            detail = f"{self._trouble.detail}; {silent.detail}"
            silent = replace(self._trouble, detail=detail, t_ns=now_ns, warns=False)
        self._supervisor.report([silent])

    def _await_next(self) -> None:
        driver = self._driver
        if driver is not None:
            setpoint_due(self.steps.next_ns if driver.rod_moves else None)

    def failed(self, finding: Finding) -> None:
        """A poll failed: that is the cause of a gap that follows, until the next answer."""
        self._await_next()
        self._trouble = finding

    def answered(self, status: ActuatorStatus) -> None:
        """A poll's answer came."""
        driver = self._driver
        if driver is None:
            return
        self._await_next()
        self._report_break(driver, status.received_ns)
        self._trouble = None
        findings: list[Finding] = []
        if driver.last is not None and driver.in_motion:
            findings = self._interlock.answered(driver.last, driver.taken_m, status.position_m, status.received_ns)
        self._supervisor.report(findings)
        if self._moved and not driver.in_motion:
            self._supervisor.pass_on(setpoints_event(self._interlock.counted, status.received_ns))
        self._moved = driver.in_motion
