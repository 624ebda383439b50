"""Separate examination of every device: opened, identified and counted, so that a missing device hides no other.

Nothing is written to a device except what reading requires; arming is impossible unless every device is well.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from drivers.errors import DriverError
from drivers.port_causes import fix_of
from drivers.roles import Actuator, FaultBit, state_name
from rig.clock import monotonic_ns
from rig.station.errors import StationRefused
from rig.station.preparation import Preparation
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.current_source_thread import CurrentSourceThread
from rig.station.threads.devices import Device, Devices, slug_of
from rig.station.threads.sensor_thread import SensorThread

NOTHING_STOPS_IT = (
    "the actuator has no watchdog and its pressure cannot be switched off: nothing would stop the actuator if this "
    "host failed"
)
REQUESTS = 100
"""So many times the controller is asked for its status one after the other, for the time that an answer takes."""
REQUEST_TIMEOUT_S = 10.0
BAUD_RATES = (921_600, 460_800, 230_400, 115_200, 57_600, 38_400, 19_200, 9_600, 4_800, 2_400, 1_200)
LISTEN_S = 0.3
LONGEST_READ_S = 0.05
ENOUGH = 5
"""Valid samples, and no more damaged frames than those, that make a baud rate the right one."""


@dataclass
class Seen:
    """What was found of one device.

    Attributes:
        name: as in the bench file.
        slug, message: what is wrong with it; empty where nothing is.
        fix: what would fix it, where the driver knows.
        proved: its identity, or its rate.
        reads_at: baud rates at which a sensor that could not be read is read.
        answers_s: how long the controller took for each of `ASKED` answers (s).
        lacking: what actuator or current source cannot do, by slug, and what is left without it.
        state, faults: the controller's, in words.
        e_stop_open: the hard-wired chain is open.
        pressure_off: there is no pressure: nothing can move.
    """

    name: str
    slug: str = ""
    message: str = ""
    fix: str = ""
    proved: dict[str, object] = field(default_factory=dict)
    reads_at: tuple[int, ...] = ()
    answers_s: tuple[float, ...] = ()
    lacking: tuple[tuple[str, str], ...] = ()
    state: str = ""
    faults: str = ""
    e_stop_open: bool = False
    pressure_off: bool = False

    def fails(self, slug: str, message: str) -> None:
        """Note what is wrong; what was found first stays."""
        if not self.slug:
            self.slug, self.message = slug, message


@dataclass
class Examined:
    """What `examine` found, in the order of `Devices`."""

    devices: list[Seen]

    @property
    def all_well(self) -> bool:
        """Every device is there, and is what the bench file says."""
        return not any(seen.slug for seen in self.devices)


def examine(devices: Devices, preparation: Preparation) -> Examined:
    """Open, start and prove every device by itself.

    Args:
        devices: of the station, not opened yet.
        preparation: what proves them.
    """
    closed = devices.open_each()
    devices.start(but=closed)
    return Examined([
        Seen(device.name, slug_of(closed[device.name]), str(closed[device.name]), fix_of(closed[device.name]))
        if device.name in closed else _seen(device, devices, preparation)
        for device in devices
    ])


def _seen(device: Device, devices: Devices, preparation: Preparation) -> Seen:
    seen = Seen(device.name)
    try:
        seen.proved = preparation.prove(device)
    except StationRefused as refusal:
        seen.fails(refusal.slug, refusal.message)
    if isinstance(device, SensorThread) and seen.slug == "serial-baud":
        seen.reads_at = tuple(_reading_rates(device, devices))
    if isinstance(device, CurrentSourceThread):
        seen.lacking = tuple((f"ecu-without-{name}", left) for name, left in device.lacking)
    if isinstance(device, ActuatorThread):
        _look_at_the_controller(device, seen)
    return seen


def _look_at_the_controller(actuator: ActuatorThread, seen: Seen) -> None:
    capabilities = actuator.capabilities
    if not capabilities.can_be_stopped:
        seen.fails("watchdog-absent", NOTHING_STOPS_IT)
    seen.lacking = tuple((f"actuator-without-{name}", left) for name, left in capabilities.lacking())
    status = actuator.fresh_status(monotonic_ns())
    if status is None:
        return
    seen.state, seen.e_stop_open = state_name(status.state), status.e_stop_open
    seen.faults = "" if not status.fault_bits else str(FaultBit(status.fault_bits).name or status.fault_bits)
    seen.pressure_off = capabilities.hydraulics and status.hydraulics_off
    if not math.isfinite(status.position_m):
        seen.fails("feedback-lost", f"the controller's position is {status.position_m}, not a number")
    try:
        seen.answers_s = actuator.call(_answer_times, REQUEST_TIMEOUT_S)
    except (DriverError, TimeoutError) as error:
        seen.fails("no-answer", f"actuator: no answer to {REQUESTS} consecutive requests: {error}")


def _answer_times(driver: Actuator) -> tuple[float, ...]:
    times_s = []
    for _ in range(REQUESTS):
        request_ns = monotonic_ns()
        driver.read_status()
        times_s.append((monotonic_ns() - request_ns) * 1e-9)
    return tuple(times_s)


def _reading_rates(sensor: SensorThread, devices: Devices) -> Iterator[int]:
    """Baud rates at which a sensor's bytes make valid frames; its own thread ends first."""
    if sensor.config.url is None or "://" in sensor.config.url:
        return  # a socket has no rate
    sensor.end()
    sensor.close()
    for rate in BAUD_RATES:
        driver = devices.at_another_rate(sensor, rate)
        samples, deadline_ns = 0, monotonic_ns() + int(LISTEN_S * 1e9)
        try:
            driver.open()
            while monotonic_ns() < deadline_ns:
                samples += len(driver.read_batch(LONGEST_READ_S).records)
        except DriverError:
            continue
        finally:
            driver.close()
        if samples >= ENOUGH and driver.bad_frames <= samples:
            yield rate
