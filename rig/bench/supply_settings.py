"""Required entries of a bench file for a supply that drives the coil, checked against the supply's description."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from drivers.catalogue import SupplyDescription
from drivers.connection import ActuatorAddress, LinkKind
from protocols.descriptions import Problem


class SupplyEntries(Protocol):
    """The entries of `[ecu]` that belong to a supply."""

    @property
    def url(self) -> str | None:
        """Its address."""

    @property
    def supply(self) -> str | dict[str, Any] | None:
        """Its language: a preset, the path of a file, a table."""

    @property
    def described_supply(self) -> SupplyDescription | None:
        """What it describes."""

    @property
    def voltage_limit_V(self) -> float | None:
        """The highest voltage allowed (V)."""

    @property
    def poll_s(self) -> float:
        """How often it is asked (s)."""

    @property
    def timeout_s(self) -> float:
        """Longest wait for an answer (s)."""

    @property
    def stale_after_s(self) -> float:
        """Age at which its last value is stale (s)."""


_CAN_ONLY = ("interface", "channel", "roles", "serial_number")


def supply_problems_of(config: SupplyEntries) -> Iterator[Problem]:
    """What is wrong with an `[ecu]` that is a supply: its description, and what must be stated beside it."""
    if config.url is None:
        yield ("url",), 'missing; write, for example, url = "tcp://192.168.0.20:5025" or url = "/dev/ttyUSB2"'
    if config.supply is None:
        yield ("supply",), 'missing; write supply = "generic-scpi", another preset, or your own file'
    for name in _CAN_ONLY:
        if getattr(config, name) is not None:
            instead = "; write identity" if name == "serial_number" else ""
            yield (name,), f"applies to a current controller on CAN; this current source is a supply{instead}"
    described = config.described_supply
    if described is not None:
        yield from _link(config.url, described)
        yield from _voltage(config, described)
    yield from _times(config)


def _link(url: str | None, described: SupplyDescription) -> Iterator[Problem]:
    """Registers are reached by Modbus, lines of text by anything else."""
    modbus = ActuatorAddress.parse(url or "").kind in {LinkKind.MODBUS_TCP, LinkKind.MODBUS_RTU}
    if url is not None and modbus is not (described.output is not None):
        yield ("url",), (
            "a supply with text commands cannot be connected over Modbus. Fix: write tcp://host:port or a serial "
            "port" if modbus else
            "a supply with registers ([quantities]) must be connected over Modbus. Fix: write modbus-tcp://host:port "
            "or modbus-rtu: followed by a serial port"
        )


def _voltage(config: SupplyEntries, described: SupplyDescription) -> Iterator[Problem]:
    limit_V = config.voltage_limit_V
    if not described.commands.set_voltage_limit:
        if limit_V is not None:
            yield ("voltage_limit",), (
                "this supply has no command for the voltage limit (set_voltage_limit). Fix: remove this entry and "
                "set the limit manually"
            )
        return
    if limit_V is None:
        yield ("voltage_limit",), (
            'missing. Fix: write the highest voltage allowed at the coil (more than resistance x highest current), '
            'such as "12 V"'
        )
    elif described.voltage_V is not None and not described.voltage_V[0] <= limit_V <= described.voltage_V[1]:
        low_V, high_V = described.voltage_V
        yield ("voltage_limit",), f"is outside the supply's range; allowed: {low_V:g} V to {high_V:g} V"


def _times(config: SupplyEntries) -> Iterator[Problem]:
    """A current that is told every `poll` is not stale after one missing answer; a late answer is waited for."""
    shortest_s = 2.0 * config.poll_s
    if config.stale_after_s < shortest_s:
        yield ("stale_after",), (
            f"is shorter than two poll periods of the supply; allowed: at least {1e3 * shortest_s:g} ms (30 ms is the "
            "default for CAN)"
        )
    if config.timeout_s > config.stale_after_s >= shortest_s:
        yield ("timeout",), "is longer than stale_after: the rig would stop before an answer counts as lost"
