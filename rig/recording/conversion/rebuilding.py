"""A point's file made again from the received data that an earlier file contains, by this version of the software."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import channel_number
from rig.errors import FileProblem
from rig.recording.conversion.conversion import Correction, build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.hdf5.read_back import prove
from rig.recording.hdf5.reading import opened
from rig.recording.journal.journal_file import JournalContent
from rig.recording.journal.point_journal import ChannelSplit
from rig.recording.layout import Attribute, Event, PointContext
from rig.recording.point_files import FinishedPoint
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.chunked_column import parts
from rig.test_point import ENDURANCE

REANALYSED = "reanalysed_"
"""Attributes of `/entry/provenance` with this beginning stay when a file is made again once more."""
NEEDED = ("context", "journal_end")
"""Attributes of `/entry/provenance` from which a file can be made again."""


def can_be_rebuilt(point: RecordedPoint) -> bool:
    """Whether a point's file contains what it was made from.

    An imported test and a file of another program do not; the file of an endurance block has the samples of some of its
    cycles only.

    Args:
        point: opened from its file.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    if point.path is None or point.kind == ENDURANCE or any(name not in point.provenance for name in NEEDED):
        return False
    with opened(point.path) as file:
        return "raw" in file["entry"] and "events" in file["entry"] and "host_ns" in file["entry/events"]


def rebuild(
    source: Path, target: Path, correction: Correction | None = None, *, old: RecordedPoint | None = None
) -> FinishedPoint:
    """Align and evaluate the received data of a point's file again.

    Args:
        source: the point's file; it is only read.
        target: the file to write, complete or not at all; it may be `source`, which is then replaced.
        correction: delays and instruments as all points of the campaign determine them; None: what this point shows.
        old: `source`, where it is open already.

    Raises:
        FileProblem: `source` does not contain what it was made from.
        OSError: the disk refuses; `target` is as it was.
    """
    old = RecordedPoint.open(source) if old is None else old
    content = _journal_of(source, old)
    context = PointContext.from_json(content.context_json)
    stays: dict[str, Attribute] = {
        name: value for name, value in old.provenance.items() if name.startswith(REANALYSED)
    }
    with ExitStack() as held:
        split = held.enter_context(ChannelSplit(target.parent))
        for records in _received(source):
            split.take(records)
        file, quality = build(
            content, context, split.channels(), recovered=bool(old.quality.recovered),
            journal_check=str(old.provenance.get("journal_check", "")), correction=correction,
        )
        file = replace(file, provenance={**stays, **file.provenance})
        write_file(target, file, before_naming=lambda partial, checks: prove(partial, file, checks))
    return FinishedPoint.of(old.id, target, quality)


def _journal_of(path: Path, old: RecordedPoint) -> JournalContent:
    """Content of the point's journal without its samples.

    Raises:
        FileProblem: the file does not contain it.
    """
    if not can_be_rebuilt(old):
        raise FileProblem(str(path), ["does not contain the data that are required to rebuild it; the file "
            "is left unchanged"])
    provenance = old.provenance
    with opened(path) as file:
        group = file["entry/events"]
        times = group["host_ns"][:].tolist()
        texts = [[text.decode("utf-8", "replace") for text in group[name][:].tolist()] for name in ("code", "text")]
    events = tuple(Event(time_ns, code, text.strip()) for time_ns, code, text in zip(times, *texts, strict=True))
    return JournalContent(
        str(provenance["context"]), np.zeros(0, RECORD_DTYPE), events, json.loads(str(provenance["journal_end"])),
        int(provenance.get("journal_missing_blocks", 0)), int(provenance.get("journal_damaged_bytes", 0)),
    )


def _received(path: Path) -> Iterator[NDArray[Any]]:
    """Every record of a file, a part at a time, channel by channel, as they came out of the ring."""
    with opened(path) as file:
        raw = file["entry/raw"]
        for name, channel in raw.items():
            number = channel_number(name)
            for rows in parts(len(channel["value"])):
                records = np.zeros(len(channel["value"][rows]), RECORD_DTYPE)
                for key in ("host_ns", "device_us", "value", "sequence", "flags"):
                    records[key] = channel[key][rows]
                records["channel"] = number
                yield records
