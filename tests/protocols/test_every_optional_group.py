"""No accepted description carries what its decoder cannot: each optional part of each kind of format, left out.

A decoder answers with a reading, a flagged reading, or a damaged line (frame), whatever arrives; it never raises.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Iterator, Mapping
from functools import reduce
from operator import xor
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.sniffing import tried
from protocols.binary_decoder import BinaryDecoder
from protocols.binary_format import SIZES, BinaryFormat
from protocols.descriptions import DescriptionProblems
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from protocols.line_example import _letter
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import from_description, preset
from protocols.sensor_presets import TABLES

_parser: Any = importlib.import_module("re._parser")

MT_SICS = {
    "pattern": r"S (?:[SD] +(?P<value>-?\d+\.\d+) (?P<unit>g)|(?P<status>[+I-]))", "unit": "g",
    "status": {"+": "overload", "-": "overload", "I": "fault"}, "maximum_length": 24,
}
"""Mettler Toledo MT-SICS: `S S      100.00 g`, and `S +` at overload, without a number."""
NUMBER = r"[+-]?\d*\.?\d*"
LINES: Mapping[str, Mapping[str, Any]] = {
    **{name: {"base": name} for name in TABLES if isinstance(preset(name), LineFormat)},
    "mt-sics": MT_SICS,
    "value-only": {"pattern": r"(?P<value>\d+\.\d)?(?: N)?"},
    "no-number": {"pattern": rf"(?P<status>[A-Z]{{2}})?,(?P<value>{NUMBER})?,?(?P<unit>N)?",
                  "status": {"ST": "ok", "OL": "overload", "ER": "fault"}},
    "checksum": {"pattern": rf"(?P<sign>-)?(?P<value>{NUMBER})(?:\*(?P<checksum>[0-9A-F]{{2}}))?",
                 "sign": "separate", "checksum": "xor-hex", "checksum_to": "*"},
    "columns": {"columns": {"value": 2, "unit": 3, "status": 1}, "separator": ",", "units": {"kN": 1000.0},
                "status": {"OK": "ok", "OL": "overload"}},
}  # fmt: skip


def variants(tree: Any) -> list[str]:  # noqa: ANN401 - the parser's own tree
    """Texts of a pattern's tree: a basic one, and each with one optional part, branch or repeat done otherwise."""
    choices = [_choices(str(operation), argument) for operation, argument in tree]
    base = [one[0] for one in choices]
    found = ["".join(base)]
    for place, one in enumerate(choices):
        found += ["".join((*base[:place], other, *base[place + 1 :])) for other in one[1:]]
    return list(dict.fromkeys(found))


def _choices(kind: str, argument: Any) -> list[str]:  # noqa: ANN401 - as above
    if kind == "LITERAL":
        return [chr(argument)]
    if kind in {"NOT_LITERAL", "ANY", "IN"}:
        return [_letter(kind, argument)]
    if kind.endswith("REPEAT"):
        least, most, inner = argument
        counts = sorted({least, max(1, least), *range(least, min(int(most), 8) + 1)}, key=lambda count: count == 0)
        return [text * count for count in counts for text in variants(inner)]
    if kind == "SUBPATTERN":
        return variants(argument[3])
    if kind == "BRANCH":
        return [text for one in argument[1] for text in variants(one)]
    return variants(argument) if kind == "ATOMIC_GROUP" else [""]


def lines_of(made: LineFormat) -> list[str]:
    """Every variant of a format's lines that matches, also with the right checksum."""
    found = [text for text in variants(_parser.parse(made.pattern, re.ASCII)) if made.match(text)]
    if made.checksum == "xor-hex" and made.checksum_to:
        for text in list(found):
            covered, mark, _ = text[len(made.checksum_from) :].rpartition(made.checksum_to)
            total = f"{reduce(xor, covered.encode(), 0):02X}"
            found += [f"{made.checksum_from}{covered}{mark}{total}"] if mark else []
    return found


def taken(made: LineFormat, text: str) -> tuple[float, int] | None:
    """Value and status of one line; None for a damaged one. Whatever it is, the decoder counts it."""
    decoder = LineDecoder(made, answers=True)
    readings = decoder.feed(made.start + text.encode() + made.terminator)
    assert len(readings) + decoder.bad_frames == 1, text
    return (readings[0][2], readings[0][3]) if readings else None


def assert_carried(made: LineFormat, text: str) -> None:
    answer = taken(made, text)
    if answer is not None:
        value, status = answer
        assert math.isfinite(value) is (status == 0), (text, answer)


@pytest.mark.parametrize("name", LINES)
def test_each_optional_part_of_a_line_is_a_reading_or_a_damaged_line(name: str) -> None:
    made = from_description(LINES[name])
    assert isinstance(made, LineFormat)
    texts = lines_of(made)
    assert texts
    for text in texts:
        assert_carried(made, text)
    tried("".join(text + made.terminator.decode() for text in texts).encode(), name if name in TABLES else "hbm-aed")


@pytest.mark.parametrize(
    ("name", "text", "status"),
    [
        ("mt-sics", "S +", STATUS_OVERLOAD), ("mt-sics", "S -", STATUS_OVERLOAD),
        ("mt-sics", "S I", STATUS_SENSOR_FAULT), ("no-number", "OL,,", STATUS_OVERLOAD),
        ("no-number", "ER,", STATUS_SENSOR_FAULT), ("no-number", "OL,1.5,N", STATUS_OVERLOAD),
        ("columns", "OL,,", STATUS_OVERLOAD),
    ],
)  # fmt: skip
def test_a_status_of_overload_or_fault_needs_no_number(name: str, text: str, status: int) -> None:
    made = from_description(LINES[name])
    assert isinstance(made, LineFormat)
    answer = taken(made, text)
    assert answer is not None
    assert math.isnan(answer[0])
    assert answer[1] == status


def test_what_has_no_number_and_no_reason_is_a_damaged_line() -> None:
    damaged = {"value-only": "", "no-number": "ST,", "checksum": "12", "columns": "OK,,N"}
    for name, text in (("no-number", ",,"), *damaged.items()):
        made = from_description(LINES[name])
        assert isinstance(made, LineFormat)
        assert taken(made, text) is None, (name, text)
    blank = from_description({"pattern": r"(?P<value>[\d.]*)", "overload_tokens": [""]})
    assert isinstance(blank, LineFormat)
    assert taken(blank, "") is not None, "a user says what an empty line means"


PIECES = {
    "value": (r"(?P<value>\d+)", r"(?P<value>[ -~]{0,6})", r"(?P<value>[+-]?\d*\.?\d*)", r"(?:OL|(?P<value>-?\d+))"),
    "unit": (r"(?P<unit>[kN]*)",), "status": (r"(?P<status>[A-Z]*)",), "sign": (r"(?P<sign>[ +-]?)",),
    "checksum": (r"\*(?P<checksum>[0-9A-F]{2})", r"(?P<checksum>[0-9A-F]*)"),
}  # fmt: skip
KEYS: Mapping[str, Mapping[str, Any]] = {
    "unit": {"units": {"kN": 1000.0}}, "status": {"status": {"": "ok", "OL": "overload", "ER": "fault"}},
    "sign": {"sign": "separate"}, "checksum": {"checksum": "sum8-hex"}, "value": {},
}  # fmt: skip


@st.composite
def described(draw: st.DrawFn) -> dict[str, Any]:
    """A line format of which every part may be optional."""
    names = draw(st.permutations(["value", *draw(st.sets(st.sampled_from(["unit", "status", "sign", "checksum"])))]))
    table: dict[str, Any] = {}
    pattern = ""
    for name in names:
        piece = draw(st.sampled_from(PIECES[name]))
        pattern += draw(st.sampled_from([piece, f"(?:{piece})?", f"(?:{piece};)?", f"{piece},"]))
        table |= KEYS[name]
    number = draw(st.sampled_from(["decimal", "scientific", "hexadecimal", "hexadecimal-signed"]))
    tokens = draw(st.sampled_from([[], [""], ["OL"]]))
    return {**table, "pattern": pattern, "number": number, "overload_tokens": tokens}


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(table=described(), data=st.data())
def test_a_drawn_description_is_refused_or_carried(table: dict[str, Any], data: st.DataObject) -> None:
    try:
        made = from_description(table)
    except DescriptionProblems:
        return
    assert isinstance(made, LineFormat)
    texts = [*lines_of(made), data.draw(st.from_regex(re.compile(made.pattern, re.ASCII), fullmatch=True))]
    for text in texts:
        if len(text) <= made.maximum_length and made.terminator.decode() not in text:
            assert_carried(made, text)


def frames_of(made: BinaryFormat) -> Iterator[bytes]:
    """Frames of extreme contents, with what makes them whole."""
    contents = [bytes([fill] * made.length) for fill in (0, 1, 0x7F, 0x80, 0xFF)]
    contents += [bytes.fromhex(text) * made.length for text in ("0000c07f", "7fc00000", "0000807f", "ff800000")]
    for content in contents:
        frame = bytearray(content[: made.length])
        for at, (mask, fixed) in enumerate(made.marks):
            frame[at] = frame[at] & ~mask & 0xFF | fixed
        if not made.packed:
            frame[: len(made.sync)] = made.sync
            frame[made.length - len(made.end) :] = made.end
        yield bytes(frame)


@st.composite
def framed(draw: st.DrawFn) -> dict[str, Any]:
    """A binary format with any fields."""
    one = st.fixed_dictionaries(
        {"at": st.integers(1, 8), "type": st.sampled_from(sorted(SIZES))},
        optional={
            "signed": st.booleans(), "bits": st.sampled_from([[0, 3], [2, 7]]),
            "scale": st.sampled_from([1e-3, 1e9, 1e300]),
            "valid": st.just([-100, 100]), "overload_values": st.just([1]), "fault_values": st.just([0]),
            "overload_bits": st.just(1), "fault_bits": st.just(128),
        },
    )  # fmt: skip
    fields = {"value": draw(one)} | {
        name: draw(one) for name in draw(st.sets(st.sampled_from(["status", "sequence", "time"])))
    }
    return {"sync": [0xA5], "length": 17, "fields": fields}


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(table=framed(), noise=st.binary(max_size=40))
def test_a_drawn_frame_is_refused_or_carried(table: dict[str, Any], noise: bytes) -> None:
    try:
        made = from_description(table)
    except DescriptionProblems:
        return
    assert isinstance(made, BinaryFormat)
    assert_frames(made, noise)


@pytest.mark.parametrize("name", [name for name, table in TABLES.items() if "fields" in table or "packed" in table])
def test_each_shipped_frame_carries_any_content(name: str) -> None:
    made = preset(name)
    assert isinstance(made, BinaryFormat)
    assert_frames(made, bytes(range(256)))


def assert_frames(made: BinaryFormat, noise: bytes) -> None:
    decoder = BinaryDecoder(made, answers=True)
    for frame in frames_of(made):
        for number, clock, value, status, _ in decoder.feed(noise + frame):
            assert isinstance(value, float)
            assert number >= 0
            assert clock >= -1
            assert not (status and math.isfinite(value))
