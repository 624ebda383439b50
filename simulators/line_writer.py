"""Readings as lines of any text format: by its template where it has one, else in a way made from its pattern."""

from __future__ import annotations

from functools import reduce
from itertools import product
from operator import xor

import numpy as np
from numpy.typing import NDArray

from protocols.errors import LocalProtocolError
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from protocols.line_example import checksum_digits, filled, fitting, parts
from protocols.line_format import LineFormat
from simulators.bit_sums import total_of


class LineWriter:
    """Writes lines of one format.

    Args:
        line_format: what to write.
        low, high: the smallest and the largest reading that is still one (in the format's unit).

    Attributes:
        size: bytes of the longest line, start and terminator included, and of the length behind it where lines differ.

    Raises:
        LocalProtocolError: the format cannot hold these.
    """

    def __init__(self, line_format: LineFormat, low: float, high: float) -> None:
        self._format = line_format
        self._parts = parts(line_format.pattern)
        middle = 0.5 * (low + high)
        values = (low, high, middle, middle + 0.37 * (high - middle), middle + 1e-3 * (high - middle))
        numbers = [self._number(value) for value in values]
        self._style = None if line_format.template else fitting(line_format, numbers)
        if self._style is None and not line_format.template:
            raise LocalProtocolError(
                f"{line_format.name}: values from {low:g} to {high:g} {line_format.unit} do not fit the pattern "
                f"{line_format.pattern!r}"
            )
        self._middle = middle
        words = [self._token(line_format.overload_tokens, "overload"), self._token(line_format.fault_tokens, "fault")]
        lengths = {*(len(self._line(value)) for value in values), *(len(word) for word in words if word)}
        self._longest = max(lengths)
        self.differ = len(lengths) > 1
        self.size = self._longest + self.differ
        self._overload = words[0] or self._noise()
        self._fault = words[1] or self._overload

    def __call__(
        self, value: NDArray[np.float64], status: NDArray[np.uint8], *_: NDArray[np.int64]
    ) -> NDArray[np.uint8]:
        """Lines (n, size) of readings (n,) with their status bits (n,); what is no number is written as an overload."""
        lines = b"".join(map(self._row, value.tolist(), status.tolist()))
        return np.frombuffer(lines, np.uint8).reshape(len(value), self.size)

    def joined(self, rows: NDArray[np.uint8]) -> bytes:
        """The bytes of such lines on the wire."""
        if not self.differ:
            return rows.tobytes()
        return b"".join(row[: row[-1]].tobytes() for row in rows)

    def _row(self, value: float, status: int) -> bytes:
        line = self._fault if status & STATUS_SENSOR_FAULT else self._overload
        if not status & (STATUS_OVERLOAD | STATUS_SENSOR_FAULT):
            try:
                line = self._line(value)
            except LocalProtocolError:
                line = self._overload
        if len(line) > self._longest or (not self.differ and len(line) != self.size):
            line = self._noise()
        return line.ljust(self._longest, b"\0") + bytes([len(line)]) if self.differ else line

    def _number(self, value: float) -> float:
        """What is written for a value, before the implied decimals."""
        return (value - self._format.offset) / self._format.scale

    def _line(self, value: float) -> bytes:
        """One line, start and terminator included.

        Raises:
            LocalProtocolError: the value does not fit.
        """
        layout, number = self._format, self._number(value)
        if not abs(number) < 1e300:
            raise LocalProtocolError(f"{layout.name}: cannot write {value}")
        digits = "0" * checksum_digits(layout)
        if self._style is None:
            shown = number * 10**layout.decimals
            text = self._templated(shown, digits)
        else:
            sign = layout.negative_tokens[0] if number < 0 else self._style.plus
            text = filled(layout, self._parts, self._style.write(number), sign)
        return layout.start + self._summed(text, value).encode(layout.encoding) + layout.terminator

    def _templated(self, shown: float, checksum: str) -> str:
        """The template filled in.

        Raises:
            LocalProtocolError: it asks for something else than value, unit and checksum.
        """
        layout = self._format
        try:
            text = layout.template.format(value=shown, unit=layout.unit, checksum=checksum)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            raise LocalProtocolError(f"{layout.name}: template {layout.template!r}: {error!r}") from error
        return text

    def _summed(self, text: str, value: float) -> str:
        """A line with its checksum in place of zeros.

        Raises:
            LocalProtocolError: the line breaks the pattern.
        """
        layout = self._format
        match = layout.match(text)
        if match is None:
            message = f"{value:g} {layout.unit} does not fit: {text!r} does not match the pattern"
            raise LocalProtocolError(f"{layout.name}: {message}")
        if layout.checksum == "none":
            return text
        first, last = match.span("checksum")
        covered = text[:first]
        if layout.checksum_over is not None:
            covered = text[layout.checksum_over[0] - 1 : layout.checksum_over[1]]
        elif layout.checksum_from or layout.checksum_to:
            begin = text.index(layout.checksum_from) + len(layout.checksum_from) if layout.checksum_from else 0
            covered = text[begin : text.rindex(layout.checksum_to) if layout.checksum_to else first]
        kind = layout.checksum.removesuffix("-hex")
        data = covered.encode(layout.encoding)
        total = reduce(xor, data, 0) if kind == "xor" else total_of(kind, data)
        return f"{text[:first]}{total:0{last - first}X}{text[last:]}"

    def _token(self, tokens: tuple[str, ...], meaning: str) -> bytes:
        """The line of zero with the device's word in place of number or status; empty where none fits."""
        layout = self._format
        line = self._line(self._middle).removeprefix(layout.start).removesuffix(layout.terminator)
        text = line.decode(layout.encoding)
        match = layout.match(text)
        if match is None:
            return b""
        words = [(group, word) for group, listed in (("value", tokens), ("status", layout.status)) for word in listed
                 if group == "value" or layout.status[word] == meaning]  # fmt: skip
        for group, word in words:
            begin, stop = match.span(group)
            room = max(0, stop - begin - len(word))
            for left, right in sorted(product(range(room + 1), repeat=2), key=lambda pads: abs(sum(pads) - room)):
                tried = f"{text[:begin]}{' ' * left}{word}{' ' * right}{text[stop:]}"
                if layout.match(tried) is not None:
                    return layout.start + self._summed(tried, 0.0).encode(layout.encoding) + layout.terminator
        return b""

    def _noise(self) -> bytes:
        """A line that is not taken for a reading."""
        end = self._format.terminator
        return b"?" * (self._longest - len(end)) + end


def span_of(line_format: LineFormat) -> tuple[float, float]:
    """The smallest and the largest value, in the format's unit, that a line can carry; (0, 0) where none can."""
    high = next((value for value in _STEPS if _carries(line_format, 0.0, value)), 0.0)
    low = next((-value for value in _STEPS if value <= high and _carries(line_format, -value, high)), 0.0)
    return low, high


_STEPS = tuple(9.0 * 10.0**exponent for exponent in range(9, -7, -1))


def _carries(line_format: LineFormat, low: float, high: float) -> bool:
    try:
        LineWriter(line_format, low * line_format.scale, high * line_format.scale)
    except LocalProtocolError:
        return False
    return True
