r"""ASCII lines: one reading a line, described by data.

    signed-decimal       +0001234.5 N\r\n
    laumas-fast          001234\r\n                  negative: -01234\r\n
    laumas-checksummed   &T001234P000000\03\r        two hex digits: XOR of the characters between & and \
    hbm-aed              +0012345\r\n                after MSV?0; until STP;
    flintec              G+01.100\r\n                after SG\r

A line is accepted whole or not at all: the pattern must match all of it, the number must be plain ASCII decimal, the
unit must be the expected one and the checksum right. The first line after the start is dropped, for its beginning may
be missing. Without a checksum a flipped digit cannot be seen; fixed-width patterns at least see lost bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import reduce
from operator import xor

from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.frame_format import SEQUENCE_MODULUS, STATUS_OVERLOAD, STATUS_SENSOR_FAULT, Reading

LONGEST_LINE = 256
CHECKSUMS = ("none", "xor-hex")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)", re.ASCII)
_NO_CLOCK = -1


@dataclass(frozen=True)
class LineFormat:
    r"""How one reading is written as a line of ASCII text.

    Attributes:
        name: as in the bench file.
        pattern: regular expression for the line without its terminator; it must match all of it. Group `value` is the
            number; groups `unit` and `checksum` are optional.
        terminator: bytes that end a line, e.g. b"\r\n".
        decimals: implied decimal places, applied when the number is written without a point.
        unit: unit of the value; a `unit` group must equal it.
        overload_tokens: texts in place of the number that mean "input out of range".
        fault_tokens: texts in place of the number that mean "sensor broken or not connected".
        checksum: "none", or "xor-hex": XOR of the checked characters as two hexadecimal digits.
        checksum_from, checksum_to: characters around what the checksum covers, themselves not covered.
        start_command, stop_command: bytes that start and stop the device's own sending, if it needs them.
        maximum_length: longest line, terminator not counted; what grows beyond is garbage.
        nominal_rate_Hz: lines a second, or None.
        template: how `encode` writes a line without terminator, from `value` (scaled by the implied decimals),
            `unit` and `checksum`; "" if nobody needs to write it.

    Raises:
        LocalProtocolError: the description contradicts itself.
    """

    name: str
    pattern: str
    terminator: bytes = b"\r\n"
    decimals: int = 0
    unit: str = "N"
    overload_tokens: tuple[str, ...] = ()
    fault_tokens: tuple[str, ...] = ()
    checksum: str = "none"
    checksum_from: str = ""
    checksum_to: str = ""
    start_command: bytes = b""
    stop_command: bytes = b""
    maximum_length: int = 64
    nominal_rate_Hz: float | None = None
    template: str = ""
    _regex: re.Pattern[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        try:
            regex = re.compile(self.pattern, re.ASCII)
        except re.error as error:
            raise LocalProtocolError(f"line format {self.name!r}: pattern {self.pattern!r}: {error}") from error
        object.__setattr__(self, "_regex", regex)
        for wrong, message in (
            ("value" not in regex.groupindex, "pattern needs a group (?P<value>...)"),
            (not self.terminator, "terminator must not be empty"),
            (not 1 <= self.maximum_length <= LONGEST_LINE, f"maximum_length must be 1..{LONGEST_LINE}"),
            (not 0 <= self.decimals <= 9, "decimals must be 0..9"),
            (
                self.nominal_rate_Hz is not None and not 0 < self.nominal_rate_Hz < math.inf,
                "nominal_rate_Hz must be a positive number",
            ),
            (self.checksum not in CHECKSUMS, f"checksum must be one of {', '.join(CHECKSUMS)}"),
            (
                self.checksum != "none" and not (self.checksum_from and self.checksum_to),
                "a checksum needs checksum_from and checksum_to",
            ),
            (self.checksum != "none" and "checksum" not in regex.groupindex, "pattern needs a group (?P<checksum>...)"),
        ):
            if wrong:
                raise LocalProtocolError(f"line format {self.name!r}: {message}")

    def decode(self, line: bytes) -> tuple[float, int]:
        """Value and status bits of one line.

        Args:
            line: without its terminator.

        Returns:
            Value in `unit` (NaN for an overload or fault token) and status bits as in the 16-byte frame.

        Raises:
            RemoteProtocolError: the line is not one of this format.
        """
        if len(line) > self.maximum_length:
            raise RemoteProtocolError(f"{self.name}: {len(line)} bytes in a line, at most {self.maximum_length} belong")
        try:
            text = line.decode("ascii")
        except UnicodeDecodeError as error:
            raise RemoteProtocolError(f"{self.name}: not ASCII: {line!r}") from error
        match = self._regex.fullmatch(text)
        if match is None:
            raise RemoteProtocolError(f"{self.name}: {text!r} does not match {self.pattern!r}")
        groups = match.groupdict()
        if self.checksum != "none" and groups["checksum"].upper() != self._checksum(text):
            raise RemoteProtocolError(f"{self.name}: {text!r} has checksum {self._checksum(text)}")
        if groups.get("unit") not in {None, self.unit}:
            raise RemoteProtocolError(f"{self.name}: expected unit {self.unit!r}, got {groups['unit']!r}")
        return self._value(groups["value"])

    def encode(self, value: float) -> bytes:
        """Write a line, terminator included.

        Args:
            value: in `unit`.

        Raises:
            LocalProtocolError: the format has no template, or the value does not fit its width.
        """
        if not self.template:
            raise LocalProtocolError(f"line format {self.name!r} has no template to write with")
        if not math.isfinite(value):
            raise LocalProtocolError(f"{self.name}: cannot write {value}")
        text = self._written(value, "00")
        if self.checksum != "none":
            text = self._written(value, self._checksum(text))
        if self._regex.fullmatch(text) is None:
            raise LocalProtocolError(f"{self.name}: {value} {self.unit} does not fit: {text!r} breaks the pattern")
        return text.encode("ascii") + self.terminator

    def _written(self, value: float, checksum: str) -> str:
        """The template filled in.

        Raises:
            LocalProtocolError: the template asks for something else than value, unit and checksum.
        """
        try:
            return self.template.format(value=value * 10**self.decimals, unit=self.unit, checksum=checksum)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            raise LocalProtocolError(f"line format {self.name!r}: template {self.template!r}: {error!r}") from error

    def _value(self, text: str) -> tuple[float, int]:
        """Number or token.

        Raises:
            RemoteProtocolError: neither.
        """
        token = text.strip()
        if token in self.overload_tokens:
            return math.nan, STATUS_OVERLOAD
        if token in self.fault_tokens:
            return math.nan, STATUS_SENSOR_FAULT
        digits = token.replace(" ", "")
        if _NUMBER.fullmatch(digits) is None:
            raise RemoteProtocolError(f"{self.name}: {text!r} is not a plain decimal number")
        return (float(digits) if "." in digits else int(digits) / 10**self.decimals), 0

    def _checksum(self, text: str) -> str:
        """XOR of the covered characters, two upper-case hexadecimal digits."""
        begin = text.find(self.checksum_from) + len(self.checksum_from)
        end = text.rfind(self.checksum_to)
        return f"{reduce(xor, text[begin:end].encode('ascii'), 0):02X}"


class LineDecoder:
    """Splits a byte stream into readings of a line format; a chunk may begin and end anywhere.

    A reading's sequence counts lines, unreadable ones too, so an unreadable line shows as a gap. It has no device
    clock (-1).

    Attributes:
        bad_frames: lines that were not of the format.
        skipped_bytes: bytes of those lines, and what came before the first terminator.
    """

    def __init__(self, line_format: LineFormat) -> None:
        self.line_format = line_format
        self.bad_frames = 0
        self.skipped_bytes = 0
        self._buffer = ReceiveBuffer()
        self._synchronised = False
        self._sequence = 0

    def feed(self, chunk: bytes) -> list[Reading]:
        """Take bytes as they arrived; return every reading they complete, in order.

        Args:
            chunk: any number of bytes.
        """
        self._buffer.append(chunk)
        readings: list[Reading] = []
        while (line := self._buffer.take_line(self.line_format.terminator)) is not None:
            if not self._synchronised:
                self._synchronised = True
                self.skipped_bytes += len(line)
                continue
            self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
            try:
                value, status = self.line_format.decode(line)
            except RemoteProtocolError:
                self.bad_frames += 1
                self.skipped_bytes += len(line)
                continue
            readings.append((self._sequence, _NO_CLOCK, value, status, 0))
        self._drop_overlong()
        return readings

    def clear(self) -> None:
        """Forget the unfinished line and drop the next one, whose beginning may be missing."""
        self._buffer.clear()
        self._synchronised = False

    def _drop_overlong(self) -> None:
        """Give up a line that has grown beyond its maximum; its rest is dropped up to the next terminator."""
        if len(self._buffer) > self.line_format.maximum_length + len(self.line_format.terminator):
            self.skipped_bytes += len(self._buffer)
            if self._synchronised:
                self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
                self.bad_frames += 1
            # The last bytes may be the beginning of a terminator.
            keep = self._buffer.tail(len(self.line_format.terminator) - 1)
            self.clear()
            self._buffer.append(keep)
            self.skipped_bytes -= len(keep)


_LAUMAS_NUMBER = r"[-\d]\d{5}"
_LAUMAS_OVERLOAD = ("ErOL", "Er OL", "^^^^^^", "------")
_LAUMAS_FAULT = ("ErCEL", "Er CEL", "ErAD", "Er AD")

PRESETS: Mapping[str, LineFormat] = {
    preset.name: preset
    for preset in (
        LineFormat(
            name="signed-decimal",
            pattern=r"(?P<value>[+-](?=[\d.]{9}(?: |$))\d+\.\d+)(?: (?P<unit>[^\d\s]\S*))?",
            template="{value:+010.1f} {unit}",
        ),
        LineFormat(
            name="laumas-fast",
            pattern=rf"(?P<value>{_LAUMAS_NUMBER}|[ -~]{{6}})",
            overload_tokens=_LAUMAS_OVERLOAD,
            fault_tokens=_LAUMAS_FAULT,
            nominal_rate_Hz=300.0,
            template="{value:06.0f}",
        ),
        LineFormat(
            name="laumas-checksummed",
            pattern=rf"&T(?P<value>{_LAUMAS_NUMBER}|[ -~]{{6}})P[ -~]{{6}}\\(?P<checksum>[0-9A-Fa-f]{{2}})",
            terminator=b"\r",
            overload_tokens=_LAUMAS_OVERLOAD,
            fault_tokens=_LAUMAS_FAULT,
            checksum="xor-hex",
            checksum_from="&",
            checksum_to="\\",
            template="&T{value:06.0f}P000000\\{checksum}",
        ),
        LineFormat(
            name="hbm-aed",
            pattern=r"(?P<value>[+-]\d{7})(?:,\d{2},\d{3})?",
            start_command=b"MSV?0;",
            stop_command=b"STP;",
            template="{value:+08.0f}",
        ),
        LineFormat(
            name="flintec",
            pattern=r"G(?P<value>[+-](?=[\d.]{6}$)\d+\.?\d*)",
            start_command=b"SG\r",
            template="G{value:+07.3f}",
        ),
    )
}
"""Formats by the name a bench file uses."""


def from_description(table: Mapping[str, object]) -> LineFormat:
    r"""A format that a user described in the bench file.

    Args:
        table: keys as the attributes of `LineFormat`; byte strings written as text (terminator "\r\n").

    Raises:
        LocalProtocolError: an unknown or missing key, a value of the wrong type, or a contradiction.
    """
    name = table.get("name", "custom")
    known = {item.name: item for item in fields(LineFormat) if item.init}
    values: dict[str, object] = {"name": name}
    for key, value in table.items():
        if key not in known:
            raise LocalProtocolError(f"line format {name!r}: unknown key {key!r}; known are {', '.join(known)}")
        values[key] = _described(name, key, value)
    if "pattern" not in values:
        raise LocalProtocolError(f"line format {name!r}: key 'pattern' is missing")
    return LineFormat(**values)  # type: ignore[arg-type]  # every value was checked against its key just now


def _described(name: object, key: str, value: object) -> object:
    """One value of a description, as the type its attribute has.

    Raises:
        LocalProtocolError: another type.
    """
    if key in _BYTES_KEYS:
        if isinstance(value, str) and value.isascii():
            return value.encode("ascii")
        raise LocalProtocolError(f"line format {name!r}: {key} = {value!r}, expected ASCII text")
    if key in _TOKEN_KEYS:
        if isinstance(value, (list, tuple)) and all(isinstance(token, str) for token in value):
            return tuple(value)
        raise LocalProtocolError(f"line format {name!r}: {key} = {value!r}, expected a list of texts")
    expected = _NUMBER_KEYS.get(key, str)
    if isinstance(value, bool) or not isinstance(value, (int, float) if expected is float else expected):
        raise LocalProtocolError(f"line format {name!r}: {key} = {value!r}, expected {_TYPE_NAMES[expected]}")
    return value


_BYTES_KEYS = frozenset({"terminator", "start_command", "stop_command"})
_TOKEN_KEYS = frozenset({"overload_tokens", "fault_tokens"})
_NUMBER_KEYS: Mapping[str, type] = {"decimals": int, "maximum_length": int, "nominal_rate_Hz": float}
_TYPE_NAMES = {int: "a whole number", float: "a number", str: "text"}


def preset(name: str) -> LineFormat:
    """The shipped format of that name.

    Raises:
        LocalProtocolError: there is none.
    """
    try:
        return PRESETS[name]
    except KeyError:
        raise LocalProtocolError(f"no line format {name!r}; there are {', '.join(PRESETS)}") from None


class ReceiveBuffer:
    """Collects chunks and gives back whole lines; a chunk may end anywhere.

    The place up to which a terminator was looked for is remembered, so a line that arrives byte by byte is searched
    once, not once a byte.
    """

    def __init__(self) -> None:
        self._data = bytearray()
        self._searched = 0

    def __len__(self) -> int:
        return len(self._data)

    def append(self, chunk: bytes) -> None:
        """Add bytes as they arrived."""
        self._data += chunk

    def take_line(self, terminator: bytes) -> bytes | None:
        """The next line without its terminator, or None when no terminator is there yet."""
        end = self._data.find(terminator, max(0, self._searched - len(terminator) + 1))
        if end < 0:
            self._searched = len(self._data)
            return None
        line = bytes(self._data[:end])
        del self._data[: end + len(terminator)]
        self._searched = 0
        return line

    def tail(self, count: int) -> bytes:
        """The last `count` bytes (fewer if fewer are there), left in place."""
        return bytes(self._data[max(0, len(self._data) - count) :])

    def clear(self) -> None:
        """Forget everything."""
        self._data.clear()
        self._searched = 0
