"""Lines that a simulated sensor writes are readings of the host's own decoder."""

from __future__ import annotations

import math

import numpy as np
import pytest

from protocols.errors import LocalProtocolError
from protocols.frame_format import STATUS_OVERLOAD
from protocols.line_format import PRESETS, LineDecoder, from_description
from simulators.clock import DeviceClock
from simulators.line_writer import LineWriter
from simulators.options import SensorOptions
from simulators.sensor import Sensor

CUSTOM = {"pattern": r"P(?P<value>[+-]\d{4}\.\d)", "template": "P{value:+07.1f}", "overload_tokens": ["+9999.9"]}


@pytest.mark.parametrize("name", PRESETS)
def test_a_sensor_of_any_preset_is_heard(name: str) -> None:
    line_format = PRESETS[name]
    options = SensorOptions(rate_Hz=100.0, format=line_format, range=90.0, noise=0.0, resolution=0.0, jitter_s=0.0)
    sensor = Sensor(options, DeviceClock(0.0, 0.0), np.random.default_rng(1), 0.0)
    data = b"".join(sensor.sample(np.full(80, 42.0), 0.01 * step, 1.25e-4, []) for step in range(60))
    assert len(data) % sensor.frame_size == 0
    decoder = LineDecoder(line_format)
    values = [value for _, _, value, _, _ in decoder.feed(data)]
    assert len(values) > 50
    assert decoder.bad_frames == 0
    assert values == pytest.approx([42.0] * len(values))


def test_an_overload_is_written_in_the_device_s_word() -> None:
    line_format = from_description(CUSTOM)
    write = LineWriter(line_format, 500.0)
    assert write.size == 10
    lines = write(np.array([1.5, math.inf, -3.25, math.nan])).tobytes()
    readings = LineDecoder(line_format).feed(b"\r\n" + lines)
    assert [status for _, _, _, status, _ in readings] == [0, STATUS_OVERLOAD, 0, STATUS_OVERLOAD]


def test_what_a_format_has_no_word_for_is_no_reading() -> None:
    line_format = PRESETS["flintec"]
    decoder = LineDecoder(line_format)
    assert len(decoder.feed(b"\r\n" + LineWriter(line_format, 90.0)(np.array([math.nan, 1.0])).tobytes())) == 1
    assert decoder.bad_frames == 1


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"template": ""}, "no template"),
        ({"template": "P{value:+.1f}", "pattern": r"P(?P<value>[+-]\d+\.\d)"}, "differ in length"),
        ({"pattern": r"P(?P<value>[+-]\d{4}\.\d\d)"}, "does not fit"),
    ],
)
def test_a_format_that_nobody_can_write_is_refused(changes: dict[str, object], says: str) -> None:
    with pytest.raises(LocalProtocolError, match=says):
        LineWriter(from_description({**CUSTOM, **changes}), 500.0)
