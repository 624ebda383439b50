"""Requirements for a sensor's driver (`drivers.roles.Sensor`)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.catalogue import SensorConnection, make_sensor
from drivers.errors import DriverError
from drivers.plugins import members_of
from drivers.ring import Channel, Record
from drivers.roles import Sensor
from drivers.sample_stream import SampleScale
from rig.conformance.peer import Peer

RATE_HZ = 250.0
PROMPT_S = 2.0
"""Within so long a driver must notice; what it takes on a busy machine is in it."""
Made = Callable[..., Sensor]


@pytest.fixture
def made(driver_name: str, peer: Peer) -> Iterator[Made]:
    """Makes drivers on the peer; what is open at the end is closed."""
    begun: list[Sensor] = []
    name = driver_name.rpartition(":")[2]
    usual = SensorConnection(peer.url, 921_600, "load_cell", Channel.FORCE, name, SampleScale(rate_Hz=RATE_HZ))

    def make(**changes: object) -> Sensor:
        begun.append(make_sensor(replace(usual, **changes)))  # type: ignore[arg-type]  # fields of the connection
        return begun[-1]

    yield make
    for sensor in begun:
        sensor.close()


def read(sensor: Sensor, seconds: float) -> list[Record]:
    """Everything that comes within so long."""
    records: list[Record] = []
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        records += sensor.read_batch(0.05).records
    return [record for record in records if record[4] == Channel.FORCE]


def test_it_has_what_the_role_has(made: Made) -> None:
    sensor = made()
    assert [name for name in members_of(Sensor) if not hasattr(sensor, name)] == []
    assert (sensor.bad_frames, sensor.skipped_bytes, sensor.moved) == (0, 0, False)


def test_it_opens_closes_and_opens_again(made: Made) -> None:
    sensor = made()
    sensor.close()
    sensor.open()
    assert read(sensor, 0.5)
    sensor.close()
    sensor.close()
    with pytest.raises(DriverError):
        sensor.read_batch(0.05)
    sensor.open()
    assert read(sensor, 0.5)


def test_opening_a_dead_port_raises_and_names_device_and_port(made: Made, peer: Peer) -> None:
    unreachable = peer.without_listener
    with pytest.raises(DriverError) as raised:
        made(url=unreachable).open()
    assert raised.value.device == "load_cell"
    assert raised.value.port == unreachable


def test_samples_come_at_their_rate_in_order_and_undamaged(made: Made) -> None:
    sensor = made()
    sensor.open()
    read(sensor, 0.3)
    bad = sensor.bad_frames
    before_ns = time.monotonic_ns()
    records = read(sensor, 2.0)
    after_ns = time.monotonic_ns()
    assert len(records) == pytest.approx(2.0 * RATE_HZ, rel=0.2), "the sensor must deliver two seconds of samples"
    assert sensor.bad_frames == bad
    assert np.all(np.diff([record[3] for record in records]) >= 1), "sequence numbers must increase"
    times_ns = [record[0] for record in records]
    assert before_ns <= times_ns[0] <= times_ns[-1] <= after_ns, (
        "arrival times must be on the host's monotonic clock (ns)"
    )
    assert np.all(np.diff(times_ns) >= 0)
    assert np.all(np.isfinite([record[2] for record in records]))


def test_values_are_si_by_the_calibration_of_the_bench_file(made: Made) -> None:
    """SI = sensitivity * wire - offset: with both changed the same wire gives other numbers, by that rule."""
    plain = made()
    plain.open()
    wire = np.array([record[2] for record in read(plain, 1.0)])
    plain.close()
    scaled = made(scale=SampleScale(sensitivity=-2.0, offset=7.5, rate_Hz=RATE_HZ))
    scaled.open()
    values = np.array([record[2] for record in read(scaled, 1.0)])
    noise = float(wire.std() / np.sqrt(len(wire)) + values.std() / np.sqrt(len(values)))
    assert values.mean() == pytest.approx(-2.0 * wire.mean() - 7.5, abs=10.0 * noise + 0.02 * abs(wire.mean()) + 1e-6)


def test_what_waited_can_be_thrown_away(made: Made) -> None:
    sensor = made()
    sensor.open()
    read(sensor, 0.2)
    time.sleep(0.6)
    sensor.discard_input()
    assert len(sensor.read_batch(0.1).records) < 0.4 * RATE_HZ, "data queued for 0.6 s must be discarded"


def test_silence_is_an_empty_batch_in_time_and_never_an_old_value(made: Made, peer: Peer) -> None:
    sensor = made()
    sensor.open()
    assert read(sensor, 0.5)
    peer.silence()
    read(sensor, 0.3)
    began_s = time.monotonic()
    assert read(sensor, 0.5) == []
    assert time.monotonic() - began_s < PROMPT_S


def test_a_pulled_cable_raises(made: Made, peer: Peer) -> None:
    sensor = made()
    sensor.open()
    assert read(sensor, 0.5)
    peer.hang_up()
    with pytest.raises(DriverError):
        read(sensor, PROMPT_S)
