"""Prediction of the disk space that a campaign needs: journals while points run, and files that stay.

A point is recorded completely. Of a block of an endurance test the file keeps the statistics of every cycle and the
samples of some; only its journal is as long as its motion, and it exists for one block at a time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from drivers.ring import RECORD_SIZE
from rig.bench.model import Bench
from rig.test_point import ENDURANCE, TestPoint

COPIES_ON_DISK = 2.5
"""Journal, HDF5 file being written at the same time, and margin."""
STATUS_RECORDS_Hz = 1500.0
"""Records of the controller's and the ECU's status a second, above the sensors' samples."""
SETTLING_S = 0.5
"""Allowed for each point in addition to its motion: current settles, rod returns to centre, file closes."""
FILE_BYTES = 90_000
"""Of a block's file without any cycle: descriptions of its channels."""
CYCLE_BYTES = 64
"""Statistics of a cycle, before compression."""
KEPT_RECORD_BYTES = 40
"""A record of a cycle whose samples are kept, before compression, its share of the aligned channels included."""
LARGEST_BLOCK_BYTES = 256_000_000
"""Largest journal of a block: its conversion needs memory and time in proportion."""


class Storage(NamedTuple):
    """Bytes on the disk.

    Attributes:
        points: of the points, with their journals.
        blocks: of the files of all blocks of endurance tests.
        working: of the longest block's journal and the file that is made of it.
    """

    points: int
    blocks: int
    working: int

    @property
    def total(self) -> int:
        """Everything."""
        return self.points + self.blocks + self.working


NO_STORAGE = Storage(0, 0, 0)


def records_Hz(bench: Bench) -> float:
    """Records a second of the rig's clock."""
    return sum(sensor.rate_Hz for sensor in (bench.load_cell, bench.lvdt, *bench.auxiliary)) + STATUS_RECORDS_Hz


def journal_bytes(motion_s: float, bench: Bench) -> float:
    """Of the journal of a motion (s)."""
    return (motion_s + SETTLING_S) * records_Hz(bench) * RECORD_SIZE


def storage_of(points: Iterable[TestPoint], bench: Bench) -> Storage:
    """The space that these points need."""
    points = tuple(points)
    blocks = [point for point in points if point.kind == ENDURANCE]
    whole = math.fsum(journal_bytes(point.motion_s, bench) for point in points if point.kind != ENDURANCE)
    largest = max((journal_bytes(block.motion_s, bench) for block in blocks), default=0.0)
    return Storage(int(COPIES_ON_DISK * whole), _files_bytes(blocks, bench), int(COPIES_ON_DISK * largest))


def _files_bytes(blocks: Sequence[TestPoint], bench: Bench) -> int:
    total = 0.0
    for block in blocks:
        every = 1 if block.endurance is None else max(1, block.endurance.keep_every)
        kept_s = max(1.0, block.cycles / every) * block.motion_s / max(1.0, block.cycles)
        total += FILE_BYTES + CYCLE_BYTES * block.cycles + kept_s * records_Hz(bench) * KEPT_RECORD_BYTES
    return int(total)


def most_in_a_block(point: TestPoint, bench: Bench) -> int | None:
    """Cycles that a block may have on this bench; None where it has no more than that."""
    size = journal_bytes(point.motion_s, bench)
    if point.kind != ENDURANCE or size <= LARGEST_BLOCK_BYTES:
        return None
    return max(1, math.floor(point.cycles * LARGEST_BLOCK_BYTES / size))
