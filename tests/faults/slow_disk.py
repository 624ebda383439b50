"""`rig` on a disk that stands still once: the first block of p002 takes `STALL_S` to be written, the ring holds 2 s."""

from __future__ import annotations

import dataclasses
import os
import threading
from pathlib import Path

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign import machine_resources
from rig.cli.main import run
from rig.matrix.model import Matrix

STALL_S = 3.2
RING_RECORDS = 4096

station_config, pwrite, stalled = machine_resources.station_config, os.pwrite, threading.Event()


def small_ring(bench: Bench, matrix: Matrix, ring_path: Path) -> StationConfig:
    return dataclasses.replace(station_config(bench, matrix, ring_path), ring_capacity=RING_RECORDS)


def slow_pwrite(handle: int, data: bytes, offset: int) -> int:
    on_its_thread = threading.current_thread() is not threading.main_thread()
    if on_its_thread and not stalled.is_set() and Path(f"/proc/self/fd/{handle}").readlink().name == "p002.journal":
        stalled.set()
        threading.Event().wait(STALL_S)
    return pwrite(handle, data, offset)


if __name__ == "__main__":
    machine_resources.station_config = small_ring
    os.pwrite = slow_pwrite
    run()
