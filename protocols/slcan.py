r"""CAN frames as ASCII lines (Lawicel "slcan"), each ended by CR.

::

    t iii l dd..        standard frame: 3 hex digits identifier, 1 digit length, 2 hex digits a byte
    T iiiiiiii l dd..   extended frame: 8 hex digits identifier
    r iii l             remote request, standard          R iiiiiiii l   remote request, extended
    d iii l dd..        CAN FD, standard                  D iiiiiiii l dd..   CAN FD, extended; l is 9..F for
    b iii l dd..        the same, data at its own rate    B iiiiiiii l dd..   12, 16, 20, 24, 32, 48, 64 bytes
    [tttt]              4 hex digits of time stamp may follow where the adapter adds them
    z, Z, V.., N.., F.. adapter -> host: answers; a lone BEL (0x07) means an error
"""

from __future__ import annotations

from binascii import unhexlify

from protocols.errors import LocalProtocolError

Frame = tuple[int, bytes, bool, bool, int]
"""(identifier, data, extended, remote, stated length)."""

LONGEST_LINE = 148
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Bytes that a CAN FD frame can have, by its length code."""

_IDENTIFIER_DIGITS = dict.fromkeys(b"trdb", 3) | dict.fromkeys(b"TRDB", 8)
EXTENDED_DIGITS, CLASSIC_LENGTH = 8, 8
STAMP_BYTES = frozenset((0, 2))
_REMOTE, _FD = frozenset(b"rR"), frozenset(b"dDbB")
_LENGTH_CODES = {code: number for number, code in enumerate(b"0123456789ABCDEF")} | {
    code: 10 + number for number, code in enumerate(b"abcdef")
}
_ANSWERS = frozenset(b"zZVNF")


def encode_frame(identifier: int, data: bytes, extended: bool = False, remote: bool = False, length: int = -1) -> bytes:
    """Line of one frame.

    Args:
        identifier: up to 0x7FF, or 0x1FFFFFFF when extended.
        data: up to 8 bytes; none in a remote request.
        extended: 29-bit identifier.
        remote: remote request.
        length: stated length of a remote request; of the data otherwise.

    Raises:
        LocalProtocolError: no classic CAN frame can carry it.
    """
    stated = length if remote else len(data)
    if not 0 <= identifier <= (0x1FFFFFFF if extended else 0x7FF) or not 0 <= stated <= 8:
        raise LocalProtocolError(f"slcan: identifier 0x{identifier:X} with {stated} bytes is not a classic CAN frame")
    kind = ("R" if remote else "T") if extended else ("r" if remote else "t")
    carried = "" if remote else data.hex().upper()
    return f"{kind}{identifier:0{8 if extended else 3}X}{stated}{carried}\r".encode("ascii")


def encode_fd_frame(identifier: int, data: bytes, extended: bool = False, switched: bool = False) -> bytes:
    """Line of one CAN FD frame.

    Args:
        identifier: up to 0x7FF, or 0x1FFFFFFF when extended.
        data: as many bytes as such a frame can have.
        extended: 29-bit identifier.
        switched: the data are sent at the faster rate.

    Raises:
        LocalProtocolError: no CAN FD frame can carry it.
    """
    if not 0 <= identifier <= (0x1FFFFFFF if extended else 0x7FF) or len(data) not in FD_LENGTHS:
        raise LocalProtocolError(f"slcan: identifier 0x{identifier:X} with {len(data)} bytes is not a CAN FD frame")
    kind = ("B" if switched else "D") if extended else ("b" if switched else "d")
    code = FD_LENGTHS.index(len(data))
    return f"{kind}{identifier:0{8 if extended else 3}X}{code:X}{data.hex().upper()}\r".encode("ascii")


class SlcanDecoder:
    """Splits a byte stream into CAN frames; a chunk may begin and end anywhere.

    Attributes:
        malformed: lines that are neither a frame nor an answer.
        errors: BEL bytes, by which the adapter reports an error.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self.errors = 0
        self._rest = b""

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take bytes as they arrived; return every frame they complete, in order."""
        *lines, rest = (self._rest + chunk).split(b"\r")
        if len(rest) > LONGEST_LINE:
            self.malformed += 1
            rest = b""
        self._rest = rest
        frames: list[Frame] = []
        for line in lines:
            if b"\a" in line:
                self.errors += line.count(b"\a")
                line = line.replace(b"\a", b"")
            if not line or line[0] in _ANSWERS:
                continue
            frame = self._frame(line)
            if frame is None:
                self.malformed += 1
            else:
                frames.append(frame)
        return frames

    def clear(self) -> None:
        """Forget the unfinished line."""
        self._rest = b""

    @staticmethod
    def _frame(line: bytes) -> Frame | None:
        """The frame a line describes; None when it describes none."""
        kind = line[0]
        digits = _IDENTIFIER_DIGITS.get(kind)
        # Letters and digits only: int() would take signs and underscores too.
        if digits is None or not line.isalnum() or len(line) < digits + 2:
            return None
        begin = digits + 2
        code = _LENGTH_CODES.get(line[digits + 1])
        try:
            identifier, body = int(line[1 : digits + 1], 16), unhexlify(line[begin:])
        except ValueError:
            return None
        if code is None or (code > CLASSIC_LENGTH and kind not in _FD):
            return None
        extended, remote = digits == EXTENDED_DIGITS, kind in _REMOTE
        length = FD_LENGTHS[code]
        carried = 0 if remote else length
        if len(body) - carried not in STAMP_BYTES or identifier > (0x1FFFFFFF if extended else 0x7FF):
            return None
        return identifier, body[:carried], extended, remote, length
