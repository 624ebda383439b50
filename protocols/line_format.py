r"""ASCII lines: one reading per line, described by data.

    signed-decimal       +0001234.5 N\r\n
    laumas-fast          001234\r\n                  negative: -01234\r\n
    laumas-checksummed   &T001234P000000\03\r        two hex digits: XOR of the characters between & and \
    flintec              G+01.100\r\n                after SG\r

A line is accepted as a whole or not at all: the pattern must match all of it, the number must be a plain number, the
unit must be an expected one and the checksum correct. The first line after the start is discarded, because its start
may be missing. Without a checksum a flipped digit cannot be detected; fixed-width patterns at least detect lost bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from protocols.checksums import CHECKSUMS, HEX
from protocols.errors import RemoteProtocolError
from protocols.exchange import Exchange
from protocols.frame_format import SEQUENCE_MODULUS, STATUS_OVERLOAD, STATUS_SENSOR_FAULT, Reading
from protocols.patterns import Match, Pattern

LONGEST_LINE = 256
NUMBERS = {
    "decimal": re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)", re.ASCII),
    "scientific": re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII),
    "hexadecimal": re.compile(r"[0-9A-Fa-f]{1,16}", re.ASCII),
    "hexadecimal-signed": re.compile(r"[0-9A-Fa-f]{1,16}", re.ASCII),
}
"""How a number may be written."""
SIGNS = ("leading", "trailing", "separate")
ENCODINGS = ("ascii", "latin-1", "cp437")
"""Encodings of characters above 7F, such as the degree and micro signs; one byte each."""
MOST_DECIMALS = 9
STATUSES = {"ok": 0, "overload": STATUS_OVERLOAD, "fault": STATUS_SENSOR_FAULT}
_NO_CLOCK = -1
_HEX_DIGITS = {1: "02X", 2: "04X", 4: "08X"}


@dataclass(frozen=True)
class LineFormat:
    r"""How one reading is written as a line of ASCII text; made and checked by `protocols.sensor_format`.

    Attributes:
        name: as in the bench file.
        pattern: regular expression for the line without start and terminator; it must match all of it. Group `value`
            is the number; groups `sign`, `unit`, `status`, `decimals` and `checksum` are optional.
        encoding: of the characters, one of `ENCODINGS`.
        start: bytes that begin a line, b"" where nothing does; what comes before them is dropped.
        terminator: bytes that end a line, e.g. b"\r\n".
        number: how the number is written, a key of `NUMBERS`.
        decimal_mark: "." or ",".
        sign: where the sign stands: "leading", "trailing", or "separate" in group `sign`.
        negative_tokens: texts of group `sign` that mean a negative number.
        decimals: implied decimal places, applied when the number is written without a mark; a group `decimals` of the
            line states them instead.
        scale, offset: value = number * scale + offset, after the implied decimals.
        unit: unit of the value; a `unit` group must equal it, or be a key of `units`.
        units: factor to `unit` by the unit on the wire.
        status: what a `status` group's texts mean: "ok", "overload" or "fault"; other texts make a damaged line.
        overload_tokens: texts in place of the number that mean "input out of range".
        fault_tokens: texts in place of the number that mean "sensor broken or not connected".
        checksum: "none", or a name of `protocols.checksums` with `-hex`.
        checksum_from, checksum_to: characters around what the checksum covers, themselves not covered; empty: from
            the line's beginning, up to the checksum.
        checksum_over: first and last covered character counted from 1, in place of the two.
        maximum_length: longest line, start and terminator not counted; what grows beyond is garbage.
        nominal_rate_Hz: lines a second, or None.
        exchange: what is sent to the device.
        template: how the line is written where its pattern leaves that open, from `value` (scaled by the implied
            decimals), `unit` and `checksum`; "" to have it made from the pattern.
    """

    name: str
    pattern: str
    start: bytes = b""
    terminator: bytes = b"\r\n"
    number: str = "decimal"
    decimal_mark: str = "."
    sign: str = "leading"
    negative_tokens: tuple[str, ...] = ("-",)
    decimals: int = 0
    scale: float = 1.0
    offset: float = 0.0
    unit: str = "N"
    units: Mapping[str, float] = field(default_factory=dict)
    status: Mapping[str, str] = field(default_factory=dict)
    overload_tokens: tuple[str, ...] = ()
    fault_tokens: tuple[str, ...] = ()
    checksum: str = "none"
    checksum_from: str = ""
    checksum_to: str = ""
    checksum_over: tuple[int, int] | None = None
    maximum_length: int = 64
    nominal_rate_Hz: float | None = None
    exchange: Exchange = field(default_factory=Exchange)
    template: str = ""
    encoding: str = "ascii"
    _regex: Pattern = field(init=False, repr=False, compare=False)
    _plain: bool = field(init=False, repr=False, compare=False)
    _statuses: Mapping[str, int] = field(init=False, repr=False, compare=False)
    _tokens: Mapping[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_regex", Pattern(self.pattern))
        object.__setattr__(self, "_plain", self._is_plain())
        object.__setattr__(self, "_statuses", {text.strip(): STATUSES[kind] for text, kind in self.status.items()})
        tokens = {text.strip(): STATUS_SENSOR_FAULT for text in self.fault_tokens}
        object.__setattr__(self, "_tokens", tokens | {text.strip(): STATUS_OVERLOAD for text in self.overload_tokens})

    @property
    def groups(self) -> frozenset[str]:
        """Names of the pattern's groups."""
        return self._regex.groups

    @property
    def has_sequence(self) -> bool:
        """Lines carry no number of their own."""
        return False

    def match(self, text: str) -> Match | None:
        """The pattern over a whole line."""
        return self._regex.fullmatch(text)

    def decode(self, line: bytes) -> tuple[float, int]:
        """Value and status bits of one line.

        Args:
            line: without start and terminator.

        Returns:
            Value in `unit` (NaN for an overload or fault) and status bits as in the 16-byte frame. A status of
            overload or fault needs no number: many devices leave it out then.

        Raises:
            RemoteProtocolError: the line is not one of this format.
        """
        if len(line) > self.maximum_length:
            raise RemoteProtocolError(f"{self.name}: got a line of {len(line)} bytes, expected at most "
                f"{self.maximum_length}")
        try:
            text = line.decode(self.encoding)
        except UnicodeDecodeError as error:
            raise RemoteProtocolError(f"{self.name}: not {self.encoding.upper()}: {line!r}") from error
        match = self._regex.fullmatch(text)
        if match is None:
            raise RemoteProtocolError(f"{self.name}: {text!r} does not match {self.pattern!r}")
        if self._plain:
            return self._value(match["value"], 1.0, self.decimals, negative=False)
        groups = self._regex.groups
        if self.checksum != "none":
            self._check_sum(text, match)
        status = self._status(match["status"]) if "status" in groups else 0
        if status:
            return math.nan, status | self._tokens.get((match["value"] or "").strip(), 0)
        factor = self._factor(match["unit"]) if "unit" in groups else 1.0
        negative = "sign" in groups and self._negative(match["sign"])
        decimals = self._places(match["decimals"]) if "decimals" in groups else self.decimals
        return self._value(match["value"], factor, decimals, negative=negative)

    def _is_plain(self) -> bool:
        """Nothing beside the number has to be looked at."""
        return self._regex.groups == {"value"} and self.sign == "leading"

    def _factor(self, unit: str | None) -> float:
        """What the unit on the wire is in `unit`.

        Raises:
            RemoteProtocolError: another unit than those expected.
        """
        if unit is None or unit.strip() == self.unit:
            return 1.0
        if unit.strip() not in self.units:
            raise RemoteProtocolError(f"{self.name}: expected unit {self.unit!r}, got {unit!r}")
        return self.units[unit.strip()]

    def _negative(self, sign: str | None) -> bool:
        """Whether a separate sign means a negative number."""
        return sign is not None and (sign in self.negative_tokens or sign.strip() in self.negative_tokens)

    def _status(self, text: str | None) -> int:
        """Status bits of the status text.

        Raises:
            RemoteProtocolError: a text without a meaning.
        """
        if text is None or not self.status:
            return 0
        try:
            return self._statuses[text.strip()]
        except KeyError:
            raise RemoteProtocolError(f"{self.name}: the meaning of status {text!r} is not defined") from None

    def _places(self, text: str | None) -> int:
        """Number of decimal places stated by the line.

        Raises:
            RemoteProtocolError: the number is missing or exceeds `MOST_DECIMALS`.
        """
        stated = (text or "").strip()
        if not (stated.isascii() and stated.isdigit() and int(stated) <= MOST_DECIMALS):
            raise RemoteProtocolError(f"{self.name}: expected 0 to {MOST_DECIMALS} decimal places, got {text!r}")
        return int(stated)

    def _value(self, text: str | None, factor: float, decimals: int, *, negative: bool) -> tuple[float, int]:
        """Number or token.

        Raises:
            RemoteProtocolError: neither; None and blanks are a line without a number, unless "" is a token.
        """
        token = (text or "").strip()
        if token in self._tokens:
            return math.nan, self._tokens[token]
        number = self._number(token, decimals)
        if number is None:
            raise RemoteProtocolError(f"{self.name}: {text!r} is not a plain {self.number} number")
        return ((-number if negative else number) * self.scale + self.offset) * factor, 0

    def _number(self, token: str, decimals: int) -> float | None:
        """The number a text means, implied decimals applied; None for anything else."""
        digits = token.replace(" ", "")
        if self.decimal_mark == ",":
            if "." in digits:
                return None
            digits = digits.replace(",", ".")
        if self.sign == "trailing":
            if digits[:1] in {"+", "-"}:
                return None
            digits = digits[-1:] + digits[:-1] if digits[-1:] in {"+", "-"} else digits
        elif self.sign == "separate" and digits[:1] in {"+", "-"}:
            return None
        if NUMBERS[self.number].fullmatch(digits) is None:
            return None
        if self.number.startswith("hexadecimal"):
            raw = int(digits, 16)
            if self.number == "hexadecimal-signed" and raw >> (4 * len(digits) - 1):
                raw -= 1 << 4 * len(digits)
            return float(raw) / 10.0**decimals
        number = float(digits)
        if not math.isfinite(number):
            return None
        return number if "." in digits or not decimals else number / 10**decimals

    def _check_sum(self, text: str, match: Match) -> None:
        """Compare the checksum of a line.

        Raises:
            RemoteProtocolError: it is missing, or another one.
        """
        shown = match["checksum"]
        if not shown:
            raise RemoteProtocolError(f"{self.name}: {text!r} has no checksum")
        if shown.upper() != (right := self._checksum(text, match)):
            raise RemoteProtocolError(f"{self.name}: {text!r} has checksum {right}")

    def _checksum(self, text: str, match: Match) -> str:
        """The checksum of the covered characters, upper-case hexadecimal digits.

        Raises:
            RemoteProtocolError: the characters around what it covers are not in the line.
        """
        kind = CHECKSUMS[self.checksum.removesuffix(HEX)]
        if self.checksum_over is not None:
            covered = text[self.checksum_over[0] - 1 : self.checksum_over[1]]
        else:
            begin = text.find(self.checksum_from)
            end = text.rfind(self.checksum_to) if self.checksum_to else match.span("checksum")[0]
            if begin < 0 or end < 0:
                raise RemoteProtocolError(f"{self.name}: {text!r} does not contain the characters that enclose the "
                    "part covered by its checksum")
            covered = text[begin + len(self.checksum_from) : end]
        return format(kind.of(covered.encode(self.encoding)), _HEX_DIGITS[kind.size])


class LineDecoder:
    """Splits a byte stream into readings of a line format; a chunk may begin and end anywhere.

    A reading's sequence counts lines, unreadable ones too, so an unreadable line shows as a gap. It has no device
    clock (-1).

    Args:
        line_format: the lines.
        answers: the stream begins anew with every answer to a request, so that no beginning is ever missing.

    Attributes:
        bad_frames: lines that were not of the format.
        skipped_bytes: bytes of those lines, and what came before the first terminator.
    """

    def __init__(self, line_format: LineFormat, *, answers: bool = False) -> None:
        self.line_format = line_format
        self.bad_frames = 0
        self.skipped_bytes = 0
        self._rest = b""
        self._whole = answers or bool(line_format.start)
        self._synchronised = self._whole
        self._sequence = 0

    def feed(self, chunk: bytes) -> list[Reading]:
        """Take bytes as they arrived; return every reading they complete, in order.

        Args:
            chunk: any number of bytes.
        """
        *lines, self._rest = (self._rest + chunk).split(self.line_format.terminator)
        readings: list[Reading] = []
        start, decode = self.line_format.start, self.line_format.decode
        for line in lines:
            if not self._synchronised:
                self._synchronised = True
                self.skipped_bytes += len(line)
                continue
            if start:
                before, found_start, line = line.rpartition(start)
                self.skipped_bytes += len(before)
                if not found_start:
                    self.skipped_bytes += len(line)
                    continue
            self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
            try:
                value, status = decode(line)
            except RemoteProtocolError:
                self.bad_frames += 1
                self.skipped_bytes += len(line)
                continue
            readings.append((self._sequence, _NO_CLOCK, value, status, 0))
        self._drop_overlong()
        return readings

    def clear(self) -> None:
        """Forget the unfinished line and drop the next one, whose beginning may be missing."""
        self._rest = b""
        self._synchronised = self._whole

    def _drop_overlong(self) -> None:
        """Give up a line that has grown beyond its maximum; its rest is dropped up to the next terminator."""
        line_format = self.line_format
        longest = len(line_format.start) + line_format.maximum_length + len(line_format.terminator)
        if len(self._rest) > longest:
            self.skipped_bytes += len(self._rest)
            if self._synchronised:
                self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
                self.bad_frames += 1
            # The last bytes may be the beginning of a terminator, or a line may begin in them.
            kept = max(len(line_format.terminator) - 1, (line_format.maximum_length if line_format.start else 0))
            keep = self._rest[len(self._rest) - kept :] if kept else b""
            self.clear()
            self._rest = keep
            self.skipped_bytes -= len(keep)
