"""A supply for driver tests, written from SCPI-1999 (volume 2: CURRent, VOLTage, OUTPut, MEASure, SYSTem:ERRor) and
IEEE 488.2 (*IDN?, *CLS): short and long forms, upper and lower case, an error queue of numbers and texts.

It knows nothing of descriptions: what the driver sends must be what the standard says.
"""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
from typing import Self

IDENTITY = "MAKER,MODEL 1,SN0042,2.01"
ENDS = b"\n"


class ScpiPeer:
    """One output; the coil takes its set current at once when the output is on.

    Attributes:
        lines: what was sent to it, in order.
        current_A, volts, on: its set-points.
        open_circuit: no current flows, the voltage is at its limit.
        mute: it answers nothing; `slow_s` delays every answer.
    """

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self.lines: list[str] = []
        self.current_A, self.volts, self.on = 0.0, 0.0, False
        self.open_circuit = self.mute = False
        self.slow_s = 0.0
        self.errors: list[str] = []
        self.answers: dict[str, str] = {}
        self._changed = threading.Condition()
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def wait_for(self, condition, timeout_s: float = 5.0) -> bool:  # noqa: ANN001 - a test's condition on the lines
        with self._changed:
            return self._changed.wait_for(lambda: condition(self.lines), timeout_s)

    @property
    def flows_A(self) -> float:
        return self.current_A if self.on and not self.open_circuit else 0.0

    def obey(self, line: str) -> str | None:
        """One program message; the response message of a query."""
        header, _, parameter = line.strip().partition(" ")
        header = header.upper().lstrip(":")
        if header in self.answers:
            return self.answers[header]
        if header == "*IDN?":
            return IDENTITY
        if header == "*CLS":
            self.errors.clear()
        elif re.fullmatch(r"(SOUR(CE)?:)?CURR(ENT)?", header):
            self.current_A = float(parameter)
        elif re.fullmatch(r"(SOUR(CE)?:)?VOLT(AGE)?", header):
            self.volts = float(parameter)
        elif re.fullmatch(r"OUTP(UT)?(:STAT(E)?)?", header):
            self.on = parameter.upper() in {"ON", "1"}
        elif re.fullmatch(r"OUTP(UT)?(:STAT(E)?)?\?", header):
            return "1" if self.on else "0"
        elif re.fullmatch(r"(MEAS|MEASURE):CURR(ENT)?(:DC)?\?", header):
            return f"{self.flows_A:+.8E}"
        elif re.fullmatch(r"(MEAS|MEASURE)(:VOLT(AGE)?)?(:DC)?\?", header):
            return f"{self.volts if self.on and self.open_circuit else 1.5 * self.flows_A:+.8E}"
        elif re.fullmatch(r"SYST(EM)?:ERR(OR)?(:NEXT)?\?", header):
            return self.errors.pop(0) if self.errors else '+0,"No error"'
        else:
            self.errors.append('-113,"Undefined header"')
        return None

    def _serve(self) -> None:
        while True:
            try:
                self._connection, _ = self._server.accept()
            except OSError:
                return
            self._answer(self._connection)

    def _answer(self, connection: socket.socket) -> None:
        rest = b""
        with connection, contextlib.suppress(OSError):
            while data := connection.recv(4096):
                *lines, rest = (rest + data).split(ENDS)
                for line in lines:
                    text = line.decode()
                    answer = self.obey(text)
                    with self._changed:
                        self.lines.append(text)
                        self._changed.notify_all()
                    if answer is not None and not self.mute:
                        time.sleep(self.slow_s)
                        connection.sendall(answer.encode() + ENDS)

    def pull(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.pull()
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join(5)
