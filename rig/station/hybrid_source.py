"""A hybrid test in the station: sensors in, set-points out; findings to the supervisor, computed values to the ring.

The computed part runs here because the sensors' newest values are here and set-points are sent from here: no process or
queue lies between the measured force and the resulting set-point. It is pure arithmetic (`rig.hybrid`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from drivers.errors import DriverError
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from drivers.setpoint_generator import Setpoint
from rig.bench.settings import StationConfig
from rig.clock import monotonic_ns
from rig.hybrid.hybrid_motion import HybridMotion, HybridOrder, Moment
from rig.hybrid.motion_bounds import Measured
from rig.signals.stopping import Reach, halted_m
from rig.station.command_channel import CommandChannel
from rig.station.errors import StationRefused
from rig.station.interlocks.finding import Finding
from rig.station.motion_start import ROUNDING, Answer, Extent, begin, read_order, refuse_beyond, travel_extents
from rig.station.supervisor import Supervisor
from rig.station.threads.current_source_thread import CurrentSourceThread
from rig.station.threads.devices import Devices

SLUG = "hybrid-unstable"
LEAST_CHANGE_A = 1e-3
"""A law's current is commanded anew when it has changed by so much."""
Reading = Callable[[int], float | None]
"""Host time (ns) -> the newest good value, SI; None when it is stale."""


class Sensors(NamedTuple):
    """The load cell's force (N) and the LVDT's position (m)."""

    force_N: Reading
    position_m: Reading


CHANNELS = (
    Channel.HYBRID_TIME, Channel.HYBRID_TARGET, Channel.HYBRID_SEEN, Channel.HYBRID_BODY, Channel.HYBRID_WHEEL,
)
"""Of the fields of a `Moment`."""


class HybridSource:
    """Source of set-points of one test; lives on the actuator's thread.

    Args (construction):
        motion: the test.
        sensors: what it sees.
        supervisor: is told of problems and of the test's course.
        append: takes records into the ring.
        coil: is commanded at every step; None where its current stays as it is.

    Attributes:
        fastest_m_s: largest planned speed of the test.
    """

    def __init__(
        self, motion: HybridMotion, sensors: Sensors, supervisor: Supervisor, append: Callable[[list[Record]], None],
        coil: CurrentSourceThread | None = None,
    ) -> None:
        self.fastest_m_s = motion.fastest_m_s
        self._motion = motion
        self._sensors = sensors
        self._supervisor = supervisor
        self._append = append
        self._coil = coil
        self._commanded_A = motion.current_A
        self._reported_phase = ""
        self._stopped = False

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point so much (s) after the motion's begin; None once it is over."""
        motion, now_ns = self._motion, monotonic_ns()
        force_N, position_m = self._sensors.force_N(now_ns), self._sensors.position_m(now_ns)
        sent = motion.at(elapsed_s, Measured(_or_nan(force_N), _or_nan(position_m)))
        if motion.moment is not None:
            self._append(_records(motion.moment, motion.outcome.steps, now_ns))
        if str(motion.phase) != self._reported_phase:
            self._reported_phase = str(motion.phase)
            self._report(now_ns)
        if motion.problem is not None and not self._stopped:
            self._stopped = True
            self._report(now_ns)
            problem = motion.problem
            self._supervisor.report([Finding(SLUG, problem.text, now_ns, problem.value, problem.limit)])
        if self._coil is not None:
            self._command(self._coil, now_ns)
            if sent is None:
                self._coil.follow_law(law=False)
        return None if sent is None else Setpoint(sent.position_m, sent.velocity_m_s)

    def _command(self, coil: CurrentSourceThread, now_ns: int) -> None:
        """Ask for the law's current; nothing once the test is stopped or a trip has taken it away."""
        target_A = self._motion.current_A
        if self._stopped or abs(target_A - self._commanded_A) < LEAST_CHANGE_A:
            return
        try:
            coil.set_current(target_A)
        except StationRefused:
            self._coil = None  # 0 A is latched: a trip is under way
        except DriverError as error:
            self._coil = None
            self._supervisor.report([Finding("can-lost", "the current of the control law could not be "
                f"sent: {error}", now_ns)])
        else:
            self._commanded_A = target_A

    def _report(self, now_ns: int) -> None:
        """Tell the application where in its course the test is, and what it says of itself."""
        outcome = self._motion.outcome
        self._supervisor.pass_on({
            "event": "hybrid", "phase": str(self._motion.phase), "steps": outcome.steps,
            "delay_s": None if math.isnan(outcome.delay_s) else outcome.delay_s, "tracking": outcome.tracking,
            "energy_share": outcome.energy_share, "t_ns": now_ns,
        })  # fmt: skip


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _records(moment: Moment, step: int, now_ns: int) -> list[Record]:
    return [
        (now_ns, NO_DEVICE_TIME, value, step, channel, 0) for channel, value in zip(CHANNELS, moment, strict=True)
    ]


def start_hybrid(given: object, devices: Devices, supervisor: Supervisor, commands: CommandChannel) -> Answer:
    """Begin a hybrid test; the answer is that of any motion's start.

    Args:
        given: `HybridOrder.to_json`.
        devices: of the rig.
        supervisor: of the station.
        commands: to the actuator.

    Raises:
        StationRefused: it is no test, is wider than the machine's limits, or the actuator does not begin it.
        DriverError: the actuator cannot be reached.
    """
    ecu = devices.config.ecu
    order = hybrid_order(given, devices.config)
    commanded = order.control.law != "passive"
    if commanded and (ecu.by_hand or ecu.url is not None):
        raise StationRefused("matrix-infeasible", "start: a control law commands the current, but the current source "
            "is not on CAN")
    sensors = Sensors(devices.load_cell.value, devices.lvdt.position_m)
    coil = devices.coil if commanded else None
    source = HybridSource(HybridMotion(order), sensors, supervisor, devices.append, coil)
    devices.coil.follow_law(law=commanded)
    return begin(source, order.duration_s, devices, supervisor, commands)


def hybrid_order(given: object, config: StationConfig) -> HybridOrder:
    """The order of a start request, within the machine's limits.

    Args:
        given: `HybridOrder.to_json`.
        config: of the station: limits, and the deceleration of a halt.

    Raises:
        StationRefused: it is none, or its own bounds are wider than the machine's limits.
    """
    order = read_order(given, "a hybrid test", HybridOrder.from_json)
    centre_m, bounds, limits = order.centre_m, order.bounds, config.limits
    probe_m_s = math.tau * order.probe.frequency_Hz * order.probe.amplitude_m
    probe_m = halted_m(order.probe.amplitude_m, probe_m_s, config.actuator.halt_deceleration_m_s2)
    reach_m = max(bounds.extension_m, bounds.travel_m, probe_m)
    extents = (
        *travel_extents(Reach(centre_m - reach_m, centre_m + reach_m), limits),
        Extent("speed", "m/s", bounds.speed_m_s, limits.speed_m_s),
        Extent("acceleration", "m/s^2", bounds.acceleration_m_s2, limits.acceleration_m_s2),
        Extent(
            "halt deceleration", "m/s^2", bounds.halt_deceleration_m_s2, config.actuator.halt_deceleration_m_s2
        ),
        Extent("current", "A", order.control.range_A[1], limits.current_A),
    )
    refuse_beyond(extents, "the bounds of a hybrid test", ROUNDING)
    return order
