"""Types of a bench file's entries: quantities inside the envelope of any rig, names, addresses."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from rig.bench import address
from rig.bench.quantity import Quantity, Wording

# A limit outside these is a slip of the pen, not a damper test rig (fault row `config-absurd`).
Position = Annotated[float, Quantity("length", "-1 m", "1 m")]
Speed = Annotated[float, Quantity("speed", "0 m/s", "5 m/s", above=True)]
Acceleration = Annotated[float, Quantity("acceleration", "0 m/s^2", "500 m/s^2", above=True)]
Force = Annotated[float, Quantity("force", "0 N", "200 kN", above=True)]
Current = Annotated[float, Quantity("current", "0 A", "20 A", above=True)]
Temperature = Annotated[float, Quantity("temperature", "20 degC", "250 degC")]
Timeout = Annotated[float, Quantity("time", "5 ms", "5 s")]

RESERVED_NAMES = frozenset({"time", "force", "displacement", "velocity", "current", "coil_temperature"})

LineValue = str | int | float | tuple[str, ...]
Name = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f]+$"),
    Wording("1 to 64 characters on one line", "bench 2"),
]  # fmt: skip
ChannelName = Annotated[
    str, Field(max_length=32, pattern=r"^[a-z][a-z0-9_]*$"),
    Wording("a lower-case letter, then lower-case letters, digits or _ (32 at most)", "oil_pressure"),
]  # fmt: skip
Address = Annotated[str, Field(min_length=1, max_length=256)]
SerialUrl = Annotated[
    Address, Field(examples=["/dev/ttyUSB0", "socket://192.168.0.7:4001"]), AfterValidator(address.serial_url)
]
ModbusUrl = Annotated[
    Address, Field(examples=["modbus-tcp://192.168.0.10:502", "modbus-rtu:/dev/ttyUSB0"]),
    AfterValidator(address.modbus_url),
]  # fmt: skip
CanInterface = Annotated[Address, Field(examples=["socketcan"]), AfterValidator(address.can_interface)]
