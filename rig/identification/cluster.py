"""The workers of a Dask scheduler as an executor, for whatever takes a `concurrent.futures.Executor`."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from rig.errors import RigError
from rig.extras import how_to_install

ANSWER_WITHIN = "10 s"


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Connect to a scheduler while the block runs.

    Args:
        address: Of the scheduler, such as `tcp://10.0.0.5:8786`.

    Yields:
        An executor on its workers, and how many tasks they run at the same time.

    Raises:
        RigError: Dask is not installed, no scheduler answers at the address, or it has no worker.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise RigError(f"--scheduler needs Dask: {how_to_install('cluster')}") from error
    try:
        client = Client(address, timeout=ANSWER_WITHIN)
    except (OSError, ValueError) as error:
        raise RigError(f"Dask scheduler {address}: no answer within {ANSWER_WITHIN}: {error}") from error
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise RigError(
                f"Dask scheduler {address}: no workers connected. Fix: start a worker with `dask worker {address}`"
            )
        yield client.get_executor(), threads
