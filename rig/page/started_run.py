"""A run that the page of a bench has started: a process of its own, exactly as if its command had been typed.

It gets a session of its own, no input, and files for its output, so that nothing of the page can reach it: when the
page ends, is killed or is started again, the run goes on. What was started is kept in the bench's state folder, so
that a page that is started later knows how it ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.prepared import Prepared, start_program
from drivers.processes import stat_fields
from rig.errors import FileProblem
from rig.station.live_folder import read_json, replace_json
from rig.text_file import read_bytes

STARTED, OUTPUT, MESSAGES = "started.json", "started.out", "started.err"
LARGEST_MESSAGES_BYTES = 64_000_000
LAST_MESSAGES = 1500


@dataclass
class StartedRun:
    """What was started last on a bench.

    Attributes:
        folder: the bench's state folder.
        arguments: of `rig run`.
        by: the operator's name.
        title: what was started, for people.
        utc: when.
        words: what the operator entered for the run's files; sent once the run can take them.
        pid, ticks: the process, and when it began (clock ticks since the computer's start), which no other one shares.
    """

    folder: Path
    arguments: tuple[str, ...]
    by: str
    title: str
    utc: str
    words: Mapping[str, str] = field(default_factory=dict)
    pid: int = 0
    ticks: int = 0
    _process: subprocess.Popen[bytes] | None = None

    @classmethod
    def start(
        cls, folder: Path, arguments: tuple[str, ...], *, by: str, title: str, utc: str, words: Mapping[str, str],
        prepared: Prepared | None = None,
    ) -> StartedRun:
        """Start `rig run` with these arguments, in the process that was loaded in advance, if there is one.

        If the process cannot be recorded for a later page, it is not started, because that page would offer another
            start.

        Raises:
            OSError: the process cannot be started or recorded.
        """
        run = cls(folder, arguments, by, title, utc, words)
        with contextlib.ExitStack() as files:
            output, messages = (files.enter_context(_new_file(folder / name)) for name in (OUTPUT, MESSAGES))
            run._write()
            nothing = files.enter_context(open(os.devnull, "rb"))
            streams = {0: nothing, 1: output, 2: messages}
            run._process = start_program("rig.cli.main", ("run", *arguments), streams, prepared=prepared)
        run.pid, run.ticks = run._process.pid, _began(run._process.pid)
        try:
            run._write()
        except OSError:
            run.interrupt()  # it is still loading, so nothing is connected
            raise
        return run

    @classmethod
    def last(cls, folder: Path) -> StartedRun | None:
        """What an earlier page of the bench has started; None where nothing is known."""
        kept = read_json(folder / STARTED)
        try:
            words = {str(key): str(value) for key, value in dict(kept.get("words", {})).items()}
            by, title, utc = (str(kept[name]) for name in ("by", "title", "utc"))
            arguments = tuple(map(str, kept["arguments"]))
            return cls(folder, arguments, by, title, utc, words, int(kept["pid"]), int(kept["ticks"]))
        except (KeyError, TypeError, ValueError):
            return None

    def keep(self) -> None:
        """Save changes for a later page; a write error has no other consequences."""
        with contextlib.suppress(OSError):
            self._write()

    def _write(self) -> None:
        """Write the state for a later page.

        Raises:
            OSError: the state cannot be written.
        """
        kept = {
            "arguments": self.arguments, "by": self.by, "title": self.title, "utc": self.utc,
            "words": dict(self.words), "pid": self.pid, "ticks": self.ticks,
        }
        replace_json(self.folder / STARTED, kept)

    @property
    def lives(self) -> bool:
        """Whether its process runs."""
        if self._process is not None:
            return self._process.poll() is None
        return self.pid > 0 and _began(self.pid) == self.ticks != 0

    def interrupt(self) -> bool:
        """Send it what Ctrl-C sends, which stops the rig if it is connected; False where it has ended."""
        if not self.lives:
            return False
        with contextlib.suppress(OSError):
            os.kill(self.pid, signal.SIGINT)
            return True
        return False

    def outcome(self) -> dict[str, Any]:
        """How it ended: `exit_code` (None where unknown), `campaign`, `report`, `refused` (a code), `text`."""
        code = None if self._process is None else self._process.returncode
        answer: Any = None
        with contextlib.suppress(FileProblem, ValueError, RecursionError):
            answer = json.loads(read_bytes(self.folder / OUTPUT, LARGEST_MESSAGES_BYTES))
        if not isinstance(answer, dict):
            lines = self._last_messages()
            text = f"`rig run` ended without a result{'' if code is None else f' (exit code {code})'}. {lines}".strip()
            return {"exit_code": code, "campaign": "", "report": "", "refused": "", "text": text, "broken": True}
        begun = "campaign" in answer
        slug = str(answer.get("slug") or (answer.get("stopped_by") if begun and answer.get("error") else "") or "")
        refused = slug if not begun or (answer.get("stop") is None and slug) else ""
        return {
            "exit_code": answer.get("exit_code", code), "campaign": Path(str(answer.get("campaign") or "")).name,
            "report": "" if not answer.get("report") else Path(str(answer["report"])).name,
            "refused": refused, "text": str(answer.get("error") or ""), "broken": False,
        }

    def _last_messages(self) -> str:
        with contextlib.suppress(FileProblem):
            return read_bytes(self.folder / MESSAGES, LARGEST_MESSAGES_BYTES).decode("utf-8", "replace")[
                -LAST_MESSAGES:].strip()
        return ""


def _new_file(path: Path) -> Any:  # noqa: ANN401 - a binary file
    """An empty file for this user alone, in place of any of that name.

    Raises:
        OSError: it cannot be made.
    """
    path.unlink(missing_ok=True)
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600), "wb")


def _began(pid: int) -> int:
    """When a process began, in clock ticks since the computer's start; 0 where there is none, or it has ended."""
    fields = stat_fields(pid)
    return 0 if fields is None or fields[0] in b"ZXx" else int(fields[19])  # starttime: field 22 of proc(5)
