"""Tools that know nothing of this project, on the simulated rig's wires: mbpoll, python-can, a serial terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.clock import monotonic_ns

pytestmark = pytest.mark.wire

PATIENCE_S = 60.0


class Terminal:
    """A program on a terminal of its own, as a person would run it."""

    def __init__(self, *command: str) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        environment = {**os.environ, "TERM": "xterm"}
        self.process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, env=environment
        )
        os.close(slave)

    def read_until(self, pattern: str) -> str:
        """What it showed, until a line of it fits `pattern`."""
        seen, deadline_ns = "", monotonic_ns() + int(PATIENCE_S * 1e9)
        while re.search(pattern, seen) is None:
            assert monotonic_ns() < deadline_ns, seen[-2000:]
            try:
                seen += os.read(self._master, 4096).decode("utf-8", "replace")
            except OSError:
                pytest.fail(f"it ended without showing {pattern!r}: {seen[-2000:]}")
        return seen

    def end(self) -> None:
        """End it and close its terminal."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(PATIENCE_S)
        os.close(self._master)


@pytest.fixture(scope="module")
def bench() -> Iterator[dict[str, Any]]:
    """The bench file of a simulated rig whose load cell sends ASCII lines."""
    rig = subprocess.Popen(
        [sys.executable, "-m", "simulators", "--force-format", "ascii", "--seed", "1"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert rig.stdout is not None
    yield tomllib.loads(Path(rig.stdout.readline().strip()).read_text(encoding="utf-8"))
    rig.terminate()
    rig.wait(PATIENCE_S)
    rig.stdout.close()


@pytest.fixture
def terminal() -> Iterator[Any]:
    """Starts programs on terminals."""
    started: list[Terminal] = []

    def start(*command: str) -> Terminal:
        started.append(Terminal(*command))
        return started[-1]

    yield start
    for each in started:
        each.end()


def mbpoll(bench: dict[str, Any], kind: str, first: int, count: int) -> dict[int, str]:
    """Registers (counted from 1) to the text that mbpoll shows for them."""
    host, port = bench["actuator"]["url"].removeprefix("modbus-tcp://").split(":")
    where = ["-m", "tcp", "-a", "1", "-p", port, "-t", f"4:{kind}", "-B", "-r", str(first), "-c", str(count)]
    message = subprocess.run(
        ["mbpoll", *where, "-1", host], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    ).stdout
    return {int(number): value for number, value in re.findall(r"^\[(\d+)\]:\s+(\S+)", message, re.MULTILINE)}


@pytest.mark.skipif(shutil.which("mbpoll") is None, reason="mbpoll is not installed")
def test_mbpoll_reads_signature_vendor_and_position(bench: dict[str, Any]) -> None:
    assert list(mbpoll(bench, "hex", 1, 4).values()) == ["0x0102", "0x0304", "0x449A", "0x5000"]
    vendor = "".join(bytes.fromhex(word.removeprefix("0x")).decode() for word in mbpoll(bench, "hex", 11, 8).values())
    assert vendor.rstrip("\0") == "Simulated"
    motion = mbpoll(bench, "float", 107, 2)
    assert abs(float(motion[107])) < 1e-3
    assert abs(float(motion[109])) < 1e-2


def test_python_cans_logger_and_viewer_show_the_ecus_frames(
    bench: dict[str, Any], terminal: Any,  # noqa: ANN401 - a factory fixture
) -> None:
    channel = bench["ecu"]["channel"]
    options = ("-i", "slcan", "-c", channel, "-b", "500000")
    logged = terminal(sys.executable, "-m", "can.logger", *options).read_until(r"ID: +123 .*DL: +8")
    assert re.search(r"ID: +121 .*DL: +8", logged)
    assert re.search(r"ID: +122 .*DL: +8", logged)
    viewer = terminal(sys.executable, "-m", "can.viewer", *options)
    viewer.read_until(r"0x121(.|\n)*0x122")


def test_a_serial_terminal_shows_the_load_cells_lines(
    bench: dict[str, Any], terminal: Any,  # noqa: ANN401 - a factory fixture
) -> None:
    shown = terminal(sys.executable, "-m", "serial.tools.miniterm", bench["load_cell"]["url"], "921600")
    lines = re.findall(r"([+-]\d{7}\.\d) N\s", shown.read_until(r"(?:[+-]\d{7}\.\d N\s+){3}"))
    assert all(float(line) == pytest.approx(-270.0, abs=60.0) for line in lines), "the gas force at rest"
