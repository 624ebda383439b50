"""Question and answer with a supply: one line at a time, each answer matched with what it belongs to.

The reading thread works off what is to be asked. Other threads put commands on the wire at any time (`send_now`): bytes
keep their order, so what comes back does too.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from enum import Enum, auto
from typing import NamedTuple

from drivers import clock
from drivers.devices.supply import Commands, SupplyLink
from drivers.serial_port import SerialPort
from protocols.scpi import AnswerLines, Command


class ExpectedReply(Enum):
    """What an answer that is waited for is about."""

    ECHO = auto()
    ACKNOWLEDGE = auto()
    IDENTITY = auto()
    CURRENT = auto()
    VOLTAGE = auto()
    OUTPUT = auto()
    ERROR = auto()
    FAULTS = auto()
    EARLIER = auto()
    """The current, asked for before the newest set-point was sent."""
    NOTHING = auto()
    """It was not requested."""


class Job(NamedTuple):
    """A command to be sent; `wanted` is what its answer is about, None: it has none.

    `number` is that of the set-point it belongs to: it is left out when there is a newer one. None: it belongs to none.
    """

    command: Command
    reply: ExpectedReply | None = None
    number: int | None = None


class SupplyDialogue:
    """Lines to a supply and its answers.

    Args:
        port: opened and closed by the caller.
        link: how lines go over the wire.
        timeout_s: longest wait for an answer (s).
        identify: asks for something whose answer is known and like no other, to find out where an answer belongs.
        numbers: current (A), voltage (V) and time (s) to put into commands, at the moment they are sent.

    Attributes:
        jobs: what is still to be sent, one line after the other.
        set_point: number of the newest set-point.
        late: answers that stayed away for longer than the time-out.
        refused: a command was not acknowledged as described.
    """

    def __init__(
        self, port: SerialPort, link: SupplyLink, timeout_s: float, identify: Commands,
        numbers: Callable[[], tuple[float, float, float]],
    ) -> None:
        self.jobs: deque[Job] = deque()
        self.set_point = 0
        self.late = 0
        self.refused = False
        self._port = port
        self._link = link
        self._timeout_ns = int(timeout_s * 1e9)
        self._identify = identify
        self._numbers = numbers
        self._acknowledge = link.acknowledge
        self._lines = AnswerLines()
        self._lock = threading.Lock()
        self._expected: deque[tuple[ExpectedReply, str, int]] = deque()
        self._request_ns = self._free_ns = 0
        self._known = ""
        self._sent_again = False
        self._strays = 0  # answers to `identify` that are still to come, or may be; 0: every answer has a request

    @property
    def malformed(self) -> int:
        """Lines that cannot be answers."""
        return self._lines.malformed

    @property
    def waits(self) -> bool:
        """Something that was sent is not answered yet."""
        return bool(self._expected)

    def know(self, answer: str) -> None:
        """What `identify` is answered with."""
        self._known = answer

    def forget(self) -> None:
        """Begin anew: nothing is to be sent, nothing is waited for."""
        with self._lock:
            self._expected.clear()
        self.jobs.clear()
        self._lines.forget()
        self._strays = 0

    def send_now(self, commands: Callable[[], Iterable[Command]]) -> None:
        """Put a new set-point on the wire at once, in one piece; what is still to be sent of an older one is dropped.

        Args:
            commands: says what is to be sent, when it is this set-point's turn.

        Raises:
            PortClosed: the port is gone.
            LinkLost: it does not take them.
        """
        with self._lock:
            self.set_point += 1
            self._write([Job(command) for command in commands()])

    def go_on(self, now_ns: int) -> int:
        """Send the next line, if its turn has come; when to look again (ns), 0 where nothing is to be done.

        Raises:
            PortClosed: the port is gone.
            LinkLost: it does not take the line.
        """
        if self._expected:
            late_ns = self._request_ns + self._timeout_ns
            if now_ns < late_ns:
                return late_ns
            self._find_out()
        if now_ns < self._free_ns:
            return self._free_ns
        if not self.jobs:
            return 0
        job = self.jobs.popleft()
        with self._lock:
            if job.number in {None, self.set_point}:
                self._write([job])
                self._free_ns = now_ns + int(self._link.gap_s * 1e9)
        return self._request_ns + self._timeout_ns if self._expected else max(now_ns, self._free_ns)

    def feed(self, data: bytes) -> Iterator[tuple[ExpectedReply, str]]:
        """Take what has arrived; every answer to a request, and what it is about."""
        for answer in self._lines.feed(data):
            if self._strays:
                if answer == self._known:
                    self._find_back()
                continue
            with self._lock:
                kind, sent, number = self._expected.popleft() if self._expected else (ExpectedReply.NOTHING, "", 0)
                if kind is ExpectedReply.CURRENT and number != self.set_point:
                    kind = ExpectedReply.EARLIER
            if kind is ExpectedReply.ACKNOWLEDGE and self._acknowledge is not None:
                self.refused |= not self._acknowledge.search(answer)
            elif kind is not ExpectedReply.ECHO or answer != sent:
                yield kind, answer

    def _find_out(self) -> None:
        """Ask who it is, and throw everything away until that is answered: a late answer is not taken for another.

        Where it was asked before in vain, that answer may still come: all of them are waited for. When only some came
        and then nothing for a whole time-out, the others never will.
        """
        self.late += 1
        strays, settled = self._strays, self._sent_again
        self.forget()
        self._sent_again = False
        if settled:
            return
        if self._known and self._identify:
            self._strays = strays + 1
            self.jobs.extend(Job(command, ExpectedReply.IDENTITY) for command in self._identify)

    def _find_back(self) -> None:
        """It has said who it is: once for every time it was asked, and the next answer has a request again."""
        self._strays -= 1
        self._sent_again = True
        self._request_ns = clock.monotonic_ns()
        if not self._strays:
            self._sent_again = False
            with self._lock:
                while self._expected and self._expected.popleft()[0] is not ExpectedReply.IDENTITY:
                    pass

    def _write(self, jobs: Iterable[Job]) -> None:
        """Put lines on the wire, and remember what will come back; under the lock."""
        numbers, data = self._numbers(), b""
        for job in jobs:
            line = job.command.line(*numbers)
            data += line + self._link.terminator.encode("ascii")
            if self._link.echo:
                self._expected.append((ExpectedReply.ECHO, line.decode("ascii").strip(), self.set_point))
            if job.reply is not None:
                self._expected.append((job.reply, "", self.set_point))
            elif self._acknowledge is not None:
                self._expected.append((ExpectedReply.ACKNOWLEDGE, "", self.set_point))
        if data:
            self._request_ns = clock.monotonic_ns()
            self._port.write(data)
