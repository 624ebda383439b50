"""The page as a process: `python -m rig.page SETTINGS`, a JSON object of `PageSettings`.

It says where it is in one line of JSON on standard output, then serves until it is told to end: by a signal, or, tied
to a campaign, by the end of its standard input.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path

from rig.errors import EXIT_DONE, EXIT_USAGE
from rig.page.access import Access, Role
from rig.page.server import PageServer
from rig.page.settings import PageProblem, PageSettings
from rig.page.watched_run import WatchedRun

LAST_WORDS_S = 1.0
"""After its campaign's end: the last state is still shown to viewers."""


def listening(settings: PageSettings) -> socket.socket:
    """A socket bound as asked for.

    Raises:
        PageProblem: it cannot be bound.
    """
    sock: socket.socket | None = None
    host = settings.host.strip("[]")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, settings.port, type=socket.SOCK_STREAM)[0]
        sock = socket.socket(family, kind, protocol)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
    except OSError as error:
        if sock is not None:
            sock.close()
        raise PageProblem(f"page address {settings.address!r}: the page cannot be served: {error}") from error
    return sock


async def serve_page(settings: PageSettings, announce: Callable[[str], object]) -> None:
    """Serve until SIGINT, SIGTERM, an operator's Close after the run, or, tied, the end of standard input.

    Args:
        settings: where, and of which run.
        announce: called with the operator's URL once it can be opened.

    Raises:
        PageProblem: it cannot be served as asked for.
    """
    tls = settings.context()
    sock = listening(settings)
    access = Access(settings.host, sock.getsockname()[1], tls is not None)
    run = WatchedRun(*(Path(text) if text else None for text in (settings.run, settings.live)))
    loop, ending = asyncio.get_running_loop(), asyncio.Event()
    page = PageServer(run, access, ending.set)
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ending.set)
    if settings.tied:
        os.set_blocking(sys.stdin.fileno(), False)
        loop.add_reader(sys.stdin.fileno(), _watch_input, ending)
    server = await page.serve(sock, tls)
    sending, waiting = asyncio.create_task(page.send()), asyncio.create_task(ending.wait())
    try:
        announce(access.url(Role.OPERATOR))
        done, _ = await asyncio.wait([waiting, sending], return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()  # a loop that failed ends the page with its traceback
        if settings.tied:
            page.send_changes()
            await asyncio.sleep(LAST_WORDS_S)
    finally:
        for task in (waiting, sending):
            task.cancel()
        server.close()
        await server.wait_closed()
        run.close()


def _watch_input(ending: asyncio.Event) -> None:
    with contextlib.suppress(BlockingIOError):
        if not os.read(sys.stdin.fileno(), 4096):
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
            ending.set()


def main(arguments: list[str]) -> int:
    """Run a page until it ends; returns the exit code."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m rig.page SETTINGS-AS-JSON\n")
        return EXIT_USAGE
    settings = PageSettings(**json.loads(arguments[0]))
    try:
        asyncio.run(serve_page(settings, lambda url: _say({"url": url})))
    except PageProblem as problem:
        _say({"refused": problem.slug, "message": str(problem)})
        return EXIT_USAGE
    return EXIT_DONE


def _say(answer: dict[str, str]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()
