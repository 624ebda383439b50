"""The load cell: force in N on channel FORCE."""

from __future__ import annotations

from drivers.ring import Channel
from drivers.serial_sensor import FRAME16, SerialSensor
from protocols.line_format import LineFormat


class LoadCell(SerialSensor):
    """Force sensor with its own conditioner; positive force resists extension.

    Args:
        url: port, e.g. "/dev/ttyUSB0" or "socket://host:port".
        baudrate: Bd.
        line_format: "frame16", a line format preset's name, or a `LineFormat`.
        sensitivity: N per unit on the wire.
        offset: N, added after scaling: minus what it shows at zero.
        rate_Hz: nominal samples a second of the device's clock.
        device_rate: device seconds a second of the host's clock.

    Raises:
        LocalProtocolError: no format of that name.
    """

    def __init__(
        self,
        url: str,
        baudrate: int = 115200,
        *,
        line_format: str | LineFormat = FRAME16,
        sensitivity: float = 1.0,
        offset: float = 0.0,
        rate_Hz: float | None = None,
        device_rate: float = 1.0,
    ) -> None:
        super().__init__(
            url, baudrate, name="load_cell", channel=Channel.FORCE, line_format=line_format,
            sensitivity=sensitivity, offset=offset, rate_Hz=rate_Hz, device_rate=device_rate,
        )
