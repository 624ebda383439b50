"""The application's end of the link to the station process: requests, events, heartbeats.

One JSON object per line in both directions. A request carries `id` and `do`; its answer carries the same `id` and
either `ok` with results or `refused` with a code. Lines without `id` from the station are events. `beat` has no answer.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import queue
import select
import subprocess
import threading
from collections import deque
from pathlib import Path
from typing import Any

from drivers.prepared import Prepared, start_program
from rig.bench.settings import StationConfig
from rig.campaign_folder import CampaignFolder
from rig.clock import monotonic_ns
from rig.recording.atomic_write import open_to_append, write_text_durably
from rig.station.errors import StationLost, StationRefused

START_TIMEOUT_S = 60.0
WRITE_TIMEOUT_S = 1.0
QUIET_S, MOST_HEARD = 0.01, 20
"""In so long the link's thread has read what has come; beside other work too."""

__all__ = ["StationClient", "StationLost", "StationRefused"]


class StationClient:
    """A running station process.

    The process runs in its own session, so that a terminal's Ctrl-C reaches only the application. When this client goes
    away without `close`, the station sees the end of its input and stops the rig by itself.

    Attributes:
        ready: the station's first event: `pid`, `ring`, `real_time` and, when that was refused, `real_time_reason`.
    """

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        if process.stdin is None or process.stdout is None:
            raise ValueError("the station process requires pipes on stdin and stdout")
        self.process = process
        self.ready: dict[str, Any] = {}
        self._stdin_fd = process.stdin.fileno()
        os.set_blocking(self._stdin_fd, False)
        self._write_lock = threading.Lock()
        self._ids = itertools.count(1)
        self._answers: dict[int, queue.SimpleQueue[dict[str, Any] | None]] = {}
        self._answers_lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque()
        self._something = threading.Condition()
        self._ended = False
        self._reader = threading.Thread(target=self._read, name="station-link", daemon=True)
        self._reader.start()

    @classmethod
    def start(
        cls, config: StationConfig, folder: Path, timeout_s: float = START_TIMEOUT_S, *,
        inherited: tuple[int, ...] = (), prepared: Prepared | None = None,
    ) -> StationClient:
        """Start the station process with its files (`station.json`, `station.log`) in `folder`; wait until it is ready.

        Args:
            config: what it is told.
            folder: where its files lie.
            timeout_s: wall seconds it may take.
            inherited: descriptors it keeps open for as long as it lives: the locks on its devices.
            prepared: a process of `rig.station.process` that may wait; None: the station is loaded now.

        Raises:
            StationLost: the process ended or was silent for `timeout_s` wall seconds; its log's tail is in the message.
        """
        folder.mkdir(parents=True, exist_ok=True)
        config_path = CampaignFolder(folder).station_config
        write_text_durably(config_path, config.to_json())
        log_path = CampaignFolder(folder).station_log
        with open_to_append(log_path) as log:
            process = start_program("rig.station", [str(config_path)], {2: log}, inherited, prepared=prepared)
        client = cls(process)
        deadline_ns = monotonic_ns() + int(timeout_s * 1e9)
        while monotonic_ns() < deadline_ns and client.alive:
            waiting_s = (deadline_ns - monotonic_ns()) / 1e9
            early = client.events(timeout_s=waiting_s)
            ready = [event for event in early if event.get("event") == "ready"]
            if ready:
                client.ready = ready[0]
                client._events.extendleft(reversed([event for event in early if event not in ready]))
                return client
        client.close(timeout_s=1.0)
        raise StationLost(f"the station did not start; last lines of {log_path}:\n{_tail(log_path)}")

    @property
    def alive(self) -> bool:
        """The process runs and its link has not ended."""
        return not self._ended and self.process.poll() is None

    def request(self, do: str, timeout_s: float = 10.0, **arguments: object) -> dict[str, Any]:
        """Ask for `do` and wait for the proved answer.

        Args:
            do: the request's name (`connect`, `arm`, `move`, ...; see `rig.station.requests`).
            timeout_s: wall seconds to wait for the answer.
            **arguments: the request's arguments, SI.

        Returns:
            The answer's results.

        Raises:
            StationRefused: the station refused or could not prove it.
            StationLost: the station is gone or did not answer.
        """
        number = next(self._ids)
        answers: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        with self._answers_lock:
            self._answers[number] = answers
        try:
            if self._ended:
                raise StationLost(f"{do}: the station process has ended (exit code {self.process.poll()})")
            self._write({"id": number, "do": do, **arguments})
            answer = self._answer(answers, do, timeout_s)
        finally:
            with self._answers_lock:
                del self._answers[number]
        if answer is None:
            raise StationLost(f"{do}: the station process ended before it answered")
        if "refused" in answer:
            raise StationRefused(answer["refused"], answer.get("message", ""))
        return {key: value for key, value in answer.items() if key not in {"id", "ok"}}

    @staticmethod
    def _answer(answers: queue.SimpleQueue[dict[str, Any] | None], do: str, timeout_s: float) -> dict[str, Any] | None:
        """The answer to a request; None where the station has ended.

        Raises:
            StationLost: there is none in time.
        """
        until_ns = monotonic_ns() + int(1e9 * timeout_s)
        while True:
            try:
                return answers.get(timeout=max(0.0, (until_ns - monotonic_ns()) * 1e-9))
            except queue.Empty:
                if monotonic_ns() >= until_ns:
                    raise StationLost(f"{do}: no answer from the station within {timeout_s:g} s") from None

    def events(self, timeout_s: float = 0.0) -> list[dict[str, Any]]:
        """The events that came since the last call, oldest first; waits up to `timeout_s` for the first one."""
        with self._something:
            if not self._events and timeout_s > 0 and not self._ended:
                self._something.wait(timeout_s)
            taken = list(self._events)
            self._events.clear()
        return taken

    def heard(self) -> list[dict[str, Any]]:
        """All that the station has said until now, oldest first, also where the link's thread has not read it yet.

        Waits until nothing comes for `QUIET_S`; not for ever, whatever the station says.
        """
        taken: list[dict[str, Any]] = []
        for _ in range(MOST_HEARD):
            more = self.events(timeout_s=QUIET_S)
            if not more:
                break
            taken += more
        return taken

    def beat(self, healthy: bool) -> None:
        """Tell the station that the application lives and whether its recorder is well.

        Raises:
            StationLost: the station is gone or does not read.
        """
        self._write({"do": "beat", "healthy": healthy})

    def close(self, timeout_s: float = 15.0) -> int | None:
        """End the link and wait for the process; the station stops the rig first if it moves.

        Returns:
            The process's exit code, or None when it still runs after `timeout_s` wall seconds (it is then left to its
            work: the rig's dead-men act without it, and killing it would not stop the rig sooner).
        """
        with contextlib.suppress(OSError):
            if self.process.stdin is not None:
                self.process.stdin.close()
        try:
            code: int | None = self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None
        self._reader.join(timeout=1.0)
        if self.process.stdout is not None:
            self.process.stdout.close()
        return code

    def _write(self, message: dict[str, Any]) -> None:
        data = json.dumps(message).encode() + b"\n"
        deadline_ns = monotonic_ns() + int(WRITE_TIMEOUT_S * 1e9)
        with self._write_lock:
            while data:
                if self.process.stdin is None or self.process.stdin.closed:
                    raise StationLost("the link to the station is closed")
                try:
                    data = data[os.write(self._stdin_fd, data) :]
                except BlockingIOError:
                    if monotonic_ns() > deadline_ns:
                        raise StationLost("the station is not reading its input") from None
                    select.select([], [self._stdin_fd], [], 0.05)
                except OSError as error:
                    raise StationLost(f"the link to the station was lost: {error}") from error

    def _read(self) -> None:
        if self.process.stdout is None:
            return
        for line in self.process.stdout:
            try:
                message = json.loads(line)
            except ValueError:
                message = {"event": "warning", "slug": "station-link", "detail": f"not JSON: {line!r}"}
            self._take(message)
        with self._something:
            self._ended = True
            self._something.notify_all()
        with self._answers_lock:
            for answers in self._answers.values():
                answers.put(None)

    def _take(self, message: dict[str, Any]) -> None:
        number = message.get("id")
        if number is None:
            with self._something:
                self._events.append(message)
                self._something.notify_all()
            return
        with self._answers_lock:
            answers = self._answers.get(number)
        if answers is not None:
            answers.put(message)


def _tail(path: Path, size: int = 2000) -> str:
    data = path.read_bytes()
    return data[-size:].decode("utf-8", "replace")
