"""The bench file's time limits: the hardware's where the rig runs like hardware, wider where it cannot."""

from __future__ import annotations

import asyncio
import tomllib
from typing import Any

import pytest

from simulators.bench import Addresses
from simulators.options import RigOptions
from simulators.pace import LONGEST_WAIT_S
from simulators.rig import RunOptions, SimulatedRig

ADDRESSES = Addresses("modbus-tcp://127.0.0.1:1", 2, "/dev/pts/1", "/dev/pts/2", ())


def limits(speed: float, *, real_time: bool) -> tuple[dict[str, Any], float]:
    """The bench file of a rig, and its ECU's own command time-out (s)."""
    rig = SimulatedRig(RigOptions(), RunOptions(speed=speed))
    try:
        return tomllib.loads(rig.bench(ADDRESSES, real_time)), rig.ecu.command_timeout_s
    finally:
        asyncio.run(rig.close())


def test_in_real_time_the_limits_are_the_hardwares() -> None:
    bench, command_timeout_s = limits(1.0, real_time=True)
    assert bench["ecu"]["stale_after"] == "30 ms"
    assert bench["load_cell"]["stale_after"] == "20 ms"
    assert bench["actuator"]["watchdog"] == "500 ms"
    assert command_timeout_s == 0.1


@pytest.mark.parametrize(("speed", "real_time"), [(20.0, True), (20.0, False), (1.0, False)])
def test_without_real_time_bench_and_ecu_are_patient_identical(speed: float, real_time: bool) -> None:
    bench, command_timeout_s = limits(speed, real_time=real_time)
    stale_s = [1e-3 * float(bench[name]["stale_after"].removesuffix(" ms")) for name in ("ecu", "load_cell", "lvdt")]
    assert min(stale_s) > LONGEST_WAIT_S, "the rig's clock may stand still that long for a slow reader"
    assert command_timeout_s >= max(stale_s)
    assert command_timeout_s < 1e-3 * float(bench["actuator"]["watchdog"].removesuffix(" ms"))
