"""A journal's samples by channel: in memory while they are few, in temporary files once they are many."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rig.recording.alignment import channel_name
from rig.recording.column import Records, StoredRecords
from rig.recording.journal import JournalProblem

MOST_BYTES_IN_MEMORY = 48_000_000
MOST_CHANNELS = 128
"""The ring has 51; more are the numbers of no rig, and each would be a file."""


class Sorter:
    """Takes blocks of records as they come and gives them back by channel, each in the order of arrival.

    Args:
        folder: where temporary files may lie.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._blocks: dict[int, list[NDArray[Any]]] = {}
        self._stored: dict[int, StoredRecords] = {}
        self._numbers: set[int] = set()
        self._bytes = 0

    def take(self, records: NDArray[Any]) -> None:
        """Add a block of records (n,) of `RECORD_DTYPE`.

        Raises:
            JournalProblem: there are more channels than any rig has.
            OSError: there is no room for the temporary files.
        """
        self._numbers.update(np.unique(records["channel"]).tolist())
        if len(self._numbers) > MOST_CHANNELS:
            raise JournalProblem(f"records of {len(self._numbers)} and more channels, expected at most {MOST_CHANNELS}")
        if self._stored or self._bytes + records.nbytes > MOST_BYTES_IN_MEMORY:
            self._spill()
            for number, part in _by_number(records):
                self._file(number).append(part)
            return
        self._bytes += records.nbytes
        for number, part in _by_number(records):
            self._blocks.setdefault(number, []).append(part)

    def channels(self) -> Mapping[str, Records]:
        """Records by channel name; usable until the sorter is closed.

        Raises:
            OSError: there is no room for the temporary files.
        """
        for stored in self._stored.values():
            stored.finish()
        held: dict[int, Records] = {number: np.concatenate(parts) for number, parts in self._blocks.items()}
        return {channel_name(number): records for number, records in sorted({**held, **self._stored}.items())}

    def _spill(self) -> None:
        for number, parts in self._blocks.items():
            stored = self._file(number)
            for part in parts:
                stored.append(part)
        self._blocks.clear()

    def _file(self, number: int) -> StoredRecords:
        if number not in self._stored:
            self._stored[number] = StoredRecords(self._folder)
        return self._stored[number]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        for stored in self._stored.values():
            stored.close()


def _by_number(records: NDArray[Any]) -> list[tuple[int, NDArray[Any]]]:
    channels = records["channel"]
    return [(int(number), records[channels == number]) for number in np.unique(channels)]
