"""What tests on real processes share: the simulated rig's true states, and a campaign in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from protocols.actuator import State
from rig.clock import monotonic_ns

# Runs a campaign as `rig run` does, says each phase, and exits with the campaign's exit code.
CAMPAIGN = """
import sys
from pathlib import Path
from rig.campaign import CampaignOptions, run_campaign

class Display:
    def planned(self, plan): pass
    def phase(self, text): print("phase", text, flush=True)
    def progress(self, point_id, cycles_done, time_left_s, live): print("cycles", cycles_done, flush=True)
    def point_done(self, result): print("done", result.id, result.verdict, flush=True)
    def message(self, level, text): print(level, text, flush=True)

matrix, out, bench, speed = sys.argv[1:5]
options = CampaignOptions(
    Path(matrix), Path(out), None if bench == "-" else Path(bench), bench == "-", float(speed), 1, tuple(sys.argv[5:])
)
sys.exit(run_campaign(options, Display()).exit_code)
"""


@dataclass(frozen=True)
class Truth:
    """What really happened: arrays over the rig's clock (s), and the commands that reached it."""

    time_s: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    force_N: NDArray[np.float64]
    current_A: NDArray[np.float64]
    state: NDArray[np.float64]
    commands: list[tuple[float, str, str]]
    """(time on the rig's clock, command, text)."""

    def runs(self) -> list[slice]:
        """Where a motion program ran, one slice a program."""
        running = np.concatenate(([False], self.state == State.RUNNING, [False]))
        edges = np.flatnonzero(np.diff(running.astype(int)))
        return [slice(int(start), int(end)) for start, end in edges.reshape(-1, 2)]

    def when(self, command: str, text: str = "") -> float:
        """When the first such command arrived (s); fails when there was none."""
        times = [at_s for at_s, name, said in self.commands if name == command and text in said]
        assert times, f"no {command} {text} among {self.commands}"
        return times[0]

    def after(self, at_s: float) -> slice:
        """The samples from `at_s` on."""
        return slice(int(np.searchsorted(self.time_s, at_s)), None)


def load_truth(path: Path) -> Truth:
    with h5py.File(path) as file:
        data, events = file["entry/data"], file["entry/events"]
        names = ("time", "displacement", "velocity", "force", "current", "controller_state")
        arrays = [np.asarray(data[name][:], np.float64) for name in names]
        columns = (events["time_ns"][:], events["code"][:], events["text"][:])
        commands = [(1e-9 * float(t), code.decode(), text.decode()) for t, code, text in zip(*columns, strict=True)]
    return Truth(*arrays, commands)


@pytest.fixture(scope="session")
def truth_of() -> Callable[[Path], Truth]:
    """Reads a truth file."""
    return load_truth


@dataclass
class Campaign:
    """A campaign in a process of its own, read line by line."""

    process: subprocess.Popen[str]
    out: Path

    def wait_for(self, text: str) -> None:
        """Read its output until a line begins with `text`."""
        assert self.process.stdout is not None
        seen = []
        for line in self.process.stdout:
            seen.append(line)
            if line.startswith(text):
                return
        pytest.fail(f"it ended without saying {text!r}:\n{''.join(seen)}")

    def finish(self) -> int:
        """Read the rest and wait for the end; returns the exit code."""
        self.process.communicate(timeout=90)
        return self.process.returncode

    @property
    def folder(self) -> Path:
        """The campaign's directory."""
        (folder,) = self.out.iterdir()
        return folder

    def truth(self, timeout_s: float = 30.0) -> Truth:
        """What really happened; a simulated rig that outlives its campaign is waited for."""
        path, deadline_ns = self.folder / "truth.h5", monotonic_ns() + int(timeout_s * 1e9)
        while not path.exists() and monotonic_ns() < deadline_ns:
            pass_time()
        return load_truth(path)


def pass_time() -> None:
    """Let other processes work for a moment; there is nothing to wait on for a file that is being written."""
    with subprocess.Popen([sys.executable, "-c", ""]) as moment:
        moment.wait()


@pytest.fixture
def start_campaign(tmp_path: Path) -> Iterator[Callable[..., Campaign]]:
    """Start campaigns; what still runs at the end of the test is ended."""
    started: list[subprocess.Popen[str]] = []

    def start(matrix: str, *arguments: str, speed: float = 5.0, bench: Path | None = None) -> Campaign:
        matrix_path, out = tmp_path / "matrix.toml", tmp_path / "out"
        matrix_path.write_text(matrix, encoding="utf-8")
        out.mkdir(exist_ok=True)
        command = [str(matrix_path), str(out), "-" if bench is None else str(bench), str(speed), *arguments]
        process = subprocess.Popen(
            [sys.executable, "-c", CAMPAIGN, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        started.append(process)
        return Campaign(process, out)

    yield start
    for process in started:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=60)
