"""The JSON schema of a supply's file (`docs/how-to/connect-a-power-supply.md`), for editors."""

from __future__ import annotations

from typing import Any

COMMANDS = {
    "connect": "sent before anything is asked: an address, say",
    "identify": "asks who it is; its answer is also how answers are told apart after one stayed away",
    "remote": "sent once after it has said who it is: remote control",
    "local": "sent at the end: front panel",
    "prepare": "sent once after remote: channel, mode; nothing that drives a current",
    "clear": "sent when the rig is armed: clears its errors",
    "set_current": "sets the current: {current_A:.3f} or {current_mA:.0f}",
    "set_voltage_limit": "sets the highest voltage: {voltage_V:.2f} or {voltage_mV:.0f}",
    "output_on": "switches the output on",
    "output_off": "switches the output off",
    "measure_current": "asks for the measured current",
    "measure_voltage": "asks for the measured voltage",
    "read_output": "asks whether the output is on",
    "error_queue": "asks for the oldest error",
    "read_faults": "asks for the bits under [faults]",
}
_QUERIES = {"identify", "measure_current", "measure_voltage", "read_output", "error_queue", "read_faults"}


def _command(name: str) -> dict[str, Any]:
    text = {"type": "string", "minLength": 1, "maxLength": 200}
    one_or_more: list[dict[str, Any]] = [text] if name in _QUERIES else [text, {"type": "array", "items": text}]
    return {"description": COMMANDS[name], "anyOf": one_or_more}


def _table(description: str, required: tuple[str, ...] = (), **properties: dict[str, Any]) -> dict[str, Any]:
    shape = {"type": "object", "description": description, "additionalProperties": False, "properties": properties}
    return {**shape, "required": list(required)} if required else shape


def _range(unit: str) -> dict[str, Any]:
    number = {"type": "number", "minimum": -1000, "maximum": 1000}
    shape = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    return {**shape, "description": f"lowest and highest ({unit})"}


_PATTERN = {"type": "string", "format": "regex"}
_SENT = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
_BIT = {"type": "integer", "minimum": 0, "maximum": 31}

SUPPLY: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "supply file",
    **_table(
        "A programmable supply that drives the coil", ("range", "commands"),
        format={"const": 1},
        maker={"type": "string"}, model={"type": "string"},
        tried={"type": "string", "description": "how far it was tried, said at connect: unverified"},
        settling_ms={"type": "number", "minimum": 1, "maximum": 10000, "default": 300,
                     "description": "time until the current is that of a new set-point, the coil in it"},
        link=_table(
            "How lines go over the wire",
            terminator={"enum": ["\n", "\r", "\r\n"], "default": "\n"},
            echo={"type": "boolean", "default": False, "description": "every command comes back first"},
            acknowledge={**_PATTERN, "description": "what commands that ask nothing are answered with"},
            gap_ms={"type": "number", "minimum": 0, "maximum": 1000, "default": 0,
                    "description": "least time between two commands"},
            baudrate={"type": "integer", "minimum": 300, "maximum": 12000000, "default": 9600},
            bytesize={"enum": [7, 8], "default": 8}, parity={"enum": ["N", "E", "O"], "default": "N"},
            stopbits={"enum": [1, 1.5, 2], "default": 1},
        ),
        range=_table("What it gives", ("current_A",), current_A=_range("A"), voltage_V=_range("V")),
        commands=_table(
            "What is sent for what", ("set_current", "measure_current"), **{name: _command(name) for name in COMMANDS}
        ),
        answers=_table(
            "What its answers look like, where they are not plain",
            identity={**_PATTERN, "description": "the answer to identify must look like this"},
            no_error={**_PATTERN, "description": "the answer to error_queue when there is no error"},
            current={**_PATTERN, "description": "the current, as the group value: (?P<value>[-+0-9.]+)"},
            voltage={**_PATTERN, "description": "the voltage, as the group value"},
            on={"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}],
                "description": "answers to read_output that say that it is on"},
        ),
        faults=_table(
            "Bits of the answer to read_faults", (),
            **dict.fromkeys(("over-temperature", "undervoltage", "open", "short"), _BIT),
        ),
        watchdog=_table(
            "Its own time-out: it switches its output off when it hears nothing", ("time_s", "start"),
            time_s={"type": "number", "minimum": 0.1, "maximum": 60}, start=_SENT, stop=_SENT, feed=_SENT,
        ),
    ),
}  # fmt: skip
