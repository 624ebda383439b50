r"""A sensor format's file, or its table in a bench file: lines of text, or frames of bytes.

Byte strings are written as text of ASCII characters ("\\r\\n", in double quotes), or as a list of numbers
([0x10, 0x7E]). What entries say together is checked by `protocols.sensor_format`, which makes the format.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from protocols.binary_format import LETTERS, ORDERS, SIZES, STUFFINGS
from protocols.checksums import FRAME_CHECKSUMS, LINE_CHECKSUMS
from protocols.line_format import LONGEST_LINE, NUMBERS, SIGNS
from protocols.sensor_format import kind_of
from rig.files.quantity import Check
from rig.files.section import DescriptionTable


def _bytes(value: object) -> object:
    if isinstance(value, str):
        if not value.isascii():
            raise ValueError("expected ASCII text, or a list of bytes such as [0x02, 0xA5]")
        if any(written in value for written in ("\\r", "\\n", "\\x", "\\0", "\\u")):
            raise ValueError('a backslash is itself in single quotes; write "\\r\\n" in double quotes, or [0x0D, 0x0A]')
    elif not isinstance(value, (list, tuple)) or not all(type(item) is int and 0 <= item <= 0xFF for item in value):
        raise ValueError("expected ASCII text, or a list of bytes from 0 to 0xFF")
    return value


def _column(value: object) -> object:
    numbers = value if isinstance(value, (list, tuple)) else (value,)
    if not all(type(number) is int and 1 <= number <= LONGEST_LINE for number in numbers) or not numbers:
        raise ValueError(f"must be a column's number, or [first, last] character; allowed: 1 to {LONGEST_LINE}")
    return value if type(value) is int else _rising(value)


def _rising(value: Any) -> Any:  # noqa: ANN401 - two numbers
    if len(value) != 2 or value[0] > value[1]:
        raise ValueError("must be two whole numbers [first, last], the first not after the last")
    return value


def _limits(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError("must be two numbers [lowest, highest]")
    return value


Byte = Annotated[int, Field(ge=0, le=0xFF)]
Bytes = Annotated[str | tuple[Byte, ...], Check(_bytes, alone=True)]
Place = Annotated[int, Field(ge=1, le=LONGEST_LINE)]
Span = Annotated[tuple[Place, Place], Check(_rising)]
ByteSpan = Annotated[tuple[Byte, Byte], Check(_rising)]
Bit = Annotated[int, Field(ge=0, le=63)]
Mask = Annotated[int, Field(ge=0, le=2**64 - 1)]
Order = Literal[ORDERS]  # type: ignore[valid-type]  # the format's own list serves schema and message
Status = Literal["ok", "overload", "fault"]


class _Format(DescriptionTable):
    """Entries of both kinds."""

    name: str | None = Field(None, description="name for messages and recordings")
    base: str | None = Field(None, description="name of a preset whose entries hold where this table has none")
    kind: Literal["lines", "frames"] | None = Field(
        None, description="lines of text, or frames of bytes; by the other keys where it is not stated"
    )
    description: str | None = Field(None, description="what the format is of: maker, device, document; only for people")
    unit: str | None = Field(None, description="unit of the value")
    nominal_rate_Hz: float | None = Field(
        None, ge=1e-3, le=1e6, description="readings a second where the bench file does not state it"
    )
    start_command: Bytes | None = Field(
        None, description="sent when the port is opened, to start the device's own sending"
    )
    stop_command: Bytes | None = Field(None, description="sent before the port is closed")
    request: Bytes | None = Field(
        None, description="sent for each reading, at the bench file's rate; {address} in a text becomes `address`"
    )
    answer_timeout_ms: float | None = Field(
        None, ge=1, le=5000, description="longest wait for the answer to a request (default 100)"
    )
    address: str | None = Field(None, description="replaces {address} in request, commands and pattern")


class LineFormatFile(_Format):
    """Lines of text."""

    start: Bytes | None = Field(
        None, description="bytes a line begins with, such as STX; not part of pattern and columns"
    )
    terminator: Bytes | None = Field(None, description="bytes a line ends with (default CR LF)")
    pattern: str | None = Field(None, description="regular expression of the whole line with a group (?P<value>...)")
    columns: dict[str, Annotated[Place | Span, Check(_column, alone=True)]] | None = Field(
        None, min_length=1,
        description="in place of a pattern: [first, last] character of value, unit, status, sign, checksum, counted "
        "from 1; with a separator the number of the column",
    )
    separator: str | None = Field(None, description="character between columns of any width")
    length: Place | None = Field(None, description="characters of every line, start and terminator not counted")
    maximum_length: Place | None = Field(
        None, description="longest line, start and terminator not counted (default 64)"
    )
    number: Literal[tuple(NUMBERS)] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="how the number is written (default decimal)"
    )
    decimal_mark: Literal[".", ","] | None = Field(None, description="point or comma (default point)")
    sign: Literal[SIGNS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="where the sign is (default leading); separate: in group or column `sign`"
    )
    negative_tokens: tuple[str, ...] | None = Field(
        None, description='texts of a separate sign that mean a negative number (default ["-"])'
    )
    decimals: int | None = Field(None, ge=0, le=9, description="implied decimal places of a number without a mark")
    scale: float | None = Field(None, description="value = number * scale + offset (default 1)")
    offset: float | None = Field(None, description="see scale (default 0)")
    units: dict[str, float] | None = Field(
        None, min_length=1, description="units the line may show, each with its factor to `unit`"
    )
    status: dict[str, Status] | None = Field(
        None, min_length=1, description="texts of group or column `status`, each ok, overload or fault"
    )
    overload_tokens: tuple[str, ...] | None = Field(
        None, description="texts in place of the number: input out of range"
    )
    fault_tokens: tuple[str, ...] | None = Field(
        None, description="texts in place of the number: sensor broken or not connected"
    )
    checksum: Literal[LINE_CHECKSUMS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="sum written in group or column `checksum` (default none)"
    )
    checksum_from: str | None = Field(
        None, description="character before the first one covered (default: all from the line's beginning)"
    )
    checksum_to: str | None = Field(
        None, description="character behind the last one covered (default: all up to the checksum)"
    )
    checksum_over: Span | None = Field(
        None, description="[first, last] character covered, counted from 1, in place of both"
    )
    template: str | None = Field(
        None, description='how a simulated sensor writes it, such as "ST,{value:+08.3f}"; made from the pattern where '
        "it is not stated",
    )


class FieldEntry(DescriptionTable):
    """One number in a frame."""

    at: Byte | None = Field(None, description="its first byte, counted from 0, sync counted")
    type: Literal[tuple(SIZES)] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="u unsigned, i signed, f float, with its bits"
    )
    order: Order | None = Field(None, description="order of its bytes (default: the frame's)")
    bits: Annotated[tuple[Bit, Bit], Check(_rising)] | None = Field(
        None, description="[lowest, highest] bit that belong to it, counted from 0"
    )
    signed: bool | None = Field(None, description="two's complement, where a type does not state it (bits, packed)")
    scale: float | None = Field(
        None, description="value = number * scale + offset (default 1); of the time: microseconds a tick"
    )
    offset: float | None = Field(None, description="see scale (default 0)")
    valid: Annotated[tuple[float, float], Check(_limits)] | None = Field(
        None, description="[lowest, highest] number that is a reading; beyond is an overload"
    )
    overload_values: tuple[int, ...] | None = Field(None, description="numbers that mean: input out of range")
    fault_values: tuple[int, ...] | None = Field(
        None, description="numbers that mean: sensor broken or not connected"
    )
    overload_bits: Mask | None = Field(None, description="mask of status bits that mean: input out of range")
    fault_bits: Mask | None = Field(None, description="mask of status bits that mean: sensor broken")


class Fields(DescriptionTable):
    """The numbers in a frame."""

    value: FieldEntry | None = None
    status: FieldEntry | None = None
    sequence: FieldEntry | None = None
    time: FieldEntry | None = None


class FrameFormatFile(_Format):
    """Frames of bytes."""

    sync: Bytes | None = Field(None, description="bytes a frame begins with")
    length: int | None = Field(
        None, ge=1, le=256, description="bytes of a whole frame with sync, checksum and end, stuffing not counted"
    )
    end: Bytes | None = Field(None, description="bytes a frame ends with")
    order: Order | None = Field(None, description="order of bytes in numbers (default little)")
    fields: Fields | None = Field(
        None, description="tables value, and where the frame has them status, sequence and time"
    )
    packed: tuple[str, ...] | None = Field(
        None, min_length=1,
        description="bits of each byte, highest first, of a stream without sync bytes: 0 and 1 as they must be, "
        f"{', '.join(f'{letter} {name}' for letter, name in LETTERS.items())}, x any",
    )
    stuffing: Literal[STUFFINGS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="how a sync inside of a frame is hidden (default none)"
    )
    escape: Byte | None = Field(None, description="byte put before a hidden one (default 0x10)")
    escape_xor: Byte | None = Field(None, description="by what a hidden byte is changed (default 0; HDLC 0x20)")
    checksum: Literal[FRAME_CHECKSUMS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="kind of sum (default none)"
    )
    checksum_at: Byte | None = Field(None, description="its first byte, counted from 0 (default: right before the end)")
    checksum_over: ByteSpan | None = Field(
        None, description="[first, last] byte covered, counted from 0 (default: all before it)"
    )
    checksum_order: Order | None = Field(None, description="order of its bytes (default: the frame's)")


def model_of(table: Mapping[str, Any]) -> type[LineFormatFile] | type[FrameFormatFile]:
    """What a table must fit."""
    return FrameFormatFile if kind_of(table) == "frames" else LineFormatFile
