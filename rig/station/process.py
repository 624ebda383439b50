"""The station process: `python -m rig.station CONFIG.json`, controlled over stdin and stdout.

It runs as long as the application's link, and after its end until the rig is stopped. Exit code 0: ended at rest;
2: the configuration cannot be used; 7: the rig's state could not be confirmed at the end.
"""

from __future__ import annotations

import gc
import json
import os
import select
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from drivers.clock import ClockRefused, Role, back_whenever, follow
from drivers.connection import draw_owner_id
from drivers.errors import DriverError
from drivers.ring import RingWriter, ring_bytes
from protocols.errors import ProtocolError
from rig.bench.settings import StationConfig
from rig.bench.settings_json import ConfigProblem, from_json
from rig.clock import monotonic_ns, wait_for
from rig.errors import EXIT_DONE, EXIT_REFUSED, EXIT_UNKNOWN_STATE, EXIT_USAGE
from rig.faults.matrix import REACTIONS
from rig.faults.row import StopKind
from rig.station.errors import StationRefused
from rig.station.interlocks.finding import Finding
from rig.station.log import say_error
from rig.station.requests import Requests
from rig.station.stop_socket import StopSocket
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices

REAL_TIME_PRIORITY = 20
END_TIMEOUT_S = 120.0
MUTATION_VARIABLE = "RIG_STATION_MUTATION"
AT_ONCE = frozenset({"stop", "status"})
"""Requests that are taken while another one is under way."""


class Station:
    """Everything of one station process."""

    def __init__(self, config: StationConfig, link: Link, ring: RingWriter) -> None:
        self.config = config
        self.link = link
        owner_id = config.owner_id or draw_owner_id()
        self.ring = ring
        self.supervisor = Supervisor(config, link.emit, ring.append, ring.beat, lambda: ring.unread_share)
        self.devices = Devices(config, owner_id, self.supervisor, self.ring.append)
        self.requests = Requests(config, self.supervisor, self.devices)
        self._busy = threading.Lock()
        self._stop_socket: StopSocket | None = None

    def start(self, real_time: str | None) -> None:
        """Start the supervisor and tell the application that requests are taken.

        Args:
            real_time: why there is no real-time priority; None when there is (or none was asked for).
        """
        self.supervisor.start()
        if self.config.stop_socket:
            try:
                self._stop_socket = StopSocket(Path(self.config.stop_socket), self._stop_requested)
            except OSError as error:
                self.supervisor.warn("station-link", "only the application can stop the rig; the page cannot: "
                    f"{error}")
        self.link.emit(
            {
                "event": "ready",
                "pid": os.getpid(),
                "ring": self.config.ring_path,
                "real_time": self.config.real_time and real_time is None,
                "real_time_reason": real_time,
                "disabled_detectors": list(self.config.disabled_detectors),
            }
        )

    def take(self, message: dict[str, object]) -> None:
        """One message of the application; never blocks."""
        do = message.get("do")
        if do == "beat":
            self.supervisor.beat(message.get("healthy") is True)
        elif do == "shutdown":
            self.link.emit({"id": message.get("id"), "ok": True})
            self.link.leave()
        else:
            # The application lives as long as it asks.
            threading.Thread(target=self._answer, args=(message, str(do)), name=f"request-{do}", daemon=True).start()

    def _stop_requested(self, by: str) -> None:
        """A stop that did not come from the application; before the ports are open there is nothing to stop."""
        if self.requests.connected:
            self.supervisor.ask_stop(StopKind.FADE_OUT, "operator", f"Stop requested on the page by {by}")

    def _answer(self, message: dict[str, object], do: str) -> None:
        number = message.get("id")
        arguments = {key: value for key, value in message.items() if key not in {"id", "do"}}
        waits = do not in AT_ONCE
        if waits and not self._busy.acquire(blocking=False):
            self.link.emit({"id": number, "refused": "busy", "message": f"{do}: another request is in progress"})
            return
        try:
            answer: dict[str, object] = {"ok": True, **self.requests.handle(do, arguments)}
        except StationRefused as error:
            answer = {"refused": error.slug, "message": error.message}
        except Exception as error:  # noqa: BLE001 - a request's defect must answer and stop the rig, not vanish
            answer = {"refused": "task-dies", "message": f"{do}: {type(error).__name__}: {error}"}
            if self.supervisor.armed:
                self.supervisor.report([Finding("task-dies", f"request {do} failed: {error}", monotonic_ns())])
            say_error()
        finally:
            back_whenever()
            if waits:
                self._busy.release()
        self.link.emit({**answer, "id": number})

    def end(self, number: int | None) -> int:
        """Stop the rig if it is armed, then close everything.

        Args:
            number: the signal that ended the link, None for the end of its input.

        Returns:
            The process's exit code.
        """
        code = EXIT_DONE
        if self.supervisor.armed:
            if number is not None:
                self.supervisor.ask_stop(StopKind.PRESSURE_OFF, "sigterm", "station received "
                    f"{signal.Signals(number).name}")
            self.supervisor.application_gone()
            code = EXIT_DONE if self._wait_safe() else EXIT_UNKNOWN_STATE
            if code == EXIT_DONE or self.supervisor.proved_without_pressure:
                self.supervisor.disarm()
                self.requests.leave()
        if self._stop_socket is not None:
            self._stop_socket.close()
        self.devices.close()
        self.supervisor.end()
        self.link.end()
        self.ring.remove()  # also where the application, which would do it, was killed
        return code

    def _wait_safe(self) -> bool:
        supervisor = self.supervisor
        with supervisor.changed:
            wait_for(supervisor.changed, lambda: supervisor.ended_for_good, END_TIMEOUT_S)
        return supervisor.proved_safe


def real_time_priority(enabled: bool) -> str | None:
    """Take SCHED_FIFO for this process and the threads it starts.

    Returns:
        Why it was not taken, None when it was or was not wanted.
    """
    if not enabled:
        return None
    if not hasattr(os, "sched_setscheduler"):
        return "this system does not support SCHED_FIFO"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    except OSError as error:
        return f"SCHED_FIFO is not permitted: {error}"
    return None


def load(path: str) -> StationConfig:
    """The configuration in `path`.

    Raises:
        ConfigProblem: unreadable, wrong, or it disables detectors outside a mutation check.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigProblem(f"{path}: {error}") from error
    config = from_json(text)
    if config.disabled_detectors and os.environ.get(MUTATION_VARIABLE) != "1":
        raise ConfigProblem(f"disabled_detectors is only for mutation checks ({MUTATION_VARIABLE}=1)")
    unknown = [slug for slug in config.disabled_detectors if slug not in REACTIONS]
    if unknown:
        raise ConfigProblem(f"disabled_detectors: unknown slug {unknown[0]!r}")
    return config


def main(arguments: list[str]) -> int:
    """Run a station until its link ends; returns the exit code."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m rig.station CONFIG.json\n")
        return EXIT_USAGE
    try:
        config = load(arguments[0])
    except ConfigProblem as error:
        sys.stderr.write(f"{arguments[0]}: {error}\n")
        return EXIT_USAGE
    try:
        follow(config.shared or "", Role.STATION, config.addresses)
    except ClockRefused as error:
        sys.stderr.write(f"{arguments[0]}: {error}\n")
        return EXIT_REFUSED
    try:
        ring = RingWriter(Path(config.ring_path), config.ring_capacity)
    except OSError as error:
        folder, needed = Path(config.ring_path).parent, ring_bytes(config.ring_capacity)
        sys.stderr.write(f"the sample ring ({needed / 1e6:.0f} MB) cannot be created in {folder}: {error}\n")
        return EXIT_REFUSED
    # Threads inherit the priority, so it comes before the first one.
    refused = real_time_priority(config.real_time)
    link = Link(sys.stdin.fileno(), sys.stdout.fileno())
    link.catch(signal.SIGTERM)
    link.catch(signal.SIGINT)
    link.catch(signal.SIGHUP)
    link.start()
    try:
        station = Station(config, link, ring)
    except (DriverError, ProtocolError) as error:
        ring.remove()
        sys.stderr.write(f"{arguments[0]}: {error}\n")
        return EXIT_USAGE
    gc.collect()
    gc.freeze()
    station.start(refused)
    return station.end(link.run(station.take))


MOST_QUEUED = 10_000
LONGEST_LINE = 1 << 22
READ_SIZE = 1 << 16


class Link:
    """Two file descriptors and the threads on them."""

    def __init__(self, in_fd: int, out_fd: int) -> None:
        self._in_fd = in_fd
        self._out_fd = out_fd
        self.dropped = 0
        self._queue: deque[bytes] = deque()
        self._something = threading.Condition()
        self._ending = False
        self._wake_read, self._wake_write = os.pipe()
        self._signalled: int | None = None
        self._writer = threading.Thread(target=self._write, name="link", daemon=True)

    def start(self) -> None:
        """Start the writing thread."""
        self._writer.start()

    def emit(self, message: dict[str, object]) -> None:
        """Queue a message for the application; returns at once."""
        line = json.dumps(message).encode() + b"\n"
        with self._something:
            if len(self._queue) >= MOST_QUEUED:
                self.dropped += 1
                return
            self._queue.append(line)
            self._something.notify()

    def catch(self, number: int) -> None:
        """Have a signal end `run` instead of the process."""
        signal.signal(number, self._on_signal)

    def leave(self) -> None:
        """End `run` from another thread."""
        os.write(self._wake_write, b"x")

    def run(self, take: Callable[[dict[str, object]], None]) -> int | None:
        """Read messages until the input ends, `leave` is called or a caught signal arrives.

        Args:
            take: called with each message, on this thread; must not block.

        Returns:
            The signal's number, or None for the end of input or `leave`.
        """
        rest = b""
        while True:
            ready, _, _ = select.select([self._in_fd, self._wake_read], [], [])
            if self._wake_read in ready:
                return self._signalled
            chunk = os.read(self._in_fd, READ_SIZE)
            if not chunk:
                return None
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                self._take_line(line, take)
            if len(rest) > LONGEST_LINE:
                detail = "the line is too long and was discarded"
                self.emit({"event": "warning", "slug": "station-link", "detail": detail})
                rest = b""

    def end(self, timeout_s: float = 1.0) -> None:
        """Write what is queued and end the writing thread."""
        with self._something:
            self._ending = True
            self._something.notify()
        self._writer.join(timeout_s)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del frame
        self._signalled = number
        os.write(self._wake_write, b"s")

    def _take_line(self, line: bytes, take: Callable[[dict[str, object]], None]) -> None:
        try:
            message = json.loads(line)
        except ValueError:
            message = None
        if isinstance(message, dict):
            take(message)
        elif line.strip():
            detail = f"expected a JSON object, got {line[:80]!r}"
            self.emit({"event": "warning", "slug": "station-link", "detail": detail})

    def _write(self) -> None:
        while True:
            with self._something:
                while not self._queue and not self._ending:
                    self._something.wait()
                if not self._queue:
                    return
                data = b"".join(self._queue)
                self._queue.clear()
            view = memoryview(data)
            try:
                while view:
                    view = view[os.write(self._out_fd, view) :]
            except OSError:
                # The application is gone; the end of its input says so to `run`. What it does not read is dropped.
                self.dropped += data.count(b"\n")
