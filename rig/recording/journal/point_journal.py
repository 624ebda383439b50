"""A point's journal as a whole: header, events, samples by channel, all with plausible values.

Few samples are kept in memory, many in temporary files.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from drivers.ring import channel_name
from rig.recording.journal.journal_file import JournalContent, JournalProblem, joined, release, scan_journal
from rig.recording.layout import PointContext
from rig.recording.ring_records import RECORD_DTYPE, Records
from rig.signals.chunked_column import PART_SAMPLES, Column, parts
from rig.signals.waveform import is_waveform

MOST_BYTES_IN_MEMORY = 48_000_000
MOST_CHANNELS = 128
"""The ring has 51; more are the numbers of no rig, and each would be a file."""


Range = tuple[float, float]
POINT: dict[str, Range] = {
    "amplitude_m": (0.0, 10.0), "frequency_Hz": (1e-6, 1e4), "current_A": (-1e3, 1e3), "cycles": (0.0, 1e6),
}
SENSOR: dict[str, Range] = {
    "rate_Hz": (1e-3, 1e7), "delay_s": (-10.0, 10.0), "range_SI": (0.0, 1e12), "sensitivity": (-1e12, 1e12),
    "offset": (-1e12, 1e12),
}
CONTEXT: dict[str, Range] = {
    "device_rate": (1e-4, 1e5), "controller_delay_s": (-10.0, 10.0), "mid_stroke_m": (-10.0, 10.0),
    "moving_mass_kg": (0.0, 1e6), "current_tolerance_A": (0.0, 1e3),
}
HOST_NS: Range = (0, 1 << 60)
"""Monotonic time of the host: 36 years."""
DEVICE_US: Range = (-1, 1 << 50)
"""A device's own clock, -1 where it has none: 35 years."""
LONGEST_NS = 30 * 24 * 3600 * 10**9
"""From a point's first record to its last."""
CHECKED_BYTES = 1 << 22


@dataclass(frozen=True)
class PointJournalContent:
    """What a journal holds.

    Attributes:
        content: its events and its end.
        context: its header.
        records: samples by channel name; usable while the journal is open.
        check: of the whole journal: a file made of it says so.
    """

    content: JournalContent
    context: PointContext
    records: Mapping[str, Records]
    check: str


@contextmanager
def opened(journal: Path, point: str) -> Iterator[PointJournalContent]:
    """A journal's content, read from the disk as it is asked for.

    Args:
        journal: the file.
        point: name of its point.

    Raises:
        JournalProblem: it cannot be read, or holds what no rig records.
        ValueError: its header is not a point's context.
        OSError: the disk refused.
    """
    with ExitStack() as held:
        split = held.enter_context(ChannelSplit(journal.parent))
        data = _mapped(journal, held)
        content = scan_journal(data, str(journal), split.take)
        context = checked_context(PointContext.from_json(content.context_json), point)
        records = split.channels()
        check_records(records)
        yield PointJournalContent(content, context, records, f"{_check_of(data):08x}-{len(data)}")


def _mapped(journal: Path, held: ExitStack) -> bytes | mmap.mmap:
    """The journal's bytes, mapped; an empty file cannot be."""
    file = held.enter_context(journal.open("rb"))
    if journal.stat().st_size == 0:
        return b""
    return held.enter_context(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


def _check_of(data: bytes | mmap.mmap) -> int:
    check = released = 0
    for start in range(0, len(data), CHECKED_BYTES):
        check = zlib.crc32(data[start : start + CHECKED_BYTES], check)
        released = release(data, released, start)
    return check


class StoredRecords:
    """Ring records of one channel in a temporary file without a name: appended once, then read a part at a time.

    `records[a:b]` is an array of `RECORD_DTYPE`, `records["value"]` one field as a `Column`. The last range is kept: a
    channel's fields are read one after the other.

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
        self._kept: tuple[int, int, NDArray[Any]] | None = None

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
        if self._kept is not None and self._kept[:2] == (start, stop):
            return self._kept[2][::step]
        size = RECORD_DTYPE.itemsize
        data = os.pread(self._file.fileno(), max(0, stop - start) * size, start * size)
        records = np.frombuffer(data, RECORD_DTYPE)
        if 1 < len(records) <= 2 * PART_SAMPLES:  # neither one value of a search nor a whole channel
            self._kept = start, stop, records
        return records[::step]


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
            raise JournalProblem(f"found records from at least {len(self._numbers)} channels, expected at most "
                f"{MOST_CHANNELS}")
        if self._stored or self._bytes + records.nbytes > MOST_BYTES_IN_MEMORY:
            self._spill()
            for number, part in _by_number(records):
                self._file(number).append(part)
            return
        self._bytes += records.nbytes
        for number, part in _by_number(records):
            self._blocks.setdefault(number, []).append(part)

    def channels(self) -> Mapping[str, Records]:
        """Records by channel name; usable until the split is closed.

        Raises:
            OSError: there is no room for the temporary files.
        """
        for stored in self._stored.values():
            stored.finish()
        held: dict[int, Records] = {number: joined(blocks) for number, blocks in self._blocks.items()}
        return {channel_name(number): records for number, records in sorted({**held, **self._stored}.items())}

    def _spill(self) -> None:
        for number, blocks in self._blocks.items():
            stored = self._file(number)
            for part in blocks:
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


def checked_context(context: PointContext, name: str) -> PointContext:
    """The context of the point called `name`, with numbers that a rig can have.

    Raises:
        JournalProblem: one line with each number that cannot be.
    """
    point = context.point
    problems = _outside("point", vars(point), POINT, needed=tuple(POINT))
    problems += _outside("header", vars(context), CONTEXT, needed=("device_rate",))
    if not is_waveform(point.waveform):
        problems.append(f"point: waveform = {point.waveform!r:.40}, expected the name of a waveform")
    for channel in ("force", "displacement"):
        if channel not in context.sensors:
            problems.append(f"no sensor {channel}")
    for channel, sensor in context.sensors.items():
        problems += _outside(channel, vars(sensor), SENSOR, needed=("rate_Hz",))
        problems += [f"{channel}: {key} is not a string" for key in ("sensor", "unit", "long_name")
                     if not isinstance(vars(sensor)[key], str)]
    if problems:
        raise JournalProblem("the header contains implausible values: " + "; ".join(problems))
    return replace(context, point=replace(point, id=name))


def _outside(
    place: str, values: Mapping[str, object], ranges: Mapping[str, Range], needed: tuple[str, ...],
) -> list[str]:
    problems = []
    for key, (low, high) in ranges.items():
        value = values.get(key)
        if value is None and key not in needed:
            continue
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (is_number and low <= value <= high):  # type: ignore[operator] # a number where the first half holds
            problems.append(f"{place}: {key} = {value!r:.40}, expected {low:g} to {high:g}")
    return problems


def check_records(channels: Mapping[str, Records]) -> None:
    """Refuse times that no clock shows.

    Raises:
        JournalProblem: naming the channel, the time and the range.
    """
    for name, records in channels.items():
        for key, (low, high) in (("host_ns", HOST_NS), ("device_us", DEVICE_US)):
            least, greatest = _extremes(records, key)
            if least < low or greatest > high:
                raise JournalProblem(f"{name}: {key} from {least} to {greatest}, expected {low} to {high}")
            if key == "host_ns" and greatest - least > LONGEST_NS:
                raise JournalProblem(f"{name}: the records are {1e-9 * (greatest - least):.0f} s apart, which is "
                    "implausible for one point")


def _extremes(records: Records, key: str) -> tuple[int, int]:
    columns = [np.asarray(records[rows][key]) for rows in parts(len(records))]
    return min(int(part.min()) for part in columns if len(part)), max(int(part.max()) for part in columns if len(part))
