r"""A sensor format's file, or its table in a bench file: lines of text, or frames of bytes.

Byte strings are written as text of ASCII characters ("\\r\\n", in double quotes), or as a list of numbers
([0x10, 0x7E]). The combination of entries is checked by `protocols.sensor_format`, which makes the format.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from protocols.binary_format import LETTERS, ORDERS, SIZES, STUFFINGS
from protocols.checksums import FRAME_CHECKSUMS, LINE_CHECKSUMS
from protocols.line_format import ENCODINGS, LONGEST_LINE, NUMBERS, SIGNS
from protocols.modbus_format import FRAMINGS, FUNCTIONS, TYPES
from protocols.sensor_format import kind_of
from rig.files.ecu_roles import Address, Byte, Identifier, Name, Numbers, Protected, Request
from rig.files.quantity import Check
from rig.files.section import DescriptionTable


def _bytes(value: object) -> object:
    if isinstance(value, str):
        if not value.isascii():
            raise ValueError("expected ASCII text, or a list of bytes such as [0x02, 0xA5]")
        if any(written in value for written in ("\\r", "\\n", "\\x", "\\0", "\\u")):
            raise ValueError('a backslash is taken literally in single quotes. Fix: write "\\r\\n" in double quotes, '
                'or '
                "[0x0D, 0x0A]")
    elif not isinstance(value, (list, tuple)) or not all(type(item) is int and 0 <= item <= 0xFF for item in value):
        raise ValueError("expected ASCII text, or a list of bytes from 0 to 0xFF")
    return value


def _column(value: object) -> object:
    numbers = value if isinstance(value, (list, tuple)) else (value,)
    if not all(type(number) is int and 1 <= number <= LONGEST_LINE for number in numbers) or not numbers:
        raise ValueError("must be a column number, or the first and last character as [first, last]; allowed: 1 "
            f"to {LONGEST_LINE}")
    return value if type(value) is int else _rising(value)


def _rising(value: Any) -> Any:  # noqa: ANN401 - two numbers
    if len(value) != 2 or value[0] > value[1]:
        raise ValueError("must be two whole numbers [first, last], the first no greater than the last")
    return value


def _limits(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError("must be two numbers [lowest, highest]")
    return value


Bytes = Annotated[str | tuple[Byte, ...], Check(_bytes, alone=True)]
Place = Annotated[int, Field(ge=1, le=LONGEST_LINE)]
Span = Annotated[tuple[Place, Place], Check(_rising)]
ByteSpan = Annotated[tuple[Byte, Byte], Check(_rising)]
Bit = Annotated[int, Field(ge=0, le=63)]
Mask = Annotated[int, Field(ge=0, le=2**64 - 1)]
Order = Literal[ORDERS]  # type: ignore[valid-type]  # the format's own list serves schema and message
Status = Literal["ok", "overload", "fault"]


class _AnyFormat(DescriptionTable):
    """Entries of every kind."""

    name: str | None = Field(None, description="name used in messages and recordings")
    base: str | None = Field(None, description="name of a preset that supplies the entries missing from this table")
    kind: Literal["lines", "frames", "modbus", "can"] | None = Field(
        None, description="lines of text, frames of bytes, Modbus registers or a CAN message; default: inferred from "
            "the other keys"
    )
    description: str | None = Field(None, description="manufacturer, device and manual for this format; for "
        "information only")
    unit: str | None = Field(None, description="unit of the value")
    nominal_rate_Hz: float | None = Field(
        None, ge=1e-3, le=1e6, description="readings per second, used if the bench file does not specify the rate"
    )
    answer_timeout_ms: float | None = Field(
        None, ge=1, le=5000, description="maximum time to wait for the answer to a request (default 100)"
    )


class _Format(_AnyFormat):
    """Entries of lines and frames."""

    start_command: Bytes | None = Field(
        None, description="command sent when the port is opened, to start continuous transmission"
    )
    stop_command: Bytes | None = Field(None, description="command sent before the port is closed")
    request: Bytes | None = Field(
        None, description="request sent for each reading, at the bench file's rate; {address} in the text is replaced "
            "by `address`"
    )
    address: str | None = Field(None, description="address that replaces {address} in the request, the commands and "
        "the pattern")


class LineFormatFile(_Format):
    """Lines of text."""

    start: Bytes | None = Field(
        None, description="bytes at the start of a line, such as STX; not part of the pattern or columns"
    )
    terminator: Bytes | None = Field(None, description="bytes at the end of a line (default CR LF)")
    pattern: str | None = Field(None, description="regular expression for the whole line, with a group (?P<value>...)")
    columns: dict[str, Annotated[Place | Span, Check(_column, alone=True)]] | None = Field(
        None, min_length=1,
        description="instead of a pattern: [first, last] character of the value, unit, status, sign and checksum, "
            "counted from 1; if a separator is specified, the column number",
    )
    separator: str | None = Field(None, description="separator between columns of variable width")
    length: Place | None = Field(None, description="fixed line length in characters, without start and terminator")
    maximum_length: Place | None = Field(
        None, description="maximum line length in characters, without start and terminator (default 64)"
    )
    encoding: Literal[ENCODINGS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="encoding of characters above 7F, such as the degree and micro signs (default ascii: a line "
            "with such a character is invalid)"
    )
    number: Literal[tuple(NUMBERS)] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="number format (default decimal)"
    )
    decimal_mark: Literal[".", ","] | None = Field(None, description="decimal separator: point or comma (default "
        "point)")
    sign: Literal[SIGNS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="position of the sign (default leading); separate: in the group or column `sign`"
    )
    negative_tokens: tuple[str, ...] | None = Field(
        None, description='strings in a separate sign field that indicate a negative number (default ["-"])'
    )
    decimals: int | None = Field(None, ge=0, le=9, description="number of implied decimal places if the number has no "
        "decimal separator; with a group or column `decimals`, the line itself states this number")
    scale: float | None = Field(None, description="scale in value = number * scale + offset (default: 1)")
    offset: float | None = Field(None, description="see scale (default 0)")
    units: dict[str, float] | None = Field(
        None, min_length=1, description="units that the line may contain, each with its conversion factor to `unit`"
    )
    status: dict[str, Status] | None = Field(
        None, min_length=1, description="strings in the group or column `status`, with their meanings: ok, "
            "overload or fault"
    )
    overload_tokens: tuple[str, ...] | None = Field(
        None, description="strings sent instead of the number if the input is out of range"
    )
    fault_tokens: tuple[str, ...] | None = Field(
        None, description="strings sent instead of the number if the sensor is broken or not connected"
    )
    checksum: Literal[LINE_CHECKSUMS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="type of the checksum in the group or column `checksum` (default none)"
    )
    checksum_from: str | None = Field(
        None, description="character before the part covered by the checksum (default: the start of the line)"
    )
    checksum_to: str | None = Field(
        None, description="character after the part covered by the checksum (default: the checksum itself)"
    )
    checksum_over: Span | None = Field(
        None, description="[first, last] character covered by the checksum, counted from 1; replaces checksum_from "
            "and checksum_to"
    )
    template: str | None = Field(
        None, description="template for the lines of a simulated sensor, such as \"ST,{value:+08.3f}\"; default: "
            "derived from the pattern",
    )


class FieldEntry(DescriptionTable):
    """One number in a frame."""

    at: Byte | None = Field(None, description="first byte of the field, counted from 0 at the start of the frame")
    type: Literal[tuple(SIZES)] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="u (unsigned), i (signed) or f (float), followed by the number of bits"
    )
    order: Order | None = Field(None, description="byte order (default: that of the frame)")
    bits: Annotated[tuple[Bit, Bit], Check(_rising)] | None = Field(
        None, description="[lowest, highest] bit of the field, counted from 0"
    )
    signed: bool | None = Field(None, description="two's complement, for fields without a type (bits, packed)")
    scale: float | None = Field(
        None, description="scale in value = number * scale + offset (default: 1); for `time`: microseconds per tick"
    )
    offset: float | None = Field(None, description="see scale (default 0)")
    valid: Annotated[tuple[float, float], Check(_limits)] | None = Field(
        None, description="[lowest, highest] valid number; a number outside this range is an overload"
    )
    overload_values: tuple[int, ...] | None = Field(None, description="numbers that indicate an input out of range")
    fault_values: tuple[int, ...] | None = Field(
        None, description="numbers that indicate a broken or disconnected sensor"
    )
    overload_bits: Mask | None = Field(None, description="mask of the status bits that indicate an input out "
        "of range")
    fault_bits: Mask | None = Field(None, description="mask of the status bits that indicate a broken sensor")


class Fields(DescriptionTable):
    """The numbers in a frame."""

    value: FieldEntry | None = None
    status: FieldEntry | None = None
    sequence: FieldEntry | None = None
    time: FieldEntry | None = None
    decimals: FieldEntry | None = Field(None, description="number of decimal places of the value, 0 to 9")


class _Checksum(DescriptionTable):
    """Checksum of a binary frame."""

    checksum: Literal[FRAME_CHECKSUMS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="checksum (default: none)"
    )
    checksum_at: Byte | None = Field(None, description="first byte of the checksum, counted from 0 (default: "
        "directly before the end)")
    checksum_over: ByteSpan | None = Field(
        None, description="[first, last] byte covered by the checksum, counted from 0 (default: all bytes before "
            "the checksum)"
    )
    checksum_order: Order | None = Field(None, description="byte order (default: that of the frame)")


class FrameFormatFile(_Format, _Checksum):
    """Frames of bytes."""

    sync: Bytes | None = Field(None, description="bytes at the start of a frame")
    length: int | None = Field(
        None, ge=1, le=256, description="total frame length in bytes, including sync, checksum and end but not "
            "stuffing"
    )
    end: Bytes | None = Field(None, description="bytes at the end of a frame")
    order: Order | None = Field(None, description="byte order of numbers (default little)")
    fields: Fields | None = Field(
        None, description="table `value` and, optionally, the tables `status`, `sequence` and `time`"
    )
    packed: tuple[str, ...] | None = Field(
        None, min_length=1,
        description="for a stream without sync bytes: the bits of each byte, highest first; 0 and 1 are fixed bits, "
            f"x is any bit, {', '.join(f'{letter} is a {name} bit' for letter, name in LETTERS.items())}",
    )
    stuffing: Literal[STUFFINGS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="byte stuffing of sync bytes within a frame (default none)"
    )
    escape: Byte | None = Field(None, description="escape byte before a stuffed byte (default 0x10)")
    escape_xor: Byte | None = Field(None, description="value with which a stuffed byte is XORed (default 0; HDLC: "
        "0x20)")


Register = Annotated[int, Field(ge=0, le=999_999)]


class StatusRegister(DescriptionTable):
    """A register whose bits state the condition of the sensor."""

    address: Register = Field(examples=[1])
    overload_bits: Mask | None = Field(None, description="mask of the bits that indicate an input out of range")
    fault_bits: Mask | None = Field(None, description="mask of the bits that indicate a broken sensor")


class DecimalsRegister(DescriptionTable):
    """Register with the number of decimal places of the reading."""

    address: Register = Field(examples=[2])


class ModbusFormatFile(_AnyFormat):
    """A Modbus register that is read for each reading."""

    framing: Literal[FRAMINGS] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="tcp: Modbus TCP; rtu: Modbus RTU on a serial line or through a gateway (default tcp)"
    )
    device_id: Byte | None = Field(None, description="Modbus unit address (default 1)")
    function: Literal[tuple(FUNCTIONS)] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="holding registers (function 3) or input registers (function 4); default holding"
    )
    address: Register | None = Field(None, description="address of the first register of the reading")
    first_address: Register | None = Field(
        None, description="number that the manual gives to the register with address 0, such as 1 or 40001 (default 0)"
    )
    type: Literal[TYPES] | None = Field(  # type: ignore[valid-type]  # the format's own list
        None, description="u (unsigned), i (signed) or f (float), followed by the number of bits (default u16)"
    )
    word_order: Order | None = Field(None, description="big: the first register holds the high word (default big)")
    byte_order: Order | None = Field(None, description="order of the bytes in a register (default big)")
    scale: float | None = Field(None, description="scale in value = number * scale + offset (default 1)")
    offset: float | None = Field(None, description="see scale (default 0)")
    valid: Annotated[tuple[float, float], Check(_limits)] | None = Field(
        None, description="[lowest, highest] valid number; a number outside this range is an overload"
    )
    overload_values: tuple[int, ...] | None = Field(
        None, description="numbers that indicate an input out of range"
    )
    fault_values: tuple[int, ...] | None = Field(
        None, description="numbers that indicate a broken or disconnected sensor"
    )
    status: StatusRegister | None = Field(None, description="register with status bits, read with the reading")
    decimals: DecimalsRegister | None = Field(
        None, description="register with the number of decimal places of the reading, read with the reading"
    )
    largest_gap: int | None = Field(
        None, ge=0, le=120, description="largest number of unused registers that one request may span between this "
            "reading and that of another sensor of the same device (default 0: only adjacent registers)"
    )


class CanStatus(DescriptionTable):
    """Signal in the same message that indicates the condition of the sensor."""

    signal: str = Field(examples=["State"], description="name of the signal in the message")
    overload_values: Numbers | None = Field(
        None, description="raw numbers or value names that indicate an input out of range"
    )
    fault_values: Numbers | None = Field(
        None, description="raw numbers or value names that indicate a broken or disconnected sensor"
    )
    overload_bits: Mask | None = Field(None, description="mask of the bits that indicate an input out of range")
    fault_bits: Mask | None = Field(None, description="mask of the bits that indicate a broken sensor")


class NetworkText(DescriptionTable):
    """A network description for the station: file name and text."""

    name: str
    text: str


class CanFormatFile(_AnyFormat, _Checksum):
    """A CAN message with the reading: a signal in a DBC file, or positions of the numbers in the message."""

    dbc: str | NetworkText | None = Field(
        None, examples=["sensors.dbc"], description="DBC, KCD, SYM or ARXML file that describes the message"
    )
    signal: Name | None = Field(None, description="the signal of the reading in the DBC file")
    status: CanStatus | None = Field(None, description="signal of the same message that states the condition of the "
        "sensor")
    id: Identifier | None = Field(None, description="identifier of the message, if there is no DBC file")
    extended: bool | None = Field(None, description="29-bit identifier (default: if the identifier exceeds 0x7FF)")
    length: int | None = Field(None, ge=1, le=64, description="number of data bytes of the message")
    j1939: bool | None = Field(
        None, description="the identifier is that of a J1939 parameter group, which is accepted from any source address"
    )
    source_address: Address | None = Field(
        None, description="J1939 source address of the sensor (default: the first one that sends the parameter group)"
    )
    order: Order | None = Field(None, description="byte order of numbers (default little)")
    fields: Fields | None = Field(
        None, description="if there is no DBC file: table `value` and, optionally, the tables `status`, `sequence` "
            "and `time`"
    )
    protection: Protected = Field(
        None, description="counter and checksum of the message, as in the roles file of an ECU"
    )
    request: Request | None = Field(
        None, description='for a sensor that must be polled: "remote" (a remote frame) or the data frame that requests '
            "a reading"
    )
    valid: Annotated[tuple[float, float], Check(_limits)] | None = Field(
        None, description="[lowest, highest] valid raw number; a number outside this range is an overload"
    )
    overload_values: Numbers | None = Field(
        None, description="raw numbers or value names that indicate an input out of range"
    )
    fault_values: Numbers | None = Field(
        None, description="raw numbers or value names that indicate a broken or disconnected sensor"
    )


FormatFile = LineFormatFile | FrameFormatFile | ModbusFormatFile | CanFormatFile
_MODELS: Mapping[str, type[FormatFile]] = {
    "lines": LineFormatFile, "frames": FrameFormatFile, "modbus": ModbusFormatFile, "can": CanFormatFile,
}  # fmt: skip


def model_of(table: Mapping[str, Any]) -> type[FormatFile]:
    """What a table must fit."""
    return _MODELS[kind_of(table)]
