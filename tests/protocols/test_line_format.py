"""ASCII lines: every preset by hand-written bytes, user descriptions, splits, damage, fuzz."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.descriptions import DescriptionProblems
from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import from_description, preset
from protocols.sensor_presets import TABLES
from rig.files.descriptions import problems_of
from simulators.line_writer import LineWriter

PRESETS = [name for name in TABLES if isinstance(preset(name), LineFormat)]
LINES = {
    "signed-decimal": [(b"+0001234.5 N", 1234.5, 0), (b"-0000000.5 N", -0.5, 0), (b"+00012.345", 12.345, 0)],
    "laumas-fast": [(b"001234", 1234.0, 0), (b"-01234", -1234.0, 0), (b"------", math.nan, STATUS_OVERLOAD)],
    # & and \ are not covered. T=54 P=50 and digits 001234 xor to 04: 54^04^50 = 00; -01234 to 29: 54^29^50 = 2D.
    "laumas-checksummed": [(b"&T001234P000000\\00", 1234.0, 0), (b"&T-01234P000000\\1d", -1234.0, 0)],
    "hbm-aed": [(b"+0012345", 12345.0, 0), (b"-0000001,31,000", -1.0, 0)],
    "flintec": [(b"G+01.100", 1.1, 0), (b"G-123.45", -123.45, 0)],
}
CASES = [(name, *line) for name, lines in LINES.items() for line in lines]


def line_preset(name: str) -> LineFormat:
    shipped = preset(name)
    assert isinstance(shipped, LineFormat)
    return shipped


SIGNED = line_preset("signed-decimal")


@pytest.mark.parametrize(("name", "line", "value", "status"), CASES)
def test_preset_reads_the_manuals_line(name: str, line: bytes, value: float, status: int) -> None:
    got, got_status = line_preset(name).decode(line)
    assert got_status == status
    assert got == pytest.approx(value, nan_ok=True)


def test_the_broken_sensor_token_is_a_sensor_fault() -> None:
    value, status = line_preset("laumas-fast").decode(b"Er CEL")
    assert math.isnan(value)
    assert status == STATUS_SENSOR_FAULT


@pytest.mark.parametrize(
    "line",
    [b"", b"nan", b"+0001234,5 N", b"+0001234.5 kg", b"+000123.5 N", b"0001234.5 N", b"+0001234.5  N", b"+inf N",
     b"+00012345.5 N", "+000123٤.5 N".encode(), b"\xff\xfe", b"+0001.34.5 N", b"+0001234.5 N" + b" " * 64],
)
def test_a_line_that_is_not_quite_right_is_refused(line: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        SIGNED.decode(line)


def test_an_unknown_text_in_place_of_the_number_is_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="'ABCDEF' is not a plain decimal number"):
        line_preset("laumas-fast").decode(b"ABCDEF")


def test_a_wrong_checksum_is_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="checksum 00"):
        line_preset("laumas-checksummed").decode(b"&T001234P000000\\01")


STREAM = b"4.5 N\r\n+0000001.0 N\r\n+0000002.0 N\r\ngarbage\r\n-0000003.0 N\r\n"
READINGS = [(1, -1, 1.0, 0, 0), (2, -1, 2.0, 0, 0), (4, -1, -3.0, 0, 0)]


@pytest.mark.parametrize("at", range(len(STREAM) + 1))
def test_every_split_point_gives_the_same_readings(at: int) -> None:
    decoder = LineDecoder(SIGNED)
    assert decoder.feed(STREAM[:at]) + decoder.feed(STREAM[at:]) == READINGS
    assert decoder.bad_frames == 1
    assert decoder.skipped_bytes == len("4.5 N" + "garbage")


def test_byte_by_byte_gives_the_same_readings() -> None:
    decoder = LineDecoder(SIGNED)
    assert [reading for byte in STREAM for reading in decoder.feed(bytes([byte]))] == READINGS


def test_the_first_line_is_dropped_because_its_beginning_may_be_missing() -> None:
    free = LineFormat("free", r"(?P<value>[\d.]+)")
    assert LineDecoder(free).feed(b"34.5\r\n1234.5\r\n") == [(1, -1, 1234.5, 0, 0)]


def test_after_clear_the_first_line_is_dropped_again() -> None:
    decoder = LineDecoder(SIGNED)
    decoder.feed(STREAM + b"+00")
    decoder.clear()
    assert decoder.feed(b"00009.0 N\r\n+0000005.0 N\r\n") == [(5, -1, 5.0, 0, 0)]


@pytest.mark.parametrize("start", [b"", b"\r\n"])
def test_a_stream_without_terminators_keeps_no_memory_and_is_found_again(start: bytes) -> None:
    decoder = LineDecoder(SIGNED)
    decoder.feed(start)
    for _ in range(100):
        assert decoder.feed(b"x" * 100) == []
    assert len(decoder._rest) < 128
    assert decoder.feed(b"\r\n+0000005.0 N\r\n")[-1][2] == 5.0
    assert decoder.bad_frames == (1 if start else 0)
    assert decoder.skipped_bytes == 10_000


def test_a_terminator_cut_by_the_length_limit_is_still_seen() -> None:
    decoder = LineDecoder(SIGNED)
    decoder.feed(b"\r\n" + b"x" * 70 + b"\r")
    assert decoder.feed(b"\n+0000005.0 N\r\n") == [(2, -1, 5.0, 0, 0)]


@given(st.binary(max_size=200), st.sampled_from(sorted(PRESETS)))
def test_any_bytes_never_crash_and_never_make_an_infinite_value(noise: bytes, name: str) -> None:
    decoder, end = LineDecoder(line_preset(name)), line_preset(name).terminator
    for _, _, value, status, _ in decoder.feed(noise + end + noise + end):
        assert math.isfinite(value) or status


@given(st.text(alphabet="0123456789+-. NG&TP\\\r\n", max_size=120), st.sampled_from(sorted(PRESETS)))
def test_nearly_right_lines_never_crash(text: str, name: str) -> None:
    decoder = LineDecoder(line_preset(name))
    for _, _, value, status, _ in decoder.feed(text.encode()):
        assert math.isfinite(value) or status


@pytest.mark.parametrize("lost", range(len(b"+0001234.5 N\r\n")))
def test_a_lost_byte_never_makes_another_value(lost: int) -> None:
    line = b"+0001234.5 N\r\n"
    wire = line + line[:lost] + line[lost + 1 :] + line + line
    values = [reading[2] for reading in LineDecoder(SIGNED).feed(wire)]
    assert set(values) == {1234.5}
    assert len(values) >= 1


def test_a_described_format_reads_its_lines() -> None:
    described = from_description({
        "name": "mine", "pattern": r"(?P<value>[+-]\d{5})(?P<unit>mm)", "terminator": ";", "decimals": 3, "unit": "mm",
        "overload_tokens": ["OVL"], "nominal_rate_Hz": 50, "maximum_length": 16, "start_command": "GO\r",
    })
    assert isinstance(described, LineFormat)
    assert LineDecoder(described).feed(b";+01234mm;")[0][2] == pytest.approx(1.234)
    assert (described.exchange.start_command, described.terminator) == (b"GO\r", b";")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "'pattern' is missing"),
        ({"pattern": "(?P<value>x", "name": "q"}, "sensor format 'q': pattern"),
        ({"pattern": "x"}, r"requires a group \(\?P<value>"),
        ({"pattern": "(?P<value>x)", "terminator": ""}, "terminator must not be empty"),
        ({"pattern": "(?P<value>x)", "checksum": "xor-hex"}, r"requires a group \(\?P<checksum>"),
        ({"pattern": "(?P<value>x)"}, "can never match: no decimal number fits"),
        ({"pattern": r"(?P<value>[+-]\d{5})(?P<unit>kg)"}, "no decimal number with the unit 'N'"),
        ({"pattern": r"(?P<value>[+-]\d{5})", "maximum_length": 5}, "can never match: the pattern's shortest line"),
        ({"pattern": r"(?P<value>[+-]\d{5})", "length": 7}, "can never match: the pattern's longest line has 6"),
        ({"pattern": r"(?P<value>[+-]\d{5})\r\n"}, "contains the terminator"),
        ({"pattern": r"(?P<value>[+-]\d{5})", "scale": 0}, "must not be 0"),
        ({"pattern": r"(?P<value>\d{5})(?P<sign>.)"}, 'which requires sign = "separate"'),
        ({"columns": {"value": [3, 8], "unit": [7, 9]}}, "columns.unit: overlaps"),
        ({"columns": {"value": 2}}, r"must be \[first, last\]"),
        ({"columns": {"value": [1, 3]}, "pattern": "(?P<value>...)"}, "cannot be combined with a pattern"),
        ({"pattern": r"(?P<value>\d+)", "request": "{address}?\r"}, "requires address"),
        ({"pattern": r"(?P<value>\d+)", "answer_timeout_ms": 20}, "requires a request"),
        ({"base": "laumas-slow"}, "unknown format 'laumas-slow'; known: signed-decimal"),
    ],
)
def test_a_contradictory_description_is_refused_with_its_reason(table: dict[str, object], message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        from_description(table)


@pytest.mark.parametrize("pattern", [
    r"(?P<value>(\d+)+(,\d+)?)", r"@(?P<value>(\d+\.?)+)N", r"(\w+ ?)*(?P<value>\d\.\d)", r"(?P<value>(\d\d*)+)N",
])
def test_a_damaged_line_is_decoded_in_time_linear_in_its_length(pattern: str) -> None:
    """A backtracking engine needs 2^40 steps for these."""
    made = from_description({"pattern": pattern, "decimal_mark": "."})
    with pytest.raises(RemoteProtocolError):
        made.decode(b"@" + b"1" * 40 + b"!")


@pytest.mark.parametrize("pattern", [r"(?=\d)(?P<value>\d+)", r"(?P<unit>N)(?P<value>\d+)\1", r"(?P<value>\d+)\x00"])
def test_a_pattern_that_no_linear_engine_matches_or_no_line_holds_is_refused(pattern: str) -> None:
    with pytest.raises(DescriptionProblems) as refused:
        from_description({"pattern": pattern, "unit": "N"})
    assert [place for place, _ in refused.value.problems] == [("pattern",)]


@pytest.mark.parametrize("template", [
    "{value:2000000000.1f}", "{value:>{unit}}", "{value.real}", "{value!r}", "{value:.999999999f}", "{other}", "{value",
])
def test_a_template_writes_short_numbers_only(template: str) -> None:
    with pytest.raises(DescriptionProblems) as refused:
        from_description({"pattern": r"(?P<value>[-+]?\d+\.\d) N", "unit": "N", "template": template})
    assert [place for place, _ in refused.value.problems] == [("template",)]


# Lines as a person writes them beside a description; the values follow from the description's words, not from our code.
DESCRIBED = [
    ({"columns": {"status": [1, 2], "value": [4, 12], "unit": [14, 15]}, "unit": "kg", "decimal_mark": ",",
      "status": {"ST": "ok", "US": "ok", "OL": "overload"}},
     [(b"ST,+00012,50 kg", 12.5, 0), (b"US,-    1,25 kg", -1.25, 0), (b"OL,+99999,99 kg", math.nan, STATUS_OVERLOAD)],
     [b"XX,+00012,50 kg", b"ST,+00012,50 lb", b"ST,+00012.50 kg", b"ST,+00012,50 k"]),
    ({"columns": {"status": [1, 2], "value": [3, 8]}, "status": {" ": "ok", "! ": "overload"}},
     [(b"  -12.50", -12.5, 0), (b" !+99.99", math.nan, STATUS_OVERLOAD)], [b"? +12.50"]),
    ({"pattern": "(?P<value>.{5})", "overload_tokens": [" OL "]}, [(b"  OL ", math.nan, STATUS_OVERLOAD)], [b" OK  "]),
    ({"separator": ";", "columns": {"value": 2, "unit": 3}, "unit": "N", "units": {"kN": 1000.0}},
     [(b"17;-3.25;N", -3.25, 0), (b"18;4.5;kN;x", 4500.0, 0)], [b"19;4.5;lbf", b"20", b"21;;N"]),
    ({"pattern": r"(?P<value>\d{3}\.\d[+-])", "sign": "trailing"}, [(b"012.5-", -12.5, 0), (b"012.5+", 12.5, 0)],
     [b"-12.5-", b"+12.5", b"012.5"]),
    ({"pattern": r"(?P<sign>[ V])(?P<value>\d{6})", "sign": "separate", "negative_tokens": ["V"], "decimals": 2},
     [(b"V000125", -1.25, 0), (b" 000125", 1.25, 0)], [b"+000125"]),
    ({"pattern": r"(?P<value>[0-9A-F]{6})", "number": "hexadecimal-signed", "scale": 0.5},
     [(b"FFFFFE", -1.0, 0), (b"000010", 8.0, 0), (b"800000", -4194304.0, 0)], [b"00001G"]),
    ({"pattern": r"(?P<value>[-+.\dE]+)", "number": "scientific", "scale": 2.0, "offset": 1.0},
     [(b"+1.5E+02", 301.0, 0), (b"-5", -9.0, 0)], [b"1E", b"E5", b"1.5E+9999"]),
    # 31 + 32 + 33 = 96 hex; its two's complement is 6A.
    ({"pattern": r"(?P<value>\d{3})\*(?P<checksum>[0-9A-F]{2})", "checksum": "sum8-negated-hex",
      "checksum_over": [1, 3]},
     [(b"123*6A", 123.0, 0)], [b"123*6B", b"124*6A"]),
    # CRC-16/MODBUS of the nine characters 123456789 is 4B37 (the catalogue's check value).
    ({"pattern": r"(?P<value>\d{9})(?P<checksum>[0-9A-F]{4})", "checksum": "crc16-modbus-hex"},
     [(b"1234567894B37", 123456789.0, 0)], [b"1234567894B38"]),
]  # fmt: skip


@pytest.mark.parametrize(("table", "good", "bad"), DESCRIBED)
def test_a_described_line_means_what_its_description_says(
    table: dict[str, object], good: list[tuple[bytes, float, int]], bad: list[bytes]
) -> None:
    described = from_description(table)
    assert isinstance(described, LineFormat)
    for line, value, status in good:
        assert described.decode(line) == (pytest.approx(value, nan_ok=True), status)
    for line in bad:
        with pytest.raises(RemoteProtocolError):
            described.decode(line)


FRAMED = {"start": "\x02", "terminator": "\x03", "columns": {"value": [1, 6]}, "decimals": 1}


@pytest.mark.parametrize("at", range(24))
def test_lines_that_begin_with_a_byte_are_found_from_any_point(at: int) -> None:
    described = from_description(FRAMED)
    assert isinstance(described, LineFormat)
    decoder = LineDecoder(described)
    stream = b"012\x03\x02+00125\x03xx\x02-00250\x03"
    assert [r[2] for part in (stream[:at], stream[at:]) for r in decoder.feed(part)] == [12.5, -25.0]
    assert decoder.skipped_bytes == len("012") + len("xx")


def test_a_base_s_entries_hold_where_the_table_has_none() -> None:
    described = from_description({"base": "laumas-fast", "decimals": 2, "unit": "kg"})
    assert isinstance(described, LineFormat)
    assert described.decode(b"-01234") == (-12.34, 0)
    assert described.decode(b"------")[1] == STATUS_OVERLOAD


def test_an_unknown_preset_names_those_there_are() -> None:
    with pytest.raises(LocalProtocolError, match="unknown line format 'nope'; known: signed-decimal"):
        preset("nope")


@pytest.mark.parametrize(
    ("table", "line", "value"),
    [
        ({"pattern": r"(?P<value>[+-]\d+\.\d) (?P<unit>µm)", "unit": "µm", "encoding": "latin-1"}, b"+2.5 \xb5m", 2.5),
        ({"pattern": r"(?P<value>\d+)(?P<unit>°C)", "unit": "°C", "encoding": "cp437"}, b"25\xf8C", 25.0),
        ({"pattern": r"(?P<value>[+-]\d{5}),(?P<decimals>\d)"}, b"-01234,3", -1.234),
        ({"columns": {"value": [1, 6], "decimals": [8, 8]}, "decimals": 2}, b"+01250 0", 1250.0),
        ({"columns": {"value": [1, 4], "unit": [5, 6]}, "unit": "µm", "encoding": "latin-1"}, b" 1.5\xb5m", 1.5),
    ],
)
def test_high_bytes_and_decimal_places_that_the_line_states(
    table: dict[str, object], line: bytes, value: float
) -> None:
    assert problems_of("sensor-format", table) == []
    made = from_description(table)
    assert isinstance(made, LineFormat)
    assert made.decode(line) == (pytest.approx(value), 0)
    written = LineWriter(made, 0.0, 90.0)
    row = written.joined(written(np.array([40.0]), np.array([0], np.uint8)))
    assert LineDecoder(made, answers=True).feed(row)[0][2] == pytest.approx(40.0, abs=0.5)


def test_a_sign_beyond_the_encoding_and_places_beyond_nine_are_refused() -> None:
    found = problems_of("sensor-format", {"pattern": r"(?P<value>\d+)(?P<unit>µm)", "unit": "µm"})
    assert [place for place, _ in found] == [("unit",)]
    assert "latin-1" in found[0][1]
    made = from_description({"pattern": r"(?P<value>\d+),(?P<decimals>.*)"})
    assert isinstance(made, LineFormat)
    for line in (b"12,x", b"12,", b"12,10", b"12,-1"):
        with pytest.raises(RemoteProtocolError, match="0 to 9 decimal places"):
            made.decode(line)
