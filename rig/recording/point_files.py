"""File names of a point's data in a campaign's `points/`, and their exact distinction from other points' names.

    ID.journal                          the running point, or one that is still to be converted
    ID.h5.tmp                           a file that is being written; its journal still exists
    ID.h5                               the point
    ID-attempt2.journal, .h5            a further attempt, after a fault that may be retried
    ID-out-of-tolerance1.journal, .h5   a motion out of tolerance; the point was repeated
    ID-attempt1.h5.old                  the file of an attempt of an earlier session
    NAME-unreadable-TIME.journal.old    a journal that could not be converted when the point was repeated

An id may itself end like one of these, or be the start of another: names are compared as a whole, never by pattern. If
the name of an attempt is the id of another point, a dot, which no id contains, replaces its dash.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.clock import utc_now

JOURNAL, FILE, PARTIAL = ".journal", ".h5", ".h5.tmp"
OLD_JOURNAL, OLD_FILE = ".journal.old", ".h5.old"
UNREADABLE = re.compile(r"(?P<name>.+)-unreadable-\d{8}T\d{6,}(-\d+)?")
ATTEMPT, OUT_OF_TOLERANCE = "attempt", "out-of-tolerance"
LONGEST_ID_BYTES = 150
"""File names have 255 bytes at most, the endings above included."""


def name_problem(point_id: str) -> str:
    """Why a text cannot be a point's id, which becomes part of file names; empty where it can."""
    if not 1 <= len(point_id.encode("utf-8", "replace")) <= LONGEST_ID_BYTES:
        return f"{len(point_id)} characters; expected 1 to {LONGEST_ID_BYTES} bytes"
    if point_id.startswith(".") or any(letter in "/\\:" or not letter.isprintable() for letter in point_id):
        return f"{point_id!r}; expected printable characters, without / \\ : and without a leading dot"
    return ""


def attempt_name(point_id: str, attempt: int, ids: Collection[str] = ()) -> str:
    """Name of a point's files: its id, and from the second attempt on which attempt it is.

    Args:
        point_id: of the point.
        attempt: counts from 1.
        ids: of all points of the campaign.
    """
    return point_id if attempt == 1 else _beside(point_id, ATTEMPT, attempt, ids)


def free_out_of_tolerance_name(points: Path, point_id: str, ids: Collection[str] = ()) -> str:
    """A name, not used yet in the folder `points`, for the record of a motion that was not the wanted one."""
    taken, number = names_in(points), 1
    while (name := _beside(point_id, OUT_OF_TOLERANCE, number, ids)) in taken:
        number += 1
    return name


def _beside(point_id: str, kind: str, number: int, ids: Collection[str]) -> str:
    name = f"{point_id}-{kind}{number}"
    known = {known.casefold() for known in ids}
    return f"{point_id}.{kind}{number}" if name.casefold() in known else name


def journal_name(journal: Path) -> str:
    """The point's name in a journal's file name, `.journal` or `.journal.old`."""
    stem = journal.name.removesuffix(OLD_JOURNAL).removesuffix(JOURNAL)
    unreadable = UNREADABLE.fullmatch(stem) if journal.name.endswith(OLD_JOURNAL) else None
    return stem if unreadable is None else unreadable["name"]


def names_in(points: Path) -> set[str]:
    """The names of which anything lies in the folder."""
    endings = (OLD_JOURNAL, OLD_FILE, PARTIAL, JOURNAL, FILE)
    names = set()
    for path in points.iterdir():
        ending = next((ending for ending in endings if path.name.endswith(ending)), "")
        names.add(journal_name(path) if "journal" in ending else path.name.removesuffix(ending))
    return names


def unfinished(points: Path) -> list[Path]:
    """Journals of which no file was made, in the order of names: those in their place first, then those set aside."""
    return [*_ending_in(points, JOURNAL), *_ending_in(points, OLD_JOURNAL)]


def partial_files(points: Path) -> list[Path]:
    """Files that were not written to their end."""
    return list(_ending_in(points, PARTIAL))


def _ending_in(points: Path, ending: str) -> Iterator[Path]:
    return iter(sorted(path for path in points.iterdir() if path.name.endswith(ending) and path.is_file()))


def free_attempt_file(points: Path, name: str) -> Path:
    """A free name under which no run lists it for the file of a point's earlier attempt."""
    number = 1
    while (kept := points / f"{name}-{ATTEMPT}{number}{OLD_FILE}").exists():
        number += 1
    return kept


def free_old_journal(journal: Path) -> Path:
    """A free name under which a journal that could not be read waits for another look."""
    stamp, number = f"{utc_now():%Y%m%dT%H%M%S%f}", 1
    kept = journal.with_name(f"{journal_name(journal)}-unreadable-{stamp}{OLD_JOURNAL}")
    while kept.exists():
        number += 1
        kept = journal.with_name(f"{journal_name(journal)}-unreadable-{stamp}-{number}{OLD_JOURNAL}")
    return kept


if TYPE_CHECKING:
    from rig.recording.quality.point_quality import PointQuality


@dataclass(frozen=True)
class FinishedPoint:
    """What became of a point: its file, or why there is none (`error`; the journal is then kept).

    `quality` holds the numbers among the attributes of `/entry/quality`, by name. `error_slug` is `disk-full`,
    `disk-error`, `unreadable` (what is in the journal), `conversion-crashed` or `conversion-timeout`.
    """

    id: str
    file: str = ""
    verdict: str = "invalid"
    reasons: tuple[str, ...] = ()
    lost_samples: int = 0
    skew_s: float | None = None
    skew_std_s: float = 0.0
    error: str = ""
    quality: Mapping[str, float] = field(default_factory=dict)
    error_slug: str = ""

    @classmethod
    def of(cls, point_id: str, file: Path, quality: PointQuality) -> FinishedPoint:
        """What became of a point whose file is complete."""
        return cls(
            point_id, str(file.resolve()), quality.verdict.verdict, quality.verdict.reasons, quality.lost_samples or 0,
            quality.skew.value_s, quality.skew.std_s or 0.0, quality=quality.numbers,
        )

    @classmethod
    def from_json(cls, answer: Mapping[str, Any]) -> FinishedPoint:
        """From `dataclasses.asdict` by way of JSON."""
        return cls(**{**answer, "reasons": tuple(answer["reasons"])})
