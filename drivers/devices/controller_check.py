"""What a controller's description must hold before anything is asked of the device: entries, and what serves them.

A capability that is declared must be served by registers, codes and bits; and whatever is declared, a stop must be
able to be sent and seen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.devices.description_file import all_of, distinct, number, only, table, text, truth, whole
from drivers.roles import ActuatorIdentity
from protocols.errors import LocalProtocolError
from protocols.register_map import Block, Register, RegisterMap

DRIVER = "modbus"
RESERVED = "reserved"
"""Registers whose name begins so are nobody's."""
MOST_READ = 125
MOST_WRITTEN = {"config": 123, "command": 123, "table": 123, "watchdog": 121, "setpoint": 121}
LARGEST_CODE = 0xFFFF

_TABLES = ("driver", "capabilities", "identity", "codes", "bits", "block")
_CODES = ("state", "command", "result", "waveform", "phase", "watchdog_action")
_BITS = ("fault", "input")
_BLOCK_KEYS = ("name", "word_order", "writable", "registers")
_REGISTER_KEYS = ("address", "name", "type", "unit", "meaning", "length", "scale", "repeat")
_TEXTS = ("vendor", "model", "serial_number", "firmware")
_STATUS_REALS = (
    "position", "velocity", "setpoint", "supply_pressure", "accumulator_pressure", "servo_error", "force",
)
_STATUS_WHOLE = (
    "heartbeat", "state", "fault_bits", "clock_us", "cycles_done", "pulse_count", "phase", "pulse_clock_us",
    "acked_sequence", "result", "acked_command", "owner", "watchdog_echo", "inputs", "program_id",
)
_CONFIG = (
    "position_min", "position_max", "speed_max", "acceleration_max", "force_max", "fade_out_cycles",
    "halt_deceleration", "watchdog_ms", "watchdog_action",
)
_MOVE = ("target_position", "speed")
_PROGRAM = ("waveform", "amplitude", "frequency", "centre", "cycles", "ramp_in_cycles", "ramp_out_cycles")
_TABLE_PROGRAM = ("table_length", "table_interval")
_REGISTERS: Mapping[str, Collection[str]] = {
    "identity": tuple(ActuatorIdentity.__dataclass_fields__),
    "status": (*_STATUS_WHOLE, *_STATUS_REALS),
    "config": _CONFIG,
    "command": ("command", "sequence", "owner_id", *_MOVE, *_PROGRAM, *_TABLE_PROGRAM),
    "watchdog": ("watchdog_counter",),
    "setpoint": ("setpoint_position", "setpoint_velocity", "watchdog_counter"),
    "table": ("table_index", "table_count"),
}
_WHOLE = frozenset({
    *_STATUS_WHOLE, "signature_u32", "layout_version", "boot_count", "config_hash", "watchdog_ms", "watchdog_action",
    "command", "sequence", "owner_id", "waveform", "table_length", "watchdog_counter", "table_index", "table_count",
})

Need = tuple[str, tuple[str, ...]]
"""A place (`status`, `codes.state` ...) and the names that must be there."""
_ALWAYS: tuple[Need, ...] = (
    ("identity", ()),
    ("status", ("state", "position", "velocity")),
    ("command", ("command", "sequence")),
    ("codes.state", ("hold",)),
)
_SERVED: Mapping[str, tuple[Need, ...]] = {
    "hydraulics": (
        ("status", ("inputs",)), ("bits.input", ("hydraulics-low", "hydraulics-on")), ("codes.state", ("off", "low")),
        ("codes.command", ("hydraulics-off", "hydraulics-low", "hydraulics-on")),
    ),
    "lease": (("status", ("owner",)), ("command", ("owner_id",)), ("codes.command", ("acquire", "release"))),
    "acknowledge": (
        ("status", ("acked_sequence", "result", "acked_command")), ("codes.result", ("done",)),
    ),
    "echo": (("status", ("watchdog_echo",)),),
    "limits_read_back": (("config", _CONFIG), ("codes.watchdog_action", ("fade-and-hold",))),
    "settings_hash": (("identity", ("boot_count", "config_hash")),),
    "phase": (("status", ("phase",)), ("codes.phase", ("ramp-in", "full-amplitude", "ramp-out"))),
    "cycle_pulse": (("status", ("pulse_count", "pulse_clock_us", "clock_us")),),
    "generator": (
        ("status", ("cycles_done",)), ("command", (*_MOVE, *_PROGRAM)), ("codes.state", ("running",)),
        ("codes.command", ("move-to", "fade-stop", "halt", "start")), ("codes.waveform", ("sine",)),
    ),
    "streamed_setpoints": (("setpoint", ("setpoint_position",)),),
    "table": (
        ("table", ("table_index", "table_count", "table_value_0")), ("command", _TABLE_PROGRAM),
        ("codes.waveform", ("table",)),
    ),
    "e_stop_input": (("status", ("inputs",)), ("bits.input", ("e-stop-closed",))),
    "force_input": (("status", ("force",)),),
}
_WATCHED: tuple[Need, ...] = (
    ("status", ("fault_bits",)), ("bits.fault", ("watchdog",)), ("codes.state", ("tripped",)),
    ("codes.command", ("reset",)),
)


def declared(data: Mapping[str, Any]) -> Capabilities:
    """The capabilities that a description declares.

    Raises:
        LocalProtocolError: one that is unknown, missing or no truth value.
    """
    only(data, _TABLES, "description")
    if data.get("driver", DRIVER) != DRIVER:
        raise LocalProtocolError(f'driver = {data["driver"]!r:.40}: a controller is driven by "{DRIVER}"')
    given = table(data, "capabilities", "capabilities")
    only(given, tuple(Capabilities.__dataclass_fields__), "[capabilities]")
    all_of(given, ("watchdog", "hydraulics"), "[capabilities]", "every controller")
    watchdog = given["watchdog"]
    kinds = [kind.value for kind in WatchdogKind]
    if watchdog not in kinds:
        raise LocalProtocolError(f"[capabilities] watchdog = {watchdog!r:.40}: must be one of {', '.join(kinds)}")
    talents = {name: truth(value, f"[capabilities] {name}") for name, value in given.items() if name != "watchdog"}
    return Capabilities(watchdog=WatchdogKind(watchdog), **talents)


def meanings(data: Mapping[str, Any]) -> tuple[dict[str, Mapping[str, int]], dict[str, Mapping[str, int]]]:
    """The tables of codes and of bits, whole numbers all of them; one that is not given is empty.

    Raises:
        LocalProtocolError: a table nobody knows, or a value that is no code or bit.
    """
    codes, bits = table(data, "codes", "codes"), table(data, "bits", "bits")
    only(codes, _CODES, "[codes]")
    only(bits, _BITS, "[bits]")
    numbers = {name: dict(table(codes, name, f"codes.{name}")) if name in codes else {} for name in _CODES}
    for name, entries in numbers.items():
        for key, value in entries.items():
            whole(value, 0, LARGEST_CODE, f"[codes.{name}] {key}")
        distinct(entries, f"[codes.{name}]")
    places = {name: dict(table(bits, name, f"bits.{name}")) if name in bits else {} for name in _BITS}
    for name, entries in places.items():
        for key, value in entries.items():
            whole(value, 0, 31, f"[bits.{name}] {key}")
        distinct(entries, f"[bits.{name}]")
    return dict(numbers), dict(places)


def blocks(data: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The entries of the blocks, each of the kind it must be.

    Raises:
        LocalProtocolError: one that is not.
    """
    given = data.get("block")
    if not isinstance(given, list) or not given:
        raise LocalProtocolError("[[block]] is missing; the registers stand in blocks")
    for entry in given:
        if not isinstance(entry, Mapping):
            raise LocalProtocolError(f"[[block]] {entry!r:.40}: must be a table")
        only(entry, _BLOCK_KEYS, "[[block]]")
        name = text(entry.get("name"), "[[block]] name")
        place = f"block {name!r}"
        only([name], tuple(_REGISTERS), "[[block]] name")
        text(entry.get("word_order", "big"), f"{place}: word_order")
        truth(entry.get("writable", False), f"{place}: writable")
        if not isinstance(entry.get("registers"), list):
            raise LocalProtocolError(f"{place}: registers is missing, or no list of tables")
        for register in entry["registers"]:
            _register(register, place)
    return given


def _register(given: object, place: str) -> None:
    if not isinstance(given, Mapping):
        raise LocalProtocolError(f"{place}: a register is {given!r:.40}; must be a table with address, name and type")
    only(given, _REGISTER_KEYS, f"{place}: a register")
    all_of(given, ("address", "name", "type"), f"{place}: a register", "every register")
    name = text(given["name"], f"{place}: name")
    place = f"{place}: register {name!r}"
    for key in ("type", "unit", "meaning"):
        text(given.get(key, ""), f"{place}: {key}")
    whole(given["address"], 0, 0xFFFF, f"{place}: address")
    whole(given.get("length", 0), 0, MOST_READ, f"{place}: length")
    whole(given.get("repeat", 0), 0, MOST_READ, f"{place}: repeat")
    number(given.get("scale", 1.0), f"{place}: scale")


def check_map(registers: RegisterMap) -> None:
    """Hold the registers against what the driver asks of them.

    Raises:
        LocalProtocolError: a name twice or unknown, a number where a text belongs, or more than one request carries.
    """
    for block in registers.blocks.values():
        most = MOST_WRITTEN.get(block.name, MOST_READ)
        if block.count > most:
            raise LocalProtocolError(
                f"block {block.name!r}: {block.count} registers; one request carries at most {most}"
            )
        seen: set[str] = set()
        for register in block.registers:
            if register.name in seen:
                raise LocalProtocolError(f"block {block.name!r}: register {register.name!r} is given twice")
            seen.add(register.name)
            _check_register(block, register)


def _check_register(block: Block, register: Register) -> None:
    """One register: a known name, and a type that can hold what it means.

    Raises:
        LocalProtocolError: it is not so.
    """
    name, place = register.name, f"block {block.name!r}: register {register.name!r}"
    if name.startswith(RESERVED) or (block.name == "table" and name.startswith("table_value_")):
        return
    only([name], _REGISTERS[block.name], f"block {block.name!r}: registers")
    if (name in _TEXTS) != (register.type == "string"):
        raise LocalProtocolError(f"{place}: type {register.type!r}; it is {'a text' if name in _TEXTS else 'a number'}")
    if name in _WHOLE and (register.type not in {"u16", "u32"} or register.scale != 1.0):
        raise LocalProtocolError(f"{place}: {register.type}, scale {register.scale:g}; must be u16 or u32 with scale 1")


def check_served(
    can: Capabilities, registers: RegisterMap, codes: Mapping[str, Mapping[str, int]],
    bits: Mapping[str, Mapping[str, int]],
) -> None:
    """Hold what is declared against the registers, codes and bits that serve it.

    Raises:
        LocalProtocolError: something declared, or needed by every stop, has none.
    """
    places: dict[str, Collection[str]] = {
        name: [register.name for register in block.registers] for name, block in registers.blocks.items()
    }
    places |= {f"codes.{name}": entries for name, entries in codes.items()}
    places |= {f"bits.{name}": entries for name, entries in bits.items()}
    _all_needs(_ALWAYS, places, "every controller")
    if not (can.generator or can.streamed_setpoints):
        raise LocalProtocolError(
            "[capabilities] generator = false: then it must follow set-points that are streamed to it: "
            "streamed_setpoints = true, and a block of the name setpoint"
        )
    for capability, needs in _SERVED.items():
        if getattr(can, capability):
            _all_needs(needs, places, f"[capabilities] {capability} = true")
    if can.watchdog is not WatchdogKind.NONE:
        _all_needs(_WATCHED, places, f'[capabilities] watchdog = "{can.watchdog}"')
    if can.watchdog is WatchdogKind.COUNTER:
        _all_needs((("watchdog", ("watchdog_counter",)),), places, '[capabilities] watchdog = "counter"')


def _all_needs(needs: tuple[Need, ...], places: Mapping[str, Collection[str]], reason: str) -> None:
    for place, names in needs:
        shown = f"[{place}]" if "." in place else f"block {place!r}"
        if place not in places:
            raise LocalProtocolError(f"{shown} is missing; {reason} needs it")
        all_of(places[place], names, shown, reason)


def check_identity(expected: Mapping[str, Any], registers: RegisterMap) -> None:
    """Hold the values that prove the device against its identity's registers.

    Raises:
        LocalProtocolError: a value without a register, or one that its register never holds.
    """
    identity = registers.block("identity")
    only(expected, [register.name for register in identity.registers], "[identity]")
    for name, value in expected.items():
        if name in _TEXTS:
            text(value, f"[identity] {name}")
        else:
            number(value, f"[identity] {name}")
        identity.encode({name: value})


def check_widths(registers: RegisterMap, bits: Mapping[str, Mapping[str, int]]) -> None:
    """Hold bit numbers against the width of their registers.

    Raises:
        LocalProtocolError: a bit that its register does not have.
    """
    held = {register.name: register for register in registers.block("status").registers}
    for name, where in (("fault", "fault_bits"), ("input", "inputs")):
        if where not in held:
            continue
        for key, bit in bits[name].items():
            whole(bit, 0, 16 * held[where].length - 1, f"[bits.{name}] {key}")
