"""Listening to a sensor without a description: what comes, at which rate, in which format; nothing is sent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers import clock
from drivers.connection import LineSettings
from drivers.sensor_formats import FRAME16, Given, described_format
from drivers.serial_port import SerialPort
from protocols.binary_decoder import BinaryDecoder
from protocols.errors import LocalProtocolError
from protocols.frame_format import FrameDecoder
from protocols.guess_frames import described_frames
from protocols.guess_lines import described_lines, text_share
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_presets import TABLES

RATES = (921_600, 115_200, 9600, 38_400, 57_600, 230_400, 460_800, 256_000, 19_200, 1_000_000)
"""Baud rates in the order in which they are tried."""
ENOUGH = 0.9
"""A format is believed when so much of what came belongs to its readings."""
FEWEST = 3
MOST_BYTES = 1 << 15
"""Read at one baud rate: hundreds of readings; each candidate format decodes them byte by byte."""
MOST_MISSED = 20


@dataclass(frozen=True)
class Match:
    """A format tried on bytes.

    Attributes:
        name: the format's: a preset's, a file's, or what it was guessed to be.
        given: as a bench file would have it: a name, or a table.
        size: bytes that there were.
        matched: bytes of accepted lines or frames.
        readings: (value, status bits) of each.
        damaged: lines or frames that were not accepted.
        missed: (offset behind them, count) of bytes that belonged to nothing; the first `MOST_MISSED` places.
    """

    name: str
    given: Given
    size: int
    matched: int
    readings: Sequence[tuple[float, int]]
    damaged: int
    missed: Sequence[tuple[int, int]] = field(default=())

    @property
    def share(self) -> float:
        """Share of the bytes that belong to readings."""
        return self.matched / max(1, self.size)

    @property
    def believed(self) -> bool:
        """Enough fits for this to be the format."""
        finite = sum(math.isfinite(value) for value, _ in self.readings)
        return self.share >= ENOUGH and len(self.readings) >= FEWEST and 2 * finite >= len(self.readings)


def tried(data: bytes, given: Given, name: str = "") -> Match:
    """Decode bytes by a format.

    Args:
        data: as received; may begin and end inside of a line or frame.
        given: a format's name, or its table.
        name: for a table.

    Raises:
        DescriptionProblems: the description cannot be used.
        LocalProtocolError: no format of that name.
    """
    decoder: FrameDecoder | LineDecoder | BinaryDecoder = FrameDecoder()
    behind = 0
    if given != FRAME16:
        described = described_format(given)
        answers = bool(described.exchange.request)
        if isinstance(described, LineFormat):
            decoder, behind = LineDecoder(described, answers=answers), len(described.terminator)
        else:
            decoder = BinaryDecoder(described, answers=answers)
    readings: list[tuple[float, int]] = []
    missed: list[tuple[int, int]] = []
    end = skipped_then = skipped = 0
    for at in range(len(data)):
        for _, _, value, status, _ in decoder.feed(data[at : at + 1]):
            readings.append((value, status))
            end, skipped_then = at + 1, decoder.skipped_bytes
        if decoder.skipped_bytes > skipped:
            if missed and missed[-1][0] == at:
                missed[-1] = (at + 1, missed[-1][1] + decoder.skipped_bytes - skipped)
            elif len(missed) < MOST_MISSED:
                missed.append((at + 1 - behind, decoder.skipped_bytes - skipped))
            skipped = decoder.skipped_bytes
    matched = max(0, end - skipped_then)
    shown = name or (given if isinstance(given, str) else str(given.get("name", "described")))
    return Match(shown, given, len(data), matched, readings, decoder.bad_frames, missed)


def guessed(data: bytes) -> Match | None:
    """The format of captured bytes: the project's own and the presets first, then lines, packed streams and frames."""
    best: Match | None = None
    for given, name in _candidates(data):
        try:
            match = tried(data, given, name)
        except LocalProtocolError:
            continue
        if match.believed:
            return match
        if match.readings and (best is None or match.share > best.share):
            best = match
    return best if best is not None and best.share >= 0.5 else None


def _candidates(data: bytes) -> Iterator[tuple[Given, str]]:
    yield FRAME16, FRAME16
    checked = sorted(TABLES, key=lambda name: ("checksum" not in TABLES[name], "request" in TABLES[name]))
    text = text_share(data) >= ENOUGH
    for name in checked:
        if text == ("pattern" in TABLES[name]):
            yield name, name
    for table in described_lines(data):
        yield table, "lines"
    if not text:
        for table in described_frames(data):
            yield table, "packed stream" if "packed" in table else "frames"


@dataclass(frozen=True)
class Heard:
    """What was heard at one baud rate.

    Attributes:
        baudrate: Bd; 0 for a socket, which has none.
        data: bytes.
        seconds: for how long.
        match: its format, None where none fits.
    """

    baudrate: int
    data: bytes
    seconds: float
    match: Match | None


def listen(url: str, line: LineSettings, seconds: float) -> tuple[bytes, float]:
    """What arrives on a port, and the time it took (s); nothing is sent.

    Stops after `MOST_BYTES`: a format shows in fewer, and a port that floods would fill the memory.

    Raises:
        PortClosed: the port cannot be opened, or has gone.
    """
    port = SerialPort(
        url, line.baudrate, device="port", bytesize=line.data_bits, parity=line.parity, stopbits=line.stop_bits
    )
    port.open()
    data = bytearray()
    begin_s = clock.monotonic()
    try:
        while len(data) < MOST_BYTES and (left_s := begin_s + seconds - clock.monotonic()) > 0.0:
            data += port.read_available(min(left_s, 0.1))[0]
    finally:
        port.close()
    return bytes(data[:MOST_BYTES]), clock.monotonic() - begin_s


def listened(url: str, line: LineSettings | None, seconds: float) -> list[Heard]:
    """Listen at one rate, or at each until one makes sense; the last one heard is the best.

    Args:
        url: the port.
        line: its settings; None to try the usual rates, without parity and with an even one.
        seconds: for how long at each.

    Raises:
        PortClosed: the port cannot be opened, or has gone.
    """
    tries = [line] if line is not None else [LineSettings(rate) for rate in RATES]
    if url.startswith(("socket://", "loop://")):
        tries = [line or LineSettings()]
    rounds: list[Heard] = []
    for settings in tries:
        data, heard_s = listen(url, settings, seconds)
        rounds.append(Heard(settings.baudrate, data, heard_s, guessed(data) if data else None))
        match = rounds[-1].match
        if match is not None and match.believed:
            return rounds
    rounds.sort(key=lambda heard: (0.0 if heard.match is None else heard.match.share, text_share(heard.data)))
    return rounds


def entries(match: Match) -> Mapping[str, Any] | str:
    """The format as a bench file has it, without what only serves its finding."""
    return match.given if isinstance(match.given, str) else dict(match.given)
