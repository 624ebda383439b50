"""Workers of a Dask scheduler.

The scheduler and its workers execute any code that they receive, so anyone who can reach the scheduler's port controls
them. Dask's own settings provide protection (`tls://` with certificates in `distributed.comm.tls`) and are used
unchanged.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import logging
import os
import pickle
import platform
import re
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from drivers.plugins import DAMPER_MODELS, METHODS, found
from rig.compile_notice import NOTICE
from rig.errors import FileProblem, RigError, some
from rig.extras import how_to_install
from rig.jobs.workers import (
    Answer,
    Job,
    Missing,
    RemoteWorkers,
    Shared,
    WorkersFailed,
    answered,
    forget,
    given_up,
    keep,
)
from rig.text_file import read_json
from rig.version import described

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
ADDRESS = re.compile(r"(?:(?:tcp|tls|wss?|ucx)://)?[^\s/]+:\d{1,5}|inproc://\S+")
ANSWER_WITHIN_S = 10.0
NO_WORKERS_S = 60.0
"""Time without any worker after which the work is stopped (s)."""
COUNTED_EVERY_S = 2.0
LOOKED_EVERY_S = 0.2
"""Interval at which the first worker is awaited (s)."""
END_BYTES = 65_536
"""Number of bytes at the beginning and end of a file that are compared."""
LIBRARIES = ("numpy", "scipy", "numba")
_turn = threading.Lock()
"""Lock: a worker process runs one job at a time, even with several threads, because jobs are not thread-safe."""


@contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """Connect to a scheduler for the duration of the block.

    Args:
        address: of the scheduler, such as `tcp://10.0.0.5:8786` or `tls://10.0.0.5:8786`, or the scheduler file that
            `dask scheduler --scheduler-file` writes.

    Yields:
        The workers of the scheduler.

    Raises:
        RigError: Dask is not installed, no scheduler answers at the address, or a worker has another version of this
            software or of its libraries.
        WorkersFailed: the connection was lost, no worker was connected for `NO_WORKERS_S`, or workers kept ending
            during one job.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise RigError(f"--scheduler needs Dask: {how_to_install('cluster')}") from error
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in {"distributed", "tornado"}:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # their log messages are reported as an error below
    where = _address_in(Path(address)) if Path(address).is_file() else address
    if ADDRESS.fullmatch(where) is None:
        raise RigError(
            f"Dask scheduler: got {where!r}, expected tcp://HOST:PORT, tls://HOST:PORT or the path of a scheduler file"
        )
    _check_certificates(where)
    try:
        client = Client(where, timeout=ANSWER_WITHIN_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = str(error) or "no connection"
        raise RigError(
            f"Dask scheduler {address}: no answer within {ANSWER_WITHIN_S:g} s: {reason}. Fix: start it with "
            "`dask scheduler`, and check the address (tcp:// or tls://) and the firewall"
        ) from error
    try:
        workers = Cluster(client, address)
        workers.wait_for_first()
        workers.check_software()
        yield workers
        workers.forget()
    except KilledWorker as error:
        name = str(error.task).partition(KEY)[0]
        raise WorkersFailed(given_up(name, error.allowed_failures + 1)) from error
    except (CancelledError, CommClosedError) as error:
        raise WorkersFailed(_lost(address)) from error
    finally:
        with suppress(Exception):  # a lost scheduler cannot be closed cleanly
            client.close(timeout=2.0 if client.status == "running" else 0.1)


def _address_in(file: Path) -> str:
    """Address in a scheduler file.

    Raises:
        FileProblem: the file is not a scheduler file.
    """
    content = read_json(file)
    address = content.get("address")
    if not isinstance(address, str):
        raise FileProblem(str(file), ["not a scheduler file: it has no string `address`. Fix: write it with `dask "
                                      "scheduler --scheduler-file FILE`"])  # fmt: skip
    return address


def _check_certificates(address: str) -> None:
    """Reject an encrypted connection without certificates, because Dask would retry it for a long time.

    Raises:
        RigError: certificates are missing or cannot be read.
    """
    if not address.startswith("tls://"):
        return
    from distributed import Security  # optional dependency, slow to load

    try:
        usable = Security().get_connection_args("client").get("ssl_context") is not None
        problem = "got no certificates"
    except (OSError, ValueError) as error:
        usable, problem = False, f"the certificates cannot be read ({error})"
    if not usable:
        raise RigError(
            f"Dask scheduler {address}: {problem}; Dask's settings must name certificate files on this computer. Fix: "
            "set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and "
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
        )


KEY = "#"
"""Separator between a job's name and the unique part of its task name."""


class Cluster(RemoteWorkers):
    """Worker processes of a Dask scheduler, each running one job at a time; workers may join and leave.

    Attributes:
        address: of the scheduler.
    """

    def __init__(self, client: Client, address: str) -> None:
        self.address = address
        self.executor: Executor = client.get_executor(pure=False)
        self._client = client
        self._count = 1
        self._counted_s = -COUNTED_EVERY_S
        self._alone_since_s: float | None = None
        self._payloads: dict[str, bytes] = {}

    @property
    def count(self) -> int:
        """Number of connected worker processes; at least 1."""
        now_s = time.monotonic()
        if now_s - self._counted_s >= COUNTED_EVERY_S:
            self._counted_s = now_s
            self._count = max(1, len(self._nthreads()))
        return self._count

    def share(self, value: T) -> T:
        """See `Workers.share`. Workers that join later, or no longer have the value, receive it with their first job.

        The value is not a task dependency, because Dask runs a task where its dependencies are: all tasks on one
            worker.
        """
        shared = Shared(uuid.uuid4().hex)
        self._payloads[shared.token] = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
        self._send(shared.token)
        return cast("T", shared)  # placeholder in the arguments of jobs

    def on_each(self, function: Callable[[], T]) -> dict[str, T]:
        """Call a function in each worker process; results by worker address."""
        values: dict[str, T] = self._run(function)
        return values

    def forget(self) -> None:
        """Delete all shared values on the workers; a lost scheduler does not matter any more."""
        with suppress(OSError, WorkersFailed):
            self._run(forget, list(self._payloads), on_error="ignore")

    def _run(self, function: Callable[..., Any], *arguments: object, **options: object) -> dict[str, Any]:
        """Call a function in worker processes, as `Client.run` does; answers by worker.

        Raises:
            WorkersFailed: the connection was lost.
        """
        try:
            answers: dict[str, Any] = self._client.run(function, *arguments, **options)
        except Exception as error:
            if self._client.status == "running":
                raise
            raise WorkersFailed(_lost(self.address)) from error  # Dask raises AttributeError and others then
        return answers

    def _supply(self, missing: Missing) -> None:
        """See `RemoteWorkers._supply`.

        Raises:
            WorkersFailed: the worker cannot load the value; sending it again would not end.
        """
        reason = self._send(missing.token, [missing.worker]).get(missing.worker)
        if isinstance(reason, str):
            raise WorkersFailed(
                f"worker {missing.worker}: cannot load the data of the jobs: {reason}. Fix: check its memory"
            )

    def _send(self, token: str, workers: list[str] | None = None) -> dict[str, Any]:
        """Send a shared value; returns the answer of `_kept` by worker.

        A worker that ends meanwhile is replaced by another one, which requests the value.

        Raises:
            WorkersFailed: the connection was lost.
        """
        with suppress(OSError):
            return self._run(_kept, token, self._payloads[token], workers=workers, on_error="return")
        return {}

    def wait_for_first(self) -> None:
        """Wait until a worker is connected, and report that once if there is none at first.

        Raises:
            WorkersFailed: the connection was lost, or no worker has connected within `NO_WORKERS_S`.
        """
        self._look()
        if self._alone_since_s is not None and NOTICE.report is not None:
            NOTICE.report(f"Dask scheduler {self.address}: waiting up to {NO_WORKERS_S:g} s for a worker ...")
        while self._alone_since_s is not None:
            time.sleep(LOOKED_EVERY_S)
            self._look()

    def check_software(self, expected: Mapping[str, str] | None = None) -> None:
        """Check that every worker and the scheduler run the same version of the software and of its libraries.

        Args:
            expected: versions by name; None: those of this computer.

        Raises:
            RigError: a worker (named in the message) or the scheduler differs.
        """
        expected = _software() if expected is None else expected
        answers = self._run(_software, on_error="return")
        for worker, answer in sorted(answers.items()):
            _check_versions(f"worker {worker}", answer, expected)
        try:
            of_scheduler = self._client.run_on_scheduler(_software)
        except Exception as error:  # noqa: BLE001 - whatever an environment without this software raises
            of_scheduler = error
        _check_versions(f"scheduler {self.address}", of_scheduler, expected)

    def check_files(self, files: Sequence[Path]) -> None:
        """See `Workers.check_files`; compares the size, beginning and end of each file.

        Raises:
            FileProblem: a file cannot be read here.
            RigError: a file differs on a worker.
        """
        own = {str(path): content for path, content in _contents([str(path.absolute()) for path in files]).items()}
        missing = [path for path, content in own.items() if not content]
        if missing:
            raise FileProblem(missing[0], ["cannot be read"])
        self._compare_files(own)

    def _compare_files(self, own: Mapping[str, str]) -> None:
        """Compare the content of files.

        Raises:
            RigError: a file differs on a worker.
        """
        answers = self._run(_contents, list(own), on_error="return")
        for worker, answer in sorted(answers.items()):
            if isinstance(answer, BaseException):
                raise RigError(f"worker {worker}: the files could not be checked: {answer!r}")
            differing = [path for path, content in own.items() if answer.get(path) != content]
            if differing:
                state = "cannot read" if not answer.get(differing[0]) else "has different content in"
                raise RigError(
                    f"worker {worker} {state} {some(differing, most=1)}. Fix: mount the same folder under the same "
                    "path on all workers"
                )

    def _nthreads(self) -> Mapping[str, int]:
        """Number of threads of each worker.

        Raises:
            WorkersFailed: the scheduler does not answer.
        """
        try:
            if self._client.status == "running":
                workers: Mapping[str, int] = self._client.nthreads()
                return workers
        except (OSError, ValueError, RuntimeError, AttributeError) as error:  # exceptions of a lost connection
            raise WorkersFailed(_lost(self.address)) from error
        raise WorkersFailed(_lost(self.address))

    def _look(self) -> None:
        """Stop the work if the scheduler or all workers are lost.

        Raises:
            WorkersFailed: see there.
        """
        if self._nthreads():
            self._alone_since_s = None
            return
        now_s = time.monotonic()
        self._alone_since_s = now_s if self._alone_since_s is None else self._alone_since_s
        if now_s - self._alone_since_s >= NO_WORKERS_S:
            raise WorkersFailed(
                f"Dask scheduler {self.address}: no workers connected for {NO_WORKERS_S:g} s. Fix: start a worker with "
                f"`dask worker {self.address} --nthreads 1`"
            )

    def _submit(self, job: Job[T]) -> Any:  # noqa: ANN401 - a future of Dask
        if self._client.status != "running":
            raise WorkersFailed(_lost(self.address))
        return self._client.submit(
            _call, _software(), job.function, job.arguments, key=f"{job.name}{KEY}{uuid.uuid4().hex}", pure=False
        )

    def _restart(self) -> None:
        """Do nothing: Dask replaces workers and runs their jobs again."""

    def _cancel(self, futures: Sequence[Any]) -> None:
        if futures and self._client.status == "running":
            with suppress(OSError, TimeoutError, CancelledError):  # it may be gone by now
                self._client.cancel(futures)


def _lost(address: str) -> str:
    """Message about a scheduler that no longer answers."""
    return f"Dask scheduler {address}: connection lost. Fix: check that it is running"


def _kept(token: str, payload: bytes) -> str | None:
    """In a worker: keep a shared value; why it cannot be loaded, None if it can."""
    try:
        keep(token, payload)
    except Exception as error:  # noqa: BLE001 - whatever loading raises
        return repr(error)
    return None


def abandoned() -> bool:
    """In a job: whether its result is no longer needed, so a long search can stop."""
    running = _current.key
    if running is None:
        return False
    from distributed import get_worker  # here runs a worker of Dask

    task = get_worker().state.tasks.get(running)
    return task is None or task.state == "cancelled"


class _Current(threading.local):
    """Task that this thread runs; None outside a Dask worker."""

    key: Any = None


_current = _Current()


def _call(software: Mapping[str, str], function: Callable[..., T], arguments: tuple[Any, ...]) -> Answer[T] | Missing:
    """In a worker: run a job; a worker that joined after the version check is checked first.

    Raises:
        RigError: its software versions differ.
    """
    from distributed import get_worker  # here runs a worker of Dask

    worker = get_worker()
    _check_versions(f"worker {worker.address}", _software(), software)
    with _turn:
        _current.key = worker.get_current_task()
        try:
            answer = answered(function, arguments)
            return Missing(answer.token, worker.address) if isinstance(answer, Missing) else answer
        finally:
            _current.key = None


@cache
def _software() -> Mapping[str, str]:
    """Versions of the software on this computer; results of different versions are not mixed."""
    python = ".".join(platform.python_version_tuple()[:2])
    plug_ins = sorted({f"{one.package} {one.version}" for group in (DAMPER_MODELS, METHODS) for one in found(group)})
    libraries = {name: importlib.metadata.version(name) for name in LIBRARIES}
    return {"mr-damper-rig": described(), "Python": python, **libraries, "plug-ins": ", ".join(plug_ins) or "none"}


def _check_versions(who: str, answer: object, expected: Mapping[str, str]) -> None:
    """Reject a worker or scheduler with different software versions.

    Raises:
        RigError: the software differs or is not installed.
    """
    if not isinstance(answer, Mapping):
        raise RigError(
            f"{who}: this software is not installed there, or its version differs ({answer!r}); expected mr-damper-rig "
            f"{expected['mr-damper-rig']}. Fix: install the same version on the scheduler and on all workers"
        )
    for name, version in expected.items():
        if answer.get(name) != version:
            raise RigError(
                f"{who}: {name}: got {answer.get(name, 'none')}, expected {version} as on this computer. Fix: install "
                "the same versions on the scheduler and on all workers"
            )


def _contents(paths: Sequence[str]) -> dict[str, str]:
    """Size, and hash of the beginning and end, of each file; empty if a file cannot be read."""
    return {path: _content(path) for path in paths}


def _content(path: str) -> str:
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            digest = hashlib.blake2b(file.read(END_BYTES), digest_size=16)
            file.seek(max(0, size - END_BYTES))
            digest.update(file.read(END_BYTES))
    except OSError:
        return ""
    return f"{size} {digest.hexdigest()}"
