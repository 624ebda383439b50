"""The campaign's own journal, `journal.jsonl`: one line per event, appended, for readers and for `jq`."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drivers.posix import O_CLOEXEC, O_NOFOLLOW
from rig.campaign_folder import CampaignFolder
from rig.clock import monotonic_ns, utc_now
from rig.text_file import lines_of, open_regular

RESERVE_BYTES = 1 << 17
LARGEST_BYTES = 1_000_000_000
"""Of a campaign's journal; a campaign of ten hours writes some megabytes."""
UNREADABLE = "unreadable"
EARLIER_WORDS = {"warming up": "temperature", "cooling down": "temperature", "reached;": "amplitude"}
"""Codes of `info` lines, by words that the programs before the codes wrote in them."""


KEPT_AT_ONCE = frozenset({"connected", "requalified", "resumed"})
"""What the next session must know even after a power cut; all of it is told before anything moves."""


class CampaignLog:
    """Appends events to `journal.jsonl`; each line is one unbuffered write, so a kill never leaves half of an old one.

    Some room is taken beforehand (`journal.reserve`) and given back when the disk is full: how a campaign was stopped
    by a full disk must still be told.

    Args:
        folder: the campaign's directory.

    Raises:
        OSError: the file cannot be opened for appending.
    """

    def __init__(self, folder: Path) -> None:
        self.path = CampaignFolder(folder).journal
        torn = self.path.is_file() and _last_byte(self.path) not in {b"", b"\n"}
        self._handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0o644)
        if torn:
            # A crash cut the last line off; the next one begins on its own.
            os.write(self._handle, b"\n")
        self._torn = False
        self.trouble: OSError | None = None
        """Why `note` could not write, the first time; None while it could."""
        self._reserve = CampaignFolder(folder).reserve
        with contextlib.suppress(OSError):
            self._reserve.write_bytes(bytes(RESERVE_BYTES))

    def write(self, event: str, **fields: object) -> None:
        """Append one event with its wall time (UTC), host time (monotonic ns) and fields that JSON can carry.

        Raises:
            OSError: the line could not be written.
        """
        stamp = {"utc": utc_now().isoformat(timespec="milliseconds"), "host_ns": monotonic_ns()}
        line = {**stamp, "event": event, **fields}
        data = json.dumps(line, default=str).encode() + b"\n"
        if self._torn:
            data = b"\n" + data
        begun, left = os.fstat(self._handle).st_size, data
        while left:
            # A disk that fills up takes a part first and refuses the rest.
            try:
                left = left[self._append(left) :]
            except OSError:
                self._torn = self._torn or not self._taken_back(begun, len(data) - len(left))
                raise
        self._torn = False
        if event in KEPT_AT_ONCE:
            self.flush()

    def note(self, event: str, **fields: object) -> None:
        """`write` while a rig is in motion: a disk that refuses the line becomes `trouble` and stops nothing here."""
        try:
            self.write(event, **fields)
        except OSError as error:
            self.trouble = self.trouble or error

    def _append(self, data: bytes) -> int:
        try:
            return os.write(self._handle, data)
        except OSError:
            if not self._reserve.exists():
                raise
            self._reserve.unlink()
            return os.write(self._handle, data)

    def _taken_back(self, begun: int, written: int) -> bool:
        """Cut off the part of a line that was refused: half a line reads as damage on resuming."""
        with contextlib.suppress(OSError):  # then the next line begins on its own
            if written and os.fstat(self._handle).st_size == begun + written:
                os.ftruncate(self._handle, begun)
                return True
        return not written

    def flush(self) -> None:
        """Make what was appended survive a power cut.

        Raises:
            OSError: the disk refused.
        """
        os.fdatasync(self._handle)

    def close(self) -> None:
        """Flush and close.

        Raises:
            OSError: the disk refused the last lines.
        """
        try:
            self._reserve.unlink(missing_ok=True)
            self.flush()
        finally:
            os.close(self._handle)


def read_log(folder: Path) -> list[dict[str, Any]]:
    """The events of a campaign's journal, oldest first; a line cut off by a crash is left out."""
    return [event for event in read_lines(folder) if event["event"] != UNREADABLE]


def read_lines(folder: Path) -> list[dict[str, Any]]:
    """The same with an event `UNREADABLE`, and the number of its `line`, for every line that is not one of ours."""
    return list(each_line(folder))


def each_line(folder: Path) -> Iterator[dict[str, Any]]:
    """The events of `read_lines` one at a time, so that memory does not grow with the journal.

    Raises:
        FileProblem: the journal cannot be read.
    """
    for number, line in enumerate(lines_of(CampaignFolder(folder).journal, LARGEST_BYTES), 1):
        text = line.decode("utf-8", "replace").removesuffix("\n")
        if not text:
            continue
        try:
            event = json.loads(text)
        except (ValueError, RecursionError):
            event = None
        ours = isinstance(event, dict) and isinstance(event.get("event"), str)
        yield _migrated(event) if ours else {"event": UNREADABLE, "line": number}


def _last_byte(file: Path) -> bytes:
    """The last byte of a regular file; none if it is empty."""
    with open_regular(file) as opened:
        if not os.fstat(opened.fileno()).st_size:
            return b""
        opened.seek(-1, os.SEEK_END)
        return opened.read(1)


def _migrated(event: dict[str, Any]) -> dict[str, Any]:
    """A line as this program writes it, whichever program wrote it.

    Programs before the codes wrote their lines about temperature and amplitude compensation without `code`: such an
    `info` line gets the code that its words stand for. This migration is the only place where words of a journal are
    read.
    """
    if event["event"] != "info" or "code" in event:
        return event
    text = str(event.get("text", ""))
    code = next((code for words, code in EARLIER_WORDS.items() if words in text), None)
    return event if code is None else {**event, "code": code}
