"""`--scheduler`: on real Dask workers every command finds what it finds here, also when a worker is killed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from rig.cli.main import main
from rig.comparison import compare
from rig.errors import RigError
from rig.identification import FitOptions, bootstrap, identify
from rig.identification.models.problem import Problem
from rig.jobs.cluster import Cluster, cluster
from rig.jobs.workers import WorkersFailed
from rig.optimisers import minimise
from rig.study.comparison import run_study
from rig.study.execution import StudyProgress
from rig.study.recordings import table1

distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")
pytestmark = pytest.mark.filterwarnings("default")  # what Dask and its parts warn of among themselves is not ours


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler and one worker in this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="inproc://", dashboard_address=":0"
    ) as local:
        yield local.scheduler_address


def test_each_run_is_fitted_on_the_workers_and_a_failure_is_of_its_run_only(
    run_folder: Path, tmp_path: Path, scheduler: str, capsys: pytest.CaptureFixture[str]
) -> None:
    copy, broken = shutil.copytree(run_folder, tmp_path / "copy"), shutil.copytree(run_folder, tmp_path / "broken")
    for file in sorted((broken / "points").glob("*.h5"))[:4]:
        file.unlink()
    runs = [str(path) for path in (copy, broken)]
    code = main(["identify", "--each", *runs, "--model", "bingham", "--scheduler", scheduler, "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert (code, answer["fitted"], answer["failed"]) == (6, 1, 1)
    assert [Path(one["run"]).name for one in answer["runs"]] == ["copy", "broken"]
    assert "no point is valid" in answer["runs"][1]["error"]
    assert not (broken / "fit.json").exists()
    alone = identify(run_folder, model="bingham")
    fitted = json.loads((copy / "fit.json").read_text())["parameters"]
    assert {name: entry["value"] for name, entry in fitted.items()} == {
        name: one.value for name, one in alone.parameters.items()
    }


def test_a_comparison_on_workers_equals_the_one_here(run_folder: Path, tmp_path: Path, scheduler: str) -> None:
    runs = [run_folder, shutil.copytree(run_folder, tmp_path / "later")]
    with cluster(scheduler) as workers:
        assert compare(runs, None, workers).to_json() == compare(runs).to_json()


def test_models_draws_and_motions_on_workers_equal_those_here(scheduler: str) -> None:
    tests = table1("demo", 5.0, seed=1)[:6:2]
    options = FitOptions(model="asymmetric", bootstrap=20, unseen="pairs", diagnose=False)
    alone = identify(tests, options)
    lines: list[str] = []
    with cluster(scheduler) as workers:
        there = identify(tests, options, workers=workers, on_progress=lines.append)
    assert (there.values, there.drawn, there.unseen) == (alone.values, alone.drawn, alone.unseen)
    assert any(line.startswith("predicted ") and "1 of 2" in line for line in lines)


def test_a_single_fit_has_no_use_for_a_scheduler(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["identify", str(run_folder), "--model", "asymmetric", "--scheduler", "tcp://127.0.0.1:1"]
    assert main(call) == 2
    assert "a fit of one model with --method separable is a single job" in capsys.readouterr().err


@contextmanager
def running(module: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    timeouts = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"}  # to a worker that was killed
    process = subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | timeouts,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers, each a process; the address, and the three processes."""
    file = tmp_path / "scheduler.json"
    worker = ("--scheduler-file", str(file), "--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--no-nanny")
    listening = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with ExitStack() as started:
        all_three = [started.enter_context(running("dask_scheduler", *listening))]
        for name in ("a", "b"):
            local = ("--local-directory", str(tmp_path / name))
            all_three.append(started.enter_context(running("dask_worker", *worker, *local)))
        yield address_with_workers(file, 2), all_three


def address_with_workers(file: Path, count: int) -> str:
    deadline_s = time.monotonic() + 90
    while time.monotonic() < deadline_s:
        try:
            address = str(json.loads(file.read_text())["address"])
            with cluster(address) as workers:
                if workers.count == count:
                    return address
        except (FileNotFoundError, json.JSONDecodeError, RigError):  # not up yet
            pass
        time.sleep(0.2)
    raise TimeoutError("the scheduler and its workers did not come up within 90 s")


@pytest.mark.wire
@pytest.mark.nightly
def test_a_study_whose_worker_is_killed_and_whose_scheduler_disappears_loses_nothing(
    small_study: Path, tmp_path: Path, processes: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, (of_scheduler, of_worker, _) = processes
    whole = run_study(small_study, tmp_path / "whole", processes=1)

    def kill_at(done: int, process: subprocess.Popen[bytes]) -> StudyKiller:
        return StudyKiller(done, process)

    there = run_study(small_study, tmp_path / "there", report=kill_at(5, of_worker), scheduler=address)
    assert there.tables == whole.tables
    assert of_worker.poll() is not None
    lost = tmp_path / "lost"
    with pytest.raises(WorkersFailed, match=rf"Dask scheduler {address}: connection lost"):
        run_study(small_study, lost, report=kill_at(5, of_scheduler), scheduler=address)
    assert len((lost / "results.jsonl").read_text().splitlines()) >= 6
    assert run_study(small_study, lost, processes=1).tables == whole.tables


class StudyKiller:
    """Kills a process when so many searches are done."""

    def __init__(self, done: int, process: subprocess.Popen[bytes]) -> None:
        self.done = done
        self.process = process

    def __call__(self, progress: StudyProgress) -> None:
        if progress.done >= self.done and self.process.poll() is None:
            self.process.kill()
            self.process.wait()


@pytest.mark.wire
@pytest.mark.nightly
def test_a_population_and_models_on_two_workers_find_the_same(
    processes: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    tests = table1("demo", 5.0, seed=1)[:4]
    problem = Problem(tests, "asymmetric")
    call = {"method": "de", "bounds": problem.bounds, "population": 20, "budget": 400, "seed": 2}
    alone, fit = minimise(problem, **call), identify(tests, model="few")
    drawn = bootstrap(fit, tests, count=40).draws if fit.model == "asymmetric" else None
    with cluster(processes[0]) as workers:
        assert workers.count == 2
        assert isinstance(workers, Cluster)
        together = minimise(problem, executor=workers.executor, chunks=2, **call)
        there = identify(tests, model="few", workers=workers)
        if drawn is not None:
            assert bootstrap(fit, tests, count=40, workers=workers).draws == pytest.approx(drawn, rel=1e-12)
    assert together.history == pytest.approx(alone.history, rel=1e-12)
    assert there.values == pytest.approx(fit.values, rel=1e-12)
    assert [one.model for one in there.selection] == [one.model for one in fit.selection]
    assert [one.reason for one in there.selection] == [one.reason for one in fit.selection]
