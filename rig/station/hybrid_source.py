"""A hybrid test in the station: sensors in, set-points out; findings to the supervisor, what it computes to the ring.

The computed part runs here because here the sensors' newest values are and from here the set-points go: no process or
queue lies between the measured force and the set-point that follows from it. It is pure arithmetic (`rig.hybrid`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers.ring import NO_DEVICE_TIME, Channel, Record
from drivers.roles import state_name
from drivers.setpoint_generator import Setpoint
from rig.bench.settings import Limits
from rig.clock import monotonic_ns
from rig.hybrid.hybrid_motion import HybridMotion, HybridOrder, Moment
from rig.hybrid.motion_bounds import Measured
from rig.station.command_channel import CommandChannel
from rig.station.errors import StationRefused
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.motion_interlock import SPEED_WINDOW_S
from rig.station.safe_stop import Movement
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices

SLUG = "hybrid-unstable"
Answer = dict[str, object]
Reading = Callable[[int], float | None]
"""Host time (ns) -> the newest good value, SI; None when it is stale."""
CHANNELS = (
    Channel.HYBRID_TIME, Channel.HYBRID_TARGET, Channel.HYBRID_SEEN, Channel.HYBRID_BODY, Channel.HYBRID_WHEEL,
)
"""Of the fields of a `Moment`."""


class HybridSource:
    """Source of set-points of one test; lives on the actuator's thread.

    Args (construction):
        motion: the test.
        force_N, position_m: the load cell and the LVDT.
        supervisor: is told of problems and of the test's course.
        append: takes records into the ring.
    """

    def __init__(
        self, motion: HybridMotion, force_N: Reading, position_m: Reading, supervisor: Supervisor,
        append: Callable[[list[Record]], None],
    ) -> None:
        self._motion = motion
        self._force_N = force_N
        self._position_m = position_m
        self._supervisor = supervisor
        self._append = append
        self._said = ""
        self._stopped = False

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point so much (s) after the motion's begin; None once it is over."""
        motion, now_ns = self._motion, monotonic_ns()
        force_N, position_m = self._force_N(now_ns), self._position_m(now_ns)
        sent = motion.at(elapsed_s, Measured(_or_nan(force_N), _or_nan(position_m)))
        if motion.moment is not None:
            self._append(_records(motion.moment, motion.outcome.steps, now_ns))
        if str(motion.phase) != self._said:
            self._said = str(motion.phase)
            self._tell(now_ns)
        if motion.problem is not None and not self._stopped:
            self._stopped = True
            self._tell(now_ns)
            problem = motion.problem
            self._supervisor.report([Finding(SLUG, problem.text, now_ns, problem.value, problem.limit)])
        return None if sent is None else Setpoint(sent.position_m, sent.velocity_m_s)

    def _tell(self, now_ns: int) -> None:
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
    config = devices.config
    order = hybrid_order(given, config.limits)
    source = HybridSource(
        HybridMotion(order), devices.load_cell.value, devices.lvdt.position_m, supervisor, devices.append
    )
    halted_s = config.limits.speed_m_s / config.actuator.halt_deceleration_m_s2
    supervisor.movement = Movement(halted_s + SPEED_WINDOW_S)
    devices.actuator.judge.expect_program(order.duration_s, 1.0)
    status = commands.compute(source)
    return {"program_id": status.program_id, "state": state_name(status.state)}


def hybrid_order(given: object, limits: Limits) -> HybridOrder:
    """The order of a start request, within the machine's limits.

    Args:
        given: `HybridOrder.to_json`.
        limits: of the machine.

    Raises:
        StationRefused: it is none, or its own bounds are wider than the machine's limits.
    """
    if not isinstance(given, dict):
        raise StationRefused("bad-request", "start: hybrid is no table of numbers")
    try:
        order = HybridOrder.from_json(given)
    except (KeyError, TypeError) as error:
        raise StationRefused("bad-request", f"start: not a hybrid test: {error}") from error
    centre_m = order.centre_m
    reach_m = max(order.bounds.extension_m, order.probe.amplitude_m)
    wide = [
        f"{what} {value:g} {unit}, allowed {limit:g} {unit}"
        for what, unit, value, limit in (
            ("travel to", "m", centre_m + reach_m, limits.position_max_m),
            ("travel to minus", "m", reach_m - centre_m, -limits.position_min_m),
            ("speed", "m/s", order.bounds.speed_m_s, limits.speed_m_s),
            ("acceleration", "m/s^2", order.bounds.acceleration_m_s2, limits.acceleration_m_s2),
        )
        if not value <= limit * (1.0 + 1e-6)
    ]
    if wide:
        raise StationRefused("matrix-infeasible", f"start: a hybrid test's bounds are too wide: {'; '.join(wide)}")
    return order
