"""Data sent to a sensor: commands that start and stop continuous transmission, or a request for each reading."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Exchange:
    """What a format has the host send.

    Attributes:
        start_command, stop_command: bytes that start and stop the device's own sending; b"" where it needs none.
        request: bytes that ask for one reading; b"" for a device that sends by itself.
        answer_timeout_s: longest wait for the answer to a request (s).
    """

    start_command: bytes = b""
    stop_command: bytes = b""
    request: bytes = b""
    answer_timeout_s: float = 0.1
