"""`rig run` as a user starts it, watched while it runs and read when it has ended."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from true_states import Truth

from rig.clock import monotonic_ns
from rig.recording.journal.campaign_log import read_log
from rig.recording.recorded_point import RecordedPoint
from simulators.truth import ROW

RIG = str(Path(sys.executable).with_name("rig"))
FINISH_S = 150.0
TRUTH_ROW_BYTES = ROW.itemsize
TRUTH_RATE_HZ = 1000.0


@dataclass(frozen=True)
class Ending:
    """A campaign that has ended: what it answered, what it wrote, what really happened."""

    exit_code: int
    answer: dict[str, Any]
    folder: Path
    output: str
    truth_path: Path
    stopped_from_ns: int | None = None
    """Host time of a fault injected around the process; None for one that the simulated rig logged itself."""

    @cached_property
    def truth(self) -> Truth:
        """What really happened; a simulated rig that outlives its campaign is waited for."""
        wait_until(self.truth_path.exists, self.truth_path.name, 60.0)
        return Truth.load(self.truth_path)

    @cached_property
    def log(self) -> list[dict[str, Any]]:
        """The campaign's journal."""
        return read_log(self.folder)

    def trips(self) -> list[tuple[str, str]]:
        """Slug and stop of every latched first cause."""
        return [(line["slug"], line["stop"]) for line in self.log if line.get("what") == "trip"]

    def warned(self) -> list[str]:
        """Slugs the station only warned of while the campaign went on."""
        return [line["slug"] for line in self.log if line.get("what") == "warning"]

    def point(self, name: str) -> RecordedPoint:
        """A finished or stopped point's file."""
        return RecordedPoint.open(self.folder / "points" / f"{name}.h5")

    def verdicts(self) -> dict[str, str]:
        """Verdicts of the campaign's points as it answered them."""
        return {each["id"]: each["verdict"] for each in self.answer["points"]}


def wait_until(true: Callable[[], bool], what: str, timeout_s: float = 60.0) -> None:
    """Wait for a state of files or processes that nothing announces."""
    deadline_ns, pause = monotonic_ns() + int(timeout_s * 1e9), threading.Event()
    while not true():
        assert monotonic_ns() < deadline_ns, f"{what} did not come within {timeout_s:g} s"
        pause.wait(0.01)


@lru_cache(maxsize=1)
def events_in(path: Path, size: int) -> list[dict[str, Any]]:
    """Whole lines of a simulated rig's live log of that size (bytes): it is asked for far more often than it grows."""
    complete = path.read_bytes()[:size].splitlines(keepends=True)
    return [json.loads(line) for line in complete if line.endswith(b"\n")]


@dataclass(frozen=True)
class Campaign:
    """`rig run` under way. Its rig's truth is in its directory, or where a rig of its own was told to write it."""

    process: subprocess.Popen[str]
    out: Path
    rigs_own_truth: Path | None = None

    @property
    def folder(self) -> Path:
        """The campaign's directory, once it is made."""
        wait_until(lambda: self.process.poll() is not None or any(self.out.iterdir()), "the campaign's directory")
        return next(iter(self.out.iterdir()))

    @property
    def truth_path(self) -> Path:
        """Where the truth is when the simulated rig has ended; its pieces lie beside it before."""
        return self.rigs_own_truth or self.folder / "truth.h5"

    @property
    def simulated_s(self) -> float:
        """The simulated rig's clock, from the size of its live record."""
        rows = self.truth_path.with_name(f"{self.truth_path.name}.part")
        return rows.stat().st_size / TRUTH_ROW_BYTES / TRUTH_RATE_HZ

    def happened(self, code: str, text: str = "", count: int = 1) -> bool:
        """Whether the simulated rig's live log has `count` such lines."""
        path = self.truth_path.with_name(f"{self.truth_path.name}.events.jsonl")
        lines = events_in(path, path.stat().st_size) if path.exists() else []
        return sum(line["code"] == code and text in line["text"] for line in lines) >= count

    def wait_for(self, code: str, text: str = "", count: int = 1) -> None:
        """Wait until the simulated rig has logged it."""
        wait_until(
            lambda: self.process.poll() is not None or self.happened(code, text, count), f"{count} x {code} {text}"
        )
        assert self.process.poll() is None, f"it ended before {code} {text}: {self.process.communicate()[1]}"

    def run_on(self, seconds: float) -> None:
        """Let the campaign run on for so long on the simulated rig's clock."""
        until_s = self.simulated_s + seconds
        wait_until(lambda: self.process.poll() is not None or self.simulated_s >= until_s, f"{seconds} s of motion")
        assert self.process.poll() is None, self.process.communicate()[1]

    def child(self, role: str) -> int:
        """Process id of one of its processes: "rig.station", "finaliser", "simulators"."""
        found = subprocess.check_output(["pgrep", "-P", str(self.process.pid), "-f", role], text=True)
        return int(found.split()[0])

    @property
    def now_ns(self) -> int:
        """The host's clock."""
        return monotonic_ns()

    def send(self, number: int, role: str = "") -> None:
        """Send the application a signal, or one of its processes: "rig.station", "finaliser", "simulators"."""
        os.kill(self.child(role) if role else self.process.pid, number)

    def end_by(self, number: int) -> Ending:
        """Send the application a signal and wait for the end."""
        sent_ns = self.now_ns
        self.send(number)
        return self.finish(sent_ns)

    def station_pid(self) -> int:
        """Process id of the station."""
        return self.child("rig.station")

    def assert_completed(self) -> None:
        """Resuming through the command finishes the campaign (`assert_completed`)."""
        assert_completed(self.folder)

    def finish(self, stopped_from_ns: int | None = None) -> Ending:
        """Wait for the end."""
        output, errors = self.process.communicate(timeout=FINISH_S)
        folders = list(self.out.iterdir())
        folder = folders[0] if folders else self.out
        truth_path = self.rigs_own_truth or folder / "truth.h5"
        answer = json.loads(output) if output else {}
        return Ending(self.process.returncode, answer, folder, errors, truth_path, stopped_from_ns)


def answer_of(*arguments: str, env: dict[str, str] | None = None) -> tuple[int, dict[str, Any]]:
    """`rig run ... --json` to its end: exit code and answer."""
    done = subprocess.run(
        [RIG, "run", "--json", *arguments], capture_output=True, text=True, timeout=FINISH_S, check=False,
        env=os.environ | (env or {}),
    )  # fmt: skip
    return done.returncode, json.loads(done.stdout)


def resumed(folder: Path, *arguments: str) -> tuple[int, dict[str, Any]]:
    """`rig run --resume` on a campaign's directory: exit code and answer."""
    return answer_of("--resume", str(folder), "--no-identify", *arguments)


def assert_completed(folder: Path, kept: str = "p001") -> None:
    """Resuming finishes the campaign: the finished point is not touched, all points are there once and valid."""
    file = folder / "points" / f"{kept}.h5"
    before = file.read_bytes() if file.exists() else None
    code, answer = resumed(folder)
    assert code == 0, answer
    assert [(each["id"], each["verdict"]) for each in answer["points"]] == [("p001", "valid"), ("p002", "valid")]
    assert sorted(path.name for path in (folder / "points").glob("*.h5")) == ["p001.h5", "p002.h5"]
    assert before is None or file.read_bytes() == before
    assert not list((folder / "points").glob("*.journal"))
