"""The page as a child of a campaign: started, asked where it is, and left to end by itself.

Nothing is ever written to it, so that it can stand still or die unnoticed; the end of its standard input ends it.
"""

from __future__ import annotations

import contextlib
import json
import select
import subprocess
from dataclasses import replace
from typing import Self

from drivers.processes import own_program
from rig.page.settings import PageProblem, PageSettings

START_S = 30.0
END_S = 4.0


class PageProcess:
    """A running page.

    Attributes:
        url: where an operator opens it.
    """

    def __init__(self, process: subprocess.Popen[bytes], url: str) -> None:
        self._process = process
        self.url = url

    @classmethod
    def start(cls, settings: PageSettings) -> Self:
        """Start it, and wait until it can be opened.

        Raises:
            PageProblem: it cannot be served as asked for, or did not start.
        """
        settings_json = json.dumps(replace(settings, tied=True).to_json())
        process = subprocess.Popen(
            own_program("rig.page", settings_json), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        answer = cls._answer(process)
        if "url" not in answer:
            process.kill()
            process.communicate()
            raise PageProblem(answer.get("message", "the page server did not start"))
        return cls(process, answer["url"])

    @staticmethod
    def _answer(process: subprocess.Popen[bytes]) -> dict[str, str]:
        if process.stdout is None or not select.select([process.stdout], [], [], START_S)[0]:
            return {}
        try:
            answer = json.loads(process.stdout.readline())
        except ValueError:
            return {}
        return answer if isinstance(answer, dict) else {}

    @property
    def pid(self) -> int:
        """Its process."""
        return self._process.pid

    def wait(self) -> None:
        """Until it has ended by itself: closed by an operator there, or killed."""
        self._process.wait()

    def close(self) -> None:
        """End it; one that does not is killed: it holds nothing."""
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
