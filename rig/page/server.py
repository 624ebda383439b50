"""The page's server: `/` for the page and `/ws` for its data; of a bench also `/run` and `/report/NAME`. Nothing else.

One loop sends every client a frame of samples 25 times a second, and at times what has changed of the run. A browser
that does not read gets nothing more until it does; one that talks too much is shown the door. None of this is waited
for by any other client, least of all by the rig.
"""

from __future__ import annotations

import asyncio
import json
import math
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Coroutine
from contextlib import suppress
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from rig.clock import monotonic_ns
from rig.page.access import Access, Denied, Role
from rig.page.commands import DESK, LONGEST_KEY, LONGEST_MESSAGE, Client, Commands, one_line, understood
from rig.page.desk import Asker, Desk
from rig.page.document import BENCH, RUN, document, headers, report_headers
from rig.page.ended_run import recorded_frame
from rig.page.lease import Lease
from rig.page.samples import Frames, packed
from rig.page.watched_run import WatchedRun
from rig.recording.journal.ring_reader import RingReader
from rig.station.live_folder import PLAN, RESULTS, STATE

FRAME_S = 0.040
NEWS_S = 0.200
SHORTEST_REST_S = 0.005
MOST_UNREAD = 1 << 15
"""Records of the ring that a page that stood still makes up for; more are left out: what is shown is now."""
MOST_CLIENTS = 40
FOR_OPERATORS = 8
"""Of these; so many viewers as there may be, an operator finds a place."""
MOST_CONNECTIONS = 120
"""Those that have not said yet who they are among them; one more is hung up on."""
MOST_MESSAGES = 60
"""Of one connection in a second; more end it."""
MOST_REQUESTED = 16
"""Recorded points that one browser may wait for."""
MOST_RECORDED = 24
"""Recorded points that are kept for the next browser; each has at most 350 kB."""
MOST_UNSENT = 1 << 16
"""Bytes that may wait for a browser before frames are left out."""
SENT_AHEAD = 1 << 16
"""Bytes that the kernel may keep for a browser that reads slowly: what waits there grows old."""
TOO_MUCH = 1008
REPORTS = "/report/"
_OPEN: dict[ServerConnection, bool] = {}
"""Connections of this process, oldest first, and whether each has shown a valid token."""


class Caller(ServerConnection):
    """A connection; where there are too many, the oldest one without a valid token is closed, else the new one."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count it, and keep little for it."""
        super().connection_made(transport)
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENT_AHEAD)
        _OPEN[self] = False
        if len(_OPEN) > MOST_CONNECTIONS:
            surplus = next(connection for connection, admitted in _OPEN.items() if not admitted)
            del _OPEN[surplus]
            surplus.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        _OPEN.pop(self, None)
        super().connection_lost(exc)


class PageServer:
    """The page of one run, or of a bench and whatever runs on it.

    Args:
        run: the run that is shown; a desk shows its own.
        access: who may open it.
        end: ends the page of a run.
        now_ns: monotonic time.
        desk: of a bench.
    """

    def __init__(
        self, run: WatchedRun | Desk, access: Access, end: Callable[[], None], now_ns: Callable[[], int] = monotonic_ns
    ) -> None:
        self._desk = run if isinstance(run, Desk) else None
        self._shown = run
        self._access = access
        self._now_ns = now_ns
        self._lease = Lease(lambda: self._run.live_folder, now_ns, lasting=self._desk is not None)
        self._commands = Commands(
            self._lease, lambda: self._run.live_folder, None if self._desk is not None else end,
            cancel=None if self._desk is None else self._desk.cancel,
        )  # fmt: skip
        self._tasks: set[asyncio.Task[None]] = set()
        self._looking = asyncio.Lock()
        self._sent_status: dict[str, Any] = {}
        self._clients: dict[ServerConnection, Client] = {}
        self._frames: tuple[RingReader, Frames] | None = None
        self._sent_lease: object = None
        self._sent_run: dict[str, Any] = {}
        self._reading = asyncio.Lock()
        self._recorded: dict[tuple[str, int], bytes | None] = {}
        self._sending_recorded: dict[ServerConnection, set[asyncio.Task[None]]] = {}

    @property
    def _run(self) -> WatchedRun:
        """The run that is shown now."""
        return self._shown.watched if isinstance(self._shown, Desk) else self._shown

    async def serve(self, sock: Any, tls: ssl.SSLContext | None) -> Server:  # noqa: ANN401 - a bound socket
        """Begin to answer on a bound socket."""
        return await serve(
            self._speak, sock=sock, ssl=tls, process_request=self._answer, max_size=LONGEST_MESSAGE, max_queue=8,
            compression=None, open_timeout=5, ping_interval=10, ping_timeout=20, close_timeout=1, server_header=None,
            create_connection=Caller,
        )  # fmt: skip

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A page or a refusal; None: a WebSocket that may begin."""
        if getattr(request, "method", "GET") != "GET":  # websockets before 16 lets nothing else come this far
            return _response(405, "refused: only GET\n")
        access = self._access.check(request.path, request.headers.get_all("Host"), request.headers.get_all("Origin"))
        if isinstance(access, Denied):
            return _response(access.status, f"refused: {access.slug}\n")
        if connection in _OPEN:
            _OPEN[connection] = True
        place = urlsplit(request.path).path
        views = {"/": RUN} if self._desk is None else {"/": BENCH, "/run": RUN}
        if place in views:
            view = views[place]
            return Response(200, "OK", _headers(headers(view), document(view)), document(view))
        if self._desk is not None and place.startswith(REPORTS):
            return await self._report(self._desk, unquote(place.removeprefix(REPORTS)))
        if place != "/ws":
            return _response(404, "not found\n")
        most = MOST_CLIENTS if access is Role.OPERATOR else MOST_CLIENTS - FOR_OPERATORS
        return _response(503, "refused: too-many-clients\n") if len(self._clients) >= most else None

    @staticmethod
    async def _report(desk: Desk, name: str) -> Response:
        """The report of a run."""
        try:
            report = await asyncio.to_thread(desk.history.report, name)
        except OSError:
            report = None
        if report is None:
            return _response(404, "this run has no report\n")
        return Response(200, "OK", _headers(report_headers(), report), report)

    async def _speak(self, connection: ServerConnection) -> None:
        """One browser, from its first to its last message."""
        client = self._client(connection)
        if client is None:
            return
        self._clients[connection] = client
        self._lease.back(client.key)
        try:
            for message in (*self._whole(client), self._standing(client)):
                await connection.send(written(message))
            await self._listen(connection)
        except ConnectionClosed:
            pass  # however it went, it is gone
        finally:
            del self._clients[connection]
            for task in self._sending_recorded.pop(connection, set()):
                task.cancel()
            if all(other.key != client.key for other in self._clients.values()):
                self._lease.left(client.key)

    def _client(self, connection: ServerConnection) -> Client | None:
        """Who has opened this connection; its handshake was judged before."""
        request = connection.request
        if request is None:
            return None
        access = self._access.check(request.path, request.headers.get_all("Host"), request.headers.get_all("Origin"))
        if not isinstance(access, Role):
            return None
        query = parse_qs(urlsplit(request.path).query)
        key = one_line(query.get("client", [""])[0], LONGEST_KEY) or str(connection.id)
        return Client(access, key, self._desk is not None and query.get("view") == [BENCH])

    async def _listen(self, connection: ServerConnection) -> None:
        counted: Counter[int] = Counter()
        async for text in connection:
            second = self._now_ns() // 1_000_000_000
            counted = Counter({second: counted[second] + 1})
            if counted[second] > MOST_MESSAGES:
                await connection.close(TOO_MUCH, "too many messages")
                return
            client = self._clients[connection]
            if self._desk is not None and self._asks_desk(self._desk, text, connection, client):
                continue
            answer = self._commands.take(text, client)
            if answer.get("do") == "recorded" and "refused" not in answer:
                answer = self._begin_recorded(connection, str(answer["point"]))
                if not answer:
                    continue
            with suppress(ConnectionClosed):  # it has left: a stop that it sent before is taken all the same
                await connection.send(written({"type": "answer", **answer}))
            if answer.get("do") in {"lease", "release"}:
                self._send_lease()

    def _begin_recorded(self, connection: ServerConnection, point: str) -> dict[str, Any]:
        """Read a recorded point for a browser, whose other messages, such as a stop, do not wait for it."""
        tasks = self._sending_recorded.setdefault(connection, set())
        if len(tasks) >= MOST_REQUESTED:
            return {"do": "recorded", "point": point, "refused": "too-many-points"}
        task = asyncio.create_task(self._send_recorded(connection, point))
        tasks.add(task)
        task.add_done_callback(tasks.discard)
        return {}

    def _asks_desk(self, desk: Desk, text: str | bytes, connection: ServerConnection, client: Client) -> bool:
        """Whether a message is for the desk of the bench; it answers later, and a stop does not wait for that."""
        message = understood(text)
        if message is None or message["do"] not in DESK:
            return False

        async def answer() -> None:
            do = message["do"]
            refused = self._commands.refused_at_desk(do, client)
            asker = Asker(self._commands.called(client), lambda: self._lease.held_by(client.key))
            reply = refused or await desk.answer(message, asker)
            self._send_status(desk)  # before the answer: what follows a start is seen by the browser in order
            with suppress(ConnectionClosed):
                await connection.send(written({"type": "answer", **reply}))
            if do == "make-report" and "ok" in reply:
                await self.refresh()

        self._later(answer())
        return True

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def refresh(self) -> None:
        """Read the history of the bench again, and show it."""
        if self._desk is None:
            return
        async with self._looking:
            over = self._desk.idle
            await asyncio.to_thread(self._desk.history.look)
        self._desk.show_newest()
        broadcast(self._on_bench(), written(self._history(self._desk)))
        if over and self._desk.idle:
            self._desk.settle()
            self._send_status(self._desk)
        self._send_lease()

    @staticmethod
    def _history(desk: Desk) -> dict[str, Any]:
        return {"type": "history", "runs": desk.history.runs}

    def _on_bench(self) -> list[ServerConnection]:
        """Connections that show the bench."""
        return [connection for connection, client in self._clients.items() if client.bench]

    def _on_run(self) -> list[ServerConnection]:
        """Connections that show the run."""
        return [connection for connection, client in self._clients.items() if not client.bench]

    def _send_status(self, desk: Desk) -> None:
        """What the bench's page shows, where it has changed."""
        status = desk.status()
        if status != self._sent_status:
            self._sent_status = status
            broadcast(self._on_bench(), written(status))

    async def _send_recorded(self, connection: ServerConnection, point: str) -> None:
        """The frame of a recorded point, with the point's id at its end; or a refusal."""
        frame = await self._recorded_frame(point)
        answer = {"refused": "not-recorded"} if frame is None else {"ok": True}
        with suppress(ConnectionClosed):
            await connection.send(written({"type": "answer", "do": "recorded", "point": point, **answer}))
            if frame is not None:
                await connection.send(frame + point.encode())

    async def _recorded_frame(self, point: str) -> bytes | None:
        path = self._run.recorded_file(point)
        if path is None:
            return None
        try:
            version = str(path), path.stat().st_mtime_ns
        except OSError:
            return None
        async with self._reading:  # one file at a time, however many browsers request one
            if version not in self._recorded:
                while len(self._recorded) >= MOST_RECORDED:
                    del self._recorded[next(iter(self._recorded))]
                self._recorded[version] = await asyncio.to_thread(recorded_frame, path)
            return self._recorded[version]

    def _whole(self, client: Client) -> tuple[dict[str, Any], ...]:
        """All that there is to tell a browser, of the run or of the bench."""
        if self._desk is not None and client.bench:
            return self._run.state(), self._desk.status(), self._history(self._desk)
        events = {"type": "events", "events": list(self._run.events), "all": True}
        return self._run.description(), self._run.results(), self._run.state(), events

    def _standing(self, client: Client) -> dict[str, Any]:
        """What this browser may do."""
        holder = self._lease.holder
        mine = self._lease.held_by(client.key)
        return {
            "type": "standing", "role": str(client.role), "mine": mine, "holder": "" if holder is None else holder.name,
            "viewer_url": self._access.url(Role.VIEWER) if client.role is Role.OPERATOR else "",
            **({} if self._desk is None else self._links(self._desk)),
        }  # fmt: skip

    def _links(self, desk: Desk) -> dict[str, Any]:
        """Of the page of a bench: that it is one, the run's report, and the token for addresses of reports.

        Such an address is copied and sent around: it carries no more than a viewer's right.
        """
        run = self._run.run
        entry = None if run is None else desk.history.entry(run.name)
        report = run.name if run is not None and entry is not None and entry["report"] else ""
        token = self._access.tokens[Role.VIEWER]
        bench = desk.bench
        return {"bench": bench.name, "simulate": bench.simulate, "report": report, "report_token": token}

    def _send_lease(self) -> None:
        self._sent_lease = self._lease.holder
        for connection, client in self._clients.items():
            broadcast([connection], written(self._standing(client)))

    async def send(self) -> None:
        """Samples, and what has changed of the run, until cancelled; without a client no sample is read.

        One loop for both: to wake up costs more than what is done then.
        """
        loop = asyncio.get_running_loop()
        due_s = news_due_s = loop.time()
        while True:
            watched = bool(self._on_run())
            if watched:
                self.send_frame()
            else:
                self._frames = None  # who comes next sees what is new then
            if due_s >= news_due_s:
                self.send_changes()
                news_due_s = due_s + NEWS_S - 0.5 * FRAME_S
            due_s += FRAME_S if watched else NEWS_S
            late_s = loop.time() - due_s
            if late_s > 0.0:  # what was missed is not made up for
                due_s += late_s + SHORTEST_REST_S
            await asyncio.sleep(due_s - loop.time())

    def send_frame(self) -> None:
        """One frame of what is new in the ring; without a ring an empty one, for its time."""
        ring = self._run.ring()
        if ring is None:
            frame = packed({}, self._now_ns() * 1e-9)
        else:
            if self._frames is None or self._frames[0] is not ring or ring.unread > MOST_UNREAD:
                ring.skip_to_newest()
                self._frames = ring, Frames(*self._run.frames_of())
            frame = self._frames[1].frame(ring.read(), self._now_ns() * 1e-9)
        broadcast([one for one in self._on_run() if one.transport.get_write_buffer_size() < MOST_UNSENT], frame)

    def send_changes(self) -> None:
        """Plan, verdicts, state, events and lease, each where it has changed."""
        messages: list[dict[str, Any]] = []
        if self._desk is not None:
            self._look_after(self._desk)
        anew = self._run.began_or_ended()
        planned = self._run.changed(PLAN)
        if anew or planned or (self._run.live_folder is not None and not self._sent_run.get("devices")):
            description = self._run.description()
            if description != self._sent_run:
                self._sent_run = description
                messages.append(description)
        if self._run.changed(RESULTS) or anew:
            messages.append(self._run.results())
        if self._run.changed(STATE) or anew:
            state = self._run.state()
            messages.append(state)
            broadcast(self._on_bench(), written(state))
        events = self._run.news()
        if events or anew:
            shown = list(self._run.events) if anew else events
            messages.append({"type": "events", "events": shown, "all": anew})
        for message in messages:
            broadcast(self._on_run(), written(message))
        if self._lease.holder != self._sent_lease:
            self._send_lease()


    def _look_after(self, desk: Desk) -> None:
        """What runs on the bench now; what has ended goes into its history."""
        if desk.look():
            self._later(self.refresh())
        if self._on_bench():
            self._send_status(desk)


def written(message: dict[str, Any]) -> str:
    """A message as JSON that every browser reads: a number that is none, or has no end, becomes null."""
    try:
        return json.dumps(message, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(message), allow_nan=False)


def _finite(value: Any) -> Any:  # noqa: ANN401 - what JSON carries
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, (list, tuple)) else value


def _response(status: int, text: str) -> Response:
    body = text.encode()
    plain = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return Response(status, HTTPStatus(status).phrase, _headers(plain, body), body)


def _headers(named: dict[str, str], body: bytes) -> Headers:
    return Headers({**named, "Content-Length": str(len(body)), "Connection": "close"})
