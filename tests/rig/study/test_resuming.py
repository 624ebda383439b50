"""A study that is killed, started twice, interrupted: nothing is done twice, nothing is lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.errors import FileProblem
from rig.study.comparison import run_study
from rig.study.results import ResultsFile

pytestmark = pytest.mark.wire


def started(study: Path, out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rig.cli.main", "study", str(study), "--out", str(out), "--processes", "2"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < deadline_s, "nothing happened for two minutes"
        time.sleep(0.02)


def searches_done(out: Path) -> int:
    results = out / "results.jsonl"
    return results.read_bytes().count(b"\n") - 1 if results.exists() else -1


def children(pid: int) -> list[int]:
    stats = {int(path.name): path / "stat" for path in Path("/proc").iterdir() if path.name.isdigit()}
    return [child for child, stat in stats.items() if stat.exists() and parent_of(stat) == pid]


def parent_of(stat: Path) -> int:
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):  # it ended meanwhile
        return -1


def keys(out: Path) -> list[str]:
    return [json.loads(line)["key"] for line in (out / "results.jsonl").read_text().splitlines()[1:]]


@pytest.mark.nightly
def test_after_kill_9_the_study_goes_on_with_the_same_tables_and_no_worker_stays(
    small_study: Path, tmp_path: Path
) -> None:
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    with started(small_study, killed) as process:
        wait_until(lambda: searches_done(killed) >= 3)
        workers = children(process.pid)
        process.kill()
    assert workers
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    before = keys(killed)

    resumed = run_study(small_study, killed, processes=2)
    straight = run_study(small_study, whole, processes=1)
    after = keys(killed)
    assert after[: len(before)] == before
    assert sorted(after) == sorted(keys(whole))
    assert len(set(after)) == len(after)
    assert resumed.tables == straight.tables
    assert resumed.kruskal_wallis == straight.kruskal_wallis


@pytest.mark.nightly
def test_ctrl_c_ends_a_study_with_one_line_and_keeps_what_is_finished(small_study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with started(small_study, out) as process:
        wait_until(lambda: searches_done(out) >= 1)
        os.kill(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 4
    assert f"stopped by operator: finished results are kept in {out}; run the same command again to continue" in errors
    assert "Traceback" not in errors
    assert len(keys(out)) >= 1


def test_a_second_session_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    with (
        ResultsFile(tmp_path / "results.jsonl", "a"),
        pytest.raises(FileProblem, match="another `rig study` is using this folder"),
    ):
        ResultsFile(tmp_path / "results.jsonl", "a")


def test_results_of_an_older_layout_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text('{"format":1,"fingerprint":"a"}\n')
    with pytest.raises(FileProblem, match="line 1: format: got 1, expected 2"):
        ResultsFile(path, "a")
