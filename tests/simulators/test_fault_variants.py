"""Injectors of the faults that share a row with another one, each by what leaves the devices."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import demo_ecu as wire
import numpy as np
import pytest

from drivers.current_source import SourceFault
from protocols.frame_format import STATUS_OVERLOAD, FrameDecoder, Reading
from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from simulators.channel import Channel
from simulators.injection import INJECTORS, VARIANTS
from simulators.options import RigOptions
from simulators.plant.records import MODE_PROGRAM
from simulators.rig import RunOptions, SimulatedRig
from simulators.schedule import ScheduledFault, drawn_faults, parse_fault

Story = Callable[[SimulatedRig], None]


def on_a_rig(story: Story, auxiliary: int = 0) -> None:
    async def run() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket", auxiliary=auxiliary))
        rig.warm_up()
        await rig.open()
        rig.plant.order(
            mode=MODE_PROGRAM, pressure=2, amplitude_m=0.02, frequency_Hz=1.0, full_cycles=50, ramp_in_cycles=1
        )
        rig.plant.state["accumulator_Pa"] = 210e5
        rig.advance(4000)
        try:
            story(rig)
        finally:
            await rig.close()

    asyncio.run(run())


def readings(rig: SimulatedRig, name: str, seconds: float = 0.8) -> list[Reading]:
    """Sequence, device time (us), value, status, edge count of what a sensor sends from now on."""
    channel, decoder, heard = rig.channel(name), FrameDecoder(), []

    def keep(data: bytes, frame_size: int) -> None:
        del frame_size
        heard.extend(decoder.feed(data))

    channel.port.write = keep  # type: ignore[method-assign]  # the wire of this test
    for _ in range(round(seconds * 50)):
        rig.advance(160)
    return [reading for reading in heard if not reading[3] & 0x80]


@pytest.mark.parametrize("name", sorted(VARIANTS))
def test_every_variant_belongs_to_a_row_and_can_be_written(name: str) -> None:
    slug, _, variant = name.partition(":")
    assert slug in MATRIX
    assert slug in INJECTORS
    assert parse_fault(f"{name}@2.5") == ScheduledFault(slug, 2.5, variant=variant)
    assert str(parse_fault(f"{name}@2.5")) == f"{name}@2.5"


@pytest.mark.parametrize(
    ("text", "message"),
    [("sensor-stuck:valve@1", "sensor-stuck has sensor-stuck:lvdt"), ("estop:left", "estop has no variants"),
     ("sensor-stuck:", "sensor-stuck has"), ("usb-renumber:lvdt@1+2", "is permanent")],
)
def test_an_unknown_variant_says_which_there_are(text: str, message: str) -> None:
    with pytest.raises(FileProblem, match=message):
        parse_fault(text)


def test_variants_are_drawn_too_and_reported_in_their_own_words() -> None:
    drawn = {fault.name for seed in range(3000) for fault in drawn_faults(seed, frozenset({"tcp", "by-id"}))}
    assert set(VARIANTS) - drawn == {"loadcell-pulled:auxiliary"}
    for seed in range(200):
        faults = drawn_faults(seed, frozenset({"tcp", "pty"}))
        assert tuple(parse_fault(str(fault)) for fault in faults) == faults


def stuck(seen: list[Reading]) -> bool:
    return len({reading[2] for reading in seen[5:]}) == 1


def saturated(seen: list[Reading]) -> bool:
    return all(reading[3] & STATUS_OVERLOAD for reading in seen[5:])


def spiky(seen: list[Reading]) -> bool:
    return bool(np.abs(np.diff([reading[2] for reading in seen])).max() > 40.0)


def without_numbers(seen: list[Reading]) -> bool:
    return any(math.isnan(reading[2]) for reading in seen)


def holed(seen: list[Reading]) -> bool:
    return bool(np.any(np.diff([reading[0] for reading in seen]) % 65536 == 4))


def going_back(seen: list[Reading]) -> bool:
    return bool(np.any(np.diff([reading[1] for reading in seen]) < 0))


def decimated(seen: list[Reading]) -> bool:
    return 0 < len(seen) < 0.8 * 200


def unreadable(seen: list[Reading]) -> bool:
    return len(seen) < 5


@pytest.mark.parametrize(
    ("variant", "sensor", "other", "shows"),
    [
        ("sensor-stuck:lvdt", "lvdt", "load_cell", stuck), ("sensor-saturated:lvdt", "lvdt", "load_cell", saturated),
        ("sensor-spike:lvdt", "lvdt", "load_cell", spiky), ("sensor-nan:lvdt", "lvdt", "load_cell", without_numbers),
        ("sample-gap:lvdt", "lvdt", "load_cell", holed), ("sample-gap:backwards", "load_cell", "lvdt", going_back),
        ("sample-gap:lvdt-backwards", "lvdt", "load_cell", going_back),
        ("serial-garbage:lvdt", "lvdt", "load_cell", decimated), ("serial-baud:lvdt", "lvdt", "load_cell", unreadable),
    ],
)  # fmt: skip
def test_a_sensors_variant_hits_that_sensor_and_no_other(
    variant: str, sensor: str, other: str, shows: Callable[[list[Reading]], bool]
) -> None:
    def story(rig: SimulatedRig) -> None:
        VARIANTS[variant](rig)
        assert shows(readings(rig, sensor))

    def elsewhere(rig: SimulatedRig) -> None:
        VARIANTS[variant](rig)
        assert shows is spiky or not shows(readings(rig, other))

    def healthy(rig: SimulatedRig) -> None:
        assert not shows(readings(rig, sensor)) or (shows is spiky and sensor == "load_cell")

    for each in (story, elsewhere, healthy):
        on_a_rig(each)


def test_an_lvdt_that_was_not_zeroed_is_off_by_a_share_of_its_range() -> None:
    def story(rig: SimulatedRig) -> None:
        VARIANTS["not-tared:lvdt"](rig)
        shown_mm = [reading[2] for reading in readings(rig, "lvdt", 0.1)]
        assert shown_mm[-1] - 1e3 * rig.plant.value("position_m") == pytest.approx(10.0, abs=1.0)

    on_a_rig(story)


def test_an_lvdts_clock_drifts_while_the_others_keep_time() -> None:
    def story(rig: SimulatedRig) -> None:
        before = {channel.name: channel.sensor.clock.ppm for channel in rig.channels}
        VARIANTS["clock-drift:lvdt"](rig)
        after = {channel.name: channel.sensor.clock.ppm for channel in rig.channels}
        assert (after["lvdt"] - before["lvdt"], after["load_cell"]) == (500.0, before["load_cell"])

    on_a_rig(story)


def closed(channel: Channel) -> bool:
    sent = channel.port.sent_bytes
    channel.port.write(bytes(16), 16)
    return channel.port.sent_bytes == sent


@pytest.mark.parametrize(
    ("variant", "gone"), [("loadcell-pulled:auxiliary", "auxiliary_1"), ("usb-renumber:lvdt", "lvdt")]
)
def test_a_pulled_cable_is_that_sensors_and_no_other(variant: str, gone: str) -> None:
    def story(rig: SimulatedRig) -> None:
        VARIANTS[variant](rig)
        assert [channel.name for channel in rig.channels if closed(channel)] == [gone]

    on_a_rig(story, auxiliary=1)


def command(rig: SimulatedRig, counter: int, current_A: float) -> None:
    rig.ecu.receive(wire.COMMAND_ID, wire.encode(wire.CoilCommand(counter, True, False, current_A)))
    for step in range(20):
        rig.ecu.tick(0.001 * step)
        rig.advance(160)


@pytest.mark.parametrize(
    ("variant", "bit"),
    [("coil-open-short:short", SourceFault.SHORT), ("ecu-overtemp:undervoltage", SourceFault.UNDERVOLTAGE)],
)
def test_the_ecu_latches_the_bit_and_drives_no_current(variant: str, bit: SourceFault) -> None:
    def story(rig: SimulatedRig) -> None:
        command(rig, 1, 1.0)
        assert rig.plant.value("current_A") > 0.9
        VARIANTS[variant](rig)
        command(rig, 2, 1.0)
        command(rig, 3, 1.0)
        assert rig.ecu.fault_bits == bit
        assert rig.plant.value("current_A") < 0.05

    on_a_rig(story)


def test_too_much_current_really_flows() -> None:
    def story(rig: SimulatedRig) -> None:
        VARIANTS["current-tracking:over"](rig)
        command(rig, 1, 1.5)
        assert rig.plant.value("current_A") == pytest.approx(4.5, rel=0.01)
        sent = [data for name, data in rig.ecu.frames() if name == wire.STATUS_ID]
        assert all(wire.decode(wire.CoilStatus, data).current_A > 4.0 for data in sent)

    on_a_rig(story)


def test_a_lost_can_adapter_hangs_up_and_cannot_be_had_again() -> None:
    async def run() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket"))
        await rig.open()
        reader, writer = await asyncio.open_connection("127.0.0.1", rig.bus.port)
        writer.write(b"O\r")
        assert await reader.readexactly(1) == b"\r"
        VARIANTS["can-busoff:lost"](rig)
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await reader.readexactly(1 << 20)
        with pytest.raises(ConnectionError):
            await asyncio.open_connection("127.0.0.1", rig.bus.port)
        writer.close()
        await rig.close()

    asyncio.run(run())
