"""A journal's samples by channel: in memory while they are few, in temporary files once they are many."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from rig.recording.journal.journal_file import JournalProblem
from rig.recording.layout import RECORD_DTYPE, Records, channel_name
from rig.signals.chunked_column import Column

MOST_BYTES_IN_MEMORY = 48_000_000
MOST_CHANNELS = 128
"""The ring has 51; more are the numbers of no rig, and each would be a file."""


class StoredRecords:
    """Ring records of one channel in a temporary file without a name: appended once, then read a part at a time.

    `records[a:b]` is an array of `RECORD_DTYPE`, `records["value"]` one field as a `Column`.

    Args:
        folder: where the file lies; it vanishes when closed, or with the process.

    Raises:
        OSError: the file cannot be made.
    """

    ndim = 1
    dtype = RECORD_DTYPE

    def __init__(self, folder: Path) -> None:
        self._file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as this object
        self._count = 0

    def append(self, records: NDArray[Any]) -> None:
        """Add records (n,).

        Raises:
            OSError: the disk refuses them.
        """
        self._file.write(records.tobytes())
        self._count += len(records)

    def finish(self) -> None:
        """Nothing more is appended.

        Raises:
            OSError: the disk refuses what was appended last.
        """
        self._file.flush()

    def close(self) -> None:
        """Give the room back."""
        self._file.close()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, key: slice | str) -> Any:  # noqa: ANN401 - an array or a column, as a record array does
        if isinstance(key, str):
            return Column(len(self), RECORD_DTYPE[key], lambda start, stop: self[start:stop][key])
        start, stop, step = key.indices(len(self))
        size = RECORD_DTYPE.itemsize
        data = os.pread(self._file.fileno(), max(0, stop - start) * size, start * size)
        return np.frombuffer(data, RECORD_DTYPE)[::step]


class ChannelSplit:
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
