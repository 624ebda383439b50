"""What a fault injector is given, and what it hands back."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from simulators.actuator import Actuator
    from simulators.channel import Channel
    from simulators.ecu import Ecu
    from simulators.modbus_server import ModbusServer
    from simulators.plant.plant import Plant
    from simulators.registers import RegisterBank
    from simulators.slcan_bus import SlcanBus


class Faulty(Protocol):
    """What a fault can be switched on in: the simulated rig's parts."""

    plant: Plant
    actuator: Actuator
    bank: RegisterBank
    ecu: Ecu
    bus: SlcanBus
    modbus: ModbusServer
    every_tick: list[Callable[[], None]]

    def channel(self, name: str) -> Channel:
        """The sensor channel of that name."""


Undo = Callable[[], None]
LastingInjector = Callable[[Faulty], None]
PassingInjector = Callable[[Faulty], Undo]
