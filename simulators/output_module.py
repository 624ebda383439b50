"""A simulated analogue output: the registers that a supply's file describes, from the module's side of the wire.

The coil, its faults and the output stage are the simulated ECU's (`simulators.ecu.Ecu`); here are its registers. How
numbers lie in them is `simulators.emulated_codec`'s: nothing of the host's driver is used but the description.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from drivers.current_source import SourceFault
from drivers.devices.output import CURRENT, ENABLE, FAULT_BITS, IDENTITY, MEASURED, AnalogueOutput
from drivers.devices.supply import SupplyDescription
from drivers.register_maps.access_plan import reads
from drivers.register_maps.quantity import BITS, SPACES, Quantity
from drivers.register_maps.recipe import Recipe, Write
from simulators.ecu import Ecu
from simulators.emulated_codec import bits_of, lay_down, raw_of, text_words, value_of
from simulators.emulated_status import Registers, make, put
from simulators.modbus_server import ModbusServer

DEVICE_ID = 1


class SimulatedOutput:
    """One module on a Modbus TCP port of its own.

    Args:
        ecu: the coil and its output stage; its own time-out is the module's.
        described: its file.
        output: its registers.
        serial_number: shown where the file has a register for it.
    """

    def __init__(self, ecu: Ecu, described: SupplyDescription, output: AnalogueOutput, serial_number: int) -> None:
        self.ecu = ecu
        self.server = ModbusServer(self, DEVICE_ID)
        self._described = described
        self._output = output
        self._number = serial_number
        self._hosted = ""
        self._cells: dict[tuple[str, int], int] = {}
        self._boots = ecu.boot_count
        self._watching = output.watchdog is not None and not output.watchdog.start
        self._heard_s = self._served_s = 0.0
        held = {(one.space, at) for one in output.quantities.values() for at in range(one.address, one.end)}
        for read in (*output.status, *output.known, *reads(output.quantities.values(), output.rules)):
            held |= {(read.space, read.address + place) for place in range(read.count)}
        self._there = held
        ecu.command_timeout_s = math.inf

    @property
    def url(self) -> str:
        """Where it is, after `open`."""
        return self._hosted or self.server.url

    def is_hosted_by(self, address: str) -> None:
        """Use the registers of a device with sensors at this address (host:port) instead of a separate server."""
        self._hosted = f"modbus-tcp://{address}"

    @property
    def stays_on(self) -> bool:
        """Its current stays when it receives no more commands."""
        return not self._watching

    async def open(self) -> None:
        """Listen on a free port of the loopback interface."""
        if not self._hosted:
            await self.server.open()

    async def close(self) -> None:
        """Stop listening and hang up."""
        if not self._hosted:
            await self.server.close()

    def tick(self, served_s: float) -> None:
        """Judge its own time-out (wall s), and start anew with the output stage."""
        self._served_s = served_s
        faults, link = self.ecu.faults, self.server.faults
        link.silent, link.slow, link.wrong_function = faults.silent, faults.late, faults.wrong_crc
        if self.ecu.boot_count != self._boots:
            self._boots = self.ecu.boot_count
            self._cells.clear()
        watchdog = self._output.watchdog
        if self._watching and watchdog is not None and served_s - self._heard_s > watchdog.time_s and self._is_on:
            self.ecu.log("ECU_FAULT", "COMMAND_TIMEOUT")
            self._cells.clear()
            self._drive()

    def blocks(self) -> dict[str, list[tuple[int, int]]]:
        """First address and count of what is there, by space."""
        runs: dict[str, list[tuple[int, int]]] = {}
        for space in SPACES:
            places = [at for held, at in self._there if held == space]
            if places:
                runs[space] = [(min(places), max(places) - min(places) + 1)]
        return runs

    def bits(self, space: str) -> dict[int, int]:
        """All coils or discrete inputs by address."""
        self._hear("")
        shown = self._cells | self._live()
        return {at: shown.get((space, at), 0) for held, at in self._there if held == space}

    def read(self, address: int, count: int, space: str = "holding") -> list[int] | None:
        """Words from `address`; None when one of them is not there."""
        cells = [(space, at) for at in range(address, address + count)]
        if not self._there.issuperset(cells):
            return None
        self._hear("")
        shown = self._cells | self._live()
        return [shown.get(cell, 0) for cell in cells]

    def write(self, address: int, words: Sequence[int], space: str = "holding") -> bool | None:
        """Take a write; None when something of it cannot be written there."""
        cells = {(space, address + place): int(word) for place, word in enumerate(words)}
        written = [one for one in self._output.quantities.values() if one.written and (one.space, one.address) in cells]
        if not self._there.issuperset(cells) or not written:
            return None
        self._cells |= cells
        for one in written:
            self._hear(one.name)
            if self._output.watchdog is not None and self._states(self._output.watchdog.start, one):
                self._watching = True
            if self._output.watchdog is not None and self._states(self._output.watchdog.stop, one):
                self._watching = False
        if {one.name for one in written} & {CURRENT, ENABLE}:
            if self.ecu.fault_bits & SourceFault.RESTARTED and self._target_A() == 0.0:
                self.ecu.fault_bits = 0
            self._drive()
        return True

    def _hear(self, name: str) -> None:
        """A host spoke: that quiets the time-out, unless something of its own feeds it."""
        watchdog = self._output.watchdog
        feeds = () if watchdog is None else _names(watchdog.feed)
        if not feeds or name in feeds:
            self._heard_s = self._served_s

    @property
    def _is_on(self) -> bool:
        return self._target_A() != 0.0

    def _target_A(self) -> float:
        """What is asked of the amplifier; a register that was not written gives nothing."""
        enable, current = self._output.quantities.get(ENABLE), self._output.current
        if (current.space, current.address) not in self._cells or (enable is not None and not self._raw(enable)):
            return 0.0
        target_A = value_of(current, self._raw(current))
        return 0.0 if abs(target_A) < current.step else target_A

    def _drive(self) -> None:
        target_A = self._target_A()
        self.ecu.obey(target_A, enable=target_A != 0.0, clear_faults=target_A == 0.0)

    def _live(self) -> dict[tuple[str, int], int]:
        """What the module shows of itself now."""
        cells: dict[tuple[str, int], int] = {}
        output = self._output
        measured, current = output.quantities.get(MEASURED), output.current
        if measured is not None:
            shown_A = self.ecu.measured_A(self.ecu.plant.value("current_A"))
            lay_down(cells, measured, raw_of(measured, shown_A))
        if (current.space, current.address) not in self._cells:
            lay_down(cells, current, raw_of(current, 0.0))
        for name, value in self._identity():
            one = output.quantities[name]
            if one.type == "string":
                words = text_words(one, str(value))
                cells |= {(one.space, one.address + place): word for place, word in enumerate(words)}
            else:
                lay_down(cells, one, raw_of(one, float(value)))
        self._show_faults(cells)
        return cells

    def _identity(self) -> Iterator[tuple[str, str | float]]:
        """Who it says it is."""
        expected, quantities = self._output.expected, self._output.quantities
        own: dict[str, str | float] = {
            "vendor": self._described.maker, "model": self._described.model, "serial_number": self._number,
            "firmware": 1,
        }  # fmt: skip
        for name in {*IDENTITY, *expected} & quantities.keys():
            value = expected.get(name, own.get(name, 0))
            yield name, value if quantities[name].type == "string" or isinstance(value, int | float) else 0.0

    def _show_faults(self, cells: dict[tuple[str, int], int]) -> None:
        faults, present = self._output.faults, self.ecu.fault_bits
        registers: Registers = {(one.space, one.address): self._raw(one) for one in faults.quantities}
        for place, member in faults.places.items():
            put(registers, self._output.quantities[FAULT_BITS], place, int(bool(present & member)))
        for member, condition in faults.conditions:
            make(registers, condition, holds=bool(present & member))
        for one in faults.quantities:
            if one.name not in {CURRENT, ENABLE, MEASURED}:
                lay_down(cells, one, registers[one.space, one.address])

    def _states(self, recipe: Recipe, written: Quantity) -> bool:
        """Whether a register contains the value that a recipe writes; start and stop may use the same register."""
        held = {
            value for step in recipe if isinstance(step, Write) for quantity, value in step.values.items()
            if quantity == written and not isinstance(value, str)
        }
        return any(self._raw(written) == raw_of(written, value) for value in held)

    def _raw(self, quantity: Quantity) -> int:
        if quantity.space in BITS:
            return self._cells.get((quantity.space, quantity.address), 0)
        return bits_of(
            quantity,
            [self._cells.get((quantity.space, at), 0) for at in quantity.cells[: quantity.length]],
        )


def _names(recipe: Recipe) -> set[str]:
    """The quantities that a recipe writes."""
    return {quantity.name for step in recipe if isinstance(step, Write) for quantity in step.values}
