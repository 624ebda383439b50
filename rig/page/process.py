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
import ssl
import sys
from collections.abc import Callable
from pathlib import Path

from rig.errors import EXIT_DONE, EXIT_USAGE
from rig.page.access import Access, Role
from rig.page.bench_control import Bench, BenchControl
from rig.page.permanent_address import PermanentAddress
from rig.page.server import PageServer
from rig.page.settings import PageProblem, PageSettings
from rig.page.watched_run import WatchedRun

OTHER_PORTS = 50
"""Tried in turn where a bench has no port yet."""
SWITCH_S = 0.0005
"""Time for which a thread that reads files may block the event loop (s)."""
LAST_WORDS_S = 1.0
"""After its campaign's end: the last state is still shown to viewers."""


def listening(settings: PageSettings, port: int | None = None) -> socket.socket:
    """A socket bound as asked for, or to another port there.

    Raises:
        PageProblem: it cannot be bound.
    """
    sock: socket.socket | None = None
    host = settings.host.strip("[]")
    try:
        wanted = settings.port if port is None else port
        family, kind, protocol, _, address = socket.getaddrinfo(host, wanted, type=socket.SOCK_STREAM)[0]
        sock = socket.socket(family, kind, protocol)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
    except OSError as error:
        if sock is not None:
            sock.close()
        raise PageProblem(f"page address {settings.address!r}: the page cannot be served: {error}") from error
    return sock


async def serve_bench(
    settings: PageSettings, bench: Bench, address: PermanentAddress, announce: Callable[[str], object]
) -> None:
    """Serve the page of a bench at its permanent address until SIGINT or SIGTERM; runs on the bench go on.

    Args:
        settings: where; without a port at the one that it had before.
        bench: the bench.
        address: its port and tokens; what is used is kept there.
        announce: called with the operator's URL once it can be opened.

    Raises:
        PageProblem: it cannot be served as asked for.
    """
    tls = settings.context()
    sock = permanent_socket(settings, address)
    access = Access(settings.host, sock.getsockname()[1], tls is not None, address.tokens)
    try:
        address.keep(access.port, access.url(Role.OPERATOR))
    except PageProblem:
        sock.close()
        raise
    await _serve(BenchControl(bench), access, sock, tls, announce)


def permanent_socket(settings: PageSettings, address: PermanentAddress) -> socket.socket:
    """A socket at the port that was asked for, else at the one that browsers know, else at the first free one.

    Raises:
        PageProblem: it cannot be bound.
    """
    if settings.port:
        return listening(settings)
    most = 1 if address.known else OTHER_PORTS
    for port in range(address.port, address.port + most):
        try:
            return listening(settings, port)
        except PageProblem as problem:
            last = problem
    raise PageProblem(f"{last}. Fix: stop the program that uses port {address.port}, or choose another port for this "
        f"start with --page-address {settings.host}:PORT")


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
    await _serve(run, access, sock, tls, announce, tied=settings.tied)


async def _serve(
    shown: WatchedRun | BenchControl, access: Access, sock: socket.socket, tls: ssl.SSLContext | None,
    announce: Callable[[str], object], *, tied: bool = False,
) -> None:
    sys.setswitchinterval(SWITCH_S)
    loop, ending = asyncio.get_running_loop(), asyncio.Event()
    page = PageServer(shown, access, ending.set)
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ending.set)
    if tied:
        os.set_blocking(sys.stdin.fileno(), False)
        loop.add_reader(sys.stdin.fileno(), _watch_input, ending)
    await page.refresh()
    server = await page.serve(sock, tls)
    sending, waiting = asyncio.create_task(page.send()), asyncio.create_task(ending.wait())
    try:
        announce(access.url(Role.OPERATOR))
        done, _ = await asyncio.wait([waiting, sending], return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()  # a loop that failed ends the page with its traceback
        if tied:
            page.send_changes()
            await asyncio.sleep(LAST_WORDS_S)
    finally:
        for task in (waiting, sending):
            task.cancel()
        server.close()
        await server.wait_closed()
        (shown.watched if isinstance(shown, BenchControl) else shown).close()


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
