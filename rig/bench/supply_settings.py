"""What a bench file must say of a supply that drives the coil, and what its description must fit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from drivers.devices.supply import SupplyDescription
from drivers.devices.supply_file import read_supply, supply
from rig.bench.quantity import Problem

if TYPE_CHECKING:
    from rig.bench.settings import EcuConfig

_CAN_ONLY = ("interface", "channel", "serial_number")


def supply_of(config: EcuConfig) -> SupplyDescription | None:
    """The description of a bench's supply; None where it has none, or one with problems."""
    if config.supply is None or isinstance(config.supply, str):
        return None if config.supply is None else supply(config.supply)
    return read_supply(config.supply, "supply")[0]


def supply_problems_of(config: EcuConfig) -> Iterator[Problem]:
    """What is wrong with an `[ecu]` that is a supply: its description, and what must be stated beside it."""
    if config.url is None:
        yield ("url",), 'missing; write for example url = "tcp://192.168.0.20:5025" or url = "/dev/ttyUSB2"'
    if config.supply is None:
        yield ("supply",), 'missing; write supply = "generic-scpi", another preset, or a file of your own'
    for name in _CAN_ONLY:
        if getattr(config, name) is not None:
            instead = "; write identity" if name == "serial_number" else ""
            yield (name,), f"belongs to a current controller on CAN; this one is a supply{instead}"
    if config.supply is not None and not isinstance(config.supply, str):
        for place, text in read_supply(config.supply, "supply")[1]:
            yield ("supply", *place), text
    described = supply_of(config)
    if described is not None:
        yield from _voltage(config, described)
    yield from _times(config)


def _voltage(config: EcuConfig, described: SupplyDescription) -> Iterator[Problem]:
    limit_V = config.voltage_limit_V
    if not described.commands.set_voltage_limit:
        if limit_V is not None:
            yield ("voltage_limit",), "this supply has no command for it (set_voltage_limit): take it out, set it by hand"
        return
    if limit_V is None:
        yield ("voltage_limit",), (
            'missing; write the highest voltage that the coil may get, above resistance x highest current: "12 V"'
        )
    elif described.voltage_V is not None and not described.voltage_V[0] <= limit_V <= described.voltage_V[1]:
        low_V, high_V = described.voltage_V
        yield ("voltage_limit",), f"is beyond what the supply takes; allowed: {low_V:g} V to {high_V:g} V"


def _times(config: EcuConfig) -> Iterator[Problem]:
    """A current that is told every `poll` is not stale after one missing answer; a late answer is waited for."""
    shortest_s = 2.0 * config.poll_s
    if config.stale_after_s < shortest_s:
        yield ("stale_after",), (
            f"is less than two polls of the supply; allowed: at least {1e3 * shortest_s:g} ms (state it: 30 ms is for CAN)"
        )
    if config.timeout_s > config.stale_after_s >= shortest_s:
        yield ("timeout",), "is longer than stale_after: the rig would have stopped before an answer counts as lost"
