"""The report's section on events: those of the campaign's journal, equal ones in one line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rig.document.blocks import Blocks, Column, Head, Paragraph, section, table
from rig.document.moments import local_time, zone_of
from rig.document.numbers import NOTHING, number
from rig.document.words import Code

ROUTINE = frozenset({"phase", "point", "rest", "result", "signature"})
"""Reported by other sections, or the same in every campaign."""
NAMES = ("slug", "code", "id")
WORDS = ("detail", "text", "operator", "note")
SILENT = frozenset({"utc", "host_ns", "event", "t_ns", "file", "what", *NAMES, *WORDS})
TITLES = {
    "connected": "Devices connected", "dropped": "Record not used", "ended": "Software ended", "endurance": "Endurance",
    "error": "Error", "finding": "Finding", "info": "Message", "judged": "Point evaluated", "operator": "Operator",
    "refused": "Refused", "requalified": "Requalified", "resumed": "Resumed", "retimed": "Time alignment corrected",
    "station": "Monitoring", "warning": "Warning", "withdrawn": "Points not run",
}  # fmt: skip
"""An event of the journal as the table shows it; one that is not listed keeps its name."""
SUBTITLES = {
    "operator": {
        "begun": "Resumed by the operator", "said": "Entry by the operator", "set": "Current set by the operator",
    },
    "station": {
        "also": "Further fault", "ended": "Monitoring ended", "hybrid": "Hybrid test", "late": "Monitoring late",
        "ready": "Monitoring ready", "safe": "Safe state reached", "sent": "Command sent",
        "setpoints": "Set-points sent", "stop": "Step of the stop", "trip": "Fault: stop triggered",
        "unknown": "State of the rig unknown", "warning": "Warning",
    },
}  # fmt: skip
"""The same for the events that differ by their `what`."""
MOST_ROWS = 60
MOST_FIELDS = 6
LONGEST = 300


@dataclass
class CampaignEvent:
    """Events of one kind: the first and last time (UTC), how often, and the text of the last.

    Attributes:
        kind: what happened, in words.
        name: code, or id of the point; empty where there is none.
    """

    kind: str
    name: str
    first: str
    last: str = ""
    count: int = 0
    words: str = field(default="")


def events(log: Sequence[Mapping[str, Any]] | None) -> Blocks:
    """The journal's events that are not routine; empty where there is no journal (None)."""
    if log is None:
        return []
    happened = campaign_events(log)
    note = ("From the campaign journal. For an explanation of a code, run ", Code("rig explain CODE"), ".")
    title = section("Events", note)
    if not happened:
        return [*title, Paragraph("The journal contains only routine events.", small=True)]
    rows = [
        [
            _clock(one.first), _clock(one.last) if one.count > 1 else NOTHING, one.kind, one.name or NOTHING,
            str(one.count), one.words,
        ]
        for one in happened[:MOST_ROWS]
    ]  # fmt: skip
    more = len(happened) - len(rows)
    count = Column("Count", "", True)
    zone = zone_of(happened[0].first) or "UTC"
    head: list[Head] = [f"First, {zone}", f"Last, {zone}", "Event", "Code or point", count, "Latest message or values"]
    rest: Blocks = [Paragraph(f"Further kinds of event in journal.jsonl: {more}.", small=True)] if more > 0 else []
    return [*title, table(head, rows), *rest]


def campaign_events(log: Sequence[Mapping[str, Any]]) -> list[CampaignEvent]:
    """Equal events as one, in the order of their first."""
    known: dict[tuple[str, str], CampaignEvent] = {}
    for line in log:
        kind = str(line["event"])
        if kind in ROUTINE or (kind == "judged" and line.get("verdict") == "valid"):
            continue
        name = next((str(line[key]) for key in NAMES if line.get(key)), "")
        when = str(line.get("utc", ""))
        title = SUBTITLES.get(kind, {}).get(str(line.get("what")), TITLES.get(kind, kind))
        one = known.setdefault((title, name), CampaignEvent(title, name, when))
        one.last, one.count, one.words = when, one.count + 1, _words(line)
    return list(known.values())


def _words(line: Mapping[str, Any]) -> str:
    """An event's text, else its values."""
    texts = [str(line[key]) for key in WORDS if line.get(key)]
    reasons = line.get("reasons")
    if isinstance(reasons, list):
        texts += [str(reason) for reason in reasons]
    if not texts:
        texts = [
            f"{key} {number(value) if isinstance(value, float) else value}" for key, value in line.items()
            if key not in SILENT and isinstance(value, (str, int, float)) and not isinstance(value, bool)
        ][:MOST_FIELDS]  # fmt: skip
    return "; ".join(texts)[:LONGEST]


def _clock(stamp: str) -> str:
    """Local date and time to the second; the zone is in the head of the column."""
    return local_time(stamp, zone=False)
