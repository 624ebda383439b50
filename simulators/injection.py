"""How each fault is put into the running rig: an attribute, or one small function, a slug.

A row that stands for several faults has variants: `sensor-stuck` is the load cell's, `sensor-stuck:lvdt` the LVDT's.

Some faults can be taken away again (`ecu-silent@5+0.2`): their injectors hand back how. The others stay, because they
changed what happened (a reboot, a pulled cable), or because they are there before anything is connected.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.roles import Command, Result
from protocols.can_frame import EXTENDED
from rig.clock import monotonic_ns
from simulators.actuator import ENDLESS_CYCLES
from simulators.beyond_limits import BEYOND_LASTING, BEYOND_PASSING
from simulators.ecu_wire import Command as CurrentCommand
from simulators.faulty import Faulty, LastingInjector, PassingInjector, Undo
from simulators.named_port import NamedPort
from simulators.plant import records
from simulators.plant.motion import envelope
from simulators.slcan_bus import ERROR, frame_line

OTHER_OWNER = 999
SHORT = 8
"""So many bytes a malformed frame has at most."""
STANDARD_MAX = 0x7FF
"""Largest identifier of a standard frame."""
BABBLED_FRAMES_S = 4200.0
"""More than nine tenths of a 500 kbit/s bus."""
MOST_BABBLED = 200
DRIFT_PPM = 500.0
TRACKING_GAIN = 0.7
OVERCURRENT_GAIN = 3.0
LOW_SUPPLY_V = 7.0
LEAST_A = 0.3
WRONG_DAMPER_SCALE = 1.6
LOOSE_PLAY_M = 2e-3
LOOSE_STIFFNESS_N_M = 5e6
ZERO_SHARE = 0.05
LVDT_ZERO_SHARE = 0.1
"""A sensor that was not tared is off by this share of its range."""


def _switch(owner: object, name: str, value: object) -> Undo:
    """Set an attribute; the answer sets it back."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    return lambda: setattr(owner, name, before)


def _every_tick(rig: Faulty, action: Callable[[], None]) -> Undo:
    """Do something at every tick of the rig; the answer ends it."""
    rig.every_tick.append(action)
    return lambda: rig.every_tick.remove(action)


def _switched(owner: Callable[[Faulty], object], name: str, value: object = True) -> PassingInjector:
    """A fault that is one attribute of the rig."""
    return lambda rig: _switch(owner(rig), name, value)


def _link(rig: Faulty) -> object:
    return rig.modbus.faults


def _registers(rig: Faulty) -> object:
    return rig.bank


def _controller(rig: Faulty) -> object:
    return rig.actuator.faults


def _ecu(rig: Faulty) -> object:
    return rig.ecu.faults


def _ecu_itself(rig: Faulty) -> object:
    return rig.ecu


def _load_cell(rig: Faulty) -> object:
    return rig.channel("load_cell").sensor.faults


def _lvdt(rig: Faulty) -> object:
    return rig.channel("lvdt").sensor.faults


def _modbus_reset(rig: Faulty) -> None:
    rig.modbus.faults.reset = True


def _modbus_halfopen(rig: Faulty) -> None:
    rig.modbus.silence_connections()


def _actuator_reboot(rig: Faulty) -> None:
    rig.actuator.boot_count += 1
    rig.actuator.boot()


def _watchdog_absent(rig: Faulty) -> None:
    rig.actuator.faults.watchdog_absent = True


def _second_master(rig: Faulty) -> None:
    """Another master takes the lease by force and stops the program it did not start."""
    rig.actuator.owner = OTHER_OWNER
    rig.actuator.sequence = (rig.actuator.sequence + 1000) % 0xFFFF or 1
    rig.actuator.acked_command = int(Command.ACQUIRE)
    rig.actuator.result = Result.DONE


def _stop_ignored(rig: Faulty) -> None:
    """Programs lose their end, the running one too, and no stop command ends them; taking the pressure away does.

    One that is ramping out goes on at the amplitude that it has: at its full one the set-point would make a step.
    """
    rig.actuator.faults.stop_ignored = True
    command, phase = rig.plant.command, float(rig.plant.state["phase_cycles"][0])
    ramp_in, full, ramp_out = (float(command[name][0]) for name in ("ramp_in_cycles", "full_cycles", "ramp_out_cycles"))
    ramping_out = command["mode"][0] == records.MODE_PROGRAM and phase > ramp_in + full
    share = envelope(phase, ramp_in, full, ramp_out) if ramping_out else 1.0
    rig.plant.order(full_cycles=ENDLESS_CYCLES, amplitude_m=share * float(command["amplitude_m"][0]))


def _pressure_stays(rig: Faulty) -> None:
    """The order to take the pressure away is acknowledged, and the pressure stays on."""
    rig.actuator.faults.pressure_stays = True


def _register_layout(rig: Faulty) -> None:
    rig.bank.word_order_swapped = True


def _estop(rig: Faulty) -> None:
    """The chain opens: valve shut, hydraulics dumped, coil supply cut."""
    rig.actuator.faults.e_stop_open = True
    rig.ecu.supply_V = 0.0


def _can_busoff(rig: Faulty) -> None:
    """The adapter reports errors, as it does on its way to bus-off, then nothing passes any more."""
    rig.bus.send_lines([ERROR] * 3)
    rig.bus.silent = True


def _can_malformed(rig: Faulty) -> Undo:
    """Every frame of the ECU is short, a remote request or has an identifier of the other kind, in turn."""
    turn = 0

    def malformed_line(identifier: int, data: bytes) -> bytes:
        nonlocal turn
        turn += 1
        if turn % 3 == 0:
            return frame_line(identifier, data[:SHORT], remote=True)
        if turn % 3 == 1 and (identifier | EXTENDED) ^ EXTENDED <= STANDARD_MAX:
            return frame_line(identifier ^ EXTENDED, data)
        return frame_line(identifier, data[: min(len(data) // 2 + 1, SHORT)] if len(data) > 1 else b"")

    return _switch(rig.bus, "encode", malformed_line)


def _can_babble(rig: Faulty) -> Undo:
    """A node that never stops fills the bus, on wall time as any other node's bits take theirs."""
    line = frame_line(0x001, bytes(8))
    begin_ns, sent = monotonic_ns(), 0

    def babble() -> None:
        nonlocal sent
        due = int((monotonic_ns() - begin_ns) * 1e-9 * BABBLED_FRAMES_S)
        rig.bus.send_lines([line] * min(MOST_BABBLED, due - sent))
        sent = due

    return _every_tick(rig, babble)


def _can_other_sender(rig: Faulty) -> Undo:
    """Another node sends commands with a valid counter and checksum of its own."""
    count = 0

    def intrude() -> None:
        nonlocal count
        count += 1
        if count % 5 == 0:
            wire = rig.ecu.wire
            command = CurrentCommand(count // 5 % max(1, wire.counter_modulus), True, False, 0.1)
            rig.bus.send_lines([frame_line(*frame) for frame in wire.commands(command)])

    return _every_tick(rig, intrude)


def _ecu_restart(rig: Faulty) -> None:
    rig.ecu.restart()


def _can_lost(rig: Faulty) -> None:
    """The CAN adapter is gone: its connection ends and cannot be had again."""
    rig.bus.close()


def _pulled(sensor: str) -> LastingInjector:
    """A sensor's cable is pulled."""
    return lambda rig: rig.channel(sensor).port.close()


def _renumbered(sensor: str) -> LastingInjector:
    """A sensor's adapter comes up under another number; without a name that follows it it is just gone."""

    def renumber(rig: Faulty) -> None:
        port = rig.channel(sensor).port
        if isinstance(port, NamedPort):
            port.renumber()
        else:
            port.close()

    return renumber


def _drifting(name: str) -> LastingInjector:
    """A sensor's clock goes wrong."""

    def drift(rig: Faulty) -> None:
        sensor = rig.channel(name).sensor
        sensor.clock.drift(sensor.clock.ppm + DRIFT_PPM, rig.plant.time_s)

    return drift


def _sensors_swapped(rig: Faulty) -> None:
    """The two plugs are exchanged: each port carries the other sensor's bytes."""
    load_cell, lvdt = rig.channel("load_cell"), rig.channel("lvdt")
    load_cell.sensor, lvdt.sensor = lvdt.sensor, load_cell.sensor
    load_cell.column, lvdt.column = lvdt.column, load_cell.column


def _not_tared(name: str, share: float) -> LastingInjector:
    """A sensor shows a share of its range at zero."""

    def untare(rig: Faulty) -> None:
        sensor = rig.channel(name).sensor
        sensor.faults.zero_offset = share * sensor.options.range

    return untare


def _wrong_damper(rig: Faulty) -> None:
    rig.plant.constants["force_scale"] = WRONG_DAMPER_SCALE


def _load_train(rig: Faulty) -> Undo:
    """A joint works loose: free play behind a softer mounting; taken away, it is tight again."""
    constants = rig.plant.constants
    before = constants[["free_play_m", "mount_stiffness_N_m"]].copy()
    constants["free_play_m"] = LOOSE_PLAY_M
    constants["mount_stiffness_N_m"] = LOOSE_STIFFNESS_N_M

    def tighten() -> None:
        for name in ("free_play_m", "mount_stiffness_N_m"):
            constants[name] = before[name]

    return tighten


LASTING: dict[str, LastingInjector] = {
    "modbus-reset": _modbus_reset,
    "modbus-halfopen": _modbus_halfopen,
    "actuator-reboot": _actuator_reboot,
    "watchdog-absent": _watchdog_absent,
    "second-master": _second_master,
    "stop-ignored": _stop_ignored,
    "register-layout": _register_layout,
    "estop": _estop,
    "can-busoff": _can_busoff,
    "ecu-restart": _ecu_restart,
    "loadcell-pulled": _pulled("load_cell"),
    "lvdt-pulled": _pulled("lvdt"),
    "usb-renumber": _renumbered("load_cell"),
    "clock-drift": _drifting("load_cell"),
    "sensors-swapped": _sensors_swapped,
    "not-tared": _not_tared("load_cell", ZERO_SHARE),
    "wrong-damper": _wrong_damper,
}
LASTING_VARIANTS: dict[str, LastingInjector] = {
    "can-busoff:lost": _can_lost,
    "stop-ignored:pressure": _pressure_stays,
    "loadcell-pulled:auxiliary": _pulled("auxiliary_1"),
    "usb-renumber:lvdt": _renumbered("lvdt"),
    "clock-drift:lvdt": _drifting("lvdt"),
    "not-tared:lvdt": _not_tared("lvdt", LVDT_ZERO_SHARE),
    **BEYOND_LASTING,
}
def _never_zero(rig: Faulty) -> Undo:
    """The output stage leaves a current that no command takes away: a relay that sticks, a lowest set-point above 0."""
    undo = _switch(rig.ecu.faults, "least_A", LEAST_A)
    rig.ecu.obey(0.0, enable=False, clear_faults=False)
    return undo


PASSING: dict[str, PassingInjector] = {
    "modbus-busy": _switched(_link, "busy"),
    "modbus-reject": _switched(_link, "reject_writes"),
    "modbus-wrong-tid": _switched(_link, "wrong_transaction"),
    "modbus-mismatch": _switched(_link, "wrong_function"),
    "rtu-stale": _switched(_link, "late_answers"),
    "rtu-crc": _switched(_link, "damaged"),
    "modbus-write-lost": _switched(_registers, "writes_lost"),
    "setpoints-late": _switched(_link, "slow"),
    "setpoints-lost": _switched(_controller, "setpoints_lost"),
    "actuator-frozen": _switched(_controller, "position_frozen"),
    "ecu-silent": _switched(_ecu, "silent"),
    "ecu-late": _switched(_ecu, "late"),
    "ecu-crc": _switched(_ecu, "wrong_crc"),
    "can-malformed": _can_malformed,
    "can-babble": _can_babble,
    "can-foreign": _can_other_sender,
    "ecu-overtemp": _switched(_ecu, "over_temperature"),
    "coil-open-short": _switched(_ecu, "coil_open"),
    "current-tracking": _switched(_ecu, "gain", TRACKING_GAIN),
    "current-stuck": _switched(_ecu, "stuck_current"),
    "supply-not-zero": _never_zero,
    "serial-garbage": _switched(_load_cell, "garbage"),
    "serial-baud": _switched(_load_cell, "wrong_baud"),
    "sensor-stuck": _switched(_load_cell, "stuck"),
    "sensor-saturated": _switched(_load_cell, "saturated"),
    "sensor-spike": _switched(_load_cell, "spikes"),
    "sensor-nan": _switched(_load_cell, "not_a_number"),
    "sample-gap": _switched(_load_cell, "gaps"),
    "load-train": _load_train,
}
"""Injectors whose fault can be taken away again."""
PASSING_VARIANTS: dict[str, PassingInjector] = {
    "ecu-overtemp:undervoltage": _switched(_ecu_itself, "supply_V", LOW_SUPPLY_V),
    "coil-open-short:short": _switched(_ecu, "coil_short"),
    "current-tracking:over": _switched(_ecu, "gain", OVERCURRENT_GAIN),
    "serial-garbage:lvdt": _switched(_lvdt, "garbage"),
    "serial-baud:lvdt": _switched(_lvdt, "wrong_baud"),
    "sensor-stuck:lvdt": _switched(_lvdt, "stuck"),
    "sensor-saturated:lvdt": _switched(_lvdt, "saturated"),
    "sensor-spike:lvdt": _switched(_lvdt, "spikes"),
    "sensor-nan:lvdt": _switched(_lvdt, "not_a_number"),
    "sample-gap:lvdt": _switched(_lvdt, "gaps"),
    "sample-gap:backwards": _switched(_load_cell, "time_backwards"),
    "sample-gap:lvdt-backwards": _switched(_lvdt, "time_backwards"),
    "current-stuck:full": _switched(_ecu, "full_current"),
    **BEYOND_PASSING,
}
BEYOND_LIMITS = ("current-stuck:full", *BEYOND_LASTING, *BEYOND_PASSING)
"""Variants that drive the rig beyond the bench's limits."""
INJECTORS: dict[str, Callable[[Faulty], Undo | None]] = {**LASTING, **PASSING}
"""One for each row of the fault matrix that is hit on the wire."""
VARIANTS: dict[str, Callable[[Faulty], Undo | None]] = {**LASTING_VARIANTS, **PASSING_VARIANTS}
"""`SLUG:VARIANT`: other faults that the same row stands for."""
NEEDS_AUXILIARY = frozenset({"loadcell-pulled:auxiliary"})
