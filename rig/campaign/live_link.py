"""The application's side of the live folder: requests from pages, and the state shown to them.

Datagrams are read in the campaign's loop, one at a time, without waiting. A page may request a stop, a pause, the start
of a paused or held campaign, and enter texts: operator, notes, data of the specimen. It cannot reset an interlock or
move anything: a start is an action of the sequencer, after its own checks.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from rig.campaign.live_display import LiveDisplay
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.recording.journal.campaign_log import CampaignLog
from rig.station.live_folder import (
    APPLICATION_SOCKET,
    DEVICES,
    STATION_SOCKET,
    bound,
    make_live_folder,
    read_json,
    received,
    replace_json,
)
from rig.station.stop_socket import requester

MOST_AT_ONCE = 8
"""Messages taken in one turn of the campaign's loop."""
MOST_NOTES = 1000
LONGEST_WORDS = {"operator": 80, "specimen": 500, "note": 2000, "acknowledged": 80}


class Request(StrEnum):
    """What a page may ask the campaign's loop for."""

    STOP = "stop"
    PAUSE = "pause"
    START = "start"
    BEGIN = "begin"


@dataclass(frozen=True)
class Wish:
    """One thing that was asked for, and by whom."""

    do: Request
    by: str


class LiveLink:
    """The live folder of one campaign and what comes in there.

    Args:
        held: the campaign begins only when a page asks for it.
        place: where the folder is made; by default shared memory.

    Attributes:
        folder: the live folder.
        display: what writes it.
        paused: a pause was asked for.
        held: nothing has begun yet.
        confirm: earlier stops that a start of a held campaign must name, each with `slug` and `text`'s parts.
        asked: the current (A) that the operator is to set now; None: none.
        paged: an operator's page is served with the campaign.

    Raises:
        OSError: the folder or its socket cannot be made.
    """

    def __init__(self, *, held: bool = False, place: Path | None = None) -> None:
        self.folder, lock = make_live_folder(place)
        self._ends = contextlib.ExitStack()
        self._ends.callback(os.close, lock)
        self._ends.callback(shutil.rmtree, self.folder, ignore_errors=True)
        self._inbox = self._ends.enter_context(bound(self.folder / APPLICATION_SOCKET))
        self.paused = False
        self.held = held
        self.confirm: tuple[Mapping[str, str], ...] = ()
        self.requested_A: float | None = None
        self.paged = False
        self.current_is_set = False
        self._questions = 0
        self.display = LiveDisplay(self.folder, self._standing)
        self._log: CampaignLog | None = None

    @property
    def station_socket(self) -> str:
        """Where the station listens for a stop."""
        return str(self.folder / STATION_SOCKET)

    def _standing(self) -> dict[str, Any]:
        requested = None if self.requested_A is None else {"current_A": self.requested_A, "number": self._questions}
        confirm = [dict(stop) for stop in self.confirm]
        return {"paused": self.paused, "held": self.held, "confirm": confirm, "asked": requested}

    def belongs_to(self, out: Path, devices: Iterable[str]) -> None:
        """State which rig this is, for the page of a bench; one that cannot be written is not found by that page.

        Args:
            out: folder in which the campaign's folder is.
            devices: names of the rig's devices; none of a simulated rig.
        """
        with contextlib.suppress(OSError):
            replace_json(self.folder / DEVICES, {"out": str(out.resolve()), "devices": sorted(devices)})

    def ask_current(self, current_A: float) -> None:
        """Show a question for a current (A); answers to earlier ones are none to it."""
        self._questions += 1
        self.requested_A, self.current_is_set = current_A, False

    def forget_question(self) -> None:
        """It was answered, or no longer matters."""
        self.requested_A, self.current_is_set = None, False

    @contextmanager
    def following(self, log: CampaignLog) -> Iterator[None]:
        """While the block runs, the campaign of this journal says where its live folder is, and words go into it.

        Raises:
            OSError: the campaign's directory cannot be written.
        """
        self._log = log
        link = CampaignFolder(log.path.parent).live_link
        replace_json(link, {"folder": str(self.folder), "pid": os.getpid()})
        self.display.campaign = str(log.path.parent.resolve())
        try:
            yield
        finally:
            self._log = None
            with contextlib.suppress(OSError):
                link.unlink(missing_ok=True)

    def take(self) -> list[Wish]:
        """What was asked for since the last call, oldest first; a few at a time, a stop among them first."""
        wishes: list[Wish] = []
        for _ in range(MOST_AT_ONCE):
            try:
                message = received(self._inbox)
            except OSError:
                break  # a broken door for pages stops no rig: the terminal is still there
            if message is None:
                break
            wish = self._understood(message)
            if wish is not None:
                wishes.append(wish)
        return sorted(wishes, key=lambda wish: wish.do is not Request.STOP)

    def _understood(self, message: Mapping[str, Any]) -> Wish | None:
        do, by = str(message.get("do")), requester(dict(message))
        if do == "words":
            self._keep(message, by)
        elif do in {Request.STOP, Request.PAUSE}:
            return Wish(Request(do), by)
        elif do == Request.START:
            return self._start(message, by)
        elif do == "set" and self.requested_A is not None and message.get("number") == self._questions:
            self.current_is_set = True
            self._note("set", by, current_A=self.requested_A)
        return None

    def _start(self, message: Mapping[str, Any], by: str) -> Wish | None:
        """A start ends a pause; of a held campaign it begins it, where it names every stop to be confirmed."""
        if not self.held:
            return Wish(Request.START, by)
        named = message.get("confirmed")
        confirmed = {str(slug) for slug in named} if isinstance(named, list) else set()
        missing = [stop["slug"] for stop in self.confirm if stop["slug"] not in confirmed]
        if missing:
            self.display.message("warning", "not started; first confirm that you have checked the following: "
                f"{', '.join(missing)}")
            return None
        self.held = False
        self._note("begun", by, confirmed=sorted(confirmed))
        return Wish(Request.BEGIN, by)

    def _note(self, what: str, by: str, **more: object) -> None:
        if self._log is not None:
            self._log.note("operator", what=what, by=by, **more)

    def _keep(self, message: Mapping[str, Any], by: str) -> None:
        """Words typed on a page: into the journal, and all of them in one file beside it."""
        if self._log is None:
            return
        words = {name: _printable(message[name], most) for name, most in LONGEST_WORDS.items() if name in message}
        self._note("said", by, **words)
        path = CampaignFolder(self._log.path.parent).operator
        kept = {"operator": "", "specimen": "", "notes": [], **read_json(path)}
        stamp = {"utc": utc_now().isoformat(timespec="seconds"), "by": by}
        kept |= {name: words[name] for name in ("operator", "specimen") if name in words}
        if "note" in words and len(kept["notes"]) < MOST_NOTES:
            kept["notes"].append({**stamp, "text": words["note"]})
        try:
            replace_json(path, kept)  # not flushed: the loop that watches the rig does not wait for a disk
        except OSError as error:
            self.display.message("error", f"{path.name}: not written: {error}")

    def close(self) -> None:
        """Take the folder away; a second time is none."""
        self._ends.close()


def _printable(value: object, most: int) -> str:
    """Text as typed, without control characters but line ends, cut to `most` characters."""
    return "".join(sign for sign in str(value) if sign.isprintable() or sign == "\n")[:most].strip()
