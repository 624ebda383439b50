"""A simulated programmable supply: it speaks whatever language a supply's file describes, from the device's side.

The coil, its faults and the output stage are the simulated ECU's (`simulators.ecu.Ecu`); here are its lines. How
numbers stand in them is this file's own: nothing of the host's driver is used but the description.
"""

from __future__ import annotations

import asyncio
import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from drivers.current_source import SourceFault
from drivers.devices.supply import SupplyDescription
from drivers.devices.supply_file import supply
from protocols.patterns import Pattern
from protocols.scpi import Command
from rig.files.described import described as read_description
from simulators.ecu import Ecu
from simulators.output_module import SimulatedOutput

NO_ERROR = '+0,"No error"'
UNDEFINED = '-113,"Undefined header"'
OUT_OF_RANGE = '-222,"Data out of range"'
MOST_ERRORS = 20
LATE_S = 0.7
"""By so much answers are late where the supply is at fault; longer than a host waits for one."""
SWITCHED_OFF = SourceFault.OVER_TEMPERATURE | SourceFault.UNDERVOLTAGE | SourceFault.RESTARTED
LINE_ENDS = re.compile(rb"\r\n|\r|\n")

_VALUE = re.compile(r"\(\?P<value>[^()]*(?:\([^()]*\)[^()]*)*\)")
_PER_SI = {"A": 1.0, "V": 1.0, "s": 1.0, "mA": 1e3, "mV": 1e3, "ms": 1e3}
_FIELD = re.compile(r"\\\{([a-z]+)_([a-zA-Z]+)(?::[^}]*)?\\\}")
FAULTS = SourceFault.OVER_TEMPERATURE | SourceFault.UNDERVOLTAGE | SourceFault.OPEN | SourceFault.SHORT
"""Faults of the output stage that a supply reports, where its description has them."""


def pattern_of(text: str) -> re.Pattern[str]:
    """What a command line looks like, whatever numbers stand in it."""
    escaped = re.escape(text).replace(r"\ ", r"\s+").replace(r"\:", ":")
    return re.compile(_FIELD.sub(r"(?P<\1_\2>[-+0-9.eE]+)", escaped), re.IGNORECASE)


def numbers_in(match: re.Match[str]) -> dict[str, float]:
    """The numbers of a command in SI, by quantity."""
    return {
        quantity: float(text) / _PER_SI[unit]
        for quantity, unit, text in ((*name.split("_"), text) for name, text in match.groupdict().items())
    }


def number_like(value: float, pattern: Pattern | None) -> str:
    """A number as an answer: as IEEE 488.2 writes it, or as a description says that this supply does."""
    plain, exponent = f"{value:.5f}", f"{value:+.5E}"
    if pattern is None:
        return exponent
    own = text_like(_VALUE.sub("@", pattern.text))
    shapes = [shape.replace("@", plain) for shape in ("@", "@A", "@ A", "@V", own)]
    return next((shape for shape in (exponent, *shapes) if pattern.search(shape)), plain)


def text_like(pattern: str) -> str:
    """A text that a simple pattern stands for: its own letters."""
    return re.sub(r"\\([^\w])", r"\1", pattern.strip("^$")).replace(r"\s*", "").replace(r"\s+", " ").split("|")[0]


def _query(answer: Callable[[], str]) -> Callable[[dict[str, float]], str | None]:
    return lambda _: answer()


@dataclass
class _Meaning:
    """A command that the supply knows: what it looks like, and what it does; it returns the answer to a question."""

    pattern: re.Pattern[str]
    do: Callable[[dict[str, float]], str | None]


class SimulatedSupply:
    """One supply on a TCP port of its own.

    Args:
        ecu: the coil and its output stage; its own time-out is the supply's.
        described: its language.
        identity: what it says it is.

    Attributes:
        url: where it is on this machine, after `open`.
    """

    def __init__(self, ecu: Ecu, described: SupplyDescription, identity: str) -> None:
        self.url = ""
        self.ecu = ecu
        self.described = described
        self.identity = identity
        ecu.command_timeout_s = math.inf
        self.on = False
        self.current_A = 0.0
        self.limit_V = math.inf
        self._watching = False
        self._heard_s = self._served_s = 0.0
        self._errors: deque[str] = deque(maxlen=MOST_ERRORS)
        self._server: asyncio.Server | None = None
        self._clients: list[SupplyClient] = []
        self._off = next(text for text in ("0", "OFF", "off") if text not in described.on)
        self._no_error = NO_ERROR if described.no_error.search(NO_ERROR) else text_like(described.no_error.text)
        self._meanings = list(self._meanings_of())

    @property
    def stays_on(self) -> bool:
        """Its current stays when it receives no more commands."""
        return not self._watching

    async def open(self) -> None:
        """Listen on a free port of the loopback interface."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: SupplyClient(self), "127.0.0.1", 0)
        self.url = f"tcp://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def close(self) -> None:
        """Stop listening and hang up."""
        if self._server is not None:
            self._server.close()
        for client in list(self._clients):
            client.hang_up()

    def tick(self, served_s: float) -> None:
        """Judge its own time-out, if it has one (wall s)."""
        self._served_s = served_s
        watchdog = self.described.watchdog
        if self._watching and watchdog is not None and served_s - self._heard_s > watchdog.time_s and self.on:
            self.ecu.log("ECU_FAULT", "COMMAND_TIMEOUT")
            self._switch(on=False)

    def line(self, text: str) -> str | None:
        """Take one line; the answer, None where there is none."""
        self._heard_s = self._served_s
        for meaning in self._meanings:
            if (match := meaning.pattern.fullmatch(text.strip())) is not None:
                return meaning.do(numbers_in(match))
        self._errors.append(UNDEFINED)
        return None

    def joined(self, client: SupplyClient) -> None:
        """A host connected."""
        self._clients.append(client)

    def left(self, client: SupplyClient) -> None:
        """A host hung up."""
        if client in self._clients:
            self._clients.remove(client)

    def _meanings_of(self) -> Iterator[_Meaning]:
        commands, watchdog = self.described.commands, self.described.watchdog
        queries: list[tuple[tuple[Command, ...], Callable[[], str]]] = [
            (commands.identify, lambda: self.identity),
            (commands.measure_current, lambda: number_like(self._measured_A(), self.described.current)),
            (commands.measure_voltage, lambda: number_like(self._volts(), self.described.voltage)),
            (commands.read_output, lambda: self.described.on[0] if self._is_on else self._off),
            (commands.error_queue, lambda: self._errors.popleft() if self._errors else self._no_error),
            (commands.read_faults, lambda: f"{self._fault_bits()}"),
        ]
        for questions, answer in queries:
            yield from (_Meaning(pattern_of(question.text), _query(answer)) for question in questions)
        settings: list[tuple[tuple[Command, ...], Callable[[dict[str, float]], None]]] = [
            (commands.set_current, self._set_current),
            (commands.set_voltage_limit, self._set_limit),
            (commands.output_on, lambda _: self._switch(on=True)),
            (commands.output_off, lambda _: self._switch(on=False)),
            (commands.clear, lambda _: self._errors.clear()),
            ((*commands.connect, *commands.remote, *commands.local, *commands.prepare), lambda _: None),
        ]
        if watchdog is not None:
            settings += [(watchdog.start, lambda _: self._watch(True)), (watchdog.stop, lambda _: self._watch(False)),
                     (watchdog.feed, lambda _: None)]  # fmt: skip
        for orders, do in settings:
            yield from (_Meaning(pattern_of(order.text), do) for order in orders)

    def _watch(self, watching: bool) -> None:
        self._watching = watching

    def _set_current(self, numbers: dict[str, float]) -> None:
        low_A, high_A = self.described.current_A
        if not low_A <= numbers["current"] <= high_A:
            self._errors.append(OUT_OF_RANGE)
            return
        self.current_A = numbers["current"]
        self._drive()

    def _set_limit(self, numbers: dict[str, float]) -> None:
        self.limit_V = numbers["voltage"]

    def _switch(self, *, on: bool) -> None:
        self.on = on
        if on:
            self.ecu.fault_bits = 0
        self._drive()

    def _drive(self) -> None:
        """What the set-point and the switch make of the output; a supply without a switch is always on."""
        on = self.on or not self.described.commands.output_on
        self.ecu.obey(self.current_A if on else 0.0, enable=on, clear_faults=False)

    @property
    def _is_on(self) -> bool:
        return self.on and not self.ecu.fault_bits & SWITCHED_OFF

    def _measured_A(self) -> float:
        return self.ecu.measured_A(self.ecu.plant.value("current_A"))

    def _volts(self) -> float:
        """At the output: what the coil takes, or the limit where no current flows that should."""
        if self.on and self.ecu.faults.coil_open and self.current_A != 0.0:
            return min(self.limit_V, 1e3)
        return self.ecu.plant.value("current_A") * self.ecu.options.ohm

    def _fault_bits(self) -> int:
        present = self.ecu.fault_bits & FAULTS
        return sum(bit for bit, meaning in self.described.faults if present & meaning)


class SupplyClient(asyncio.Protocol):
    """One connection: cuts lines, answers them."""

    def __init__(self, supply: SimulatedSupply) -> None:
        self._supply = supply
        self._rest = b""
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A host is there.

        Raises:
            TypeError: the transport is no stream.
        """
        if not isinstance(transport, asyncio.Transport):
            raise TypeError(f"a supply requires a stream transport, got {type(transport).__name__}")
        self._transport = transport
        self._supply.joined(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """The host is gone."""
        del exc
        self._supply.left(self)

    def data_received(self, data: bytes) -> None:
        """Cut into lines; a chunk may begin and end anywhere."""
        *lines, self._rest = LINE_ENDS.split(self._rest + data)
        for line in lines:
            if line.strip():
                self._answer(line.decode("ascii", "replace"))

    def hang_up(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def _answer(self, line: str) -> None:
        supply, faults = self._supply, self._supply.ecu.faults
        answer = supply.line(line)
        link = supply.described.link
        replies = [line] if link.echo else []
        if answer is not None:
            replies.append(answer.translate(GARBLED) if faults.wrong_crc else answer)
        elif link.acknowledge:
            replies.append(text_like(link.acknowledge.text))
        if faults.silent or not replies:
            return
        data = b"".join(text.encode("ascii", "replace") + link.terminator.encode("ascii") for text in replies)
        if faults.late:
            asyncio.get_running_loop().call_later(LATE_S, self._write, data)
        else:
            self._write(data)

    def _write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)


GARBLED = str.maketrans("0123456789", "#?!*%&/()=")


def simulated_supply(
    ecu: Ecu, given: str | Mapping[str, Any], serial_number: int
) -> SimulatedSupply | SimulatedOutput | None:
    """A supply that says it is of its description's kind; None where nothing is given."""
    if not given:
        return None
    described = supply(read_description("supply", given))
    if described.output is not None:
        return SimulatedOutput(ecu, described, described.output, serial_number)
    maker, model = described.maker or "SIMULATED", (described.model or described.name).split(",")[0]
    identity = f"{maker},{model},{serial_number},1.0"
    if described.identity is not None and not described.identity.search(identity):
        identity = text_like(described.identity.text)
    return SimulatedSupply(ecu, described, identity)
