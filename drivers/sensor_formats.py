"""Sensor formats by name or table: where a driver, a check or a simulated sensor gets a format from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.devices.can_sensor import can_format
from drivers.ring import Channel
from protocols.binary_format import BinaryFormat, Registers
from protocols.descriptions import DescriptionProblems, Problem
from protocols.line_format import LineFormat
from protocols.sensor_format import SensorFormat, from_description, kind_of, modbus_framing, preset
from protocols.sensor_presets import TABLES

FRAME16 = "frame16"
"""The project's own frame, which has a decoder of its own."""
WIRE_UNITS = {Channel.FORCE: "N", Channel.DISPLACEMENT: "mm"}
CAN = "can"
"""Kind of a format that is a CAN message."""
NUMBER = "number"
OWN_UNIT = "signed-decimal"
"""The preset that writes the unit of its channel behind the number."""

Given = str | Mapping[str, Any]
"""A preset's name, or the table of a description."""


def described_format(given: Given, channel: Channel | None = None) -> SensorFormat:
    """A format that is not `frame16`.

    Args:
        given: a preset's name, or a table.
        channel: whose it is; the project's own line carries the unit of its channel.

    Raises:
        DescriptionProblems: a table that contradicts itself; each problem with its place.
        LocalProtocolError: no preset of that name.
    """
    if not isinstance(given, str):
        return can_format(given) if kind_of(given) == CAN else from_description(given)
    shipped = preset(given)
    if given == OWN_UNIT and channel is not None and isinstance(shipped, LineFormat):
        return replace(shipped, unit=WIRE_UNITS.get(channel, shipped.unit))
    return shipped


def is_can(given: Given) -> bool:
    """Whether a format is a CAN message."""
    return not isinstance(given, str) and kind_of(given) == CAN


def registers_of(given: Given) -> Registers | None:
    """The Modbus registers of a format; None for other formats and plug-ins.

    Raises:
        DescriptionProblems: the table contradicts itself.
    """
    made = described_format(given) if modbus_framing(given) else None
    return made.registers if isinstance(made, BinaryFormat) else None


def format_problems(table: Mapping[str, Any]) -> list[Problem]:
    """Contradictions between valid entries of a description."""
    try:
        described_format(table)
    except DescriptionProblems as error:
        return error.problems
    return []


def wire_text(given: Given, written: Given) -> str:
    """A format in one line: its name, and how it makes a reading of the number on the wire where that is not all of it.

    Args:
        given: a preset's name, a table, or the name of a plug-in's format.
        written: as the bench file has it: a name, a file's name, or a table.
    """
    if isinstance(given, str) and given not in TABLES:
        return given
    name = written if isinstance(written, str) else "described in the bench file"
    made = described_format(given)
    reading = _line_reading(made) if isinstance(made, LineFormat) else _frame_reading(made)
    if isinstance(made, BinaryFormat) and made.can is not None:
        return f"{name}, CAN message {made.can.shown}, read as {reading}"
    return name if reading == NUMBER else f"{name}, read as {reading}"


def _line_reading(made: LineFormat) -> str:
    number = NUMBER
    if made.decimals:
        bare = "" if made.number.startswith("hexadecimal") else " if it has no decimal separator"
        number = f"({NUMBER} / {10**made.decimals}{bare})"
    reading = _scaled(made.scale, number, made.offset)
    if not made.units:
        return reading
    factors = ", ".join(f"{unit} {factor:.9g}" for unit, factor in {made.unit: 1.0, **made.units}.items())
    return f"({reading}) * factor for the unit in the line ({factors})"


def _frame_reading(made: BinaryFormat) -> str:
    value = made.fields["value"]
    return _scaled(value.scale, NUMBER, value.offset)


def _scaled(scale: float, number: str, offset: float) -> str:
    return f"{scale:.9g} * " * (scale != 1.0) + number + f" {offset:+.9g}" * (offset != 0.0)
