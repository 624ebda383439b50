"""The JSON schemas of a register map's file and of an analogue output's, for editors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from drivers.current_source import SourceFault
from drivers.register_maps.condition import COMPARISONS
from drivers.register_maps.indirect import KEYS as INDIRECT
from drivers.register_maps.meanings import word
from drivers.register_maps.quantity import SPACES, TYPES
from drivers.register_maps.read_quantities import ACCESS, ORDERS
from drivers.register_maps.read_recipes import COMMANDS, KINDS
from drivers.roles import Command, FaultBit, Input, Pressure, ProgramPhase, Result, State, WatchdogAction, Waveform
from protocols.wire_units import ALIASES, UNITS

Schema = dict[str, Any]

TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
TIME: Schema = {"type": "string", "pattern": r"^\s*\d+(\.\d+)?\s*(us|ms|s|min)\s*$", "examples": ["500 ms"]}
TRUTH: Schema = {"type": "boolean"}
LARGEST = 65_535 + 499_999
"""An address with the largest `first_address`."""


def _whole(low: int, high: int) -> Schema:
    return {"type": "integer", "minimum": low, "maximum": high}


def _among(choices: Iterable[object]) -> Schema:
    return {"enum": list(choices)}


def _table(properties: Schema, needed: Iterable[str] = ()) -> Schema:
    return {"type": "object", "properties": properties, "additionalProperties": False, "required": list(needed)}


def _ref(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _or_list(one: Schema) -> Schema:
    return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}


def _words(meaning: Iterable[Any], one: Schema) -> Schema:
    return _table({word(member): one for member in meaning})


def _quantity() -> Schema:
    return _table(
        {
            "address": _whole(0, LARGEST), "function": _among(SPACES), "type": _among(TYPES), "scale": NUMBER,
            "offset": NUMBER, "unit": _among([*UNITS, *ALIASES]), "word_order": _among(ORDERS),
            "byte_order": _among(ORDERS), "access": _among(ACCESS), "write_function": _among((5, 6, 15, 16)),
            "length": _whole(1, 120), "bit": _whole(0, 15), "count": _whole(1, 120), "description": TEXT,
        },
        ("address",),
    )  # fmt: skip


def _modbus() -> Schema:
    start = _whole(0, 499_999)
    return _table({
        "word_order": _among(ORDERS), "byte_order": _among(ORDERS), "function": _among(SPACES),
        "first_address": {"anyOf": [start, _table(dict.fromkeys(SPACES, start))]},
        "write_function": _among((6, 16)), "coil_function": _among((5, 15)), "largest_gap": _whole(0, 124),
        "largest_read": _whole(1, 125), "read_while_writing": TRUTH,
        "unreadable": {
            "type": "array", "items": {"type": "array", "items": _whole(0, LARGEST), "minItems": 2, "maxItems": 2}
        },
    })  # fmt: skip


def _definitions() -> Schema:
    value: Schema = {"type": ["number", "boolean", "string"]}
    comparisons: Schema = dict.fromkeys(COMPARISONS, value) | {"one_of": {"type": "array", "items": value}}
    span: Schema = {"type": "array", "items": TEXT, "minItems": 2, "maxItems": 2}
    values: Schema = {"type": "object", "additionalProperties": value, "minProperties": 1}
    condition = _table({"quantity": TEXT, "bit": _whole(0, 63), **comparisons}, ("quantity",))
    steps = [
        _table({"write": values, "span": span, "description": TEXT}, ("write",)),
        _table({"wait": _or_list(_ref("condition")), "within": TIME, "description": TEXT}, ("wait", "within")),
        _table({"pause": TIME, "description": TEXT}, ("pause",)),
        _table({"recipe": TEXT, "description": TEXT}, ("recipe",)),
    ]
    written = {"write": values, "span": span}
    return {
        "condition": condition, "step": {"anyOf": steps}, "recipe": _or_list(_ref("step")),
        "code": _or_list(_whole(0, (1 << 32) - 1)), "quantity": _quantity(),
        "bit": {"anyOf": [_or_list(_whole(0, 63)), _or_list(_ref("condition"))]},
        "written": _table(written, ("write",)),
    }  # fmt: skip


def schema() -> Schema:
    """The schema, draft 2020-12."""
    code = _ref("code")
    state: Schema = {"anyOf": [code, _or_list(_ref("condition")), {"const": True}]}
    written: Schema = {"write": {"type": "object"}, "span": {"type": "array"}}
    properties: Schema = {
        "format": {"const": 1}, "name": TEXT, "description": TEXT, "unverified": TRUTH, "base": TEXT,
        "without": {"type": "array", "items": TEXT}, "modbus": _modbus(),
        "quantities": {"type": "object", "additionalProperties": _ref("quantity"), "required": ["position"]},
        "identity": {"type": "object", "additionalProperties": {"type": ["number", "string", "boolean"]}},
        "state": _words(State, state) | {"required": ["hold"]},
        "pressure": _words(
            (Pressure.OFF, Pressure.LOW, Pressure.ON), {"anyOf": [code, _or_list(_ref("condition"))]}
        ) | {"required": ["off"]},
        "faults": _words(FaultBit, _ref("bit")), "inputs": _words(Input, _ref("bit")),
        "phase": _words(ProgramPhase, code), "results": _words(Result, code), "command_codes": _words(Command, code),
        "waveforms": _words(Waveform, code), "watchdog_actions": _words(WatchdogAction, code),
        "commands": _table(dict.fromkeys(COMMANDS, _ref("recipe"))),
        "recipes": {"type": "object", "additionalProperties": _ref("recipe")},
        "setpoint": _ref("written"), "table": _ref("written"),
        "watchdog": _table({"kind": _among(KINDS), "time": TIME, **written}),
        "indirect": _table(_indirect(), ("pointers", "data", "quantities")),
    }  # fmt: skip
    needed = ("quantities", "state")
    return _table(properties, needed) | {"$defs": _definitions()}


def output_schema() -> Schema:
    """The schema of an analogue output's file, draft 2020-12; `$defs` stand beside it."""
    values: Schema = {"type": "object", "additionalProperties": {"type": ["number", "boolean", "string"]}}
    ends: Schema = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}
    properties: Schema = {
        "format": {"const": 1}, "maker": TEXT, "model": TEXT, "tried": TEXT,
        "settling_ms": {"type": "number", "minimum": 1, "maximum": 10_000},
        "range": _table({"current_A": ends}, ("current_A",)),
        "link": _table({"baudrate": _whole(300, 12_000_000), "parity": _among(("N", "E", "O"))}), "modbus": _modbus(),
        "quantities": {"type": "object", "additionalProperties": _ref("quantity"), "required": ["current"]},
        "identity": values, "prepare": values, "faults": _words(SourceFault, _ref("bit")),
        "watchdog": _table({
            "time_s": {"type": "number", "minimum": 0.1, "maximum": 60}, "start": values, "feed": values, "stop": values
        }, ("time_s",)),
    }  # fmt: skip
    return _table(properties, ("range", "quantities")) | {"$defs": _definitions()}


def _indirect() -> Schema:
    own: Schema = {
        "pointers": _whole(0, LARGEST), "data": _whole(0, LARGEST), "function": _among(("holding", "input")),
        "quantities": {"type": "array", "items": TEXT, "minItems": 1}, "pointer_registers": _among((1, 2)),
        "pointer_offset": {"type": "integer"},
    }  # fmt: skip
    return {key: own[key] for key in INDIRECT}
