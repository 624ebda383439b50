"""The workers of a Dask scheduler as an executor: the earlier name of `rig.jobs.cluster`, kept until 2.0."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from rig.jobs import cluster as jobs


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Connect to a scheduler while the block runs.

    Args:
        address: of the scheduler, such as `tcp://10.0.0.5:8786`.

    Yields:
        An executor on its workers, and how many tasks they run at the same time.

    Raises:
        RigError: as `rig.jobs.cluster.cluster`.
    """
    with jobs.cluster(address) as workers:
        yield workers.executor, workers.count
