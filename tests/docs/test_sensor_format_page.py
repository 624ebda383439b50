"""The formats that the how-to shows are formats, and read the bytes that it shows beside them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from drivers.sensor_formats import described_format
from protocols.binary_format import BinaryFormat
from protocols.line_format import LineFormat
from protocols.sensor_format import from_description
from rig.files.section import Section
from rig.files.sensor_format import CanFormatFile, FieldEntry, FrameFormatFile, LineFormatFile, ModbusFormatFile
from simulators.emulated_format import span_of, writer

PAGE = (Path(__file__).resolve().parents[2] / "docs/how-to/add-a-sensor-format.md").read_text(encoding="utf-8")
BLOCKS = [tomllib.loads(block) for block in re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)]
FORMATS = [block for block in BLOCKS if block.keys() & {"pattern", "columns", "packed", "sync", "id"}]
SHOWN = [b"ST,+001.250 kN", b"ST,+001,250 kN", b"17;-3.25;N", None, None, b"#07,+01234.5", None]
VALUES = [1.25, 1.25, -3.25, None, None, 1234.5, None]


def test_the_page_shows_so_many_formats() -> None:
    assert len(FORMATS) == len(SHOWN)


@pytest.mark.parametrize("number", range(len(SHOWN)))
def test_a_format_of_the_page_reads_what_the_page_shows(number: int) -> None:
    made = described_format(FORMATS[number])
    line = SHOWN[number]
    if line is None:
        assert isinstance(made, BinaryFormat)
    else:
        assert isinstance(made, LineFormat)
        assert made.decode(line) == (VALUES[number], 0)
    low, high = span_of(made)
    assert high > low
    writer(made, low, high)


def test_the_overload_of_the_page_is_one() -> None:
    made = from_description(FORMATS[0])
    assert isinstance(made, LineFormat)
    assert made.decode(b"ST,  OL    kN")[1] == 1


@pytest.mark.parametrize("model", [LineFormatFile, FrameFormatFile, ModbusFormatFile, CanFormatFile, FieldEntry])
def test_every_key_is_on_the_page(model: type[Section]) -> None:
    assert [key for key in model.model_fields if f"`{key}`" not in PAGE] == []
