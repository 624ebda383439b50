"""What the operator must confirm before a campaign is resumed, by the resume class of the fault row.

After a stop of class `c` the operator must have checked the cause: `--resume` confirms this, and the check is printed.
After one of class `n` (e-stop, broken coil, load train ...) the specimen must be requalified, and `--requalified TEXT`
states how. Both are stored in the journal, so that nothing is confirmed twice.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.campaign.stop_cause import OPERATOR
from rig.campaign_folder import CampaignFolder
from rig.errors import Refused
from rig.faults.matrix import MATRIX
from rig.recording.journal.campaign_log import UNREADABLE, each_line

REQUALIFY = "n"
CONFIRM = "c"
LONGEST_TEXT = 500

LOOK_AT = {
    "modbus": "the link to the controller: its cable and other devices on the network",
    "rtu": "the serial line to the controller: its termination and other devices on the line",
    "controller": "the controller: its state, settings and messages, and any other masters",
    "can": "the CAN bus: cable, termination, other nodes",
    "ecu": "the current ECU, its power supply, and the coil with its cable",
    "sensor": "the sensor, its cable, plug and adapter",
    "specimen": "the damper, its joints and its mounting",
    "signal": "the rig: it must be at rest with nothing loose, and the guard area must be clear",
    "disk": "the disk: free space and permissions",
    "silence": "the computer: find out why its programs were not running",
    "starvation": "the computer: find out why its programs were not running",
    "clock": "the computer: find out why it was suspended or its clock jumped",
    "process": "the computer: read the logs of the programs that stopped",
}
"""By the place of the fault matrix's row."""
DAMAGED = "journal-damaged"
LOOK_AT_THE_RIG = "the rig and station.log, in which the stop message names the cause"


@dataclass(frozen=True)
class EarlierStop:
    """A stop of an earlier session: its cause, how it stopped, when (UTC), what was said, what to look at."""

    slug: str
    stop: str
    utc: str
    detail: str
    look_at: str
    resume: str

    @property
    def text(self) -> str:
        """For the operator."""
        return f"{self.slug} ({self.stop}, {self.utc}): {self.detail or 'no detail'}; inspect {self.look_at}"

    def to_json(self) -> dict[str, str]:
        """One entry of `confirmed` in `rig run --json`."""
        return {key: str(value) for key, value in asdict(self).items()} | {"check": self.look_at}


def resume_class(slug: str) -> str:
    """`n` where the specimen must be requalified, else `c`: that the operator resumes at all confirms the rest."""
    return REQUALIFY if slug in MATRIX and MATRIX[slug].resume == REQUALIFY else CONFIRM


def look_at(slug: str) -> str:
    """What the operator must have checked after this stop."""
    row = MATRIX.get(slug)
    if row is None:
        return LOOK_AT_THE_RIG
    what = LOOK_AT.get(row.place, LOOK_AT_THE_RIG)
    return what if slug in OPERATOR else f"{what} ({row.fault})"


def open_stops(folder: Path) -> tuple[EarlierStop, ...]:
    """What stopped earlier sessions of a campaign and was not confirmed since, first causes and later ones.

    A campaign that has points and whose journal knows of no connected rig has lost what it told.

    Raises:
        OSError: the journal cannot be read.
    """
    campaign, events = CampaignFolder(folder), set[str]()

    def lines() -> Iterator[dict[str, Any]]:
        for line in each_line(folder) if campaign.journal.is_file() else ():
            events.add(line["event"])
            yield line

    stops = unconfirmed(lines())
    if any(campaign.points.glob("*")) and not {"connected", "requalified"} & events:
        return (_damaged(f"{CampaignFolder.journal} is missing or truncated"),)
    return stops


def unconfirmed(lines: Iterable[Mapping[str, Any]]) -> tuple[EarlierStop, ...]:
    """The same for the lines of a journal: a later `resumed` or `requalified` line confirms what came before it.

    A line that cannot be read may have told of a grave stop, so it counts as one (`journal-damaged`).
    """
    stops: dict[str, EarlierStop] = {}
    for line in lines:
        event, what = line.get("event"), line.get("what")
        if event == "requalified":
            stops = {slug: stop for slug, stop in stops.items() if stop.resume != REQUALIFY}
        elif event == "resumed":
            stops = {slug: stop for slug, stop in stops.items() if stop.resume == REQUALIFY}
        elif event == "station" and what in {"trip", "also"}:
            _enter(stops, str(line.get("slug")), line, str(line.get("stop")), str(line.get("detail", "")))
        elif event == "result" and line.get("stopped_by") and not line.get("refused"):
            _enter(stops, str(line["stopped_by"]), line, "stop", str(line.get("detail", "")))
        elif event == UNREADABLE and DAMAGED not in stops:
            stops[DAMAGED] = _damaged(f"line {line['line']} of journal.jsonl cannot be read")
    return tuple(stops.values())


def _damaged(what: str) -> EarlierStop:
    detail = f"{what}; the missing part may record an e-stop or another serious fault"
    return EarlierStop(DAMAGED, "unknown", "unknown", detail, LOOK_AT_THE_RIG, REQUALIFY)


def _enter(stops: dict[str, EarlierStop], slug: str, line: Mapping[str, Any], stop: str, detail: str) -> None:
    if slug not in stops:
        stops[slug] = EarlierStop(slug, stop, str(line.get("utc", "")), detail, look_at(slug), resume_class(slug))


def confirm(stops: Iterable[EarlierStop], requalified: str) -> None:
    """Refuse to resume after a stop that demands a requalification, unless there is one.

    Args:
        stops: what was not confirmed yet.
        requalified: what was checked or replaced, in the operator's words.

    Raises:
        Refused: none is given (slug `requalify`); nothing was connected.
    """
    grave = [stop for stop in stops if stop.resume == REQUALIFY]
    if grave and not requalified:
        named = "\n".join(stop.text for stop in grave)
        raise Refused(
            "requalify",
            f"the specimen must be requalified because this campaign was stopped:\n{named}\nNothing was connected. "
            'Fix: check the specimen, then state what was checked or replaced: --requalified "TEXT"',
        )


def confirm_all(stops: Iterable[EarlierStop], confirmed: frozenset[str] | None) -> None:
    """Refuse to resume where the operator was shown other stops than there are now.

    Args:
        stops: what was not confirmed yet.
        confirmed: codes of the stops that the operator has confirmed; None: those that are printed on resuming.

    Raises:
        Refused: there is another one (slug `stops-changed`); nothing was connected.
    """
    others = [] if confirmed is None else [stop.text for stop in stops if stop.slug not in confirmed]
    if others:
        listed = "\n".join(others)
        raise Refused(
            "stops-changed",
            f"this campaign was also stopped for a reason that was not confirmed:\n{listed}\nNo device was connected. "
            "Fix: read the questions again, check the cause, then resume",
        )


def resume_command(folder: Path, resume: str = CONFIRM) -> str:
    """What to type to go on with a campaign after a stop of this class."""
    command = f"rig run --resume {shlex.quote(str(folder))}"
    return f'{command} --requalified "WHAT WAS CHECKED"' if resume == REQUALIFY else command
