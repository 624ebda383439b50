"""python-can's slcan bus with another reader: blocks instead of single bytes, no 2 s wait, over `SerialPort`.

The released reader takes one byte a call (100 us of processor time a frame, half a core on a full bus). Errors that the
adapter reports (BEL) come out as error frames, as other interfaces of python-can have them; a bus-off shows as silence.
"""

from __future__ import annotations

from collections import deque

from drivers.can_library import import_can
from drivers.errors import DriverError
from drivers.serial_port import SerialPort
from protocols.slcan import Frame, SlcanDecoder, encode_fd_frame, encode_frame

import_can()
import can  # noqa: E402 - only after it was loaded without its log reader
from can.interfaces.slcan import slcanBus  # noqa: E402 - the same

WRITE_TIMEOUT_S = 0.02
CLASSIC_BYTES = 8
"""Most data of a classic frame."""


class BlockSlcanBus(slcanBus):
    """A serial CAN adapter (Lawicel protocol) on a tty or `socket://`, as a bus of python-can.

    Args:
        channel: URL of the serial port.
        bitrate: CAN bit rate, bit/s.
        data_bitrate: bit rate of the data in CAN FD frames, bit/s; None: the same bit rate.
        tty_baudrate: Bd of the serial port; ignored by sockets and USB adapters.
        device: owner of the bus, for messages.

    Attributes:
        malformed: number of lines that were neither a frame nor an answer.

    Raises:
        ValueError: slcan has no code for the bit rate; nothing was opened.
        PortClosed: the port cannot be opened.
        CanOperationError: it rejects the adapter's configuration.
    """

    def __init__(
        self, channel: str, bitrate: int, data_bitrate: int | None = None, tty_baudrate: int = 921_600,
        device: str = "ecu",
    ) -> None:
        if bitrate not in self._BITRATES:
            raise ValueError(f"slcan: unsupported bit rate {bitrate} bit/s; supported: "
                f"{', '.join(map(str, self._BITRATES))}")
        self._listen_only = False
        self._can_protocol = can.CanProtocol.CAN_20
        self._decoder = SlcanDecoder()
        self._errors = 0
        self._ready: deque[can.Message] = deque()
        self._port = SerialPort(channel, tty_baudrate, device=device)
        self._port.open()
        self.set_bitrate(bitrate, data_bitrate)
        can.BusABC.__init__(self, channel)

    @property
    def malformed(self) -> int:
        """Lines that were neither frame nor answer."""
        return self._decoder.malformed

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand one frame to the adapter; what becomes of it on the bus it does not say.

        Raises:
            CanOperationError: the port is gone, or takes no more bytes within `timeout` (s).
        """
        if msg.is_fd:
            line = encode_fd_frame(msg.arbitration_id, bytes(msg.data), msg.is_extended_id, msg.bitrate_switch)
        else:
            line = encode_frame(msg.arbitration_id, bytes(msg.data), msg.is_extended_id, msg.is_remote_frame, msg.dlc)
        self._put(line, WRITE_TIMEOUT_S if timeout is None else timeout)

    def take(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Every frame of one block, as the decoder gives them, and errors that the adapter reported with them.

        Raises:
            CanOperationError: the port is gone.
        """
        try:
            chunk, _ = self._port.read_available(timeout_s)
        except DriverError as error:
            raise can.CanOperationError(str(error)) from error
        frames = self._decoder.feed(chunk)
        errors, self._errors = self._decoder.errors - self._errors, self._decoder.errors
        return frames, errors

    def shutdown(self) -> None:
        """Leave the bus as far as the adapter still listens, and close the port."""
        try:
            super(slcanBus, self).shutdown()
            self.close()
        finally:
            self._port.close()

    def fileno(self) -> int:
        """Not supported: frames may wait in this object while the port is silent.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError("read this bus with recv()")

    def _write(self, string: str) -> None:
        self._put(string.encode("ascii") + b"\r", 0.1)

    def _put(self, line: bytes, timeout_s: float) -> None:
        try:
            self._port.write(line, timeout_s)
        except DriverError as error:
            raise can.CanOperationError(str(error)) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Next frame of those that came in one block; a new block when none is left.

        Raises:
            CanOperationError: the port is gone.
        """
        if not self._ready:
            frames, errors = self.take(1.0 if timeout is None else timeout)
            self._ready.extend(map(_message, frames))
            self._ready.extend(can.Message(is_error_frame=True) for _ in range(errors))
        return (self._ready.popleft() if self._ready else None), False


def _message(frame: Frame) -> can.Message:
    identifier, data, extended, remote, length = frame
    return can.Message(
        arbitration_id=identifier, is_extended_id=extended, is_remote_frame=remote, dlc=length, data=data,
        is_fd=length > CLASSIC_BYTES,
    )
