"""The page's server: `/` for the page, `/ws` for its data; of a bench also `/run`, `/report/NAME`, `/pdf/NAME`.

One loop sends every client a frame of samples 25 times a second, and at times what has changed of the run. A browser
that does not read gets nothing more until it does; one that talks too much is shown the door. None of this is waited
for by any other client, least of all by the rig.
"""

from __future__ import annotations

import asyncio
import gc
import json
import math
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import State

from rig.clock import monotonic_ns
from rig.explanations.explanation import explained
from rig.page.access import Access, Denied, Role
from rig.page.bench_control import BenchControl, Requester
from rig.page.commands import CONTROL_REQUESTS, LONGEST_KEY, LONGEST_MESSAGE, Client, Commands, one_line, understood
from rig.page.document import BENCH, RUN, document, headers, pdf_headers, report_headers
from rig.page.ended_run import recorded_frame
from rig.page.lease import Lease
from rig.page.samples import Frames, packed
from rig.page.watched_run import WatchedRun
from rig.recording.journal.ring_reader import RingReader

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
PIECE = 400
"""Number of points of a run in one message; a Stop waits only milliseconds while it is written."""
TOO_MUCH = 1008
REPORTS, PDFS = "/report/", "/pdf/"
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
        run: the run that is shown; a control shows its own.
        access: who may open it.
        end: ends the page of a run.
        now_ns: monotonic time.
        control: of a bench.
    """

    def __init__(
        self, run: WatchedRun | BenchControl, access: Access, end: Callable[[], None],
        now_ns: Callable[[], int] = monotonic_ns
    ) -> None:
        self._control = run if isinstance(run, BenchControl) else None
        self._shown = run
        self._access = access
        self._now_ns = now_ns
        self._lease = Lease(lambda: self._run.live_folder, now_ns, permanent=self._control is not None)
        self._commands = Commands(
            self._lease, lambda: self._run.live_folder, None if self._control is not None else end,
            cancel=None if self._control is None else self._control.cancel,
        )  # fmt: skip
        self._tasks: set[asyncio.Task[None]] = set()
        self._failed: asyncio.Future[None] | None = None
        self._timer: asyncio.Handle
        self._looking = asyncio.Lock()
        self._sent_status: dict[str, Any] = {}
        self._clients: dict[ServerConnection, Client] = {}
        self._informed: dict[ServerConnection, Client] = {}
        self._finished: dict[ServerConnection, WatchedRun] = {}
        self._frames: tuple[RingReader, Frames] | None = None
        self._sent_lease: object = None
        self._known: WatchedRun | None = None
        self._sent_run: list[str] = []
        self._sent_results: dict[str, str] = {}
        self._reading_run = asyncio.Lock()
        self._reading = asyncio.Lock()
        self._recorded: dict[tuple[str, int], bytes | None] = {}
        self._sending_recorded: dict[ServerConnection, set[asyncio.Task[None]]] = {}

    @property
    def _run(self) -> WatchedRun:
        """The run that is shown now."""
        return self._shown.watched if isinstance(self._shown, BenchControl) else self._shown

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
            return _response(access.status, _denial(access.slug))
        if connection in _OPEN:
            _OPEN[connection] = True
        place = urlsplit(request.path).path
        views = {"/": RUN} if self._control is None else {"/": BENCH, "/run": RUN}
        if place in views:
            view = views[place]
            return Response(200, "OK", _headers(headers(view), document(view)), document(view))
        if self._control is not None and place.startswith(REPORTS):
            return await self._report(self._control, unquote(place.removeprefix(REPORTS)), pdf=False)
        if self._control is not None and place.startswith(PDFS):
            return await self._report(self._control, unquote(place.removeprefix(PDFS)), pdf=True)
        if place != "/ws":
            return _response(404, "not found\n")
        most = MOST_CLIENTS if access is Role.OPERATOR else MOST_CLIENTS - FOR_OPERATORS
        return _response(503, "refused: too-many-clients\n") if len(self._clients) >= most else None

    @staticmethod
    async def _report(control: BenchControl, name: str, *, pdf: bool) -> Response:
        """The report of a run."""
        try:
            report = await asyncio.to_thread(control.history.report, name, pdf=pdf)
        except OSError:
            report = None
        if report is None:
            return _response(404, "this run has no report\n")
        about = pdf_headers(name) if pdf else report_headers()
        return Response(200, "OK", _headers(about, report), report)

    async def _speak(self, connection: ServerConnection) -> None:
        """One browser, from its first to its last message."""
        client = self._client(connection)
        if client is None:
            return
        self._clients[connection] = client
        self._lease.back(client.key)
        try:
            self._later(self._inform(connection, client))
            await self._listen(connection)
        except ConnectionClosed:
            pass  # however it went, it is gone
        finally:
            del self._clients[connection]
            self._informed.pop(connection, None)
            self._finished.pop(connection, None)
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
        bench = self._control is not None and query.get("view") == [BENCH]
        return Client(access, key, bench, "" if bench else query.get("run", [""])[0])

    async def _listen(self, connection: ServerConnection) -> None:
        counted: Counter[int] = Counter()
        async for text in connection:
            second = self._now_ns() // 1_000_000_000
            counted = Counter({second: counted[second] + 1})
            if counted[second] > MOST_MESSAGES:
                await connection.close(TOO_MUCH, "too many messages")
                return
            client = self._clients[connection]
            if self._control is not None and self._asks_control(self._control, text, connection, client):
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

    def _asks_control(
        self, control: BenchControl, text: str | bytes, connection: ServerConnection, client: Client
    ) -> bool:
        """Whether a message is a request to the bench, which is answered later; a stop does not wait for this."""
        message = understood(text)
        if message is None or message["do"] not in CONTROL_REQUESTS:
            return False

        async def answer() -> None:
            do = message["do"]
            refused = self._commands.refused_at_bench(do, client)
            requester = Requester(self._commands.called(client), lambda: self._lease.held_by(client.key))
            reply = refused or await control.answer(message, requester)
            self._send_status(control)  # before the answer: what follows a start is seen by the browser in order
            with suppress(ConnectionClosed):
                await connection.send(written({"type": "answer", **reply}))
            if do == "make-report" and "ok" in reply:
                await self.refresh()

        self._later(answer())
        return True

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a background task; an unexpected exception stops the page with a traceback."""

        def done(task: asyncio.Task[None]) -> None:
            self._tasks.discard(task)
            error = None if task.cancelled() else task.exception()
            if error is not None and self._failed is not None and not self._failed.done():
                self._failed.set_exception(error)

        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(done)

    async def refresh(self) -> None:
        """Read the history of the bench again, and show it."""
        if self._control is None:
            return
        async with self._looking:
            over = self._control.idle
            await asyncio.to_thread(self._control.history.look)
        self._control.show_newest()
        broadcast(self._on_bench(), written(self._history(self._control)))
        if over and self._control.idle:
            self._control.settle()
            self._send_status(self._control)
        self._send_lease()

    async def _look_again(self, control: BenchControl) -> None:
        """Show what other programs have changed in the folder of runs."""
        before = self._history(control)
        async with self._looking:
            await asyncio.to_thread(control.history.look)
        if (after := self._history(control)) != before:
            broadcast(self._on_bench(), written(after))

    @staticmethod
    def _history(control: BenchControl) -> dict[str, Any]:
        return {"type": "history", "runs": control.history.runs, "today": control.history.today}

    def _on_bench(self) -> list[ServerConnection]:
        """Connections that show the bench."""
        return [connection for connection, client in self._informed.items() if client.bench]

    def _on_run(self) -> list[ServerConnection]:
        """Connections that show the current run."""
        finished = self._finished
        return [one for one, client in self._informed.items() if not client.bench and one not in finished]

    def _send_status(self, control: BenchControl) -> None:
        """What the bench's page shows, where it has changed."""
        status = control.status()
        if status != self._sent_status:
            self._sent_status = status
            broadcast(self._on_bench(), written(status))

    async def _send_recorded(self, connection: ServerConnection, point: str) -> None:
        """The frame of a recorded point, with the point's id at its end; or a refusal."""
        frame = await self._recorded_frame(self._finished.get(connection, self._run), point)
        answer = {"refused": "not-recorded"} if frame is None else {"ok": True}
        with suppress(ConnectionClosed):
            await connection.send(written({"type": "answer", "do": "recorded", "point": point, **answer}))
            if frame is not None:
                await connection.send(frame + point.encode())

    async def _recorded_frame(self, run: WatchedRun, point: str) -> bytes | None:
        async with self._reading:  # one file at a time, however many browsers request one
            path = await asyncio.to_thread(run.recorded_file, point)
            if path is None:
                return None
            try:
                version = str(path), path.stat().st_mtime_ns
            except OSError:
                return None
            if version not in self._recorded:
                while len(self._recorded) >= MOST_RECORDED:
                    del self._recorded[next(iter(self._recorded))]
                self._recorded[version] = await asyncio.to_thread(recorded_frame, path)
            return self._recorded[version]

    async def _inform(self, connection: ServerConnection, client: Client) -> None:
        """Send a browser the complete state of the run or the bench; changes follow later.

        Files are read in a thread, one run at a time, so a Stop never waits for them.
        """
        control = self._control
        with suppress(ConnectionClosed):
            await connection.send(written(self._standing(connection, client)))
        async with self._reading_run:
            if control is not None and client.run and (finished := control.finished(client.run)) is not None:
                self._finished[connection] = finished
            run = self._finished.get(connection, self._run)
            if client.bench and control is not None:
                shown = control.status(), self._history(control)
                sent = await asyncio.to_thread(lambda: framed(map(written, (run.state(), *shown))))
            else:
                sent = await asyncio.to_thread(lambda: framed(self._whole(run)))
            if connection not in self._clients:
                self._finished.pop(connection, None)
                return
            self._informed[connection] = client
            send_framed([connection], sent)  # without waiting, so no change can occur in between
        if not client.bench:
            self._later(self._send_trials(run, connection))
        if connection in self._finished:
            broadcast([connection], written(self._standing(connection, client)))

    def _standing(self, connection: ServerConnection, client: Client) -> dict[str, Any]:
        """What this browser may do."""
        holder = self._lease.holder
        mine = self._lease.held_by(client.key)
        return {
            "type": "standing", "role": str(client.role), "mine": mine, "holder": "" if holder is None else holder.name,
            "viewer_url": self._access.url(Role.VIEWER) if client.role is Role.OPERATOR else "",
            **({} if self._control is None else self._links(self._control, self._finished.get(connection, self._run))),
        }  # fmt: skip

    def _links(self, control: BenchControl, shown: WatchedRun) -> dict[str, Any]:
        """Of the page of a bench: that it is one, the run's report, and the token for addresses of reports.

        Such an address is copied and sent around: it carries no more than a viewer's right.
        """
        run = shown.run
        entry = None if run is None else control.history.entry(run.name)
        report = run.name if run is not None and entry is not None and entry["report"] else ""
        token = self._access.tokens[Role.VIEWER]
        bench = control.bench
        return {"bench": bench.name, "simulate": bench.simulate, "report": report, "report_token": token}

    def _send_lease(self) -> None:
        self._sent_lease = self._lease.holder
        for connection, client in self._clients.items():
            broadcast([connection], written(self._standing(connection, client)))

    async def send(self) -> None:
        """Send samples and changes of the run until cancelled; without a client, no samples are read.

        One timer serves both and is not a task, because waking up a task costs more than the work itself.
        """
        loop = asyncio.get_running_loop()
        self._failed = failed = loop.create_future()
        due_s = news_due_s = loop.time()

        def turn() -> None:
            nonlocal due_s, news_due_s
            try:
                watched = bool(self._on_run())
                if watched:
                    self.send_frame()
                else:
                    self._frames = None  # later clients see the changes
                if due_s >= news_due_s:
                    self.send_changes()
                    news_due_s = due_s + NEWS_S - 0.5 * FRAME_S
            except Exception as error:  # noqa: BLE001 - it ends the page with its traceback, by `send`
                failed.set_exception(error)
                return
            due_s += FRAME_S if watched else NEWS_S
            if (late_s := loop.time() - due_s) > 0.0:  # missed frames are not sent later
                due_s += late_s + SHORTEST_REST_S
            self._timer = loop.call_at(due_s, turn)

        self._timer = loop.call_soon(turn)
        try:
            await failed
        finally:
            self._timer.cancel()

    def send_frame(self) -> None:
        """One frame of what is new in the ring; without a ring an empty one, for its time."""
        ring = self._run.ring()
        if ring is None:
            frame = packed({}, self._now_ns() * 1e-9)
        else:
            if self._frames is None or self._frames[0] is not ring or ring.unread > MOST_UNREAD:
                ring.skip_to_newest()
                self._frames = ring, Frames(*self._run.frames_of())
            frame = self._frames[1].frame(ring.read_bytes(), self._now_ns() * 1e-9)
        ready = [one for one in self._on_run() if one.transport.get_write_buffer_size() < MOST_UNSENT]
        send_framed(ready, Frame(Opcode.BINARY, frame).serialize(mask=False))  # `broadcast`: twice the cost per browser

    def send_changes(self) -> None:
        """Send state and lease, and changes of plan, verdicts and events once they have been read."""
        if self._control is not None:
            self._look_after(self._control)
        run, reading = self._run, self._reading_run.locked()
        live = run.live_folder
        anew = not reading and run.began_or_ended(live)
        parts = frozenset[str]() if reading else run.grown()
        if anew or parts:
            self._later(self._send_read(run, parts, anew=anew))
        if anew or "iteration" in parts:
            self._later(self._send_trials(run))
        if run.state_changed() and live is not None and not anew:
            self._send_state(run.running_state(live))
        if self._lease.holder != self._sent_lease:
            self._send_lease()

    async def _send_trials(self, run: WatchedRun, connection: ServerConnection | None = None) -> None:
        """Read the trials of an iterated signal, and send them to one browser or to all that show the run.

        Nothing else waits for the process that reads them: on a busy computer it takes seconds.
        """
        async with self._reading:
            trials = await asyncio.to_thread(run.trials)
        if connection is None:
            receivers = self._on_run() if run is self._run else []
        else:
            receivers = [connection] if connection in self._informed else []
        if trials is not None:
            broadcast(receivers, written({"type": "iteration", "trials": trials}))

    def _send_state(self, state: dict[str, Any]) -> None:
        broadcast((*self._on_run(), *self._on_bench()), written(state))

    async def _send_read(self, run: WatchedRun, parts: frozenset[str], *, anew: bool) -> None:
        """Read the changes of the run in a thread, and send them."""
        async with self._reading_run:
            sent, state = await asyncio.to_thread(self._read, run, parts, anew=anew)
            if run is not self._run:
                return
            if run.live_folder is not None:
                self._finished.clear()  # every browser shows the run that moves the rig
            send_framed(self._on_run(), sent)
            if state is not None:
                self._send_state(state)

    def _read(
        self, run: WatchedRun, parts: frozenset[str], *, anew: bool
    ) -> tuple[bytes, dict[str, Any] | None]:
        """Messages with the changes of a run, and its state if requested."""
        texts: list[str] = []
        if anew or "run" in parts:
            description = _description(run)
            if description != self._sent_run:
                self._sent_run = description
                texts += description
        if anew or "results" in parts:
            before, self._sent_results = self._sent_results, _results(run)
            if anew or not before.keys() <= self._sent_results.keys():
                texts += in_pieces(RESULTS, self._sent_results)
            else:
                changed = {name: one for name, one in self._sent_results.items() if before.get(name) != one}
                texts += in_pieces({**RESULTS, "all": False}, changed)
        if anew or "endurance" in parts:
            texts.append(written(run.endurance()))
        self._known = run
        events = run.news()
        state = run.state() if anew else None
        if events or anew:
            shown = list(run.events) if anew else events
            texts.append(written({"type": "events", "events": shown, "all": anew}))
        return framed(texts), state

    def _whole(self, run: WatchedRun) -> list[str]:
        """Messages with the complete state of a run; for the current run, as sent to the other browsers."""
        if run is self._known:
            described, results = self._sent_run, self._sent_results
        else:
            described, results = _description(run), _results(run)
        if run is not self._run:
            run.news()
        events = {"type": "events", "events": list(run.events), "all": True}
        endurance = run.endurance()
        tests = [written(endurance)] if endurance["tests"] else []
        return [*described, *in_pieces(RESULTS, results), *tests, written(run.state()), written(events)]

    def _look_after(self, control: BenchControl) -> None:
        """What runs on the bench now; what has ended goes into its history."""
        if control.look():
            self._later(self.refresh())
        if self._on_bench():
            if control.matrices_due:
                self._later(control.list_matrices())
            if not self._looking.locked() and control.history_due():
                self._later(self._look_again(control))
            self._send_status(control)


RESULTS = {"type": "results"}


def _denial(slug: str) -> str:
    """Text of the page that a browser shows instead: why it is refused, and what to do."""
    why = explained(slug)
    return "\n".join((f"refused: {slug}", "", why.means, "", "Look at:", *(f"- {one}" for one in why.look_at), ""))


def _description(run: WatchedRun) -> list[str]:
    """Messages with the description of a run."""
    with _no_collection():
        described = run.description()
        points = {str(number): written(one) for number, one in enumerate(described.pop("points"))}
    return list(in_pieces(described, points, listed=True))


def _results(run: WatchedRun) -> dict[str, str]:
    """Verdicts by point as JSON text, because garbage collection of thousands of objects is slow."""
    with _no_collection():
        return {name: written(one) for name, one in run.results()["points"].items()}


@contextmanager
def _no_collection() -> Iterator[None]:
    """Suspend garbage collection while a thread reads many points; it would stop the loop for up to 0.1 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def in_pieces(message: dict[str, Any], points: Mapping[str, str], *, listed: bool = False) -> Iterator[str]:
    """A message as JSON texts; many points are sent in advance, in messages with a part of the points each.

    Args:
        message: without its points.
        points: as JSON, by name.
        listed: whether `points` is a list in the message (names are omitted).
    """

    def joined(names: Sequence[str]) -> str:
        if listed:
            return f"[{', '.join(points[name] for name in names)}]"
        return f"{{{', '.join(f'{json.dumps(name)}: {points[name]}' for name in names)}}}"

    names, head = list(points), written(message)[:-1]
    if len(names) <= PIECE:
        yield f'{head}, "points": {joined(names)}}}'
        return
    for begin in range(0, len(names), PIECE):
        piece = written({"type": "points", "of": message["type"], "begin": begin == 0})[:-1]
        yield f'{piece}, "points": {joined(names[begin : begin + PIECE])}}}'
    yield f'{head}, "points": null}}'


def framed(texts: Iterable[str]) -> bytes:
    """Frame messages once, in the thread that creates them, for all browsers."""
    return b"".join(Frame(Opcode.TEXT, text.encode()).serialize(mask=False) for text in texts)


def send_framed(connections: Iterable[ServerConnection], sent: bytes) -> None:
    """Send complete messages to open connections, without waiting."""
    for connection in connections:
        if sent and connection.state is State.OPEN:
            connection.transport.write(sent)


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
