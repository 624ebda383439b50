"""A simulated sensor that wears a described format: what its numbers on the wire are."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.sensor_formats import FRAME16, described_format
from protocols.binary_format import BinaryFormat
from protocols.errors import LocalProtocolError
from protocols.line_format import LineFormat
from protocols.sensor_format import SensorFormat
from protocols.sensor_presets import TABLES
from rig import units
from rig.errors import FileProblem
from rig.files.described import described as read_description
from rig.files.names import is_file
from rig.files.network_text import NETWORK
from simulators import frame_writer, line_writer
from simulators.frame_writer import FrameWriter
from simulators.line_writer import LineWriter
from simulators.options import SI_UNITS, SensorOptions

BRIDGE = "mV/V"
RATED_mV_V = 2.0
"""What a strain gauge bridge gives at its range."""
FINEST = 1e6
"""Where the format does not say its unit, its numbers make no more than so many steps of the range."""
REQUEST_RATE_Hz = 100.0
BURST_SHARE = 0.3
"""A line holds back for so much of the time until the next request, at most."""
OWN = ("signed-decimal", "ascii")
"""The project's own line, by its name and by the name it also has on the command line."""


def span_of(described: SensorFormat) -> tuple[float, float]:
    """The smallest and the largest value, in the format's unit, that it can carry."""
    if isinstance(described, LineFormat):
        return line_writer.span_of(described)
    return frame_writer.span_of(described)


def writer(described: SensorFormat, low: float, high: float) -> LineWriter | FrameWriter:
    """What writes readings between two values in a format.

    Raises:
        LocalProtocolError: the format cannot hold them.
    """
    kind = LineWriter if isinstance(described, LineFormat) else FrameWriter
    return kind(described, low, high)  # type: ignore[arg-type]  # each its own kind of format


def sending(options: SensorOptions, given: str, whose: str, least_si: float) -> SensorOptions:
    """A simulated sensor that sends a format.

    Its numbers are in the format's unit where that is known, else in steps that fit; a format that counts from 0 has
    its zero in the middle.

    Args:
        options: the sensor as it is.
        given: `frame16`, a preset's name or a file's, or a table of a bench file as JSON.
        whose: the option that names the format, for messages.
        least_si: the range (SI) that it must have at least.

    Raises:
        FileProblem: the format cannot be read, or not carry that range.
    """
    if given == FRAME16:
        return options
    if given in OWN:
        return replace(options, format=OWN[0])
    entry = _table(given, whose) if given.startswith("{") else str(Path(given).absolute()) if is_file(given) else given
    own = read_description("sensor-format", entry)
    try:
        described = described_format(own)
    except LocalProtocolError as error:
        raise FileProblem(whose, [str(error)]) from error
    table = own if isinstance(own, Mapping) else TABLES[own]
    low, high = span_of(described)
    zero = 0.0 if low < 0.0 else 0.5 * (low + high)
    half = min(high - zero, zero - low)
    stated = "unit" in table or "unit" in TABLES.get(str(table.get("base")), {}) or NETWORK in table
    per_si = _per_si(described, stated=stated, half=half, options=options)
    range_si = min(options.range / options.wire_per_si, half / per_si) if per_si else 0.0
    if range_si < least_si:
        raise FileProblem(
            f"{whose} {given}",
            [f"cannot represent the values of the simulated rig: the format's range, {low:g} to {high:g} "
                f"{described.unit}, covers +-{range_si:g} {SI_UNITS[options.unit]}; required: +-{least_si:g}"],
        )  # fmt: skip
    ratio = per_si / options.wire_per_si
    rate_Hz, burst_s = options.rate_Hz, options.burst_s
    if described.exchange.request:
        rate_Hz = min(rate_Hz, described.nominal_rate_Hz or REQUEST_RATE_Hz)
        burst_s = min(burst_s, BURST_SHARE / rate_Hz)
    # The time for a Modbus answer is part of the exchange.
    polled = isinstance(described, BinaryFormat) and described.registers is not None
    return replace(
        options, format=described, described=entry, latency_s=0.0 if polled else options.latency_s,
        wire_per_si=per_si, wire_zero=zero, range=range_si * per_si, rate_Hz=rate_Hz, burst_s=burst_s,
        noise=options.noise * ratio, resolution=options.resolution * ratio,
        offset=options.offset * ratio, drift_per_s=options.drift_per_s * ratio, hum=options.hum * ratio,
        crosstalk_per_A=options.crosstalk_per_A * ratio, clip=options.clip * ratio,
    )  # fmt: skip


def _table(given: str, whose: str) -> dict[str, Any]:
    """A format's table from JSON.

    Raises:
        FileProblem: it is none.
    """
    from rig.files.descriptions import entry_problems  # loads the validator, which the usual rig does not need

    try:
        table = json.loads(given)
    except ValueError as error:
        raise FileProblem(f"{whose} {given}", [f"cannot be read as JSON: {error}"]) from error
    if problems := entry_problems("sensor-format", table):
        raise FileProblem(f"{whose} {given}", [f"{'.'.join(map(str, place))}: {text}" for place, text in problems])
    return dict(table)


def _per_si(described: SensorFormat, *, stated: bool, half: float, options: SensorOptions) -> float:
    """Numbers on the wire for one SI unit."""
    range_si = options.range / options.wire_per_si
    unit = units.ALIASES.get(described.unit, described.unit)
    if stated and unit == BRIDGE:
        return RATED_mV_V / range_si
    known = units.UNITS.get(unit)
    own = units.UNITS[SI_UNITS[options.unit]]
    if stated and known is not None and known.dimension == own.dimension and known.scale * half >= 0.5 * range_si:
        return 1.0 / known.scale
    if half <= 0.0:
        return 0.0
    largest = min(half, FINEST) if half > 1.0 else half
    return float(10.0 ** math.floor(math.log10(largest / range_si)))
