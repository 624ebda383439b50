"""Lines and frames that a simulated sensor writes are readings of the host's own decoder."""

from __future__ import annotations

import math

import numpy as np
import pytest

from protocols.binary_decoder import BinaryDecoder
from protocols.errors import LocalProtocolError
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT, Reading
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import SensorFormat, from_description, preset
from protocols.sensor_presets import TABLES
from simulators.bit_sums import total_of
from simulators.clock import DeviceClock
from simulators.emulated_format import span_of, writer
from simulators.options import SensorOptions
from simulators.sensor import Sensor

CUSTOM = {"pattern": r"P(?P<value>[+-]\d{4}\.\d)", "template": "P{value:+07.1f}", "overload_tokens": ["+9999.9"]}
DESCRIBED: list[dict[str, object]] = [
    {"pattern": r"ST,(?P<value>[+-]\d{3}\.\d{3}|  OL   ) (?P<unit>kN)", "unit": "kN", "overload_tokens": ["OL"]},
    {"columns": {"status": [1, 2], "value": [4, 12], "unit": [14, 15]}, "status": {"ST": "ok", "OL": "overload"}},
    {"separator": ";", "columns": {"value": 2, "unit": 3}},
    {"pattern": r"(?P<value>\d{3},\d[+-])", "sign": "trailing", "decimal_mark": ","},
    {"pattern": r"(?P<sign>[ V])(?P<value>\d{6})", "sign": "separate", "negative_tokens": ["V"], "decimals": 2},
    {"pattern": r"(?P<value>[0-9A-F]{6})", "number": "hexadecimal-signed", "scale": 0.5},
    {"pattern": r"(?P<value>-?(?:0|[1-9]\d*)\.\d\d)"},
    {"start": "\x02", "terminator": "\x03", "pattern": r"(?P<value>[+-]\d{4}\.\d)(?P<checksum>[0-9A-F]{4})",
     "checksum": "crc16-modbus-hex"},
    {"sync": [0xAA, 0x55], "length": 12, "order": "big", "checksum": "crc16-x25", "fields": {
        "value": {"at": 2, "type": "i24", "scale": 0.01}, "sequence": {"at": 5, "type": "u8"},
        "time": {"at": 6, "type": "u16", "scale": 100.0},
        "status": {"at": 8, "type": "u8", "overload_bits": 4, "fault_bits": 2}}},
    {"sync": [2], "end": [3], "stuffing": "escape", "length": 8, "checksum": "sum8-bit7", "order": "big",
     "fields": {"value": {"at": 3, "type": "i24"}, "status": {"at": 1, "type": "u16", "overload_bits": 8}}},
    {"sync": [0x10, 2], "end": [0x10, 3], "stuffing": "dle", "length": 9, "checksum": "xor",
     "fields": {"value": {"at": 2, "type": "f32"}}},
    {"end": [0xC0], "stuffing": "slip", "length": 7, "checksum": "crc16-kermit",
     "fields": {"value": {"at": 0, "type": "i32"}}},
    {"packed": ["00vvvvvv", "01vvvvvv", "10nnvvvv"], "order": "little",
     "fields": {"value": {"signed": True}, "sequence": {}}},
]  # fmt: skip


def heard(layout: SensorFormat, data: bytes) -> tuple[list[Reading], int]:
    """Readings of a stream, and how many lines or frames were damaged."""
    decoder = LineDecoder(layout) if isinstance(layout, LineFormat) else BinaryDecoder(layout)
    return decoder.feed(data), decoder.bad_frames


@pytest.mark.parametrize("table", [*({"base": name} for name in TABLES), *DESCRIBED])
def test_a_sensor_of_any_format_is_heard(table: dict[str, object]) -> None:
    layout = from_description(table)
    low, high = span_of(layout)
    zero = 0.0 if low < 0.0 else 0.5 * (low + high)
    options = SensorOptions(
        rate_Hz=100.0, format=layout, range=min(90.0, high - zero), wire_zero=zero, noise=0.0, resolution=0.0,
        jitter_s=0.0,
    )  # fmt: skip
    sensor = Sensor(options, DeviceClock(0.0, 0.0), np.random.default_rng(1), 0.0)
    data, level = b"", min(42.0, options.range)
    for step in range(60):
        if sensor.requests is not None:
            sensor.requests.append(math.nan)
        data += sensor.sample(np.full(80, level), 0.01 * step, 1.25e-4, [])
    readings, damaged = heard(layout, data)
    assert len(readings) > 50
    assert damaged == 0
    # A stream of an even count of numbers has its middle between two of them.
    within = 0.51 if zero else 1e-4
    assert [value - zero for _, _, value, _, _ in readings] == pytest.approx([level] * len(readings), abs=within)


@pytest.mark.parametrize("table", DESCRIBED)
@pytest.mark.parametrize("value", [-77.0, -1.0, 0.0, 2.0, 16.0])
def test_numbers_of_either_sign_come_back(table: dict[str, object], value: float) -> None:
    layout = from_description(table)
    write = writer(layout, -90.0, 90.0)
    none = np.zeros(3, np.int64)
    data = write.joined(write(np.full(3, value), none.astype(np.uint8), np.arange(3), none))
    assert [reading[2] for reading in heard(layout, data)[0]][-1] == pytest.approx(value)


def test_an_overload_and_a_fault_are_written_in_the_device_s_words() -> None:
    for table in (CUSTOM, DESCRIBED[0], DESCRIBED[8]):
        layout = from_description(table)
        write = writer(layout, -500.0, 500.0)
        status = np.array([0, STATUS_OVERLOAD, 0, STATUS_SENSOR_FAULT, 0], np.uint8)
        count = np.arange(5)
        data = write.joined(write(np.array([1.5, 500.0, -3.25, 1.0, 2.0]), status, count, count))
        got = [status for _, _, _, status, _ in heard(layout, b"\r\n" + data)[0]]
        fault = STATUS_SENSOR_FAULT if table is DESCRIBED[8] else STATUS_OVERLOAD
        assert got == [0, STATUS_OVERLOAD, 0, fault, 0]


def test_what_a_format_has_no_word_for_is_no_reading() -> None:
    layout = preset("flintec")
    write = writer(layout, -90.0, 90.0)
    lines = write(np.array([math.nan, 1.0]), np.array([STATUS_OVERLOAD, 0], np.uint8), np.arange(2), np.arange(2))
    readings, damaged = heard(layout, b"x\r\n" + lines.tobytes())
    assert (len(readings), damaged) == (1, 1)


def test_checksums_are_the_catalogue_s_check_values() -> None:
    values = {
        "crc8": 0xF4, "crc16-modbus": 0x4B37, "crc16-arc": 0xBB3D, "crc16-ccitt-false": 0x29B1, "crc16-xmodem": 0x31C3,
        "crc16-kermit": 0x2189, "crc16-x25": 0x906E, "crc32": 0xCBF43926,
    }  # fmt: skip
    assert {kind: total_of(kind, b"123456789") for kind in values} == values


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"template": "P{weight}"}, "template"),
        ({"pattern": r"P(?P<value>[+-]\d{4}\.\d\d)"}, "does not match the pattern"),
        ({"template": "", "pattern": r"P(?P<value>[+-]\d\.\d)"}, "-500 to 500 N do not fit"),
    ],
)
def test_a_format_that_nobody_can_write_is_refused(changes: dict[str, object], says: str) -> None:
    with pytest.raises(LocalProtocolError, match=says):
        writer(from_description({**CUSTOM, **changes}), -500.0, 500.0)
