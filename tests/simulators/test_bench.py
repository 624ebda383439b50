"""The bench file's time limits: the hardware's where the rig runs like hardware, wider where it cannot."""

from __future__ import annotations

import asyncio
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.bench.model import Bench
from simulators.bench import Addresses
from simulators.options import RigOptions
from simulators.pace import LONGEST_WAIT_S
from simulators.rig import RunOptions, SimulatedRig

ADDRESSES = Addresses("modbus-tcp://127.0.0.1:1", 2, "/dev/pts/1", "/dev/pts/2", ())


def limits(speed: float, *, real_time: bool, clock: Path | None = None) -> tuple[dict[str, Any], float]:
    """The bench file of a rig, and its ECU's own command time-out (s); with a file for its `clock`, it waits."""
    rig = SimulatedRig(RigOptions(), RunOptions(speed=speed))
    try:
        if clock is not None:
            rig.share_clock(clock, ADDRESSES)
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


def test_where_the_clock_waits_the_watchdog_has_the_hardwares_time_and_the_current_still_goes_first(
    tmp_path: Path
) -> None:
    bench, command_timeout_s = limits(1.0, real_time=False, clock=tmp_path / "clock")
    numbers = {(table, key): 1e-3 * float(bench[table][key].removesuffix(" ms")) for table, key in (
        ("ecu", "stale_after"), ("lvdt", "stale_after"), ("actuator", "timeout"), ("actuator", "watchdog"),
    )}  # fmt: skip
    watchdog_s = numbers.pop(("actuator", "watchdog"))
    assert watchdog_s == 0.5
    assert max(*numbers.values(), command_timeout_s) < watchdog_s
    assert command_timeout_s >= numbers["ecu", "stale_after"]
    assert limits(20.0, real_time=False, clock=tmp_path / "fast")[0]["actuator"]["watchdog"] == "1000 ms"


@pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
@pytest.mark.parametrize("actuator", ["tcp", "rtu"])
def test_a_bench_file_with_a_clock_that_waits_is_accepted(tmp_path: Path, speed: float, actuator: str) -> None:
    rig = SimulatedRig(RigOptions(), RunOptions(speed=speed, actuator=actuator))
    try:
        addresses = replace(ADDRESSES, actuator_url="modbus-rtu:///dev/pts/3") if actuator == "rtu" else ADDRESSES
        rig.share_clock(tmp_path / "clock", addresses)
        (tmp_path / "bench.toml").write_text(rig.bench(addresses, real_time=False))
    finally:
        asyncio.run(rig.close())
    assert Bench.load(tmp_path / "bench.toml").actuator.watchdog_s == (0.5 if speed <= 1.0 else 1.0)
