"""What tests on real processes share: a campaign in a process of its own, read line by line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from true_states import Truth

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
        return Truth.load(path)


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
