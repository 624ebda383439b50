"""Readings as lines of any ASCII format, every line of the same length."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from protocols.errors import LocalProtocolError
from protocols.line_format import LineFormat


class LineWriter:
    """Writes lines of one format.

    Args:
        line_format: with a template.
        largest: the largest reading that is still one (in the format's unit); beyond it the line says overload.

    Attributes:
        size: bytes of a line, its terminator included.

    Raises:
        LocalProtocolError: the format has no template, cannot hold `largest`, or its lines differ in length.
    """

    def __init__(self, line_format: LineFormat, largest: float) -> None:
        self._format = line_format
        sizes = {len(line_format.encode(value)) for value in (0.0, largest, -largest)}
        if len(sizes) > 1:
            raise LocalProtocolError(f"line format {line_format.name!r}: its lines differ in length")
        self.size = sizes.pop()
        self._overload = self._overloaded() or self._noise()

    def __call__(self, value: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Lines (n, size) of readings (n,); what is no number, or does not fit, is written as an overload."""
        lines = b"".join(map(self._line, value.tolist()))
        return np.frombuffer(lines, np.uint8).reshape(len(value), self.size)

    def _line(self, value: float) -> bytes:
        try:
            line = self._format.encode(value)
        except LocalProtocolError:
            line = b""
        return line if len(line) == self.size else self._overload

    def _overloaded(self) -> bytes:
        """The line of zero with the device's word for an overload in place of the number; empty where none fits."""
        end = self._format.terminator
        text = self._format.encode(0.0).removesuffix(end).decode("ascii")
        match = re.fullmatch(self._format.pattern, text, re.ASCII)
        if match is None or self._format.checksum != "none":
            return b""
        begin, stop = match.span("value")
        fitting = (token for token in self._format.overload_tokens if len(token) == stop - begin)
        token = next(fitting, "")
        return (text[:begin] + token + text[stop:]).encode("ascii") + end if token else b""

    def _noise(self) -> bytes:
        """A line that nobody takes for a reading."""
        end = self._format.terminator
        return b"?" * (self.size - len(end)) + end
