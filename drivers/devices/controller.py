"""An actuator controller as data: its registers, what its codes mean, what it can do; read from a TOML file."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

from drivers.devices import controller_check
from drivers.devices.description_file import read_description
from drivers.roles import (
    UNNAMED,
    ActuatorIdentity,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    FaultBit,
    Input,
    Move,
    Program,
    ProgramPhase,
    Result,
    State,
    WatchdogAction,
    Waveform,
)
from drivers.setpoint_generator import Setpoint
from protocols.errors import LocalProtocolError
from protocols.register_map import Block, Register, RegisterMap, Value

FOLDER = Path(__file__).parent
COUNTER = "watchdog_counter"
UNNAMED_BITS = 32
"""So far up a bit is moved that has no name and whose number has another meaning here."""

_SUFFIXES = ("_m_s2", "_m_s", "_Pa", "_m", "_N")
_IDENTITY = tuple(ActuatorIdentity.__dataclass_fields__)


def _bare(field: str) -> str:
    """Register name of a field: the unit suffix dropped."""
    return next((field.removesuffix(suffix) for suffix in _SUFFIXES if field.endswith(suffix)), field)


_LIMITS = {field: _bare(field) for field in ActuatorLimits.__dataclass_fields__}
_STATUS = tuple(_bare(field) for field in ActuatorStatus._fields[1:])
_MEASURED = frozenset(_bare(field) for field in ActuatorStatus._fields if field != _bare(field))


class _Codes:
    """What a register's codes mean, there and back."""

    def __init__(self, meaning: type[IntEnum], codes: Mapping[str, int]) -> None:
        members = {_slug(member.name): member for member in meaning}
        if strange := [name for name in codes if name not in members]:
            raise LocalProtocolError(f"code {strange[0]!r} is not one of {', '.join(members)}")
        self._meaning = {code: int(members[name]) for name, code in codes.items()}
        self._code = {int(members[name]): code for name, code in codes.items()}
        self._members = tuple(meaning)
        self._taken = {int(member) for member in meaning}

    def meaning(self, code: int) -> int:
        """The neutral number of a device's code."""
        named = self._meaning.get(code)
        if named is not None:
            return named
        return code + UNNAMED if code in self._taken else code

    def has(self, number: int) -> bool:
        """The device has a code of this meaning."""
        return number in self._code

    def code(self, number: int) -> int:
        """The device's code of a neutral number; what `meaning` made of a code without a name becomes that code again.

        Raises:
            LocalProtocolError: the device has none.
        """
        known = self._code.get(number)
        if known is not None:
            return known
        if number in self._taken:
            name = next(_slug(member.name) for member in self._members if member == number)
            raise LocalProtocolError(f"{name} is nothing this controller knows")
        return number - UNNAMED if number - UNNAMED in self._taken else number


class _Bits:
    """What a register's bits mean."""

    def __init__(self, meaning: type[IntFlag], bits: Mapping[str, int]) -> None:
        members = {_slug(str(member.name)): int(member) for member in meaning}
        if strange := [name for name in bits if name not in members]:
            raise LocalProtocolError(f"bit {strange[0]!r} is not one of {', '.join(members)}")
        self._pairs = [(1 << bit, members[name]) for name, bit in bits.items()]
        self._same = all(bit == member for bit, member in self._pairs)
        self._named = sum(bit for bit, _ in self._pairs)
        self._taken = sum(members.values())

    def meaning(self, word: int) -> int:
        """The neutral bits of a device's word."""
        rest = word & ~self._named
        shown = rest & ~self._taken | (rest & self._taken) << UNNAMED_BITS
        if self._same:
            return word & self._named | shown
        return sum(member for bit, member in self._pairs if word & bit) | shown


class ControllerDescription:
    """What the generic driver needs to know of one kind of controller.

    Args:
        name: as in the bench file.
        data: contents of its file.

    Attributes:
        capabilities: what it can do.
        map: where its registers are.
        expected_identity: what its identity must show, by register: signatures, layout version.

    Raises:
        LocalProtocolError: the description contradicts itself.
    """

    def __init__(self, name: str, data: Mapping[str, Any]) -> None:
        self.name = name
        self.capabilities = controller_check.declared(data)
        codes, bits = controller_check.meanings(data)
        self._states = _Codes(State, codes["state"])
        self._commands = _Codes(Command, codes["command"])
        self._results = _Codes(Result, codes["result"])
        self._waveforms = _Codes(Waveform, codes["waveform"])
        self._phases = _Codes(ProgramPhase, codes["phase"])
        self._actions = _Codes(WatchdogAction, codes["watchdog_action"])
        self._faults = _Bits(FaultBit, bits["fault"])
        self._inputs = _Bits(Input, bits["input"])
        self.map = RegisterMap(name, [_block(entry) for entry in controller_check.blocks(data)])
        controller_check.check_map(self.map)
        controller_check.check_served(self.capabilities, self.map, codes, bits)
        controller_check.check_widths(self.map, bits)
        self.expected_identity: dict[str, Value] = dict(data.get("identity", {}))
        controller_check.check_identity(self.expected_identity, self.map)
        self._has = {register.name for register in self.map.block("status").registers}
        self._complete = self._has.issuperset(_STATUS)
        self._names_owner = any(register.name == "owner_id" for register in self.map.block("command").registers)
        setpoint = self.map.blocks.get("setpoint")
        self._setpoint = {register.name for register in setpoint.registers} if setpoint is not None else set()

    def decode_identity(self, words: Sequence[int]) -> ActuatorIdentity:
        """Identity from the words of its block.

        Raises:
            RemoteProtocolError: the words do not make up the block.
        """
        values = self.map.block("identity").decode(words)
        held = {name: values[name] for name in _IDENTITY if name in values}
        return ActuatorIdentity(**held)  # type: ignore[arg-type]  # types follow the map

    def decode_status(self, words: Sequence[int], received_ns: int) -> ActuatorStatus:
        """Status from the words of its block, in neutral terms; what the controller does not show is 0 or NaN.

        Without a heartbeat or a clock of its own the arrival's time stands for it; without an e-stop input the chain
        counts as closed.

        Args:
            words: register values of the status block.
            received_ns: when the answer arrived, host's monotonic clock.

        Raises:
            RemoteProtocolError: the words do not make up the block.
        """
        values = self._unshown(received_ns) | self.map.block("status").decode(words)
        values["state"] = self._states.meaning(int(values["state"]))
        values["result"] = self._results.meaning(int(values["result"]))
        values["phase"] = self._phases.meaning(int(values["phase"]))
        values["acked_command"] = self._commands.meaning(int(values["acked_command"]))
        values["fault_bits"] = self._faults.meaning(int(values["fault_bits"]))
        closed = 0 if self.capabilities.e_stop_input else int(Input.E_STOP_CLOSED)
        values["inputs"] = self._inputs.meaning(int(values["inputs"])) | closed
        return ActuatorStatus(received_ns, *[values[name] for name in _STATUS])  # type: ignore[arg-type]  # types follow the map

    def _unshown(self, received_ns: int) -> dict[str, Value]:
        """Values of what the status block does not have."""
        if self._complete:
            return {}
        own = {"heartbeat": received_ns // 10_000_000 & 0xFFFF, "clock_us": received_ns // 1000 & 0xFFFFFFFF}
        missing: dict[str, Value] = {name: own.get(name, 0) for name in _STATUS if name not in self._has}
        return missing | {name: math.nan for name in missing if name in _MEASURED}

    def decode_limits(self, words: Sequence[int]) -> ActuatorLimits:
        """Limits from the words of the config block.

        Raises:
            RemoteProtocolError: the words do not make up the block.
        """
        values = self.map.block("config").decode(words)
        values["watchdog_action"] = self._actions.meaning(int(values["watchdog_action"]))
        return ActuatorLimits(**{field: values[name] for field, name in _LIMITS.items()})  # type: ignore[arg-type]  # types follow the map

    def encode_limits(self, limits: ActuatorLimits) -> list[int]:
        """Words of the config block.

        Raises:
            LocalProtocolError: a limit does not fit its register.
        """
        values: dict[str, Value] = {_LIMITS[field]: value for field, value in asdict(limits).items()}
        values["watchdog_action"] = self._actions.code(limits.watchdog_action)
        return self.map.block("config").encode(values)

    def encode_command(
        self, command: Command, sequence: int, owner_id: int, order: Move | Program | None = None
    ) -> list[int]:
        """Words of the command block.

        Raises:
            LocalProtocolError: the controller knows no such command, or a value does not fit its register.
        """
        values: dict[str, Value] = {"command": self._commands.code(command), "sequence": sequence}
        if self._names_owner:
            values["owner_id"] = owner_id
        if isinstance(order, Move):
            values |= {"target_position": order.target_m, "speed": order.speed_m_s}
        elif order is not None:
            values |= {
                "waveform": self._waveforms.code(order.waveform), "amplitude": order.amplitude_m,
                "frequency": order.frequency_Hz, "centre": order.centre_m, "cycles": order.cycles,
                "ramp_in_cycles": order.ramp_in_cycles, "ramp_out_cycles": order.ramp_out_cycles,
            }
            if order.table_length:
                interval_s = 1.0 / (order.frequency_Hz * order.table_length)
                values |= {"table_length": order.table_length, "table_interval": interval_s}
        return self.map.block("command").encode(values)

    def knows(self, command: Command) -> bool:
        """Whether the controller has this command."""
        return self._commands.has(command)

    @property
    def counter_with_setpoint(self) -> bool:
        """The watchdog's counter lies in the block of the set-point: one write carries both."""
        return COUNTER in self._setpoint

    def encode_setpoint(self, setpoint: Setpoint, counter: int) -> list[int]:
        """Words of the set-point block; what it does not have is left out.

        Args:
            setpoint: where the rod is to be (m), and how fast it goes on (m/s).
            counter: the watchdog's.

        Raises:
            LocalProtocolError: a value does not fit its register.
        """
        values: dict[str, Value] = {
            "setpoint_position": setpoint.position_m, "setpoint_velocity": setpoint.velocity_m_s, COUNTER: counter,
        }
        held = {name: value for name, value in values.items() if name in self._setpoint}
        return self.map.block("setpoint").encode(held)

    @property
    def table_values(self) -> int:
        """Samples of a table waveform that fit one write."""
        return sum(register.name.startswith("table_value_") for register in self.map.block("table").registers)


@functools.cache
def controller(name: str) -> ControllerDescription:
    """The description of that name.

    Raises:
        LocalProtocolError: there is none, or it contradicts itself.
    """
    if name not in controller_names():
        raise LocalProtocolError(f"no controller {name!r}; known: {', '.join(controller_names())}")
    path = FOLDER / f"{name}_controller.toml"
    data = read_description(path)
    try:
        return ControllerDescription(name, _upon_its_base(data))
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{path}: {error}") from error


def _upon_its_base(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """A description's entries over those of the one that it names as its `base`: capabilities replaced, blocks added.

    Raises:
        LocalProtocolError: there is no such base, or it has one itself.
    """
    if "base" not in data:
        return data
    name = data["base"]
    if name not in controller_names():
        raise LocalProtocolError(f"base = {name!r:.40}: known are {', '.join(controller_names())}")
    base = read_description(FOLDER / f"{name}_controller.toml")
    if "base" in base:
        raise LocalProtocolError(f"base = {name!r}: it has a base itself")
    capabilities = {**base.get("capabilities", {}), **data.get("capabilities", {})}
    blocks = [*base.get("block", ()), *data.get("block", ())]
    own = {key: value for key, value in data.items() if key != "base"}
    return {**base, **own, "capabilities": capabilities, "block": blocks}


def controller_names() -> tuple[str, ...]:
    """Names of the controllers described here."""
    return tuple(sorted(path.stem.removesuffix("_controller") for path in FOLDER.glob("*_controller.toml")))


def _slug(name: str) -> str:
    return name.lower().replace("_", "-")


def _block(entry: Mapping[str, Any]) -> Block:
    """One block; an entry with `repeat` stands for so many registers in a row, numbered from 0."""
    writable = bool(entry.get("writable", False))
    registers: list[Register] = []
    for given in entry["registers"]:
        one = dict(given)
        repeat = int(one.pop("repeat", 0))
        if not repeat:
            registers.append(Register(**one, writable=writable))
            continue
        first = Register(**(one | {"name": f"{one['name']}0"}), writable=writable)
        registers += [
            Register(
                **(one | {"name": f"{one['name']}{i}", "address": first.address + i * first.length}), writable=writable
            )
            for i in range(repeat)
        ]
    return Block(entry["name"], tuple(registers), entry.get("word_order", "big"))
