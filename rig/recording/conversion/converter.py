"""Conversion of journals in a separate process: a crash caused by one journal does not affect the others.

    python -m rig.recording.conversion.converter

reads one JSON object per line, `{"journal": path, "recovered": bool}` or `{"retime": points folder}`, answers with
lines of the fields of `FinishedPoint`, and with `{"done": error or ""}` when a request is finished. `Converter` is the
other end: it starts the process, reports its failure (a crash of a library, a time-out) and starts another one.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO

from drivers.posix import resource
from drivers.processes import own_program
from rig.clock import monotonic_ns
from rig.recording.point_files import FinishedPoint, journal_name

NICENESS = 5
MEMORY_BYTES = 2 << 30
"""What a process may take beyond what it needs to start; a ten-minute point at 10 kHz takes less than a tenth of it."""
TIMEOUT_S = 300.0
BYTES_A_SECOND = 500_000.0
"""A journal may take this long for its length: twenty times the CPU time that was measured."""
RETIME_TIMEOUT_S = 600.0
"""From one answer to the next."""


class ConversionEnded(Exception):
    """The process that makes files died or was ended while it was at work; `slug` is that of `FinishedPoint`."""

    def __init__(self, slug: str, message: str) -> None:
        self.slug = slug
        super().__init__(message)


class Converter:
    """Makes files of journals, one at a time, in a process that is started when needed and replaced when it dies.

    Args:
        log: file for what libraries have to say; by default the standard error.
        timeout_s: a journal's time beside what its length allows.
    """

    def __init__(self, log: TextIO | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        self._log = log
        self._timeout_s = timeout_s
        self._process: subprocess.Popen[bytes] | None = None
        self._unread = b""

    def start(self) -> None:
        """Start the process now, so that it is warm when the first journal comes."""
        if self._process is not None and self._process.poll() is None:
            return
        self.close()
        self._unread = b""
        self._process = subprocess.Popen(
            own_program(__name__), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
        )

    def finish(self, journal: Path, *, recovered: bool = False) -> FinishedPoint:
        """`recovery.finish_alone` over there; the answer says what happened, also to the process itself.

        Args:
            journal: the point's journal; it must not be recorded to.
            recovered: as for `conversion.finish_point`.
        """
        size = 0
        with contextlib.suppress(OSError):
            size = journal.stat().st_size
        request = {"journal": str(journal), "recovered": recovered}
        try:
            answers = list(self._answers(request, self._timeout_s + size / BYTES_A_SECOND))
        except ConversionEnded as ended:
            return FinishedPoint(
                journal_name(journal), error=f"{journal.name}: {ended}; the journal is kept", error_slug=ended.slug
            )
        return FinishedPoint.from_json(answers[0])

    def retime(self, points: Path) -> Iterator[FinishedPoint]:
        """`retiming.retime` over there; gives each file that was written again.

        Raises:
            ConversionEnded: it could not be done, or not for all; every file is complete all the same.
        """
        for answer in self._answers({"retime": str(points)}, RETIME_TIMEOUT_S):
            yield FinishedPoint.from_json(answer)

    def close(self) -> None:
        """End the process, which finishes what it is doing."""
        if self._process is None:
            return
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._process = None

    def _answers(self, request: dict[str, Any], timeout_s: float) -> Iterator[dict[str, Any]]:
        """The answers to a request, each awaited for `timeout_s`.

        Raises:
            ConversionEnded: the process died, hung and was ended, or says that it failed.
        """
        self.start()
        process = self._process
        if process is None or process.stdin is None:
            raise ConversionEnded("conversion-crashed", "the converter process could not be started")
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        except OSError:
            raise self._ended(process) from None
        while True:
            line = self._line(process, timeout_s)
            if line is None:
                raise self._ended(process)
            answer = json.loads(line)
            if "done" in answer:
                if answer["done"]:
                    raise ConversionEnded("conversion-failed", answer["done"])
                return
            yield answer

    def _line(self, process: subprocess.Popen[bytes], timeout_s: float) -> bytes | None:
        """One line of the process's output; None when it has ended.

        Raises:
            ConversionEnded: none came in time; the process is killed.
        """
        if process.stdout is None:
            return None
        deadline_ns = monotonic_ns() + round(1e9 * timeout_s)
        while b"\n" not in self._unread:
            left_s = (deadline_ns - monotonic_ns()) * 1e-9
            if left_s <= 0.0 or not select.select([process.stdout], [], [], left_s)[0]:
                process.kill()
                process.wait()
                text = f"the conversion did not finish within {timeout_s:.0f} s and was cancelled"
                raise ConversionEnded("conversion-timeout", text)
            data = os.read(process.stdout.fileno(), 1 << 16)
            if not data:
                return None
            self._unread += data
        line, _, self._unread = self._unread.partition(b"\n")
        return line

    @staticmethod
    def _ended(process: subprocess.Popen[bytes]) -> ConversionEnded:
        code = process.wait()
        how = f"stopped with exit code {code}"
        if code < 0:
            name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
            how = f"was terminated by {name}"
        return ConversionEnded("conversion-crashed", f"the converter process {how}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        if kind is not None and self._process is not None:
            self._process.kill()
        self.close()


def warm_up() -> None:
    """Load what the first point would wait for, and write one small file."""
    import numpy as np

    from rig.recording.hdf5.hdf5_image import write_file  # loads numpy
    from rig.recording.hdf5.read_back import prove  # loads numpy
    from rig.recording.layout import AlignedChannel, PointFile  # loads numpy

    import_module("rig.recording.conversion.conversion")
    time_s = np.arange(16) / 250.0
    point = PointFile(
        time_s, 250.0, [AlignedChannel("force", time_s, "N", "Force")],
        test={"id": "p000", "waveform": "sine", "amplitude_m": 0.0, "frequency_Hz": 0.0, "current_A": 0.0},
    )
    with tempfile.TemporaryDirectory() as folder:
        write_file(
            Path(folder) / "p000.h5", point, before_naming=lambda partial, checks: prove(partial, point, checks)
        )


def limit_memory() -> None:
    """No journal takes the memory that the station needs: beyond the limit it is this process that fails."""
    status = Path("/proc/self/statm")
    if not status.is_file() or resource is None:
        return
    page = os.sysconf("SC_PAGE_SIZE")
    data_pages = int(status.read_text(encoding="ascii").split()[5])
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = data_pages * page + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def main() -> int:
    """Serve standard input until it ends; Ctrl-C is for the application, which then ends this process if it must.

    If the reader is gone there is no one to answer: a finished file remains, else its journal does.
    """
    os.nice(NICENESS)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A library that prints must not answer in our name.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with contextlib.suppress(OSError):
        warm_up()
    limit_memory()
    with contextlib.suppress(BrokenPipeError):
        for line in sys.stdin:
            for answer in _served(json.loads(line)):
                answers.write(json.dumps(answer) + "\n")
                answers.flush()
    return 0


def _served(request: dict[str, Any]) -> Iterator[dict[str, Any]]:
    from rig.recording.conversion.conversion import finish_alone  # loads numpy
    from rig.recording.conversion.delay_correction import retime  # loads numpy

    if "journal" in request:
        yield asdict(finish_alone(Path(request["journal"]), recovered=request["recovered"]))
        yield {"done": ""}
        return
    try:
        for point in retime(Path(request["retime"])):
            yield asdict(point)
    except Exception as error:  # noqa: BLE001 - reported by name to the client; the process serves the next request
        yield {"done": f"{type(error).__name__}: {error}"}
    else:
        yield {"done": ""}


if __name__ == "__main__":
    sys.exit(main())
