"""A sensor's bytes through driver, judge and supervisor: what blinds a channel stops the rig."""

from __future__ import annotations

import math
import os
import pty
import time
import tty
from collections.abc import Callable, Iterator

import pytest
from station_bench import Journal, config_for

from drivers.ring import Channel
from drivers.serial_sensor import DEFAULT_FORMAT, SerialSensor
from protocols.frame_format import encode
from rig.bench.sensor_settings import Calibration, LoadCell
from rig.clock import monotonic_ns
from rig.station.interlocks.channel_interlock import ChannelInterlock, ChannelLimits
from rig.station.interlocks.motion_interlock import MotionInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.sensor_thread import SensorRole, SensorThread

PERIOD_S = 0.004
STALE_S = 0.4
PATIENCE_S = 5.0

Line = Callable[[int], bytes]
"""What the sensor sends as its sample of that number."""


class Cable:
    """A load cell's line into a running station thread; `send` plays samples at the sensor's rate."""

    def __init__(self, line_format: str, motion: MotionInterlock | None = None) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        url = os.ttyname(self._slave)
        self.journal = Journal()
        self.supervisor = Supervisor(
            config_for(url), self.journal.append, lambda records: None, lambda now_ns: None, lambda: 0.0
        )
        given = LoadCell(
            url=url, rate_Hz=1.0 / PERIOD_S, range_N=10e3, stale_after_s=STALE_S, format=line_format,
            calibration=Calibration(serial_number="LC-1"),
        )
        driver = SerialSensor(url, name="load_cell", channel=Channel.FORCE, line_format=line_format)
        interlock = ChannelInterlock("load_cell", "force-limit", ChannelLimits(low=-5e3, high=5e3, span=10e3, unit="N"))
        role = SensorRole("loadcell-pulled", Channel.FORCE, interlock, motion, None, None)
        self.thread = SensorThread(given, driver, role, self.supervisor, lambda records: None)
        self.thread.open()
        self.thread.start()
        self._number = 0

    def begin(self, line: Line) -> None:
        """Send until the station reads: what waited when it began is thrown away."""
        while self.thread.samples < 10:
            self._write(line)
        read = -1
        while read != (read := self.thread.samples):
            time.sleep(10 * PERIOD_S)

    def send(self, line: Line, samples: int) -> None:
        """Send so many samples, and wait until the station has read them."""
        count = self.thread.samples + samples
        for _ in range(samples):
            self._write(line)
        deadline = time.monotonic() + PATIENCE_S
        while self.thread.samples < count and time.monotonic() < deadline:
            time.sleep(PERIOD_S)
        assert self.thread.samples == count

    def _write(self, line: Line) -> None:
        os.write(self._master, line(self._number))
        self._number += 1
        time.sleep(PERIOD_S)

    def close(self) -> None:
        self.thread.end()
        self.thread.close()
        os.close(self._master)
        os.close(self._slave)


@pytest.fixture
def cable() -> Iterator[Callable[[str], Cable]]:
    made: list[Cable] = []

    def make(line_format: str, motion: MotionInterlock | None = None) -> Cable:
        made.append(Cable(line_format, motion))
        return made[-1]

    yield make
    for each in made:
        each.close()


def laumas(text: bytes) -> Line:
    return lambda number: (text if text else b"%06d" % (100 + number % 7)) + b"\r\n"


def frame(value_N: float, status: int = 0) -> Line:
    return lambda number: encode(value_N, number, round(1e6 * PERIOD_S * number), status)


@pytest.mark.parametrize(
    ("line_format", "good", "blind", "slug"),
    [
        ("laumas-fast", laumas(b""), laumas(b"^^^^^^"), "sensor-saturated"),
        ("laumas-fast", laumas(b""), laumas(b"  ErOL"), "sensor-saturated"),
        ("laumas-fast", laumas(b""), laumas(b" ErCEL"), "sensor-fault"),
        (DEFAULT_FORMAT, frame(120.0), frame(math.inf), "sensor-saturated"),
        (DEFAULT_FORMAT, frame(120.0), frame(-math.inf), "sensor-saturated"),
        (DEFAULT_FORMAT, frame(120.0), frame(math.nan, 1), "sensor-saturated"),
        (DEFAULT_FORMAT, frame(120.0), frame(math.nan, 2), "sensor-fault"),
    ],
)
def test_three_samples_that_say_overload_or_fault_trip_whether_or_not_they_carry_a_number(
    cable: Callable[[str], Cable], line_format: str, good: Line, blind: Line, slug: str
) -> None:
    line = cable(line_format)
    line.begin(good)
    line.supervisor.arm()
    line.send(blind, 2)
    assert line.supervisor.trip is None, "two samples are a disturbance"
    line.send(blind, 1)
    assert line.supervisor.trip is not None
    assert line.supervisor.trip.slug == slug


def noisy(number: int) -> bytes:
    return encode(0.01 + 1e-6 * (number % 7), number, round(1e6 * PERIOD_S * number), 0)


@pytest.mark.parametrize("quiet", [True, False])
def test_a_value_that_repeats_is_a_standstill_only_where_it_repeated_at_rest_before(
    cable: Callable[..., Cable], quiet: bool
) -> None:
    line = cable(DEFAULT_FORMAT, MotionInterlock(1.0, 1.0 / PERIOD_S))
    line.begin(noisy)
    line.send(noisy, 60)
    if quiet:
        line.send(frame(0.0101), 25)
        line.send(noisy, 60)
    line.supervisor.arm()
    line.thread.restart_still()
    line.send(noisy, 5)
    line.send(frame(0.0102), 30)
    still_s = line.thread.still_s(monotonic_ns())
    assert (still_s is not None) is quiet
    assert still_s is None or still_s > 0.1
    assert not line.thread.changed, "alone it proves nothing: a quiet one may be stuck too"
    line.send(noisy, 5)
    assert line.thread.changed


@pytest.mark.parametrize(("shown", "left"), [(frame(0.0125), True), (frame(math.inf), False), (frame(0.5, 2), False)])
def test_an_lvdt_that_says_nothing_of_the_rod_does_not_say_that_it_has_left_its_place(
    cable: Callable[..., Cable], shown: Line, left: bool
) -> None:
    line = cable(DEFAULT_FORMAT, MotionInterlock(1.0, 1.0 / PERIOD_S))
    line.begin(noisy)
    line.send(noisy, 60)
    line.thread.hold_place()
    line.send(shown, 3)
    assert line.thread.left_place(monotonic_ns()) is left
    line.thread.restart_still()
    line.send(shown, 3)
    assert not line.thread.left_place(monotonic_ns()), "another stop is under way: nothing is proved"


def test_a_load_cell_that_sends_no_number_any_more_is_as_good_as_pulled(cable: Callable[[str], Cable]) -> None:
    line = cable(DEFAULT_FORMAT)
    line.begin(frame(120.0))
    line.supervisor.arm()
    line.send(frame(math.nan), round(1.5 * STALE_S / PERIOD_S))
    assert line.supervisor.trip is not None
    assert line.supervisor.trip.slug == "loadcell-pulled"
    assert line.thread.value(time.monotonic_ns() + int(1e9 * STALE_S)) is None


def test_every_tenth_sample_that_is_no_number_only_warns(cable: Callable[[str], Cable]) -> None:
    line = cable(DEFAULT_FORMAT)
    line.begin(frame(120.0))
    line.supervisor.arm()
    began_s = time.monotonic()
    line.send(lambda number: frame(math.nan if number % 10 == 0 else 120.0)(number), 100)
    assert line.supervisor.trip is None
    warnings = line.journal.slugs("warning")
    assert set(warnings) == {"sensor-nan"}
    assert len(warnings) <= 1 + int(time.monotonic() - began_s), "told once a second, not once a sample"


def test_a_sensor_that_reports_a_fault_from_power_on_stops_the_rig_once_it_is_armed(
    cable: Callable[[str], Cable],
) -> None:
    line = cable(DEFAULT_FORMAT)
    line.begin(frame(120.0, 2))
    assert line.supervisor.trip is None
    line.supervisor.arm()
    line.send(frame(120.0, 2), 1)
    assert line.supervisor.trip is not None
    assert line.supervisor.trip.slug == "sensor-fault"
    line.send(frame(120.0, 2), 50)
    assert line.journal.slugs("trip") == ["sensor-fault"]
    assert line.journal.slugs("warning") == ["sensor-fault"], "one before arming; fifty more samples tell nothing new"
