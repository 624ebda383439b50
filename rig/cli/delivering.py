"""Delivery of results in a separate process, which neither delays nor fails what the application does."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import click

from drivers.processes import own_program
from rig.bench.server_address import ADDRESS_VARIABLE, checked_address, server_name
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem

if TYPE_CHECKING:
    from rig.bench.model import Bench

Command = TypeVar("Command", bound=Callable[..., Any])
WAIT_S = 3.0
"""The application waits so long for the state of the delivery, which goes on without it."""


class ServerAddress(click.ParamType[str]):
    """The address of a results server."""

    name = "url"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The address unchanged; what is not an address is a usage error, which does not show the password."""
        try:
            return checked_address(value)
        except ValueError as problem:
            self.fail(str(problem), param, ctx)


def results_option(when: str) -> Callable[[Command], Command]:
    """The option of a command that delivers its results; `when` says after what."""
    return click.option(
        "--results", "results_url", type=ServerAddress(), metavar="URL", envvar=ADDRESS_VARIABLE, show_envvar=True,
        help=f"Deliver the results to this PostgreSQL server (postgresql://USER@HOST/DATABASE) {when}. Default: "
             "`url` in [results] of the bench file.",
    )


def address_for(given: str | None, bench: Bench | None) -> str | None:
    """The address that was given, else that in the bench file; None if there is none."""
    return bench.results.url if given is None and bench is not None and bench.results is not None else given


class Delivery:
    """The application's end of `rig.results.delivery_process`.

    It is started early, so that its imports happen during the motion.
    """

    def __init__(self, url: str) -> None:
        self._server, self._delivers = server_name(url), False
        self._process = subprocess.Popen(
            own_program("rig.results.delivery_process"), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, start_new_session=True, env={**os.environ, ADDRESS_VARIABLE: url},
        )  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        """End a process that was given nothing to deliver; another one finishes its delivery."""
        if not self._delivers:
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        if self._process.poll() is None:
            threading.Thread(target=self._process.wait, daemon=True).start()  # no zombie in a program that goes on

    def deliver(self, folder: Path, wait_s: float = WAIT_S) -> dict[str, Any]:
        """Deliver every campaign of a folder of runs that the server does not have.

        Args:
            folder: folder of runs.
            wait_s: the longest time to wait for the state.

        Returns:
            The keys of `delivery` in `rig run --json`: `server`, `delivered`, `waiting` (null while the delivery is
            still running), `last_attempt`, `error`, `line` (the state in one line).
        """
        running = {
            "server": self._server, "delivered": None, "waiting": None, "last_attempt": None, "error": None,
            "line": f"results are being delivered to {self._server}; `rig results` shows the state",
        }  # fmt: skip
        self._delivers = True
        answer = self._answer(folder, wait_s)
        if answer is None:
            return running
        if "line" not in answer:
            answer["line"] = f"results not delivered to {self._server}: {answer['error']}"
        return {**running, **answer}

    def _answer(self, folder: Path, wait_s: float) -> dict[str, Any] | None:
        """What the process answers; None if it has not answered yet."""
        requests, output = self._process.stdin, self._process.stdout
        if requests is None or output is None:
            return None
        text, until_s = b"", time.monotonic() + wait_s
        try:
            requests.write(json.dumps({"folder": str(folder.resolve())}).encode() + b"\n")
            requests.close()
            while not text.endswith(b"\n"):
                if not select.select([output], [], [], max(0.0, until_s - time.monotonic()))[0]:
                    return None
                part = os.read(output.fileno(), 65536)
                if not part:
                    break
                text += part
            answer: dict[str, Any] = json.loads(text)
        except (OSError, ValueError):
            return {"error": "the delivery process ended unexpectedly. Fix: run rig results --deliver"}
        return answer


def address_of_run(run: Path) -> str | None:
    """Address of the server in the bench file of a run; None if there is none, or the file cannot be read.

    Raises:
        FileProblem: the entry is not an address.
    """
    from rig.files.toml_source import read_toml  # loads the TOML reader: not needed for the help

    file = CampaignFolder(run).bench
    try:
        table = read_toml(file).data.get("results") if file.is_file() else None
    except FileProblem:
        return None
    address = table.get("url") if isinstance(table, Mapping) else None
    try:
        return None if address is None else checked_address(str(address))
    except ValueError as error:
        raise FileProblem(str(file), [f"results.url = {error}"]) from error


def delivery_to(url: str | None) -> contextlib.AbstractContextManager[Delivery | None]:
    """A delivery to a server; without an address, none."""
    return contextlib.nullcontext(None) if url is None else Delivery(url)
