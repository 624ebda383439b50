"""The workers of a real Dask scheduler in this process: what is checked before work starts, shared values, errors."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from operator import mul
from pathlib import Path

import pytest

from rig.errors import FileProblem, RigError
from rig.jobs import cluster as module
from rig.jobs.cluster import Cluster, abandoned, cluster
from rig.jobs.workers import Job, WorkersFailed, forget

distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")
pytestmark = pytest.mark.filterwarnings("default")  # what Dask and its parts warn of among themselves is not ours


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="inproc://", dashboard_address=":0"
    ) as local:
        yield local.scheduler_address


@pytest.fixture
def workers(scheduler: str) -> Iterator[Cluster]:
    with cluster(scheduler) as connected:
        yield connected


def refuse(number: int) -> int:
    raise FileProblem("run.h5", [f"damaged {number}"])


def test_results_shared_values_and_errors_come_from_the_workers(workers: Cluster) -> None:
    assert workers.count == 1
    shared = workers.share(7)
    assert workers.in_order(Job(f"job {k}", mul, (shared, k)) for k in range(5)) == [0, 7, 14, 21, 28]
    forget([shared.token])  # type: ignore[attr-defined]  # as a worker that has joined later
    assert workers.in_order([Job("late", mul, (shared, 9)), Job("later", mul, (shared, 10))]) == [63, 70]
    with pytest.raises(FileProblem, match=r"run.h5: damaged 3"):
        workers.in_order([Job("a", refuse, (3,))])
    assert workers.executor.submit(mul, 6, 7).result() == 42
    assert not abandoned()


class TooLarge:
    """A value that a worker has no memory for."""

    def __getstate__(self) -> dict[str, int]:
        return {"size": 1}

    def __setstate__(self, state: object) -> None:
        raise MemoryError("no memory")


def test_a_worker_that_cannot_load_a_shared_value_ends_the_work(workers: Cluster) -> None:
    """Instead of being sent the value forever."""
    shared = workers.share(TooLarge())
    with pytest.raises(WorkersFailed, match=r"worker inproc://\S+: cannot load the data of the jobs: MemoryError"):
        workers.in_order([Job("a", isinstance, (shared, int))])


def test_the_first_worker_is_awaited_and_its_absence_ends_the_wait(
    workers: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[str] = []
    connected = iter([{}, {}, {"inproc://worker": 1}])
    monkeypatch.setattr(module, "LOOKED_EVERY_S", 0.0)
    monkeypatch.setattr(module.NOTICE, "report", lines.append)
    monkeypatch.setattr(workers, "_nthreads", lambda: next(connected))
    workers.wait_for_first()
    assert lines == [f"Dask scheduler {workers.address}: waiting up to 60 s for a worker ..."]
    monkeypatch.setattr(module, "NO_WORKERS_S", 0.0)
    monkeypatch.setattr(workers, "_nthreads", dict)
    with pytest.raises(WorkersFailed, match=r"no workers connected for 0 s. Fix: start a worker with `dask worker"):
        workers.wait_for_first()


def test_a_worker_that_reads_other_files_is_named_before_work_starts(workers: Cluster, tmp_path: Path) -> None:
    here = tmp_path / "here.h5"
    with pytest.raises(FileProblem, match=r"here.h5: cannot be read"):
        workers.check_files([here])
    here.write_bytes(bytes(200_000))
    workers.check_files([here])
    expected = {str(here): "200000 of another run"}
    with pytest.raises(RigError, match=rf"worker inproc://\S+ has different content in {here}. Fix: mount the same"):
        workers._compare_files(expected)
    with pytest.raises(RigError, match=rf"worker inproc://\S+ cannot read {tmp_path}/there.h5"):
        workers._compare_files({f"{tmp_path}/there.h5": "1 a"})


@pytest.mark.parametrize("name", ["mr-damper-rig", "Python", "numpy", "plug-ins"])
def test_a_worker_with_another_version_is_named_before_work_starts(
    workers: Cluster, name: str
) -> None:
    with pytest.raises(RigError, match=rf"worker inproc://\S+: {name}: got .*, expected 99 as on this computer"):
        workers.check_software({**module._software(), name: "99"})


def test_a_worker_without_this_software_is_named() -> None:
    lacking = ModuleNotFoundError("No module named 'rig'")
    with pytest.raises(RigError, match=r"worker tcp://10.0.0.7:1: this software is not installed there"):
        module._check_versions("worker tcp://10.0.0.7:1", lacking, module._software())


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ANSWER_WITHIN_S", 0.3)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(RigError, match=rf"Dask scheduler {address}: no answer within 0.3 s"), cluster(address):
            pass


def test_an_encrypted_connection_without_certificates_is_refused_at_once() -> None:
    with pytest.raises(RigError, match=r"tls://127.0.0.1:1: got no certificates; Dask.s settings must name"), cluster("tls://127.0.0.1:1"):
        pass


@pytest.mark.parametrize("address", ["node0", "http://node0:8786", "tcp://node0", "/no/such/scheduler.json"])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    with pytest.raises(RigError, match=rf"got .{address}., expected tcp://HOST:PORT"), cluster(address):
        pass


def test_a_file_that_is_no_scheduler_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text('{"type": "Worker"}')
    with pytest.raises(FileProblem, match=r"scheduler.json: not a scheduler file"), cluster(str(file)):
        pass


def test_dask_that_is_not_installed_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(RigError, match=r"Dask: .*pip install 'mr-damper-rig\[cluster\]'"), cluster("a"):
        pass


class Lost:
    """A client of Dask whose scheduler has disappeared between two jobs."""

    status = "connecting"

    def get_executor(self, *, pure: bool) -> None:
        pass

    def run(self, *_: object, **__: object) -> None:
        raise AttributeError("'NoneType' object has no attribute 'broadcast'")


def test_a_scheduler_that_disappears_between_two_jobs_is_named() -> None:
    lost = Cluster(Lost(), "tcp://lab:8786")  # type: ignore[arg-type]
    for call in (lambda: lost.share([1.0]), lambda: lost.on_each(int), lambda: lost._submit(Job("fit", abs, (1,)))):
        with pytest.raises(WorkersFailed, match="Dask scheduler tcp://lab:8786: connection lost"):
            call()
    lost.forget()  # the results are complete by then
