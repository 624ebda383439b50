"""`--scheduler`: searches on a real Dask scheduler with two worker processes find what they find here."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from rig.cli.main import main
from rig.errors import RigError
from rig.identification.cluster import cluster
from rig.identification.models.problem import Problem
from rig.optimisers import minimise
from rig.study.comparison import run_study
from rig.study.recordings import table1

pytest.importorskip("distributed", reason="the cluster extra is not installed")
pytestmark = [
    pytest.mark.wire,
    pytest.mark.filterwarnings("default"),  # what Dask and its parts warn of among themselves is not ours
]


@contextmanager
def running(module: str, *arguments: str) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    place = tmp_path_factory.mktemp("scheduler")
    file = place / "scheduler.json"
    worker = ("--scheduler-file", str(file), "--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--no-nanny")
    listening = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with ExitStack() as processes:
        processes.enter_context(running("dask_scheduler", *listening))
        for name in ("a", "b"):
            processes.enter_context(running("dask_worker", *worker, "--local-directory", str(place / name)))
        yield address_with_workers(file, workers=2)


def address_with_workers(file: Path, workers: int) -> str:
    deadline_s = time.monotonic() + 90
    while time.monotonic() < deadline_s:
        try:
            address = str(json.loads(file.read_text())["address"])
            with cluster(address) as (_, count):
                if count == workers:
                    return address
        except (FileNotFoundError, json.JSONDecodeError, RigError):  # not up yet
            pass
        time.sleep(0.2)
    raise TimeoutError("the scheduler and its workers did not come up within 90 s")


@pytest.mark.nightly
def test_a_population_evaluated_by_two_workers_finds_the_same_search(scheduler: str) -> None:
    problem = Problem(table1("demo", 5.0, seed=1)[:4], "asymmetric")
    call = {"method": "de", "bounds": problem.bounds, "population": 20, "budget": 400, "seed": 2}
    alone = minimise(problem, **call)
    with cluster(scheduler) as (executor, count):
        assert count == 2
        together = minimise(problem, executor=executor, chunks=count, **call)
    assert together.history == pytest.approx(alone.history, rel=1e-9), "a chunk sums in another order"
    assert together.best == pytest.approx(alone.best, rel=1e-9)


@pytest.mark.nightly
def test_a_study_on_a_scheduler_has_the_same_tables(small_study: Path, tmp_path: Path, scheduler: str) -> None:
    here = run_study(small_study, tmp_path / "here", processes=1)
    there = run_study(small_study, tmp_path / "there", scheduler=scheduler)
    assert there.tables == here.tables
    hosts = {json.loads(line).get("host") for line in (tmp_path / "there" / "results.jsonl").read_text().splitlines()}
    assert len(hosts - {None}) == 2  # both workers searched


def test_rig_identify_on_a_scheduler_finds_the_same_fit(
    run_folder: Path, scheduler: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fits = []
    for where in ([], ["--scheduler", scheduler]):
        assert main(["identify", str(run_folder), "--method", "pso", "--budget", "600", "--json", *where]) == 0
        fits.append(json.loads(capsys.readouterr().out))
    assert fits[0]["parameters"] == fits[1]["parameters"]


@pytest.mark.nightly
def test_a_method_without_populations_has_no_use_for_a_scheduler(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(run_folder), "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "separable does not evaluate populations" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_scheduler_that_does_not_answer_is_named(
    small_study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.identification.cluster.ANSWER_WITHIN", "1 s")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        assert main(["study", str(small_study), "--out", str(tmp_path / "out"), "--scheduler", address]) == 2
    assert f"Dask scheduler {address}: no answer within 1 s" in capsys.readouterr().err
