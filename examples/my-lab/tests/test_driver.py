"""The lab's own driver, on a simulated load cell that writes its lines on a real socket."""

import time

from drivers.catalogue import SensorConnection, make_sensor
from drivers.ring import Channel
from drivers.sample_stream import SampleScale


def test_the_load_cell_is_read_at_its_rate(simulated_rig):
    load_cell = simulated_rig().bench.load_cell
    sensor = make_sensor(SensorConnection(
        load_cell.url, load_cell.baudrate, "load_cell", Channel.FORCE, load_cell.format, SampleScale(rate_Hz=250.0)
    ))
    sensor.open()
    records, until_s = [], time.monotonic() + 1.0
    while time.monotonic() < until_s:
        records += sensor.read_batch(0.1).records
    sensor.close()
    assert 200 < len(records) < 300
    assert sensor.bad_frames == 0
