"""What is wrong with a sensor's format: one entry after the other, with its place and what would be right."""

from __future__ import annotations

import math
from typing import Any

import pytest

from protocols.sensor_format import from_description
from rig.cli.schema import SCHEMAS
from rig.files.descriptions import problems_of

LINE: dict[str, Any] = {"pattern": r"(?P<value>[+-]\d{5})"}
COLUMNS: dict[str, Any] = {"columns": {"value": [1, 6]}}
FRAME: dict[str, Any] = {"sync": [0xAA], "length": 6, "fields": {"value": {"at": 1, "type": "i16"}}}
PACKED: dict[str, Any] = {"packed": ["1vvvvvvv", "0vvvvvvv"], "fields": {"value": {}}}


def value(**more: object) -> dict[str, Any]:
    return FRAME | {"fields": {"value": {"at": 1, "type": "i16"} | more}}


def status(**more: object) -> dict[str, Any]:
    return FRAME | {"fields": FRAME["fields"] | {"status": {"at": 4, "type": "u8"} | more}}


@pytest.mark.parametrize("table", [LINE, COLUMNS, FRAME, PACKED, status(fault_bits=1)])
def test_these_are_right_before_one_thing_is_changed(table: dict[str, Any]) -> None:
    assert from_description(table)


@pytest.mark.parametrize(
    ("table", "place", "says"),
    [
        (LINE | COLUMNS, "columns", "cannot be combined with a pattern"),
        (LINE | {"separator": ";"}, "separator", "requires columns"),
        ({"terminator": "\n"}, "", "key 'pattern' is missing"),
        ({"pattern": "(?P<value>"}, "pattern", "missing )"),
        ({"pattern": "abc"}, "pattern", "requires a group (?P<value>...)"),
        ({"columns": {"force": [1, 2], "value": [3, 4]}}, "columns.force", "unknown column"),
        ({"columns": {"value": 2}}, "columns.value", "must be [first, last] character"),
        ({"columns": {"value": [1, 2]}, "separator": ";"}, "columns.value", "the column number"),
        ({"columns": {"unit": [1, 2]}}, "columns", "requires a column for the value"),
        ({"columns": {"value": 1}, "separator": ";;"}, "separator", "must be one ASCII character"),
        ({"columns": {"value": [1, 6], "unit": [6, 8]}}, "columns.unit", "overlaps the previous column"),
        (COLUMNS | {"length": 4}, "length", "is shorter than the columns, which end at character 6"),
        ({"columns": {"value": 2, "unit": 2}, "separator": ";"}, "columns", "two entries refer to the same column"),
        (LINE | {"terminator": ""}, "terminator", "must not be empty"),
        (LINE | {"scale": 0.0}, "scale", "must not be 0"),
        (LINE | {"maximum_length": 5}, "maximum_length", "shortest line has 6 characters"),
        (LINE | {"length": 7}, "length", "longest line has 6 characters"),
        (LINE | {"decimal_mark": ";"}, "decimal_mark", "must be '.' or ','"),
        (LINE | {"sign": "separate"}, "sign", "requires a group (?P<sign>...)"),
        (COLUMNS | {"status": {"S": "ok"}}, "status", "requires a column status"),
        (LINE | {"units": {"kN": 1000.0}}, "units", "requires a group (?P<unit>...)"),
        (LINE | {"checksum_from": "@"}, "checksum_from", "no checksum is specified"),
        ({"pattern": r"(?P<value>[+-]\d{5})(?P<checksum>[0-9A-F]{2})", "checksum": "xor-hex", "checksum_over": [1, 9]},
         "checksum_over", "the longest line has 8 characters"),
        ({"pattern": r"@(?P<value>[+-]\d{5})(?P<checksum>[0-9A-F]{2})", "checksum": "xor-hex", "checksum_over": [1, 6],
          "checksum_from": "@"}, "checksum_over", "use either checksum_over or the other entries"),
        ({"pattern": r"(?P<sign>[ -])(?P<value>\d{5})", "sign": "separate", "negative_tokens": []}, "negative_tokens",
         "must not be empty"),
        (LINE | {"base": "laumas"}, "base", "unknown format 'laumas'; known:"),
        (LINE | {"template": "{force}"}, "template", "allowed: {value}, {unit} and {checksum}"),
        ({"pattern": r"(?P<value>[a-z]+)"}, "pattern", "can never match"),
        (LINE | {"request": ""}, "request", "must not be empty"),
        (LINE | {"request": "?{address}"}, "request", 'requires address = "..."'),
        (LINE | {"address": "07"}, "address", "is not used"),
        (LINE | {"answer_timeout_ms": 30}, "answer_timeout_ms", "requires a request"),
        ({"sync": [0xAA], "length": 6, "fields": {"time": {"at": 1, "type": "u16"}}}, "fields", "field for the "
            "value is missing"),
        ({"sync": [0xAA], "fields": FRAME["fields"]}, "", "key 'length' is missing"),
        ({"length": 6, "fields": FRAME["fields"]}, "", "sync bytes or a checksum are required"),
        (FRAME | {"checksum": "xor", "checksum_at": 9}, "checksum_at", "lies outside the frame of 6 bytes"),
        (FRAME | {"checksum": "xor", "checksum_over": [0, 9]}, "checksum_over", "lies outside the frame of 6 bytes"),
        (FRAME | {"checksum": "xor", "checksum_over": [0, 5]}, "checksum_over", "covers the checksum itself"),
        (FRAME | {"sync": [1, 2, 3], "end": [4, 5, 6]}, "length", "leaves no room for a value"),
        (FRAME | {"fields": {"value": {"at": 1}}}, "fields.value", "requires the entries at (the first byte"),
        (value(at=5), "fields.value.at", "extends beyond the frame of 6 bytes"),
        (value(at=0), "fields.value.at", "byte 0 already belongs to sync"),
        (FRAME | {"stuffing": "escape"}, "stuffing", "escape requires exactly one sync byte and one end byte"),
        (FRAME | {"stuffing": "dle"}, "stuffing", "dle requires sync = [0x10, ...]"),
        (FRAME | {"stuffing": "slip"}, "stuffing", "slip requires end = [0xC0]"),
        (FRAME | {"stuffing": "escape", "end": [0x10]}, "escape", "must not occur in sync or end"),
        (FRAME | {"escape": 0x7D}, "escape", 'requires stuffing = "escape"'),
        (PACKED | {"sync": [1]}, "sync", "cannot be combined with packed"),
        (PACKED | {"packed": ["1vvv", "0vvvvvvv"]}, "packed.0", "expected eight characters from 0, 1, x"),
        (PACKED | {"packed": ["1vvvvvvv", "1vvvvvvv"]}, "packed", "fixed bits also match a frame shifted by 1 byte"),
        (PACKED | {"packed": ["1vvvvvvv"]}, "packed", "requires at least two bytes"),
        (PACKED | {"packed": ["1vvvvvvs", "0vvvvvvv"]}, "fields", "packed has bits marked s, which require a table "
            "[fields.status]"),
        (PACKED | {"fields": {"value": {}, "sequence": {}}}, "fields.sequence", "packed has no bits marked n"),
        (PACKED | {"fields": {"value": {"at": 0}}}, "fields.value.at", "which already defines the bits"),
        (status(type="f32", at=2), "fields.status.type", "must be a whole number"),
        (value(type="f32", bits=[0, 3]), "fields.value.bits", "only for whole numbers"),
        (value(bits=[0, 16]), "fields.value.bits", "extends beyond the 16 bits of i16"),
        (value(scale=0.0), "fields.value.scale", "must not be 0"),
        (status(), "fields.status", "has no entries"),
        (value(fault_values=[40_000]), "fields.value.fault_values", "range of the field, -32768 to 32767"),
        (value(valid=[40_000, 50_000]), "fields.value.valid", "range of the field is -32768 to 32767"),
        (status(fault_bits=0x100), "fields.status.fault_bits", "bits outside the field, 0xff"),
        (FRAME | {"sync": "\\x02"}, "sync", "a backslash is taken literally in single quotes"),
        (FRAME | {"sync": "µ"}, "sync", "expected ASCII text"),
        (FRAME | {"sync": [300]}, "sync", "bytes from 0 to 0xFF"),
        ({"patterns": "x"}, "patterns", "did you mean pattern?"),
        (LINE | {"overload_tokens": "OVL"}, "overload_tokens", "must be a list in [ ]"),
        (LINE | {"decimals": 10}, "decimals", "allowed: 0 to 9"),
        (LINE | {"checksum": "xor-hexx"}, "checksum", "did you mean xor-hex?"),
        (LINE | {"scale": math.nan}, "scale", "must be a finite number"),
        (LINE | {"base": ["x"]}, "base", "must be a string in quotes"),
        (LINE | {"scale": True}, "scale", "must be a number"),
        (FRAME | {"length": 6.5}, "length", "must be a whole number (allowed: 1 to 256)"),
        (value(signed=1), "fields.value.signed", "must be true or false"),
        (value(valid=[3]), "fields.value.valid.1", "missing"),
        (value(bits=[3, 1]), "fields.value.bits", "the first no greater than the last"),
        (value(fault_values=7), "fields.value.fault_values", "must be a list in [ ]"),
        (LINE | {"units": {}}, "units", "is empty"),
        (LINE | {"units": {"kN": "x"}}, "units.kN", "must be a number"),
    ],
)
def test_one_thing_that_is_wrong_is_reported_at_its_place(table: dict[str, Any], place: str, says: str) -> None:
    problems = [(".".join(map(str, where)), text) for where, text in problems_of("sensor-format", table)]
    assert any(where == place and says in text for where, text in problems), problems


def test_the_schema_has_both_kinds_and_every_field() -> None:
    schema = SCHEMAS["sensor-format"]()["$defs"]
    lines, frames = schema["LineFormatFile"], schema["FrameFormatFile"]
    assert {"pattern", "decimal_mark", "checksum_over"} <= lines["properties"].keys()
    assert frames["properties"]["fields"]["$ref"].endswith("Fields")
    assert schema["Fields"]["properties"].keys() == {"value", "status", "sequence", "time", "decimals"}
    assert lines["properties"]["decimal_mark"]["enum"] == [".", ","]
