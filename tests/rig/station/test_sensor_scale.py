"""What a sensor sends becomes SI as its bench file says, and as its point's file says in `from_wire`."""

from __future__ import annotations

from dataclasses import replace

import pytest
from station_bench import config_for

from drivers.ring import Channel
from drivers.sample_stream import SampleStream
from protocols.frame_format import FrameDecoder, encode
from rig.bench.sensor_settings import Calibration, LoadCell
from rig.recording.conversion.conversion import wire_attributes
from rig.recording.layout import SensorContext
from rig.station.threads.devices import scale_of

NOW = 10**12


def load_cell(polarity: str) -> LoadCell:
    """A load cell that shows 40 N unloaded, at 2 N a count."""
    calibration = Calibration(serial_number="LC-1", sensitivity=2.0, polarity=polarity, offset="40 N")  # type: ignore[arg-type]  # by parameter
    return replace(config_for().load_cell, calibration=calibration)


@pytest.mark.parametrize(("polarity", "sign"), [("normal", 1.0), ("reversed", -1.0)])
def test_bytes_of_a_sensor_with_an_offset_become_si(polarity: str, sign: float) -> None:
    given, counts = load_cell(polarity), (20.0, 70.0, -30.0)
    stream = SampleStream(FrameDecoder(), Channel.FORCE, scale_of(given, 1.0))
    batch = stream.take(b"".join(encode(count, k, 4000 * k) for k, count in enumerate(counts)), NOW)
    assert [record[2] for record in batch.records] == [0.0, sign * 100.0, sign * -100.0]


@pytest.mark.parametrize("polarity", ["normal", "reversed"])
def test_what_stands_beside_the_recorded_value_leads_back_to_the_wire(polarity: str) -> None:
    given = load_cell(polarity)
    scale = scale_of(given, 1.0)
    attributes = wire_attributes(SensorContext(
        given.label, given.rate_Hz, sensitivity=given.sensitivity, offset=given.offset,
    ))
    assert (attributes["sensitivity"], attributes["offset"]) == (scale.sensitivity, scale.offset)
    value = SampleStream(FrameDecoder(), Channel.FORCE, scale).take(encode(70.0, 0, 0), NOW).records[0][2]
    assert (value + float(attributes["offset"])) / float(attributes["sensitivity"]) == 70.0  # type: ignore[arg-type]  # numbers, asserted above
    assert str(attributes["from_wire"]).startswith("value = sensitivity * wire - offset;")
