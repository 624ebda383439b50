"""From a closed or cut-off journal to a point's finished file, proved against what it was made from."""

from __future__ import annotations

import mmap
import zlib
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import FileProblem
from rig.recording.atomic_write import FULL, flush_directory
from rig.recording.channel_split import ChannelSplit
from rig.recording.context import PointContext, check_records, checked_context
from rig.recording.conversion.conversion import build
from rig.recording.conversion.finished_point import FinishedPoint
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import release, scan_journal
from rig.recording.journal.journal_lock import journal_claimed
from rig.recording.layout import (
    PointFile,
)
from rig.recording.point_names import (
    FILE,
    OLD_JOURNAL,
    free_attempt_file,
    journal_name,
)
from rig.recording.recorded_point import RecordedPoint
from rig.signals.chunked_column import Values, mapped, parts

if TYPE_CHECKING:
    import h5py

CHECKED_BYTES = 1 << 22


class ReadBackDiffers(OSError):
    """The finished file does not hold what was written: the disk or the library failed; the journal is kept."""


def finish_point(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """Make a journal's `<name>.h5` beside it, prove it, delete the journal.

    A file of that name from an earlier attempt is kept under another name; a journal that had been set aside does not
    take the place of what was recorded since. A journal whose file is already complete (the power failed between the
    two) is only deleted.

    Args:
        journal: the point's journal.
        recovered: True when the campaign did not end by itself; recorded in the file.

    Raises:
        JournalProblem: it cannot be read, or holds what no rig records.
        NothingRecorded: it holds no displacement or no force.
        FileProblem: the file made of it could not be opened as a point again.
        OSError: the disk refused.
        ValueError: something in it fits nothing; so may any other error a library has for values that cannot be.
    """
    name = journal_name(journal)
    with ExitStack() as held:
        sorter = held.enter_context(ChannelSplit(journal.parent))
        data = _mapped(journal, held)
        content = scan_journal(data, str(journal), sorter.take)
        context = checked_context(PointContext.from_json(content.context_json), name)
        check = f"{_check_of(data):08x}-{len(data)}"
        records = sorter.channels()
        check_records(records)
        point, quality = build(content, context, records, recovered=recovered, journal_check=check)
        final = journal.with_name(name + FILE)
        if journal.name.endswith(OLD_JOURNAL) and final.exists() and not _made_from(final, check):
            final = free_attempt_file(journal.parent, name)
        if not (final.exists() and _made_from(final, check)):
            _write_proved(final, point)
    journal.unlink()
    flush_directory(journal.parent)
    return FinishedPoint.of(name, final, quality)


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


def _write_proved(final: Path, point: PointFile) -> None:
    """Write under a temporary name, read back, compare, only then give it its name."""

    def proved(partial: Path) -> None:
        prove(partial, point)
        RecordedPoint.open(partial)  # what nobody could open must not take its journal's place
        if final.exists():
            keep_attempt(final)

    write_file(final, point, before_naming=proved)


def prove(path: Path, point: PointFile) -> None:
    """Read a file back and compare every value with what was to be written.

    Raises:
        ReadBackDiffers: naming the first dataset that differs.
    """
    import h5py

    with h5py.File(path, "r") as file:
        data, raw = file["entry/data"], file["entry/raw"]
        _same(path, data, "time", point.time_s)
        for channel in point.channels:
            _same(path, data, channel.name, mapped(channel.values, lambda values: values, np.float32))
        if point.flags is not None:
            _same(path, data, "flags", point.flags)
        for received in point.raw:
            for name in ("value", "sequence", "device_us", "host_ns"):
                _same(path, raw[received.name], name, received.records[name])
            flags = mapped(received.records["flags"], lambda values: values, np.int8)  # as they are stored
            _same(path, raw[received.name], "flags", flags)
            if received.time_s is not None:
                _same(path, raw[received.name], "time", received.time_s)


def _same(path: Path, group: h5py.Group, name: str, wanted: Values) -> None:
    same = name in group and group[name].shape == wanted.shape
    for rows in parts(len(wanted)) if same else ():
        same = same and np.array_equal(group[name][rows], wanted[rows], equal_nan=wanted.dtype.kind == "f")
    if not same:
        raise ReadBackDiffers(f"{path}: {group.name}/{name} read back differs from what was recorded")


def _made_from(final: Path, journal_check: str) -> bool:
    """Whether a file is whole and was made of the journal with this check; a damaged one was not."""
    try:
        return RecordedPoint.open(final).provenance.get("journal_check") == journal_check
    except FileProblem:
        return False


def keep_attempt(final: Path) -> None:
    """Give an earlier attempt's file another name, which no run lists."""
    final.rename(free_attempt_file(final.parent, final.name.removesuffix(FILE)))


def finish_alone(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """`conversion.finish_point` by one process at a time; who comes second gets the first one's answer.

    Nothing is raised: whatever this journal does to the conversion is in the answer, so that the next one is looked at.

    Args:
        journal: the point's journal; nobody may be recording in it.
        recovered: as for `finish_point`.
    """
    try:
        with journal_claimed(journal) as handle:
            if handle is not None:
                return finish_point(journal, recovered=recovered)
        name = journal_name(journal)
        final = journal.with_name(name + FILE)
        return FinishedPoint.of(name, final, RecordedPoint.open(final).quality)
    except Exception as error:  # noqa: BLE001 - said by name; a journal may hold anything
        text = f"{journal.name}: {type(error).__name__}: {error}; the journal is kept"
        return FinishedPoint(journal_name(journal), error=text, error_slug=_slug(error))


def _slug(error: Exception) -> str:
    if not isinstance(error, OSError):
        return "unreadable"
    return "disk-full" if error.errno in FULL else "disk-error"
