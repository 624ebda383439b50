"""ASCII lines: every preset by hand-written bytes, user descriptions, splits, damage, fuzz."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from protocols.line_format import PRESETS, LineDecoder, LineFormat, from_description, preset

LINES = {
    "signed-decimal": [(b"+0001234.5 N", 1234.5, 0), (b"-0000000.5 N", -0.5, 0), (b"+00012.345", 12.345, 0)],
    "laumas-fast": [(b"001234", 1234.0, 0), (b"-01234", -1234.0, 0), (b"------", math.nan, STATUS_OVERLOAD)],
    # & and \ are not covered. T=54 P=50 and digits 001234 xor to 04: 54^04^50 = 00; -01234 to 29: 54^29^50 = 2D.
    "laumas-checksummed": [(b"&T001234P000000\\00", 1234.0, 0), (b"&T-01234P000000\\1d", -1234.0, 0)],
    "hbm-aed": [(b"+0012345", 12345.0, 0), (b"-0000001,31,000", -1.0, 0)],
    "flintec": [(b"G+01.100", 1.1, 0), (b"G-123.45", -123.45, 0)],
}
CASES = [(name, *line) for name, lines in LINES.items() for line in lines]
SIGNED = preset("signed-decimal")


@pytest.mark.parametrize(("name", "line", "value", "status"), CASES)
def test_preset_reads_the_manuals_line(name: str, line: bytes, value: float, status: int) -> None:
    got, got_status = preset(name).decode(line)
    assert got_status == status
    assert got == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize("name", PRESETS)
def test_preset_writes_what_it_reads(name: str) -> None:
    wire = preset(name).encode(12.0)
    assert wire.endswith(preset(name).terminator)
    assert preset(name).decode(wire.removesuffix(preset(name).terminator)) == (12.0, 0)


def test_the_broken_sensor_token_is_a_sensor_fault() -> None:
    value, status = preset("laumas-fast").decode(b"Er CEL")
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
        preset("laumas-fast").decode(b"ABCDEF")


def test_a_wrong_checksum_is_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="checksum 00"):
        preset("laumas-checksummed").decode(b"&T001234P000000\\01")


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
    assert len(decoder._buffer) < 128
    assert decoder.feed(b"\r\n+0000005.0 N\r\n")[-1][2] == 5.0
    assert decoder.bad_frames == (1 if start else 0)
    assert decoder.skipped_bytes == 10_000


def test_a_terminator_cut_by_the_length_limit_is_still_seen() -> None:
    decoder = LineDecoder(SIGNED)
    decoder.feed(b"\r\n" + b"x" * 70 + b"\r")
    assert decoder.feed(b"\n+0000005.0 N\r\n") == [(2, -1, 5.0, 0, 0)]


@given(st.binary(max_size=200), st.sampled_from(sorted(PRESETS)))
def test_any_bytes_never_crash_and_never_make_an_infinite_value(noise: bytes, name: str) -> None:
    decoder = LineDecoder(preset(name))
    for _, _, value, status, _ in decoder.feed(noise + preset(name).terminator + noise + preset(name).terminator):
        assert math.isfinite(value) or status


@given(st.text(alphabet="0123456789+-. NG&TP\\\r\n", max_size=120), st.sampled_from(sorted(PRESETS)))
def test_nearly_right_lines_never_crash(text: str, name: str) -> None:
    decoder = LineDecoder(preset(name))
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
    assert LineDecoder(described).feed(b";+01234mm;")[0][2] == pytest.approx(1.234)
    assert (described.start_command, described.terminator) == (b"GO\r", b";")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "'pattern' is missing"),
        ({"pattern": "(?P<value>x", "name": "q"}, "line format 'q': pattern"),
        ({"pattern": "x"}, r"needs a group \(\?P<value>"),
        ({"patterns": "x"}, "unknown key 'patterns'; known are name, pattern"),
        ({"pattern": 5}, "pattern = 5, expected text"),
        ({"pattern": "(?P<value>x)", "terminator": ""}, "terminator must not be empty"),
        ({"pattern": "(?P<value>x)", "terminator": "€"}, "expected ASCII text"),
        ({"pattern": "(?P<value>x)", "overload_tokens": "OVL"}, "expected a list of texts"),
        ({"pattern": "(?P<value>x)", "maximum_length": 1000}, "maximum_length must be 1..256"),
        ({"pattern": "(?P<value>x)", "decimals": 10}, "decimals must be 0..9"),
        ({"pattern": "(?P<value>x)", "decimals": True}, "decimals = True, expected a whole number"),
        ({"pattern": "(?P<value>x)", "nominal_rate_Hz": 0}, "must be a positive number"),
        ({"pattern": "(?P<value>x)", "nominal_rate_Hz": "fast"}, "expected a number"),
        ({"pattern": "(?P<value>x)", "checksum": "md5"}, "checksum must be one of none, xor-hex"),
        ({"pattern": "(?P<value>x)", "checksum": "xor-hex"}, "needs checksum_from and checksum_to"),
        (
            {"pattern": "(?P<value>x)", "checksum": "xor-hex", "checksum_from": "&", "checksum_to": "*"},
            r"needs a group \(\?P<checksum>",
        ),
    ],
)
def test_a_contradictory_description_is_refused_with_its_reason(table: dict[str, object], message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        from_description(table)


def test_an_unknown_preset_names_those_there_are() -> None:
    with pytest.raises(LocalProtocolError, match="no line format 'nope'; there are signed-decimal"):
        preset("nope")


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e9])
def test_a_value_the_line_cannot_carry_is_our_own_error(value: float) -> None:
    with pytest.raises(LocalProtocolError, match="signed-decimal"):
        SIGNED.encode(value)


def test_a_format_without_template_cannot_write() -> None:
    with pytest.raises(LocalProtocolError, match="no template"):
        LineFormat("free", r"(?P<value>\d+)").encode(1.0)


@pytest.mark.parametrize("template", ["{weight}", "{}", "{value:Q}", "{value"])
def test_a_template_that_asks_for_something_else_is_our_own_error(template: str) -> None:
    with pytest.raises(LocalProtocolError, match="template"):
        LineFormat("free", r"(?P<value>\d+)", template=template).encode(1.0)
