"""Selection of the workers for a command."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from rig.jobs.local import local_workers
from rig.jobs.workers import HERE, Workers


@contextmanager
def workers_for(scheduler: str | None, processes: int | None = None) -> Iterator[Workers]:
    """Provide workers for the duration of the block.

    Args:
        scheduler: address of a Dask scheduler; None: this computer.
        processes: number of local processes; None: one per processor; 1: run the jobs in this process.

    Yields:
        The workers.

    Raises:
        RigError: the scheduler or its workers cannot be used.
    """
    if scheduler is not None:
        from rig.jobs.cluster import cluster  # loads the metadata of packages: not needed for the help

        with cluster(scheduler) as remote:
            yield remote
        return
    count = processes or os.cpu_count() or 1
    if count == 1:
        yield HERE
        return
    with local_workers(count) as local:
        yield local
