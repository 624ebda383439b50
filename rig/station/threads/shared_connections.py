"""Connections shared by several devices of a bench: CAN buses, Modbus servers and serial lines."""

from __future__ import annotations

from drivers.can_bus import CanBus
from drivers.catalogue import current_source_needs_fd, modbus_connection
from drivers.connection import modbus_line
from drivers.modbus_line import ModbusLine
from drivers.sensor_formats import described_format, registers_of
from protocols.binary_format import BinaryFormat
from rig.bench.settings import StationConfig


class SharedConnections:
    """One connection for all devices at one address, created before the drivers that use it.

    Args:
        config: configuration of the station.
    """

    def __init__(self, config: StationConfig) -> None:
        self._buses: dict[str, CanBus] = {}
        on_CAN = [given for given in config.sensors if given.bus is not None]
        for given in on_CAN:
            if given.bus is not None and given.port not in self._buses:
                formats = [described_format(one.described) for one in on_CAN if one.port == given.port]
                fd = any(isinstance(one, BinaryFormat) and one.can is not None and one.can.fd for one in formats)
                ecu = config.ecu
                if ecu.url is None and not ecu.by_hand and ecu.port == given.port:
                    fd = fd or current_source_needs_fd(*ecu.described_source)
                self._buses[given.port] = CanBus(given.bus, fd=fd)

        self._lines: dict[str, ModbusLine] = {}
        for given in config.sensors:
            registers = registers_of(given.described)
            if registers is not None:
                key = modbus_line(given.port)
                if key not in self._lines:
                    self._lines[key] = modbus_connection(
                        given.port, given.line, config.device_rate, rtu=registers.rtu
                    )

    def modbus(self, port: str | None) -> ModbusLine | None:
        """The connection of Modbus sensors at this address, or None."""
        return self._lines.get(modbus_line(port or ""))

    def bus(self, port: str) -> CanBus | None:
        """The CAN bus with this name, if it has sensors, or None."""
        return self._buses.get(port)
