"""The report's part about what happened: the events of the campaign's journal, those alike told once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rig.recording.journal.campaign_log import read_log
from rig.recording.run import Run
from rig.report.fragment import NOTHING, heading, lead, number, table, text

ROUTINE = frozenset({"phase", "point", "rest", "result", "signature"})
"""Told by other parts, or the same in every campaign."""
NAMES = ("slug", "what", "code", "id")
WORDS = ("detail", "text", "operator", "note")
SILENT = frozenset({"utc", "host_ns", "event", "t_ns", "file", *NAMES, *WORDS})
MOST_ROWS = 60
MOST_FIELDS = 6
LONGEST = 300


@dataclass
class Happening:
    """Events of one kind: the first and last time (UTC), how often, and the last one's words."""

    kind: str
    name: str
    first: str
    last: str = ""
    count: int = 0
    words: str = field(default="")


def events(run: Run) -> str:
    """What the journal tells beyond routine; one sentence where there is nothing, nothing where there is no journal."""
    if not (run.path / "journal.jsonl").is_file():
        return ""
    happened = happenings(read_log(run.path))
    title = heading("Events", "From the campaign's journal; <code>rig explain SLUG</code> says what a slug means.")
    if not happened:
        return title + lead("Nothing beyond the routine of a campaign.")
    rows = [
        ("", [
            text(_clock(one.first)), text(_clock(one.last) if one.count > 1 else NOTHING), text(one.kind),
            text(one.name or NOTHING), str(one.count), text(one.words),
        ])
        for one in happened[:MOST_ROWS]
    ]  # fmt: skip
    more = len(happened) - len(rows)
    head = ["First, UTC", "Last", "Event", "Slug or name", "Times", "The last one's words and numbers"]
    return title + table(head, rows, (4,)) + (lead(f"{more} more kinds are in journal.jsonl.") if more > 0 else "")


def happenings(log: list[dict[str, Any]]) -> list[Happening]:
    """Events that are alike, in the order of their first."""
    known: dict[tuple[str, str], Happening] = {}
    for line in log:
        kind = str(line["event"])
        if kind in ROUTINE or (kind == "judged" and line.get("verdict") == "valid"):
            continue
        name = next((str(line[key]) for key in NAMES if line.get(key)), "")
        when = str(line.get("utc", ""))
        one = known.setdefault((kind, name), Happening(kind, name, when))
        one.last, one.count, one.words = when, one.count + 1, _words(line)
    return list(known.values())


def _words(line: Mapping[str, Any]) -> str:
    """An event's words, else its numbers."""
    said = [str(line[key]) for key in WORDS if line.get(key)]
    reasons = line.get("reasons")
    if isinstance(reasons, list):
        said += [str(reason) for reason in reasons]
    if not said:
        said = [
            f"{key} {number(value) if isinstance(value, float) else value}" for key, value in line.items()
            if key not in SILENT and isinstance(value, (str, int, float)) and not isinstance(value, bool)
        ][:MOST_FIELDS]  # fmt: skip
    return "; ".join(said)[:LONGEST]


def _clock(stamp: str) -> str:
    """Date and time to the second, as people read it."""
    return stamp[:19].replace("T", " ")
