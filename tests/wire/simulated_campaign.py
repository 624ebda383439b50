"""`rig run --simulate --json` in processes of its own, and what is left of it: answer, journal, points, truth."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from true_states import Truth

from rig.recording.journal.campaign_log import read_log
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

TIMEOUT_S = 170.0


@dataclass(frozen=True)
class Ended:
    """How a campaign ended."""

    exit_code: int
    said: str
    answer: dict[str, Any]

    @property
    def folder(self) -> Path:
        return Path(self.answer["campaign"])

    @cached_property
    def story(self) -> list[dict[str, Any]]:
        """The campaign's journal; empty when it did not come to one."""
        return read_log(self.folder) if "campaign" in self.answer else []

    @cached_property
    def run(self) -> Run:
        return Run.open(self.folder)

    @cached_property
    def truth(self) -> Truth:
        return Truth.load(self.folder / "truth.h5")

    def point(self, name: str) -> RecordedPoint:
        return next(point for point in self.run.points if point.id == name)


def simulated(folder: Path, matrix: str, *simulator: str, speed: float = 20.0, seed: int = 5) -> Ended:
    """Run a matrix on a simulated rig with these arguments."""
    path = folder / "matrix.toml"
    path.write_text(matrix, encoding="utf-8")
    arguments = ["run", str(path), "--simulate", "--speed", f"{speed:g}", "--seed", str(seed), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "rig.cli.main", *arguments, "--out", str(folder / "out"), "--", *simulator],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    return Ended(done.returncode, done.stderr, json.loads(done.stdout))


def options(*settings: str) -> list[str]:
    """Settings of the simulated rig as its arguments."""
    return [part for setting in settings for part in ("--option", setting)]
