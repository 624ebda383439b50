"""The study's results: an append-only file of JSON lines, keyed, safe against an interrupted write.

One line is one search. A line's `marks` are results of their own: the values of the same search at smaller budgets.
"""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rig.errors import FileProblem
from rig.study.result_line import shorter_lines

FORMAT = 2


class ResultsFile:
    """Results of a study by key; opened, it first reads what earlier sessions left.

    The first line names the format and the fingerprint of study and recordings. A last line without its end, left by
    a session that was killed, is cut off. One process at a time holds the file.

    Attributes:
        fingerprint: Of the study and its recordings.
        lines: Results by key.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = path
        self.fingerprint = fingerprint
        self.lines: dict[str, dict[str, Any]] = {}
        self._file = path.open("a", encoding="utf-8")
        try:
            self._hold()
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __contains__(self, key: object) -> bool:
        return key in self.lines

    def add(self, line: dict[str, Any]) -> None:
        """Append one result and make it durable.

        Args:
            line: Has `key`.
        """
        self._write(line)
        self._take(line)

    def _take(self, line: dict[str, Any]) -> None:
        self.lines[str(line["key"])] = line
        for shorter in shorter_lines(line):
            self.lines[shorter["key"]] = shorter

    def _hold(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise FileProblem(
                str(self.path), ["another `rig study` is working on it: wait for it, or give another --out"]
            ) from error

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self) -> None:
        text = self.path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if not whole:
            os.truncate(self.path, 0)
            self._write({"format": FORMAT, "fingerprint": self.fingerprint})
            return
        if len(whole) < len(text):
            os.truncate(self.path, len(whole.encode()))
        for number, line in enumerate(whole.splitlines()):
            try:
                entry = json.loads(line)
            except json.JSONDecodeError as error:
                raise FileProblem(
                    str(self.path), [f"line {number + 1}: not JSON ({error.msg}): delete that line"]
                ) from error
            if number == 0:
                self._check(entry)
            else:
                self._take(entry)

    def _check(self, found: dict[str, Any]) -> None:
        if found.get("format") != FORMAT:
            raise FileProblem(
                str(self.path),
                [f"line 1: format {found.get('format')!r}, this version writes {FORMAT}: give another --out"],
            )
        if found.get("fingerprint") != self.fingerprint:
            raise FileProblem(
                str(self.path),
                [
                    f"line 1: fingerprint {found.get('fingerprint')!r}, this study's is {self.fingerprint!r}: "
                    "the results belong to other recordings or settings; give another --out"
                ],
            )
