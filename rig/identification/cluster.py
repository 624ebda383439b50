"""Workers of a Dask scheduler as an executor; deprecated name of `rig.jobs.cluster`, available until 2.0."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from rig.jobs import cluster as jobs


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Connect to a scheduler for the duration of the block.

    Args:
        address: of the scheduler, such as `tcp://10.0.0.5:8786`.

    Yields:
        An executor on the workers, and the number of tasks that they run at the same time.

    Raises:
        RigError: as `rig.jobs.cluster.cluster`.
    """
    with jobs.cluster(address) as workers:
        yield workers.executor, workers.count
