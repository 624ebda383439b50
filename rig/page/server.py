"""The page's server: two addresses, `/` for the page and `/ws` for its data, and nothing else.

One loop sends a frame of samples 25 times a second to everybody, another what has changed of the run. A browser that
does not read gets nothing more until it does; one that talks too much is shown the door. None of this is waited for by
anybody else, least of all by the rig.
"""

from __future__ import annotations

import asyncio
import json
import ssl
from collections import Counter
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from rig.clock import monotonic_ns
from rig.page.access import Access, Denied, Role
from rig.page.commands import LONGEST_KEY, LONGEST_MESSAGE, Client, Commands, one_line
from rig.page.document import document, headers
from rig.page.lease import Lease
from rig.page.samples import Frames
from rig.page.watched_run import WatchedRun
from rig.recording.journal.ring_reader import RingReader
from rig.recording.layout import RECORD_DTYPE
from rig.station.live_folder import PLAN, RESULTS, STATE

FRAME_S = 0.040
NEWS_S = 0.200
MOST_CLIENTS = 40
MOST_MESSAGES = 60
"""Of one connection in a second; more end it."""
MOST_UNSENT = 1 << 18
"""Bytes that may wait for a browser before frames are left out."""
TOO_MUCH = 1008
_NOTHING = np.zeros(0, RECORD_DTYPE)


class PageServer:
    """One run's page.

    Args:
        run: the run that is shown.
        access: who may open it.
        now_ns: monotonic time.
    """

    def __init__(self, run: WatchedRun, access: Access, now_ns: Callable[[], int] = monotonic_ns) -> None:
        self._run = run
        self._access = access
        self._now_ns = now_ns
        self._lease = Lease(lambda: run.live_folder, now_ns)
        self._commands = Commands(self._lease, lambda: run.live_folder)
        self._clients: dict[ServerConnection, Client] = {}
        self._frames: tuple[RingReader, Frames] | None = None
        self._told_lease: object = None
        self._told_run: dict[str, Any] = {}

    async def serve(self, sock: Any, tls: ssl.SSLContext | None) -> Server:  # noqa: ANN401 - a bound socket
        """Begin to answer on a bound socket."""
        return await serve(
            self._speak, sock=sock, ssl=tls, process_request=self._answer, max_size=LONGEST_MESSAGE, max_queue=8,
            compression=None, open_timeout=5, ping_interval=10, ping_timeout=20, close_timeout=1, server_header=None,
        )  # fmt: skip

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A page or a refusal; None: a WebSocket that may begin."""
        if getattr(request, "method", "GET") != "GET":  # websockets before 16 lets nothing else come this far
            return _response(405, "refused: only GET\n")
        judged = self._access.judge(request.path, request.headers.get_all("Host"), request.headers.get_all("Origin"))
        if isinstance(judged, Denied):
            return _response(judged.status, f"refused: {judged.slug}\n")
        place = urlsplit(request.path).path
        if place == "/":
            return Response(200, "OK", _headers(headers(), document()), document())
        if place != "/ws":
            return _response(404, "not here\n")
        return _response(503, "refused: too-many-clients\n") if len(self._clients) >= MOST_CLIENTS else None

    async def _speak(self, connection: ServerConnection) -> None:
        """One browser, from its first to its last message."""
        client = self._client(connection)
        if client is None:
            return
        self._clients[connection] = client
        self._lease.back(client.key)
        try:
            for message in (self._run.description(), self._run.results(), self._run.state(), self._all_events()):
                await connection.send(json.dumps(message))
            await connection.send(json.dumps(self._standing(client)))
            await self._listen(connection)
        except ConnectionClosed:
            pass  # however it went, it is gone
        finally:
            del self._clients[connection]
            if all(other.key != client.key for other in self._clients.values()):
                self._lease.left(client.key)

    def _client(self, connection: ServerConnection) -> Client | None:
        """Who has opened this connection; its handshake was judged before."""
        request = connection.request
        if request is None:
            return None
        judged = self._access.judge(request.path, request.headers.get_all("Host"), request.headers.get_all("Origin"))
        if not isinstance(judged, Role):
            return None
        key = parse_qs(urlsplit(request.path).query).get("client", [""])[0]
        return Client(judged, one_line(key, LONGEST_KEY) or str(connection.id))

    async def _listen(self, connection: ServerConnection) -> None:
        counted: Counter[int] = Counter()
        async for text in connection:
            second = self._now_ns() // 1_000_000_000
            counted = Counter({second: counted[second] + 1})
            if counted[second] > MOST_MESSAGES:
                await connection.close(TOO_MUCH, "too many messages")
                return
            client = self._clients[connection]
            answer = self._commands.take(text, client)
            await connection.send(json.dumps({"type": "answer", **answer}))
            if answer.get("do") in {"lease", "release"}:
                self._tell_lease()

    def _all_events(self) -> dict[str, Any]:
        return {"type": "events", "events": list(self._run.events), "all": True}

    def _standing(self, client: Client) -> dict[str, Any]:
        """What this browser may do."""
        holder = self._lease.holder
        mine = self._lease.held_by(client.key)
        return {
            "type": "standing", "role": str(client.role), "mine": mine, "holder": "" if holder is None else holder.name,
            "viewer_url": self._access.url(Role.VIEWER) if client.role is Role.OPERATOR else "",
        }  # fmt: skip

    def _tell_lease(self) -> None:
        self._told_lease = self._lease.holder
        for connection, client in self._clients.items():
            broadcast([connection], json.dumps(self._standing(client)))

    async def send_frames(self) -> None:
        """Samples to everybody, until cancelled; while nobody looks nothing is read."""
        while True:
            began_ns = self._now_ns()
            if self._clients:
                self.send_frame()
            await asyncio.sleep(max(0.005, FRAME_S - (self._now_ns() - began_ns) * 1e-9))

    def send_frame(self) -> None:
        """One frame of what is new in the ring; without a ring an empty one, for its time."""
        ring = self._run.ring()
        if ring is None:
            frame = Frames(1.0, 1.0).frame(_NOTHING, self._now_ns() * 1e-9)
        else:
            if self._frames is None or self._frames[0] is not ring:
                ring.skip_to_newest()
                self._frames = ring, Frames(*self._run.frames_of())
            frame = self._frames[1].frame(ring.read(), self._now_ns() * 1e-9)
        broadcast([one for one in self._clients if one.transport.get_write_buffer_size() < MOST_UNSENT], frame)

    async def send_news(self) -> None:
        """What has changed of the run, until cancelled."""
        while True:
            self.send_changes()
            await asyncio.sleep(NEWS_S)

    def send_changes(self) -> None:
        """Plan, verdicts, state, events and lease, each where it has changed."""
        told: list[dict[str, Any]] = []
        planned = self._run.changed(PLAN)
        if planned or not self._told_run.get("devices"):
            description = self._run.description()
            if description != self._told_run:
                self._told_run = description
                told.append(description)
        if self._run.changed(RESULTS):
            told.append(self._run.results())
        if self._run.changed(STATE):
            told.append(self._run.state())
        events = self._run.news()
        if events:
            told.append({"type": "events", "events": events, "all": False})
        for message in told:
            broadcast(self._clients, json.dumps(message))
        if self._lease.holder != self._told_lease:
            self._tell_lease()


def _response(status: int, text: str) -> Response:
    body = text.encode()
    plain = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return Response(status, HTTPStatus(status).phrase, _headers(plain, body), body)


def _headers(named: dict[str, str], body: bytes) -> Headers:
    return Headers({**named, "Content-Length": str(len(body)), "Connection": "close"})
