"""The finaliser: one process per campaign that converts journals to files, so that compression never delays a sample.

    python -m rig.recording.conversion.finaliser

reads one JSON object per line, `{"journal": path}`, and answers one line each with the fields of `FinishedPoint`. To
`{"retime": points folder}` it answers one line for each rewritten file (`delay_correction`) and a last one
`{"retimed": error or ""}`. The work is done by a child process (`converter`), so that a journal that crashes a library
costs this point only. It ends when its input ends, after the last journal; so it also completes the files of a killed
application.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

from drivers.processes import own_program
from rig.campaign_folder import CampaignFolder
from rig.clock import monotonic_ns
from rig.recording.atomic_write import open_to_append
from rig.recording.conversion.converter import ConversionEnded, Converter
from rig.recording.point_files import FinishedPoint

if TYPE_CHECKING:
    from rig.recording.journal.recorder import PointJournal


class Finaliser:
    """The application's end of the finaliser process. Make it with `start`."""

    def __init__(self, process: subprocess.Popen[str], to_it: IO[str], from_it: IO[str]) -> None:
        self._process = process
        self._input, self._output = to_it, from_it
        self._answers: queue.Queue[FinishedPoint] = queue.Queue()
        self._kept: dict[str, FinishedPoint] = {}
        self._retimed: queue.Queue[str] = queue.Queue()
        self._pending: list[str] = []
        self._reader = threading.Thread(target=self._listen, name="finaliser answers", daemon=True)
        self._reader.start()

    @classmethod
    def start(cls, folder: Path) -> Finaliser:
        """Start the process; it warms up while the rig connects.

        Args:
            folder: the campaign's directory; what the process has to say beyond its answers goes to `finaliser.log`.
        """
        with open_to_append(CampaignFolder(folder).finaliser_log) as log:
            process = subprocess.Popen(
                own_program(__name__), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=log, text=True, start_new_session=True,
            )
        return cls(process, cast("IO[str]", process.stdin), cast("IO[str]", process.stdout))

    @property
    def alive(self) -> bool:
        """False once the process has ended."""
        return self._process.poll() is None

    def submit(self, journal: PointJournal) -> None:
        """Hand in a point's journal. Should the process be gone, the answer says so and the journal stays."""
        self._pending.append(journal.id)
        try:
            self._input.write(json.dumps({"journal": str(journal.path)}) + "\n")
            self._input.flush()
        except (OSError, ValueError) as error:
            self._answers.put(FinishedPoint(
                journal.id, error=f"the finaliser process does not respond: {error}", error_slug="conversion-crashed"
            ))

    def results(self) -> list[FinishedPoint]:
        """Points finished since the last call; returns at once."""
        points = list(self._kept.values())
        self._kept.clear()
        while True:
            try:
                points.append(self._taken(self._answers.get_nowait()))
            except queue.Empty:
                return points

    def wait(self, point_id: str, timeout_s: float) -> FinishedPoint:
        """Wait for one point; others that finish meanwhile are kept for `results`.

        Raises:
            TimeoutError: it was not finished in time; it still may be later.
        """
        if point_id in self._kept:
            return self._kept.pop(point_id)
        deadline_ns = monotonic_ns() + round(timeout_s * 1e9)
        while True:
            left_s = (deadline_ns - monotonic_ns()) * 1e-9
            try:
                answer = self._taken(self._answers.get(timeout=max(left_s, 0.001)))
            except queue.Empty:
                raise TimeoutError(f"point {point_id} was not finished within {timeout_s:g} s") from None
            if answer.id == point_id:
                return answer
            self._kept[answer.id] = answer

    def retime(self, points_folder: Path, timeout_s: float) -> list[FinishedPoint]:
        """Once every point is finished: bring them to one skew; those whose file changed, as they are now.

        Raises:
            OSError: it could not be done; every file is complete all the same.
            TimeoutError: it is not done in time, and goes on.
        """
        self._input.write(json.dumps({"retime": str(points_folder)}) + "\n")
        self._input.flush()
        try:
            problem = self._retimed.get(timeout=timeout_s)
        except queue.Empty:
            text = f"the correction to a common sensor delay did not finish within {timeout_s:g} s"
            raise TimeoutError(text) from None
        if problem:
            raise OSError(problem)
        return self.results()

    def close(self, timeout_s: float = 60.0) -> None:
        """Let it finish what it has, then end it; `results` still gives the last answers.

        Raises:
            subprocess.TimeoutExpired: it did not end in time; it goes on by itself and journals are safe.
        """
        with contextlib.suppress(BrokenPipeError):
            self._input.close()
        self._process.wait(timeout_s)
        self._reader.join(timeout_s)

    def kill(self) -> None:
        """End the process and the one below it at once; journals not yet finished stay for `rig recover`."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # a session of its own: `start_new_session`
        self._process.wait()
        with contextlib.suppress(BrokenPipeError):
            self._input.close()

    def _taken(self, answer: FinishedPoint) -> FinishedPoint:
        if answer.id in self._pending:
            self._pending.remove(answer.id)
        return answer

    def _listen(self) -> None:
        answered = set()
        with self._output:
            for line in self._output:
                answer = json.loads(line)
                if "retimed" in answer:
                    self._retimed.put(answer["retimed"])
                    continue
                answered.add(answer["id"])
                self._answers.put(FinishedPoint.from_json(answer))
        gone = "the finaliser process ended early; `rig recover` completes the files"
        for point_id in list(self._pending):
            if point_id not in answered:
                self._answers.put(FinishedPoint(point_id, error=gone, error_slug="conversion-crashed"))
        self._retimed.put("the finaliser process has ended")


def main() -> int:
    """Serve standard input until it ends, or the reader is gone: recovery does the rest."""
    with Converter() as converter, contextlib.suppress(BrokenPipeError):
        converter.start()
        for line in sys.stdin:
            for answer in _answers_to(json.loads(line), converter):
                sys.stdout.write(json.dumps(answer) + "\n")
                sys.stdout.flush()
            converter.start()
    return 0


def _answers_to(request: dict[str, str], converter: Converter) -> Iterator[dict[str, object]]:
    if "journal" in request:
        yield asdict(converter.finish(Path(request["journal"])))
        return
    problem = ""
    try:
        for point in converter.retime(Path(request["retime"])):
            yield asdict(point)
    except ConversionEnded as ended:
        problem = str(ended)
    yield {"retimed": problem}


if __name__ == "__main__":
    sys.exit(main())
