"""How each fault is put into the running rig: one small function a slug.

Some faults can be taken away again (`ecu-silent@5+0.2`): their injectors hand back how. The others stay, because they
changed what happened (a reboot, a pulled cable), or because they are there before anything is connected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from protocols import ecu as wire
from protocols.actuator import Command, Result
from rig.clock import monotonic_ns
from simulators.actuator import ENDLESS_CYCLES
from simulators.named_port import NamedPort
from simulators.slcan_bus import ERROR, standard_line

if TYPE_CHECKING:
    from simulators.rig import SimulatedRig

Undo = Callable[[], None]
LastingInjector = Callable[["SimulatedRig"], None]
PassingInjector = Callable[["SimulatedRig"], Undo]
LASTING: dict[str, LastingInjector] = {}
PASSING: dict[str, PassingInjector] = {}
"""Injectors whose fault can be taken away again."""

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


def _switch(owner: object, name: str, value: object) -> Undo:
    """Set an attribute; the answer sets it back."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    return lambda: setattr(owner, name, before)


def _every_tick(rig: SimulatedRig, action: Callable[[], None]) -> Undo:
    """Do something at every tick of the rig; the answer ends it."""
    rig.every_tick.append(action)
    return lambda: rig.every_tick.remove(action)


def _stays(slug: str) -> Callable[[LastingInjector], LastingInjector]:
    def register(injector: LastingInjector) -> LastingInjector:
        LASTING[slug] = injector
        return injector

    return register


def _passes(slug: str) -> Callable[[PassingInjector], PassingInjector]:
    def register(injector: PassingInjector) -> PassingInjector:
        PASSING[slug] = injector
        return injector

    return register


@_passes("modbus-busy")
def _modbus_busy(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "busy", True)


@_passes("modbus-reject")
def _modbus_reject(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "reject_writes", True)


@_stays("modbus-reset")
def _modbus_reset(rig: SimulatedRig) -> None:
    rig.modbus.faults.reset = True


@_stays("modbus-halfopen")
def _modbus_halfopen(rig: SimulatedRig) -> None:
    rig.modbus.silence_connections()


@_passes("modbus-wrong-tid")
def _modbus_wrong_tid(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "wrong_transaction", True)


@_passes("modbus-mismatch")
def _modbus_mismatch(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "wrong_function", True)


@_passes("rtu-stale")
def _rtu_stale(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "late_answers", True)


@_passes("rtu-crc")
def _rtu_crc(rig: SimulatedRig) -> Undo:
    return _switch(rig.modbus.faults, "damaged", True)


@_passes("modbus-write-lost")
def _modbus_write_lost(rig: SimulatedRig) -> Undo:
    return _switch(rig.bank, "writes_lost", True)


@_passes("actuator-frozen")
def _actuator_frozen(rig: SimulatedRig) -> Undo:
    return _switch(rig.actuator.faults, "position_frozen", True)


@_stays("actuator-reboot")
def _actuator_reboot(rig: SimulatedRig) -> None:
    rig.actuator.boot_count += 1
    rig.actuator.boot()


@_stays("watchdog-absent")
def _watchdog_absent(rig: SimulatedRig) -> None:
    rig.actuator.faults.watchdog_absent = True


@_stays("second-master")
def _second_master(rig: SimulatedRig) -> None:
    """Another master takes the lease by force and stops the program it did not start."""
    rig.actuator.owner = FOREIGN_OWNER
    rig.actuator.sequence = (rig.actuator.sequence + 1000) % 0xFFFF or 1
    rig.actuator.acked_command = int(Command.ACQUIRE)
    rig.actuator.result = Result.DONE


@_stays("stop-ignored")
def _stop_ignored(rig: SimulatedRig) -> None:
    """Programs lose their end, the running one too, and no stop command ends them; taking the pressure away does."""
    rig.actuator.faults.stop_ignored = True
    rig.plant.order(full_cycles=ENDLESS_CYCLES)


@_stays("register-layout")
def _register_layout(rig: SimulatedRig) -> None:
    rig.bank.word_order_swapped = True


@_stays("estop")
def _estop(rig: SimulatedRig) -> None:
    """The chain opens: valve shut, hydraulics dumped, coil supply cut."""
    rig.actuator.faults.e_stop_open = True
    rig.ecu.supply_V = 0.0


@_stays("can-busoff")
def _can_busoff(rig: SimulatedRig) -> None:
    """The adapter reports errors, as it does on its way to bus-off, then nothing passes any more."""
    rig.bus.send_lines([ERROR] * 3)
    rig.bus.silent = True


@_passes("ecu-silent")
def _ecu_silent(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "silent", True)


@_passes("ecu-late")
def _ecu_late(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "late", True)


@_passes("ecu-crc")
def _ecu_crc(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "wrong_crc", True)


@_passes("can-malformed")
def _can_malformed(rig: SimulatedRig) -> Undo:
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

    return _switch(rig.bus, "encode", malformed_line)


@_passes("can-babble")
def _can_babble(rig: SimulatedRig) -> Undo:
    """A node that never stops fills the bus, on wall time as any other node's bits take theirs."""
    line = standard_line(0x001, bytes(8))
    begin_ns, sent = monotonic_ns(), 0

    def babble() -> None:
        nonlocal sent
        due = int((monotonic_ns() - begin_ns) * 1e-9 * BABBLED_FRAMES_S)
        rig.bus.send_lines([line] * min(MOST_BABBLED, due - sent))
        sent = due

    return _every_tick(rig, babble)


@_passes("can-foreign")
def _can_foreign(rig: SimulatedRig) -> Undo:
    """Another node sends CoilCommand with a valid counter and CRC of its own."""
    count = 0

    def intrude() -> None:
        nonlocal count
        count += 1
        if count % 5 == 0:
            command = wire.CoilCommand(count // 5 % wire.COUNTER_MODULUS, True, False, 0.1)
            rig.bus.send_lines([standard_line(wire.COMMAND_ID, wire.encode_command(command))])

    return _every_tick(rig, intrude)


@_passes("ecu-overtemp")
def _ecu_overtemp(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "over_temperature", True)


@_passes("coil-open-short")
def _coil_open(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "coil_open", True)


@_passes("current-tracking")
def _current_tracking(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "gain", TRACKING_GAIN)


@_passes("current-stuck")
def _current_stuck(rig: SimulatedRig) -> Undo:
    return _switch(rig.ecu.faults, "stuck_current", True)


@_stays("ecu-restart")
def _ecu_restart(rig: SimulatedRig) -> None:
    rig.ecu.restart()


@_stays("loadcell-pulled")
def _loadcell_pulled(rig: SimulatedRig) -> None:
    rig.channel("load_cell").port.close()


@_stays("lvdt-pulled")
def _lvdt_pulled(rig: SimulatedRig) -> None:
    rig.channel("lvdt").port.close()


@_stays("usb-renumber")
def _usb_renumber(rig: SimulatedRig) -> None:
    """The adapter comes up under another number; without a name that follows it (`--ports by-id`) it is just gone."""
    port = rig.channel("load_cell").port
    if isinstance(port, NamedPort):
        port.renumber()
    else:
        port.close()


@_passes("serial-garbage")
def _serial_garbage(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "garbage", True)


@_passes("serial-baud")
def _serial_baud(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "wrong_baud", True)


@_passes("sensor-stuck")
def _sensor_stuck(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "stuck", True)


@_passes("sensor-saturated")
def _sensor_saturated(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "saturated", True)


@_passes("sensor-spike")
def _sensor_spike(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "spikes", True)


@_passes("sensor-nan")
def _sensor_nan(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "not_a_number", True)


@_passes("sample-gap")
def _sample_gap(rig: SimulatedRig) -> Undo:
    return _switch(rig.channel("load_cell").sensor.faults, "gaps", True)


@_stays("clock-drift")
def _clock_drift(rig: SimulatedRig) -> None:
    sensor = rig.channel("load_cell").sensor
    sensor.clock.drift(sensor.clock.ppm + DRIFT_PPM, rig.plant.time_s)


@_stays("sensors-swapped")
def _sensors_swapped(rig: SimulatedRig) -> None:
    """The two plugs are exchanged: each port carries the other sensor's bytes."""
    load_cell, lvdt = rig.channel("load_cell"), rig.channel("lvdt")
    load_cell.sensor, lvdt.sensor = lvdt.sensor, load_cell.sensor
    load_cell.column, lvdt.column = lvdt.column, load_cell.column


@_stays("not-tared")
def _not_tared(rig: SimulatedRig) -> None:
    sensor = rig.channel("load_cell").sensor
    sensor.faults.zero_offset = ZERO_SHARE * sensor.options.range


@_stays("wrong-damper")
def _wrong_damper(rig: SimulatedRig) -> None:
    rig.plant.constants["force_scale"] = WRONG_DAMPER_SCALE


@_passes("load-train")
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


INJECTORS: dict[str, Callable[[SimulatedRig], Undo | None]] = {**LASTING, **PASSING}
