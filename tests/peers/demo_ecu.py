"""Frames of the demo ECU by other means than the product's: cantools packs by the DBC, autosar-e2e protects.

    CoilCommand      host to ECU       counter, enable, clear faults, set-point
    CoilStatus       ECU to host       counter, state, current, faults, duty cycle, clock
    CoilTemperature  ECU to host       coil, case, supply, starts
    EcuIdentity      ECU to host       serial number, firmware (binary coded decimal), layout
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import cantools
from e2e.p01 import e2e_p01_check, e2e_p01_protect

from drivers.devices.source import FOLDER

DBC: Any = cantools.database.load_file(FOLDER / "demo_ecu.dbc")
COMMAND_ID, STATUS_ID, TEMPERATURE_ID, IDENTITY_ID = 0x120, 0x121, 0x122, 0x123
DATA_IDS = {"CoilCommand": 0x0120, "CoilStatus": 0x0121}
COUNTER_MODULUS = 15


class CoilCommand(NamedTuple):
    """Of the host."""

    counter: int
    enable: bool
    clear_faults: bool
    setpoint_A: float


class CoilStatus(NamedTuple):
    """State, faults and clock as on the wire."""

    counter: int
    state: int
    current_A: float
    faults: int
    duty_percent: float
    device_time_ticks: int


class CoilTemperature(NamedTuple):
    """In degC and V."""

    coil_degC: float
    ecu_degC: float
    supply_V: float
    boot_count: int


class EcuIdentity(NamedTuple):
    """As on the wire."""

    serial_number: int
    firmware: int
    layout: int


SIGNALS = {
    "CoilCommand": ("Counter", "Enable", "ClearFaults", "CurrentSetpoint"),
    "CoilStatus": ("Counter", "State", "Current", "Faults", "DutyCycle", "DeviceTime"),
    "CoilTemperature": ("CoilTemperature", "EcuTemperature", "Supply", "BootCount"),
    "EcuIdentity": ("SerialNumber", "Firmware", "Layout"),
}
WHOLE = {"device_time_ticks": 0.0001}
"""Fields that are steps of their signal, and the size of a step."""
T = TypeVar("T", CoilCommand, CoilStatus, CoilTemperature, EcuIdentity)


def encode(contents: CoilCommand | CoilStatus | CoilTemperature | EcuIdentity) -> bytes:
    """The frame of these contents, with its checksum."""
    name = type(contents).__name__
    values = {
        signal: value * WHOLE.get(field, 1) if field in WHOLE else value
        for signal, (field, value) in zip(SIGNALS[name], contents._asdict().items(), strict=True)
    }
    message = DBC.get_message_by_name(name)
    data = bytearray(message.encode({**{signal.name: 0 for signal in message.signals}, **values}))
    if name in DATA_IDS:
        e2e_p01_protect(data, DATA_IDS[name], increment_counter=False)
    return bytes(data)


def decode(kind: type[T], data: bytes) -> T:
    """The contents of a frame.

    Raises:
        ValueError: wrong checksum.
    """
    name = kind.__name__
    if name in DATA_IDS and not e2e_p01_check(bytearray(data), DATA_IDS[name]):
        raise ValueError(f"wrong checksum in {data.hex(' ')}")
    values = DBC.get_message_by_name(name).decode(data, decode_choices=False)
    fields = (
        round(values[signal] / WHOLE[field]) if field in WHOLE else round(values[signal], 9)  # 853 steps of 0.1: 85.3
        for signal, field in zip(SIGNALS[name], kind._fields, strict=True)
    )
    return kind(*fields)
