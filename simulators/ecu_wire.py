"""What the simulated ECU puts into its frames and takes from commands; how they are laid out is `emulated_ecu`'s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

Frame = tuple[int, bytes]
"""Identifier (`EXTENDED` set where it is extended) and data."""


class Command(NamedTuple):
    """What a command requests; `counter` is -1 where commands have none."""

    counter: int
    enable: bool
    clear_faults: bool
    setpoint_A: float


@dataclass(frozen=True)
class Shown:
    """Status of the ECU at one instant; `state` and `faults` by the codes of `drivers.current_source`."""

    state: int = 0
    current_A: float = 0.0
    faults: int = 0
    device_us: int = 0
    coil_degC: float = 0.0
    ecu_degC: float = 0.0
    supply_V: float = 0.0
    boot_count: int = 0
    serial_number: int = 0
