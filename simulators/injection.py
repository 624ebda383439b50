"""How each fault is put into the running rig: one small function a slug.

`--fault SLUG@T` switches it on T seconds of simulated time after the first program's first cycle begins; without `@T`
it is there from the start. `SLUG@T+D` takes it away again D seconds later, where its injector says how.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocols import ecu as wire
from protocols.actuator import Command, Result
from rig.clock import monotonic_ns
from rig.errors import FileProblem
from rig.fault_matrix import MATRIX
from simulators.named_port import NamedPort
from simulators.slcan_bus import ERROR, standard_line

if TYPE_CHECKING:
    from simulators.rig import SimulatedRig

Undo = Callable[[], None]
Injector = Callable[["SimulatedRig"], Undo | None]
INJECTORS: dict[str, Injector] = {}

FOREIGN_OWNER = 999
BABBLED_FRAMES_S = 4200.0
"""More than nine tenths of a 500 kbit/s bus."""
MOST_BABBLED = 200
DRIFT_PPM = 500.0
TRACKING_GAIN = 0.7
WRONG_DAMPER_SCALE = 1.6
LOOSE_PLAY_M = 2e-3
LOOSE_STIFFNESS_N_M = 5e6
ZERO_SHARE = 0.05
"""A sensor that was not tared is off by this share of its range."""
ENDLESS_CYCLES = 1e6
LOW_SUPPLY_V = 8.0


@dataclass(frozen=True)
class ScheduledFault:
    """A fault, when it begins (simulated seconds after the first cycle, None from the start), how long it lasts."""

    slug: str
    after_s: float | None
    lasts_s: float = math.inf


def parse_fault(text: str) -> ScheduledFault:
    """`SLUG`, `SLUG@T` or `SLUG@T+D`.

    Raises:
        FileProblem: an unknown slug, one without an injector here, or a time that is no number.
    """
    slug, at, times = text.partition("@")
    if slug not in MATRIX:
        close = difflib.get_close_matches(slug, MATRIX, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else "; --list-faults names them all"
        raise FileProblem("--fault", [f"{slug!r} is not in the fault matrix{hint}"])
    if slug not in INJECTORS:
        outside = MATRIX[slug].where == "process"
        reason = "where = process, the fault suite injects it around the processes" if outside else "not injected yet"
        raise FileProblem("--fault", [f"{slug!r} has no injector in the simulated rig: {reason}"])
    begin, plus, duration = times.partition("+")
    try:
        after_s = float(begin) if at else None
        lasts_s = float(duration) if plus else math.inf
    except ValueError:
        raise FileProblem(
            "--fault", [f"{text!r}: {times!r} is not a number of seconds; write {slug}@5, or {slug}@5+0.1"]
        ) from None
    if after_s is not None and not 0 <= after_s < math.inf:
        raise FileProblem("--fault", [f"{text!r}: the time must be 0 s or more"])
    if not lasts_s > 0:
        raise FileProblem("--fault", [f"{text!r}: the duration must be above 0 s"])
    return ScheduledFault(slug, after_s, lasts_s)


def _switch(owner: object, name: str, value: object) -> Undo:
    """Set an attribute; the answer sets it back."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    return lambda: setattr(owner, name, before)


def _injects(slug: str) -> Callable[[Injector], Injector]:
    def register(injector: Injector) -> Injector:
        INJECTORS[slug] = injector
        return injector

    return register


@_injects("modbus-busy")
def _modbus_busy(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "busy", True)


@_injects("modbus-reject")
def _modbus_reject(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "reject_writes", True)


@_injects("modbus-reset")
def _modbus_reset(rig: SimulatedRig) -> None:
    rig.modbus.faults.reset = True


@_injects("modbus-halfopen")
def _modbus_halfopen(rig: SimulatedRig) -> None:
    rig.modbus.silence_connections()


@_injects("modbus-wrong-tid")
def _modbus_wrong_tid(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "wrong_transaction", True)


@_injects("modbus-mismatch")
def _modbus_mismatch(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "wrong_function", True)


@_injects("rtu-stale")
def _rtu_stale(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "late_answers", True)


@_injects("rtu-crc")
def _rtu_crc(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "damaged", True)


@_injects("modbus-write-lost")
def _modbus_write_lost(rig: SimulatedRig) -> Undo:
    return _switch(rig.bank, "writes_lost", True)


@_injects("actuator-frozen")
def _actuator_frozen(rig: SimulatedRig) -> Undo:
    return _switch(rig.actuator.faults, "position_frozen", True)


@_injects("actuator-reboot")
def _actuator_reboot(rig: SimulatedRig) -> None:
    rig.actuator.boot_count += 1
    rig.actuator.boot()


@_injects("watchdog-absent")
def _watchdog_absent(rig: SimulatedRig) -> None:
    rig.actuator.faults.watchdog_absent = True


@_injects("second-master")
def _second_master(rig: SimulatedRig) -> None:
    """Another master takes the lease by force and stops the program it did not start."""
    rig.actuator.owner = FOREIGN_OWNER
    rig.actuator.sequence = (rig.actuator.sequence + 1000) % 0xFFFF or 1
    rig.actuator.acked_command = int(Command.ACQUIRE)
    rig.actuator.result = Result.DONE


@_injects("stop-ignored")
def _stop_ignored(rig: SimulatedRig) -> None:
    """The running program loses its end, and no stop command ends it either; only the hydraulics can be taken away."""
    rig.actuator.faults.stop_ignored = True
    rig.plant.order(full_cycles=ENDLESS_CYCLES)


@_injects("register-layout")
def _register_layout(rig: SimulatedRig) -> None:
    rig.bank.word_order_swapped = True


@_injects("estop")
def _estop(rig: SimulatedRig) -> None:
    """The chain opens: valve shut, hydraulics dumped, coil supply cut."""
    rig.actuator.faults.e_stop_open = True
    rig.ecu.supply_V = 0.0


@_injects("can-busoff")
def _can_busoff(rig: SimulatedRig) -> None:
    """The adapter reports errors, as it does on its way to bus-off, then nothing passes any more."""
    rig.bus.send_lines([ERROR] * 3)
    rig.bus.silent = True


@_injects("ecu-silent")
def _ecu_silent(rig: SimulatedRig) -> None:
    rig.ecu.faults.silent = True


@_injects("ecu-late")
def _ecu_late(rig: SimulatedRig) -> None:
    rig.ecu.faults.late = True


@_injects("ecu-crc")
def _ecu_crc(rig: SimulatedRig) -> None:
    rig.ecu.faults.wrong_crc = True


@_injects("can-malformed")
def _can_malformed(rig: SimulatedRig) -> None:
    """Every frame of the ECU is short, a remote request or has an extended identifier, in turn."""
    turn = 0

    def malformed_line(identifier: int, data: bytes) -> bytes:
        nonlocal turn
        turn += 1
        if turn % 3 == 0:
            return b"r%03X%X\r" % (identifier, len(data))
        if turn % 3 == 1:
            return b"T%08X%X%s\r" % (identifier, len(data), data.hex().upper().encode("ascii"))
        return standard_line(identifier, data[:5])

    rig.bus.encode = malformed_line


@_injects("can-babble")
def _can_babble(rig: SimulatedRig) -> None:
    """A node that never stops fills the bus, on wall time as any other node's bits take theirs."""
    line = standard_line(0x001, bytes(8))
    begin_ns, sent = monotonic_ns(), 0

    def babble() -> None:
        nonlocal sent
        due = int((monotonic_ns() - begin_ns) * 1e-9 * BABBLED_FRAMES_S)
        rig.bus.send_lines([line] * min(MOST_BABBLED, due - sent))
        sent = due

    rig.every_tick.append(babble)


@_injects("can-foreign")
def _can_foreign(rig: SimulatedRig) -> None:
    """Another node sends CoilCommand with a valid counter and CRC of its own."""
    count = 0

    def intrude() -> None:
        nonlocal count
        count += 1
        if count % 5 == 0:
            command = wire.CoilCommand(count // 5 % wire.COUNTER_MODULUS, True, False, 0.1)
            rig.bus.send_lines([standard_line(wire.COMMAND_ID, wire.encode_command(command))])

    rig.every_tick.append(intrude)


@_injects("ecu-overtemp")
def _ecu_overtemp(rig: SimulatedRig) -> None:
    rig.ecu.faults.over_temperature = True


@_injects("coil-open-short")
def _coil_open(rig: SimulatedRig) -> None:
    rig.ecu.faults.coil_open = True


@_injects("current-tracking")
def _current_tracking(rig: SimulatedRig) -> None:
    rig.ecu.faults.gain = TRACKING_GAIN


@_injects("current-stuck")
def _current_stuck(rig: SimulatedRig) -> None:
    rig.ecu.faults.stuck_current = True


@_injects("ecu-restart")
def _ecu_restart(rig: SimulatedRig) -> None:
    rig.ecu.restart()


@_injects("loadcell-pulled")
def _loadcell_pulled(rig: SimulatedRig) -> None:
    rig.channel("load_cell").port.close()


@_injects("lvdt-pulled")
def _lvdt_pulled(rig: SimulatedRig) -> None:
    rig.channel("lvdt").port.close()


@_injects("usb-renumber")
def _usb_renumber(rig: SimulatedRig) -> None:
    """The adapter comes up under another number; without a name that follows it (`--ports by-id`) it is just gone."""
    port = rig.channel("load_cell").port
    if isinstance(port, NamedPort):
        port.renumber()
    else:
        port.close()


@_injects("serial-garbage")
def _serial_garbage(rig: SimulatedRig) -> None:
    rig.channel("load_cell").sensor.faults.garbage = True


@_injects("serial-baud")
def _serial_baud(rig: SimulatedRig) -> None:
    rig.channel("load_cell").sensor.faults.wrong_baud = True


@_injects("sensor-stuck")
def _sensor_stuck(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "stuck", True)


@_injects("sensor-saturated")
def _sensor_saturated(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "saturated", True)


@_injects("sensor-spike")
def _sensor_spike(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "spikes", True)


@_injects("sensor-nan")
def _sensor_nan(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "not_a_number", True)


@_injects("sample-gap")
def _sample_gap(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "gaps", True)


@_injects("clock-drift")
def _clock_drift(rig: SimulatedRig) -> None:
    sensor = rig.channel("load_cell").sensor
    sensor.clock.drift(sensor.clock.ppm + DRIFT_PPM, rig.plant.time_s)


@_injects("sensors-swapped")
def _sensors_swapped(rig: SimulatedRig) -> None:
    """The two plugs are exchanged: each port carries the other sensor's bytes."""
    load_cell, lvdt = rig.channel("load_cell"), rig.channel("lvdt")
    load_cell.sensor, lvdt.sensor = lvdt.sensor, load_cell.sensor
    load_cell.column, lvdt.column = lvdt.column, load_cell.column


@_injects("not-tared")
def _not_tared(rig: SimulatedRig) -> None:
    sensor = rig.channel("load_cell").sensor
    sensor.faults.zero_offset = ZERO_SHARE * sensor.options.range


@_injects("wrong-damper")
def _wrong_damper(rig: SimulatedRig) -> None:
    rig.plant.constants["force_scale"] = WRONG_DAMPER_SCALE


@_injects("load-train")
def _load_train(rig: SimulatedRig) -> Undo:
    """A joint works loose: free play behind a softer mounting; taken away, it is tight again."""
    constants = rig.plant.constants
    before = constants[["free_play_m", "mount_stiffness_N_m"]].copy()
    constants["free_play_m"] = LOOSE_PLAY_M
    constants["mount_stiffness_N_m"] = LOOSE_STIFFNESS_N_M

    def tighten() -> None:
        for name in ("free_play_m", "mount_stiffness_N_m"):
            constants[name] = before[name]

    return tighten
