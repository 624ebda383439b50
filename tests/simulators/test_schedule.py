"""Schedules drawn from a seed, and faults that are taken away again."""

from __future__ import annotations

import asyncio
import math

import pytest

from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from simulators.actuator import ActuatorFaults
from simulators.ecu import EcuFaults
from simulators.injection import INJECTORS, LASTING, PASSING
from simulators.modbus_server import LinkFaults
from simulators.options import RigOptions
from simulators.rig import RunOptions, SimulatedRig
from simulators.schedule import MOST_DRAWN, ONLY_BY_SUPPLY, ONLY_ON, ScheduledFault, drawn_faults, parse_fault
from simulators.sensor import SensorFaults
from simulators.slcan_bus import frame_line

TCP = frozenset({"tcp", "pty"})
RTU_BY_ID = frozenset({"rtu", "by-id"})
STREAMED = frozenset({"setpoints", "tcp", "pty"})


@pytest.mark.parametrize("seed", range(50))
def test_a_seed_draws_the_same_few_faults_each_time_and_they_can_be_written(seed: int) -> None:
    faults = drawn_faults(seed, TCP, 20.0)
    assert faults == drawn_faults(seed, TCP, 20.0)
    assert 1 <= len({fault.slug for fault in faults}) == len(faults) <= MOST_DRAWN
    assert tuple(parse_fault(str(fault)) for fault in faults) == faults
    for fault in faults:
        assert (fault.after_s is None) is (MATRIX[fault.slug].end == "R")
        assert fault.after_s is None or 0.0 <= fault.after_s <= 20.0
        assert math.isinf(fault.lasts_s) or (fault.slug in PASSING and 0.0 < fault.lasts_s <= 2.0)


@pytest.mark.parametrize(("kinds", "excluded"), [
    (TCP, {"rtu", "by-id", "setpoints"}), (RTU_BY_ID, {"tcp", "setpoints"}), (STREAMED, {"rtu", "by-id"}),
])
def test_every_fault_of_the_rig_is_drawn_sooner_or_later_and_none_of_another_kind(
    kinds: frozenset[str], excluded: set[str]
) -> None:
    drawn = {fault.slug for seed in range(1500) for fault in drawn_faults(seed, kinds)}
    assert drawn == {slug for slug in INJECTORS if ONLY_ON.get(slug) not in excluded} - ONLY_BY_SUPPLY


def test_a_fault_that_cannot_be_taken_away_refuses_an_end() -> None:
    for slug in LASTING:
        with pytest.raises(FileProblem, match="is permanent"):
            parse_fault(f"{slug}@1+2")
    for slug in PASSING:
        assert parse_fault(f"{slug}@1+2") == ScheduledFault(slug, 1.0, 2.0)


def test_what_is_taken_away_leaves_a_rig_as_it_was() -> None:
    async def story() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket"))
        await rig.open()
        try:
            constants = rig.plant.constants.copy()
            for inject in PASSING.values():
                inject(rig)()
            assert rig.ecu.faults == EcuFaults()
            assert rig.modbus.faults == LinkFaults()
            assert rig.actuator.faults == ActuatorFaults()
            assert [channel.sensor.faults for channel in rig.channels] == [SensorFaults()] * 2
            assert (rig.bus.encode, rig.bus.silent, rig.every_tick) == (frame_line, False, [])
            assert not rig.bank.writes_lost
            assert (rig.plant.constants == constants).all()
        finally:
            await rig.close()

    asyncio.run(story())
