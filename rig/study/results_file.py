"""The study's results: an append-only file of JSON lines, keyed, safe against an interrupted write."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rig.errors import FileProblem

FORMAT = 1


class ResultsFile:
    """Results of a study by key; opened, it first reads what earlier sessions left.

    The first line names the format and the fingerprint of study and recordings. A last line without its end, left by
    a session that was killed, is cut off.

    Attributes:
        lines: Results by key.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = path
        self.lines: dict[str, dict[str, Any]] = {}
        header = {"format": FORMAT, "fingerprint": fingerprint}
        if path.exists():
            self._read(header)
        self._file = path.open("a", encoding="utf-8")
        if self._file.tell() == 0:
            self._write(header)

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
        self.lines[str(line["key"])] = line

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, header: dict[str, Any]) -> None:
        text = self.path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
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
                self._check(entry, header)
            else:
                self.lines[entry["key"]] = entry

    def _check(self, found: dict[str, Any], expected: dict[str, Any]) -> None:
        if found != expected:
            raise FileProblem(
                str(self.path),
                [
                    f"line 1: fingerprint {found.get('fingerprint')!r}, this study's is {expected['fingerprint']!r}: "
                    "the results belong to other recordings or settings; give another --out"
                ],
            )
