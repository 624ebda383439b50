"""The JSON schema of a roles file, made of the same tables by which it is read."""

from __future__ import annotations

from typing import Any

from drivers.devices.ecu_roles import FAULT_NAMES, ROLE_KEYS, SENDING, STATES
from drivers.devices.role_protection import KEYS, MODES, PROFILES
from drivers.devices.role_reading import UNITS

_TEXTS = {
    "command": "set-point of the coil's current",
    "enable": "output stage on and off",
    "clear_faults": "asks the ECU to clear its latched faults",
    "measured_current": "the current as the ECU measures it",
    "state": "state of the output stage; off, enabled, ...: its numbers or their names in the DBC",
    "faults": "a word of fault bits (signal); each fault a bit of it, a name of its value, or a signal of its own",
    "coil_temperature": "temperature of the coil",
    "ecu_temperature": "temperature of the ECU",
    "supply_voltage": "supply of the output stage",
    "clock": "the ECU's own clock, counting up and starting again",
    "serial_number": "serial number",
    "firmware": "firmware version",
    "layout": "version of the frames; value: the one of this DBC, proved at connect",
    "boot_count": "how often the ECU has started",
}
_NAME = {"type": "string", "pattern": r"^\w+\.\w+$", "description": '"Message.signal" with the names of the DBC'}
_NUMBER = {"anyOf": [{"type": "integer"}, {"type": "string"}, {"type": "boolean"}]}
_NUMBERS = {"anyOf": [*_NUMBER["anyOf"], {"type": "array", "items": _NUMBER}]}
_DURATION = {"type": "string", "pattern": r"^\s*[0-9]+(\.[0-9]*)?\s*(us|ms|s)\s*$", "examples": ["10 ms"]}
_FULL_SCALE = {"type": "string", "pattern": r"^\s*[0-9.]+\s*m?A\s*$", "examples": ["3 A"]}


def ecu_roles_schema() -> dict[str, Any]:
    """The JSON schema of a roles file."""
    return {
        "description": "What the signals of a DBC file mean: docs/how-to/connect-an-ecu-by-dbc.md",
        "type": "object",
        "properties": {
            **{role: _role(role) for role in ROLE_KEYS},
            "constants": {
                "type": "object",
                "description": '"Message.signal" = number or name: further signals of the messages that are sent',
                "additionalProperties": {
                    "anyOf": [
                        *_NUMBER["anyOf"], {"type": "number"}, {"type": "object", "additionalProperties": _NUMBER},
                    ]
                },
            },
            "protection": {
                "type": "object", "description": "counter and checksum, by message",
                "additionalProperties": {"oneOf": [_protection(profile) for profile in PROFILES]},
            },
            "periods": {
                "type": "object", "description": "how often a message comes, where the DBC does not say",
                "additionalProperties": _DURATION,
            },
            "sending": {"enum": list(SENDING), "default": SENDING[0], "description": "when commands are sent"},
            "command_timeout": {
                **_DURATION,
                "description": "without commands for so long the ECU goes to 0 A by itself; leave out if it does not",
            },
        },
        "required": ["command", "measured_current"],
        "additionalProperties": False,
    }  # fmt: skip


def _role(role: str) -> dict[str, Any]:
    keys: dict[str, Any] = {"signal": _NAME}
    dimension = {"command": "current", "measured_current": "current", "coil_temperature": "temperature",
                 "ecu_temperature": "temperature", "supply_voltage": "voltage", "clock": "time"}.get(role)  # fmt: skip
    for key in ROLE_KEYS[role][1:]:
        if key == "unit" and dimension is not None:
            keys[key] = {"enum": [*UNITS[dimension], *(["%"] if dimension == "current" else [])]}
        elif key == "full_scale":
            keys[key] = _FULL_SCALE
        elif key in STATES:
            keys[key] = _NUMBERS
        elif key in FAULT_NAMES:
            one = {"type": "object", "properties": {"signal": _NAME, "value": _NUMBERS}, "required": ["signal"],
                   "additionalProperties": False}  # fmt: skip
            keys[key] = {"anyOf": [{"type": "integer", "minimum": 0, "maximum": 63}, {"type": "string"}, one]}
        else:
            keys[key] = _NUMBER
    table: dict[str, Any] = {"type": "object", "properties": keys, "additionalProperties": False}
    if role != "faults":
        table["required"] = ["signal"]
    return {"description": _TEXTS[role], "anyOf": [_NAME, table]}


def _protection(profile: str) -> dict[str, Any]:
    """The table of one profile."""
    byte = {"type": "integer", "minimum": 0, "maximum": 0xFF}
    shapes: dict[str, Any] = {
        "profile": {"const": profile}, "data_ids": {"type": "array", "items": byte, "minItems": 16, "maxItems": 16},
        "data_id_mode": {"enum": list(MODES if profile == "e2e-1" else MODES[:1] + MODES[-1:])},
        "counter": {"type": "string"}, "crc": {"type": "string"}, "nibble": {"type": "string"},
        "reflected": {"type": "boolean"}, "data_id_first": {"type": "boolean"},
    }
    needed = {
        "counter": ["counter"], "counter+crc": ["counter", "crc", "polynomial"], "e2e-1": ["data_id"],
        "e2e-2": ["data_ids"], "e2e-5": ["data_id"], "e2e-11": ["data_id"],
    }
    return {
        "type": "object",
        "properties": {key: shapes.get(key, {"type": "integer", "minimum": 0}) for key in KEYS[profile]},
        "required": ["profile", *needed.get(profile, [])],
        "additionalProperties": False,
    }
