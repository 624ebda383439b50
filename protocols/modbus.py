"""Modbus requests and answers for registers and coils, and their frames on TCP and on a serial line.

Messages and frames are built and read by pymodbus; what is added here is the matching of an answer to its request.
House rules: no I/O here; an answer is believed only when function, count and echo are those of the request.

    PDU     function u8 | data                          an exception answer: function + 0x80 | code u8
    TCP     transaction u16 | 0 u16 | length u16 | unit u8 | PDU
    RTU     unit u8 | PDU | CRC-16 (low byte first)     no length, no transaction: the request decides what may come
"""

from __future__ import annotations

from collections.abc import Sequence

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsRequest,
    ReadDiscreteInputsRequest,
    WriteMultipleCoilsRequest,
    WriteSingleCoilRequest,
)
from pymodbus.pdu.register_message import (
    MaskWriteRegisterRequest,
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
)

from protocols.errors import RemoteProtocolError

READ_COILS, READ_DISCRETE, READ, READ_INPUT = 1, 2, 3, 4
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE, MASK_WRITE, EXCHANGE = 5, 6, 15, 16, 22, 23
WRITES = frozenset({WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE})
ECHOING = frozenset({WRITE_COIL, WRITE_REGISTER})
"""Functions whose answer repeats the request."""
BIT_READS = frozenset({READ_COILS, READ_DISCRETE})
BUSY = 6
EXCEPTION_BIT = 0x80
EXCEPTION_NAMES = {
    1: "illegal function", 2: "illegal address", 3: "illegal value", 4: "device failure",
    5: "acknowledge", 6: "busy", 10: "gateway path unavailable", 11: "gateway target silent",
}
LONGEST_PDU = 253
_COIL_VALUES = {b"\xff\x00": "1", b"\x00\x00": "0"}
_ANSWERS = DecodePDU(is_server=False)
_TCP = FramerSocket(_ANSWERS)
_RTU = FramerRTU(_ANSWERS)
_TCP_HEADER_SIZE = 7
_CRC_SIZE = 2
_MASK_ANSWER_SIZE = 10


def _pdu(message: ModbusPDU) -> bytes:
    return bytes([message.function_code]) + message.encode()


def read_request(address: int, count: int, function: int = READ) -> bytes:
    """PDU of a read of `count` registers (1..125) or coils (1..2000) from `address`, by function 1, 2, 3 or 4."""
    kinds: dict[int, type[ModbusPDU]] = {
        READ_COILS: ReadCoilsRequest, READ_DISCRETE: ReadDiscreteInputsRequest, READ: ReadHoldingRegistersRequest,
        READ_INPUT: ReadInputRegistersRequest,
    }  # fmt: skip
    return _pdu(kinds[function](address=address, count=count))


def write_request(address: int, words: Sequence[int], function: int = WRITE) -> bytes:
    """PDU of a write from `address`, by function 5, 6, 15, 16 or 22.

    Args:
        address: first register or coil.
        words: 1..123 registers or coils (0 or 1); for function 22, the mask of the unchanged bits and the other bits.
        function: 5, 6, 15, 16 or 22.
    """
    if function == MASK_WRITE:
        return _pdu(MaskWriteRegisterRequest(address=address, and_mask=words[0], or_mask=words[1]))
    if function == WRITE_COIL:
        return _pdu(WriteSingleCoilRequest(address=address, bits=[bool(words[0])]))
    if function == WRITE_COILS:
        return _pdu(WriteMultipleCoilsRequest(address=address, bits=[bool(word) for word in words]))
    if function == WRITE_REGISTER:
        return _pdu(WriteSingleRegisterRequest(address=address, registers=[words[0]]))
    return _pdu(WriteMultipleRegistersRequest(address=address, count=len(words), registers=list(words)))


def exchange_request(read_address: int, read_count: int, write_address: int, words: Sequence[int]) -> bytes:
    """PDU of a write of `words` (1..121) followed by a read of `read_count` (1..125) registers."""
    return _pdu(
        ReadWriteMultipleRegistersRequest(
            read_address=read_address, read_count=read_count, write_address=write_address, write_registers=list(words)
        )
    )


def refusal(request: bytes, answer: bytes) -> int | None:
    """The exception code of an answer that refuses `request`; None when it is no such answer."""
    refused = len(answer) == 2 and answer[0] == request[0] | EXCEPTION_BIT
    return answer[1] if refused else None


def decode_bits(request: bytes, answer: bytes, count: int) -> list[int]:
    """Coils (0 and 1) of the answer to a read of them.

    Raises:
        RemoteProtocolError: another function, another count, or bytes missing or left over.
    """
    _check_function(request, answer)
    size = (count + 7) // 8
    if len(answer) != 2 + size or answer[1] != size:
        raise RemoteProtocolError(f"requested {count} coils in {size} bytes, but the answer has {len(answer) - 2} "
            "bytes")
    return [answer[2 + place // 8] >> place % 8 & 1 for place in range(count)]


def decode_words(request: bytes, answer: bytes, count: int) -> list[int]:
    """Registers of the answer to a read or an exchange.

    Raises:
        RemoteProtocolError: another function, another count, or bytes missing or left over.
    """
    _check_function(request, answer)
    if len(answer) < 2 or len(answer) != 2 + answer[1] or answer[1] % 2:
        raise RemoteProtocolError(f"the answer's byte count does not match its {len(answer)} bytes")
    if answer[1] != 2 * count:
        raise RemoteProtocolError(f"requested {count} registers, got {answer[1] // 2}")
    message = _ANSWERS.decode(answer)
    if message is None:
        raise RemoteProtocolError(f"the answer {answer.hex()} cannot be decoded")
    return list(message.registers)


def check_written(request: bytes, answer: bytes) -> None:
    """Make sure that the answer acknowledges this write.

    Raises:
        RemoteProtocolError: another function, address or count.
    """
    _check_function(request, answer)
    if answer != request[: 7 if request[0] == MASK_WRITE else 5]:
        if request[0] in ECHOING and len(answer) == len(request) and answer[:3] == request[:3]:
            coil = request[0] == WRITE_COIL
            wrote, named = (_COIL_VALUES.get(one[3:5], one[3:5].hex()) if coil else str(int.from_bytes(one[3:5], "big"))
                            for one in (request, answer))
            at = f"{'coil' if coil else 'register'} {int.from_bytes(request[1:3], 'big')}"
            raise RemoteProtocolError(f"wrote {wrote} to {at}, but the answer states {named}: the value was not "
                "accepted")
        wrote_at, named_at = request[1:5].hex(), answer[1:].hex()
        raise RemoteProtocolError(f"wrote address and count {wrote_at}, but the answer states {named_at or 'nothing'}")


def _check_function(request: bytes, answer: bytes) -> None:
    if not answer or answer[0] != request[0]:
        got = f"has function {answer[0]}" if answer else "is empty"
        raise RemoteProtocolError(f"the request has function {request[0]}, but the answer {got}")


def encode_tcp(transaction: int, unit: int, pdu: bytes) -> bytes:
    """A frame on TCP."""
    return _TCP.encode(pdu, unit, transaction)


class TcpFrames:
    """Cuts frames out of what a TCP connection brings; a chunk is never a frame."""

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> None:
        """Take what was read."""
        self._held += data

    def next(self) -> tuple[int, int, bytes] | None:
        """Transaction, unit and PDU of the next whole frame; None while there is none.

        Raises:
            RemoteProtocolError: the header is not Modbus; the stream cannot be followed any further.
        """
        if len(self._held) < _TCP_HEADER_SIZE:
            return None
        protocol, length = int.from_bytes(self._held[2:4], "big"), int.from_bytes(self._held[4:6], "big")
        if protocol != 0 or not 2 <= length <= LONGEST_PDU + 1:
            raise RemoteProtocolError(f"invalid Modbus header: protocol {protocol}, length {length}")
        end = _TCP_HEADER_SIZE - 1 + length
        if len(self._held) < end:
            return None
        _, unit, transaction, pdu = _TCP.decode(bytes(self._held[:end]))
        del self._held[:end]
        return transaction, unit, pdu


def encode_rtu(unit: int, pdu: bytes) -> bytes:
    """A frame on a serial line."""
    return _RTU.encode(pdu, unit, 0)


def rtu_answer_size(head: bytes, request: bytes) -> int | None:
    """Bytes of the whole answer frame that begins with `head`; None while it does not show yet.

    Args:
        head: what has come so far.
        request: the PDU asked.

    Raises:
        RemoteProtocolError: what comes is no answer to this request's function.
    """
    if len(head) < 2:
        return None
    if head[1] == request[0] | EXCEPTION_BIT:
        return ExceptionResponse.rtu_frame_size
    if head[1] != request[0]:
        raise RemoteProtocolError(f"the request has function {request[0]}, but the answer has function {head[1]}")
    if head[1] == MASK_WRITE:
        return _MASK_ANSWER_SIZE
    if head[1] in WRITES:
        return WriteMultipleRegistersResponse.rtu_frame_size
    return None if len(head) < 3 else 3 + head[2] + _CRC_SIZE


def decode_rtu(frame: bytes) -> tuple[int, bytes]:
    """Unit and PDU of a whole frame.

    Raises:
        RemoteProtocolError: too short, or the checksum is wrong.
    """
    if len(frame) < ExceptionResponse.rtu_frame_size:
        raise RemoteProtocolError(f"the frame has only {len(frame)} bytes")
    sent = int.from_bytes(frame[-_CRC_SIZE:], "big")
    if not FramerRTU.check_CRC(frame[:-_CRC_SIZE], sent):
        computed = FramerRTU.compute_CRC(frame[:-_CRC_SIZE])
        raise RemoteProtocolError(f"checksum 0x{sent:04X}, computed 0x{computed:04X}")
    return frame[0], frame[1:-_CRC_SIZE]
