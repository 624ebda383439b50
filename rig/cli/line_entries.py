"""Entries of a production line: lines of the keyboard or a keyboard wedge on standard input, and of a serial port."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rig.errors import FileProblem

if TYPE_CHECKING:
    from rig.campaign.results import Display, PointResult

LIST_WAIT_S = 0.5
"""Time in which a list of serial numbers on standard input ends."""
BAUDRATE = 9600
LONGEST_LINE = 4096
STANDARD_INPUT = "standard input"


@dataclass(frozen=True)
class Typed:
    """One line, or the end of a source (`text` None)."""

    text: str | None
    source: str


class Lines(Protocol):
    """Where lines come from."""

    def readline(self, most: int, /) -> str:
        """The next line with its end; empty at the end."""

    def close(self) -> None:
        """Release the source."""


class Port(Protocol):
    """A serial port."""

    def read(self, size: int, /) -> bytes:
        """Wait for bytes."""

    def close(self) -> None:
        """Release the port."""


class Entries:
    """Lines from all sources, in the order of arrival.

    Args:
        reader: serial port of a barcode reader, or a file with its lines; None: standard input alone.

    Raises:
        FileProblem: the port cannot be opened.
    """

    def __init__(self, reader: str | None = None, stdin: Lines | None = None) -> None:
        self._lines: queue.SimpleQueue[Typed] = queue.SimpleQueue()
        self._sources = 1
        self._ended: list[Typed] = []
        own = sys.stdin if stdin is None else stdin
        self._follow(own, STANDARD_INPUT)
        if reader is not None:
            self._sources += 1
            self._follow(_opened(reader), reader)

    def _follow(self, stream: Lines, name: str) -> None:
        def follow() -> None:
            try:
                while line := stream.readline(LONGEST_LINE):
                    self._lines.put(Typed(line.rstrip("\r\n"), name))
            except (OSError, ValueError):
                pass  # the source is gone: reported as its end
            finally:
                if stream is not sys.stdin:
                    stream.close()
            self._lines.put(Typed(None, name))

        threading.Thread(target=follow, name=f"entries of {name}", daemon=True).start()

    def next(self) -> Typed | None:
        """The next line; waits for it. None when every source has ended."""
        if self._ended and self._sources:  # a reader that was lost during a test
            return self._ended.pop()
        while self._sources:
            typed = self._lines.get()
            if typed.text is not None:
                return typed
            self._sources -= 1
            if self._sources and typed.source != STANDARD_INPUT:
                return typed
        return None

    def arrived(self) -> Iterator[Typed]:
        """Lines that have arrived, without waiting."""
        while True:
            try:
                typed = self._lines.get_nowait()
            except queue.Empty:
                return
            if typed.text is None:
                self._sources -= 1
                self._ended += [typed] if typed.source != STANDARD_INPUT else []
            else:
                yield typed

    def list_at_once(self) -> list[str] | None:
        """All lines if standard input ends at once, as that of a list in a file or a pipe does; else None.

        With a barcode reader, there is no list.

        Lines that came but did not end are kept for `next`.
        """
        if self._sources > 1:
            return None
        came: list[Typed] = []
        ended = False
        while not ended:
            try:
                typed = self._lines.get(timeout=LIST_WAIT_S)
            except queue.Empty:
                break
            came.append(typed)
            ended = typed.text is None
        if ended:
            self._sources -= 1
            return [typed.text for typed in came if typed.text is not None]
        for typed in came:
            self._lines.put(typed)
        return None


def _opened(reader: str) -> Lines:
    """The serial port of a barcode reader, or a file or pipe.

    Raises:
        FileProblem: it cannot be opened.
    """
    path = Path(reader)
    try:
        if path.is_char_device():
            import serial  # not needed for keyboards

            port = serial.Serial(reader, BAUDRATE, timeout=None)
            return _PortLines(port)
        return path.open(encoding="utf-8", errors="replace")
    except (OSError, ValueError) as error:
        raise FileProblem(reader, [
            f"the barcode reader cannot be opened: {error}. Fix: check the port, or use a reader in keyboard mode"
        ]) from error


class _PortLines:
    """Lines of a serial port, which end with CR, LF or both."""

    def __init__(self, port: Port) -> None:
        self._port = port

    def close(self) -> None:
        """Release the port."""
        self._port.close()

    def readline(self, most: int, /) -> str:
        """One line with a line end; empty lines are left out."""
        line = b""
        while len(line) < most:
            sign = self._port.read(1)
            if sign in {b"\r", b"\n"}:
                if line:
                    break
                continue
            line += sign
        return line.decode("utf-8", "replace") + "\n"


class WatchingDisplay:
    """The display of a campaign that also takes entries, which are refused during a test.

    Implements `rig.campaign.results.Display`.

    Args:
        display: the usual one.
        refuse: what an entry is answered.
        entries: the sources; None: none is read during a test.
        recorded: called when a point has been recorded: the computer has time to prepare the next specimen.
    """

    def __init__(
        self, display: Display, entries: Entries | None, refuse: Callable[[str], str],
        recorded: Callable[[], None] = lambda: None,
    ) -> None:
        self._recorded = recorded
        self._display = display
        self._entries = entries
        self._refuse = refuse
        self.planned, self.message = display.planned, display.message

    def look(self) -> None:
        """Refuse what has arrived."""
        for typed in () if self._entries is None else self._entries.arrived():
            if text := self._refuse(typed.text or ""):
                self._display.message("warning", text)

    def phase(self, text: str) -> None:
        """The campaign entered another phase."""
        self.look()
        self._display.phase(text)

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """Live numbers."""
        self.look()
        self._display.progress(point_id, cycles_done, time_left_s, live)

    def point_done(self, result: PointResult) -> None:
        """A point has its verdict."""
        self.look()
        self._display.point_done(result)
        self._recorded()
