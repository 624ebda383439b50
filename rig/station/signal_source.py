"""A prescribed motion without cycles in the station: samples in, set-points out, each recorded as requested.

The samples come with the start request and are checked here again, against the machine's limits, before any is sent.
Between two of them the set-point follows the cubic through their positions and speeds. Where the motion is the iterated
command for a target, the target comes with it: it is recorded with each set-point and moves nothing. The same applies
to a target force.
"""

from __future__ import annotations

import base64
import binascii
import math
import sys
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from drivers.ring import NO_DEVICE_TIME, Channel, Record
from drivers.setpoint_generator import Setpoint
from rig.bench.settings import Limits
from rig.clock import monotonic_ns
from rig.signals.stopping import Reach, reach
from rig.station.command_channel import CommandChannel
from rig.station.motion_start import Answer, Extent, begin, read_order, refuse_beyond, travel_extents
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices

MOST_SAMPLES = 200_000
LARGEST_STEP_S = 0.02
REST_M, REST_M_S = 1e-4, 0.01
"""How far from the centre, and how fast, a motion may begin and end: it is faded there."""
ROUNDING = 1e-3
"""Share of a limit that the samples' float32 and their finite differences may add."""


@dataclass(frozen=True)
class SignalOrder:
    """A motion as the application sends it: `step_s`, `centre_m`, `samples`, of an iterated command `target`.

    A target force is `force`: float32 in base64, one for each position. The samples are little-endian float32, all
    positions, then all speeds, in base64: a text, as long as it may be, is read at once, while 200,000 numbers keep
    every thread of the station waiting for a tenth of a second.

    Attributes:
        step_s: between two samples, s.
        position_m, velocity_m_s: (n,) about the centre; at rest at the centre at both ends.
        centre_m: in the rig's coordinate.
        target: what the rod is to follow, in samples of the same number; None: the motion itself.
        force_N: (n,) what the force is to follow; empty: the displacement is to follow its target.
    """

    step_s: float
    position_m: Sequence[float]
    velocity_m_s: Sequence[float]
    centre_m: float
    target: SignalOrder | None = None
    force_N: Sequence[float] = ()

    @property
    def duration_s(self) -> float:
        """From the first sample to the last, s."""
        return self.step_s * (len(self.position_m) - 1)

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> SignalOrder:
        """The order of a start request.

        Raises:
            KeyError: something is missing.
            TypeError: an entry is no number or no text.
            ValueError: it is no motion.
        """
        step_s, centre_m = float(given["step_s"]), float(given["centre_m"])
        position_m, velocity_m_s = _samples(given["samples"], step_s, centre_m)
        target = None
        if "target" in given:
            target = cls(step_s, *_samples(given["target"], step_s, centre_m), centre_m)
            if len(target.position_m) != len(position_m):
                raise ValueError(f"{len(target.position_m)} samples of the target, but {len(position_m)} of the motion")
        force_N: Sequence[float] = _numbers(given["force"], "force") if "force" in given else ()
        if len(force_N) not in {0, len(position_m)}:
            raise ValueError(f"{len(force_N)} samples of the force, but {len(position_m)} of the motion")
        return cls(step_s, position_m, velocity_m_s, centre_m, target, force_N)

    def force_at(self, elapsed_s: float) -> float:
        """Target force (N) so much after its begin (s, within its duration), linear between two samples."""
        place = max(0.0, elapsed_s) / self.step_s
        first = min(int(place), len(self.force_N) - 2)
        share = min(1.0, place - first)
        return (1.0 - share) * self.force_N[first] + share * self.force_N[first + 1]

    def at(self, elapsed_s: float) -> Setpoint:
        """Position (m) and speed (m/s) in the rig's coordinate, so much after its begin (s, within its duration)."""
        place = max(0.0, elapsed_s) / self.step_s
        first = min(int(place), len(self.position_m) - 2)
        share, h = min(1.0, place - first), self.step_s
        begin_m, end_m = self.position_m[first], self.position_m[first + 1]
        begin_m_s, end_m_s = self.velocity_m_s[first], self.velocity_m_s[first + 1]
        way_m = end_m - begin_m
        bend, twist = 3.0 * way_m - h * (2.0 * begin_m_s + end_m_s), h * (begin_m_s + end_m_s) - 2.0 * way_m
        position_m = begin_m + share * (h * begin_m_s + share * (bend + share * twist))
        velocity_m_s = begin_m_s + share * (2.0 * bend + 3.0 * share * twist) / h
        return Setpoint(self.centre_m + position_m, velocity_m_s)


def _samples(given: str, step_s: float, centre_m: float) -> tuple[Sequence[float], Sequence[float]]:
    """Positions and speeds of an order, each (n,).

    Raises:
        TypeError: they are no text.
        ValueError: they are no motion.
    """
    numbers = _numbers(given, "samples")
    count, rest = divmod(len(numbers), 2)
    if rest or not (2 <= count <= MOST_SAMPLES and 0.0 < step_s <= LARGEST_STEP_S):
        raise ValueError(f"{len(numbers)} samples at intervals of {step_s:g} s are not valid")
    if not math.isfinite(centre_m):
        raise ValueError("the centre is not finite")
    return numbers[:count], numbers[count:]


def _numbers(given: str, what: str) -> array[float]:
    """Little-endian float32 in base64.

    Raises:
        TypeError: they are no text.
        ValueError: they are no finite numbers.
    """
    try:
        content = base64.b64decode(given, validate=True)
    except binascii.Error as error:
        raise ValueError(f"{what}: {error}") from error
    numbers = array("f")
    if len(content) % numbers.itemsize or len(content) > 2 * MOST_SAMPLES * numbers.itemsize:
        raise ValueError(f"{what}: {len(content)} bytes are not valid")
    numbers.frombytes(content)
    if sys.byteorder == "big":
        numbers.byteswap()
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{what}: the values are not all finite")
    return numbers


class SignalSource:
    """Source of set-points of one motion; lives on the actuator's thread.

    Args (construction):
        order: the motion.
        append: takes records into the ring.

    Attributes:
        fastest_m_s: largest speed of its samples.
    """

    def __init__(self, order: SignalOrder, append: Callable[[list[Record]], None]) -> None:
        self.fastest_m_s = max(map(abs, order.velocity_m_s))
        self._order = order
        self._append = append
        self._count = 0

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point so much (s) after the motion's begin; None once it is over: the rod is at its centre."""
        order = self._order
        if elapsed_s > order.duration_s + LARGEST_STEP_S and self._count:
            return None
        at_s = min(elapsed_s, order.duration_s)
        setpoint = order.at(at_s)
        target = setpoint if order.target is None else order.target.at(at_s)
        now_ns, self._count = monotonic_ns(), self._count + 1
        values = [(Channel.SIGNAL_TIME, elapsed_s), (Channel.SIGNAL_TARGET, target.position_m - order.centre_m)]
        if order.target is not None:
            values.append((Channel.SIGNAL_COMMAND, setpoint.position_m - order.centre_m))
        if order.force_N:
            values.append((Channel.SIGNAL_FORCE, order.force_at(at_s)))
        self._append([(now_ns, NO_DEVICE_TIME, value, self._count, channel, 0) for channel, value in values])
        return setpoint

    def position_m(self, elapsed_s: float) -> float:
        """Position (m) at any time (s) after the start, in the rig's coordinate; nothing is recorded."""
        return self._order.at(min(elapsed_s, self._order.duration_s)).position_m


def start_signal(given: object, devices: Devices, supervisor: Supervisor, commands: CommandChannel) -> Answer:
    """Begin a prescribed motion; the answer is that of any motion's start.

    Args:
        given: as `SignalOrder` says.
        devices: of the rig.
        supervisor: of the station.
        commands: to the actuator.

    Raises:
        StationRefused: it is no motion, is beyond the machine's limits, or the actuator does not begin it.
        DriverError: the actuator cannot be reached.
    """
    order = signal_order(given, devices.config.limits, devices.config.actuator.halt_deceleration_m_s2)
    return begin(SignalSource(order, devices.append), order.duration_s, devices, supervisor, commands)


def signal_order(given: object, limits: Limits, halt_deceleration_m_s2: float) -> SignalOrder:
    """The motion of a start request, within the machine's limits.

    Args:
        given: as `SignalOrder` says.
        limits: of the machine.
        halt_deceleration_m_s2: of a halt, which must find the travel that it needs at every instant.

    Raises:
        StationRefused: it is none, is beyond a limit, or does not begin and end at rest at its centre.
    """
    order = read_order(given, "a signal", SignalOrder.from_json)
    positions, speeds, centre_m = order.position_m, order.velocity_m_s, order.centre_m
    speed_m_s = max(map(abs, speeds))
    change_m_s2 = max(abs(after - before) for before, after in pairwise(speeds)) / order.step_s
    way_m_s = max(abs(after - before) for before, after in pairwise(positions)) / order.step_s
    reached = reach(zip(positions, speeds, strict=True), halt_deceleration_m_s2)
    extents = (
        *travel_extents(Reach(centre_m + reached.low_m, centre_m + reached.high_m), limits),
        Extent("speed", "m/s", max(speed_m_s, way_m_s), limits.speed_m_s),
        Extent("acceleration", "m/s^2", change_m_s2, limits.acceleration_m_s2),
        Extent("distance from the centre at start or end", "m", max(abs(positions[0]), abs(positions[-1])), REST_M),
        Extent("speed at start or end", "m/s", max(abs(speeds[0]), abs(speeds[-1])), REST_M_S),
    )
    refuse_beyond(extents, "a signal", ROUNDING)
    return order
