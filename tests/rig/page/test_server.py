"""The page's server, spoken to over its socket as browsers and strangers do."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import http.client
import json
import math
import os
import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus

from drivers.ring import RingWriter
from rig.page import server
from rig.page.access import Access, Role
from rig.page.bench_control import Bench, BenchControl
from rig.page.document import BENCH, RUN, document
from rig.page.process import listening
from rig.page.server import (
    FOR_OPERATORS,
    MOST_CLIENTS,
    MOST_CONNECTIONS,
    MOST_MESSAGES,
    MOST_REQUESTED,
    MOST_UNSENT,
    PIECE,
    PageServer,
)
from rig.page.settings import PageSettings
from rig.page.watched_run import WatchedRun
from rig.station.live_folder import bound, make_live_folder, received, replace_json

HERE = PageSettings()
HOSTILE = "<script>alert(1)</script>"


@dataclass
class Rig:
    """What a page finds: a run, its live folder with both sockets, a ring."""

    run: Path
    live: Path
    station: socket.socket
    application: socket.socket
    ring: RingWriter
    lock: int


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    live, lock = make_live_folder(tmp_path)
    run = tmp_path / "run"
    run.mkdir()
    ring = RingWriter(tmp_path / "ring", 4096)
    station = {
        "ring_path": str(ring.path), "device_rate": 1.0, "limits": {"force_N": 5000.0},
        "load_cell": {"rate_Hz": 250.0, "stale_after_s": 0.05}, "lvdt": {"rate_Hz": 250.0},
    }  # fmt: skip
    replace_json(run / "station.json", station)
    replace_json(live / "plan.json", {"specimen": HOSTILE, "bench": HOSTILE, "points": []})
    replace_json(live / "state.json", {"phase": "running", "campaign": str(run)})
    (run / "journal.jsonl").write_text(
        json.dumps({"utc": "2026-01-02T03:04:05", "event": "warning", "slug": "sample-gap", "text": HOSTILE}) + "\n"
    )
    made = Rig(run, live, bound(live / "station.sock"), bound(live / "application.sock"), ring, lock)
    yield made
    made.station.close()
    made.application.close()
    ring.close()
    os.close(lock)


def served(
    rig: Rig, do: Callable[[PageServer, Access], Awaitable[None]], settings: PageSettings = HERE,
    shown: BenchControl | None = None,
) -> None:
    """Run the server and a test against it."""

    async def both() -> None:
        sock, tls = listening(settings), settings.context()
        access = Access(settings.host, sock.getsockname()[1], tls is not None)
        page = PageServer(shown or WatchedRun(None, rig.live), access, lambda: None)
        serving = await page.serve(sock, tls)
        try:
            await asyncio.wait_for(do(page, access), 20.0)
        finally:
            serving.close()
            await serving.wait_closed()

    asyncio.run(both())


def opened(access: Access, role: Role = Role.OPERATOR, client: str = "a") -> connect:
    uri = f"ws://127.0.0.1:{access.port}/ws?token={access.tokens[role]}&client={client}"
    return connect(uri, close_timeout=0.2)


async def answer(connection: ClientConnection, **message: object) -> dict[str, Any]:
    await connection.send(json.dumps(message))
    while True:
        text = await connection.recv()
        reported = json.loads(text) if isinstance(text, str) else {}
        if reported.get("type") == "answer":
            return dict(reported)


async def swallow(connection: ClientConnection) -> None:
    with contextlib.suppress(ConnectionClosed):
        async for _ in connection:
            pass


async def ended_by(connection: ClientConnection, messages: list[str]) -> int | None:
    """The code with which the server ends it; None where it was gone before it could say so."""
    try:
        for message in messages:
            await connection.send(message)
        while True:
            await connection.recv()
    except ConnectionClosed as closed:
        return None if closed.rcvd is None else closed.rcvd.code


def got(access: Access, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes, dict[str, str]]:
    client = http.client.HTTPConnection("127.0.0.1", access.port, timeout=5)
    try:
        client.request(method, path, headers=headers)
        response = client.getresponse()
        return response.status, response.read(), dict(response.getheaders())
    finally:
        client.close()


def test_the_page_is_one_document_that_fetches_nothing_and_runs_only_its_own_script(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        status, body, headers = await asyncio.to_thread(got, access, f"/?token={access.tokens[Role.VIEWER]}")
        assert (status, body) == (200, document())
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["Referrer-Policy"] == "no-referrer"

    served(rig, do)
    text = document().decode()
    assert "src=" not in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text.replace("/*! https://github.com/leeoniya/uPlot", "")
    assert "Copyright (c) 2022 Leon Sorokin" in text
    dangerous = ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "Function(")
    assert not any(word in text for word in dangerous)


def test_strangers_are_refused_over_http_and_websocket(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        own = f"/?token={access.tokens[Role.OPERATOR]}"
        for path, headers, status in (
            ("/", {}, 401), ("/?token=wrong", {}, 401), (own, {"Host": "evil.example"}, 403),
            (own, {"Origin": "http://evil.example"}, 403), (f"/etc/passwd{own[1:]}", {}, 404),
        ):  # fmt: skip
            assert (await asyncio.to_thread(got, access, path, **headers))[0] == status
        assert b"the complete address that is printed after" in (await asyncio.to_thread(got, access, "/"))[1]
        uri = f"ws://127.0.0.1:{access.port}/ws{own[1:]}"
        for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
            with pytest.raises(InvalidStatus) as refusal:
                await connect(uri, additional_headers=headers, origin=None)
            assert refusal.value.response.status_code == 403
        with pytest.raises(InvalidStatus) as refusal:
            await connect(f"ws://127.0.0.1:{access.port}/ws?token={Access('127.0.0.1', 1).tokens[Role.OPERATOR]}")
        assert refusal.value.response.status_code == 401

    served(rig, do)
    assert received(rig.station) is None
    assert received(rig.application) is None


def test_a_request_that_is_no_get_changes_nothing(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        for method in ("POST", "PUT", "DELETE"):
            path = f"/?token={access.tokens[Role.OPERATOR]}"
            try:
                status = (await asyncio.to_thread(got, access, path, method))[0]
            except (http.client.HTTPException, ConnectionError):
                continue  # shown the door without an answer
            assert status >= 400

    served(rig, do)
    assert received(rig.application) is None


def test_everybody_sees_the_samples_and_anybody_may_stop(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        async with opened(access, Role.VIEWER, "v") as viewer, opened(access, client="o") as operator:
            for connection in (viewer, operator):
                kinds = [json.loads(await connection.recv())["type"] for _ in range(5)]
                assert kinds == ["standing", "run", "results", "state", "events"]
            page.send_frame()  # from here on
            await asyncio.gather(viewer.recv(), operator.recv())
            rig.ring.append([(5_000_000_000, 4000, 321.5, 1, 1, 0)])
            page.send_frame()
            first, second = await asyncio.gather(viewer.recv(), operator.recv())
            assert first == second
            assert first.endswith(bytes.fromhex("0100 0000 01000000 00000000 00c0a043".replace(" ", "")))  # 321.5 N
            assert (await answer(operator, do="lease", name="Ada"))["ok"] is True
            stopped = await answer(viewer, do="stop")
            assert (stopped["ok"], stopped["station"], stopped["application"]) == (True, True, True)
            assert (await answer(viewer, do="start"))["refused"] == "viewer"

    served(rig, do)
    assert received(rig.station) == {"do": "stop", "by": "a browser (viewer)"}
    assert received(rig.station) is None
    reported = []
    while (message := received(rig.application)) is not None:
        reported.append(message["do"])
    assert reported == ["words", "stop"]


def test_hostile_names_arrive_as_the_text_they_are(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        page.send_changes()
        async with opened(access) as operator:
            reported = [json.loads(await operator.recv()) for _ in range(5)]
        assert (reported[1]["specimen"], reported[4]["events"][0]["text"]) == (HOSTILE, HOSTILE)

    served(rig, do)


def test_a_browser_that_floods_is_shown_the_door_and_others_still_stop_the_rig(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        async with opened(access, client="calm") as calm:
            async with opened(access, client="flood") as flood:
                assert await ended_by(flood, ['{"do": "nonsense"}'] * (20 * MOST_MESSAGES)) in {1008, None}
            async with opened(access, client="large") as large:
                assert await ended_by(large, [" " * 100_000]) in {1009, None}
            assert (await answer(calm, do="stop"))["ok"] is True

    served(rig, do)
    assert received(rig.station) == {"do": "stop", "by": "a browser (without control)"}
    assert received(rig.station) is None


def test_numbers_that_are_none_arrive_as_null(rig: Rig) -> None:
    replace_json(rig.live / "results.json", {"p001": {"verdict": "valid", "reasons": [], "score": math.nan}})

    async def do(page: PageServer, access: Access) -> None:
        async with opened(access) as operator:
            texts = [await operator.recv() for _ in range(5)]
        assert not any("NaN" in str(text) or "Infinity" in str(text) for text in texts)
        assert json.loads(texts[2])["points"]["p001"] == {"verdict": "valid", "reasons": [], "score": None}

    served(rig, do)


def test_viewers_leave_places_for_operators(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        async with AsyncExitStack() as ends:
            for number in range(MOST_CLIENTS - FOR_OPERATORS):
                await ends.enter_async_context(opened(access, Role.VIEWER, f"v{number}"))
            with pytest.raises(InvalidStatus) as refusal:
                await opened(access, Role.VIEWER, "one-more")
            assert refusal.value.response.status_code == 503
            operator = await ends.enter_async_context(opened(access, client="o"))
            assert (await answer(operator, do="stop"))["ok"] is True

    served(rig, do)


def test_silent_sockets_keep_no_browser_out_and_a_stop_gets_through(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        async with opened(access) as operator:
            silent = [await asyncio.open_connection("127.0.0.1", access.port) for _ in range(MOST_CONNECTIONS + 20)]
            ended = [asyncio.create_task(reader.read()) for reader, _ in silent]
            _, waiting = await asyncio.wait(ended, timeout=2.0, return_when=asyncio.FIRST_COMPLETED)
            assert len(waiting) < MOST_CONNECTIONS + 20
            assert (await answer(operator, do="stop"))["ok"] is True
            async with opened(access, client="new") as new:
                assert (await answer(new, do="stop"))["ok"] is True
            for task in ended:
                task.cancel()
            for _, writer in silent:
                writer.close()

    served(rig, do)


def test_a_browser_that_reads_nothing_does_not_block_and_heaps_nothing(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        async with opened(access, client="reads") as reads, opened(access, client="sleeps") as sleeps:
            sleeps.transport.pause_reading()
            asyncio.create_task(swallow(reads)).add_done_callback(lambda _: None)
            for number in range(400):
                rig.ring.append([(10**9 + number, 4000 * number, 1.0, number, c, 0) for c in (1, 2, 23)] * 40)
                page.send_frame()
                await asyncio.sleep(0)
            heaps = [one.transport.get_write_buffer_size() for one in page._clients]
            assert max(heaps) < 2 * MOST_UNSENT
            sleeps.transport.resume_reading()

    served(rig, do)


def test_points_finished_in_a_running_campaign_are_shown_and_a_stop_does_not_wait_for_them(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    (rig.run / "points").mkdir()
    for name in ("p001.h5", "p002.h5"):
        (rig.run / "points" / name).write_bytes(b"")
    listed = {"p001": "p001.h5", "p002": "../points/p002.h5", "p003": "gone.h5", "p004": None}
    replace_json(rig.live / "results.json", {name: {"file": file} for name, file in listed.items()})
    read, stopped = list[str](), threading.Event()

    def slowly(path: Path) -> bytes:
        assert stopped.wait(10.0)
        read.append(path.name)
        return b"frame of "

    monkeypatch.setattr(server, "recorded_frame", slowly)

    async def do(page: PageServer, access: Access) -> None:
        async with opened(access, Role.VIEWER) as viewer:
            for point in ("p001", "p002", "p001"):
                await viewer.send(json.dumps({"do": "recorded", "point": point}))
            assert (await answer(viewer, do="stop"))["ok"] is True
            stopped.set()
            frames = [message async for message in first(viewer, 3)]
            assert sorted(frames) == [b"frame of p001", b"frame of p001", b"frame of p002"]
            for point in ("p003", "p004", "../../etc/passwd"):
                assert (await answer(viewer, do="recorded", point=point))["refused"] == "not-recorded"
            stopped.clear()
            (rig.run / "points" / "p001.h5").write_bytes(b"again")  # the point was repeated
            for _ in range(MOST_REQUESTED + 1):
                await viewer.send(json.dumps({"do": "recorded", "point": "p001"}))
            assert (await answer(viewer, do="clock"))["do"] == "recorded", "the one too many is refused at once"
            stopped.set()

    served(rig, do)
    assert sorted(read[:2]) == ["p001.h5", "p002.h5"], "each file is read once"


async def first(connection: ClientConnection, count: int) -> AsyncIterator[bytes]:
    """So many frames of recorded points."""
    while count:
        message = await connection.recv()
        if isinstance(message, bytes):
            count -= 1
            yield message


def test_many_points_arrive_in_pieces_changes_alone_and_a_stop_does_not_wait_for_them(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = [{"id": f"p{number:05}", "described": HOSTILE} for number in range(PIECE + 1)]
    replace_json(rig.live / "plan.json", {"points": points})
    verdicts = {one["id"]: {"verdict": "valid", "reasons": []} for one in points}
    replace_json(rig.live / "results.json", verdicts)
    results, reading, stopped = WatchedRun.results, threading.Event(), threading.Event()

    def slowly(run: WatchedRun) -> dict[str, Any]:
        reading.set()
        assert stopped.wait(10.0)
        return results(run)

    async def read(connection: ClientConnection, last: str) -> list[dict[str, Any]]:
        messages = [json.loads(await connection.recv())]
        while messages[-1]["type"] != last:
            messages.append(json.loads(await connection.recv()))
        return messages

    async def do(page: PageServer, access: Access) -> None:
        page.send_changes()
        async with opened(access) as operator:
            shown = await read(operator, "events")
            pieces = [one for one in shown if one["type"] == "points"]
            assert [len(one["points"]) for one in pieces] == [PIECE, 1] * 2
            assert [one["of"] for one in pieces] == ["run", "run", "results", "results"]
            assert pieces[0]["points"] + pieces[1]["points"] == points
            assert pieces[2]["points"] | pieces[3]["points"] == verdicts
            assert [one["points"] for one in shown if one["type"] in {"run", "results"}] == [None, None]
            monkeypatch.setattr(WatchedRun, "results", slowly)
            verdicts["p00007"] = {"verdict": "invalid", "reasons": []}
            replace_json(rig.live / "results.json", verdicts)
            page.send_changes()
            assert await asyncio.to_thread(reading.wait, 10.0)
            assert (await answer(operator, do="stop"))["ok"] is True
            stopped.set()
            (changed,) = await read(operator, "results")
            assert (changed["points"], changed["all"]) == ({"p00007": verdicts["p00007"]}, False)

    served(rig, do)


def test_a_campaign_that_is_killed_is_reported_as_gone(rig: Rig) -> None:
    async def do(page: PageServer, access: Access) -> None:
        page.send_changes()
        async with opened(access) as operator:
            reported = [json.loads(await operator.recv()) for _ in range(5)]
            assert reported[3]["running"] is True
            fcntl.flock(rig.lock, fcntl.LOCK_UN)
            page.send_changes()
            while True:
                message = json.loads(await operator.recv())
                if message["type"] == "state":
                    break
            assert (message["running"], message["ended"]) == (False, {"cut_off": True})
            assert (await answer(operator, do="stop"))["refused"] == "not-running"

    served(rig, do)


def test_the_page_of_a_bench_gives_out_reports_without_their_scripts_and_samples_to_the_run_s_view_alone(
    rig: Rig, tmp_path: Path
) -> None:
    run = tmp_path / "logs" / "20260102T030405Z-MR-1-aaaaaa"
    (run / "points").mkdir(parents=True)
    (run / "report.html").write_text(HOSTILE)
    bench = Bench(tmp_path / "b.toml", "b", frozenset(), tmp_path, tmp_path / "logs", tmp_path, simulate=True)
    replace_json(rig.live / "devices.json", {"out": str(tmp_path / "logs"), "devices": []})

    async def do(page: PageServer, access: Access) -> None:
        await page.refresh()
        page.send_changes()
        viewer = access.tokens[Role.VIEWER]
        status, body, headers = await asyncio.to_thread(got, access, f"/report/{run.name}?token={viewer}")
        assert (status, body) == (200, HOSTILE.encode())
        policy = headers["Content-Security-Policy"]
        assert policy.startswith("sandbox; default-src 'none'")
        assert "script" not in policy
        for path in ("..%2F..%2Fb.toml", "..", f"{run.name}%2F..%2F{run.name}", "", "%00", "no-such-run"):
            assert (await asyncio.to_thread(got, access, f"/report/{path}?token={viewer}"))[0] == 404
        assert (await asyncio.to_thread(got, access, f"/report/{run.name}?token=wrong"))[0] == 401
        assert (await asyncio.to_thread(got, access, f"/pdf/{run.name}?token={viewer}"))[0] == 404, "it has none yet"
        (run / "report.pdf").write_bytes(b"%PDF-1.4")
        status, body, headers = await asyncio.to_thread(got, access, f"/pdf/{run.name}?token={viewer}")
        assert (status, body, headers["Content-Type"]) == (200, b"%PDF-1.4", "application/pdf")
        assert headers["Content-Disposition"] == f"attachment; filename*=UTF-8''{run.name}.pdf"
        assert (await asyncio.to_thread(got, access, f"/pdf/..%2f{run.name}?token={viewer}"))[0] == 404
        assert (await asyncio.to_thread(got, access, f"/pdf/{run.name}?token=wrong"))[0] == 401
        assert (await asyncio.to_thread(got, access, f"/?token={viewer}"))[1] == document(BENCH)
        assert (await asyncio.to_thread(got, access, f"/run?token={viewer}"))[1] == document(RUN)
        uri = f"ws://127.0.0.1:{access.port}/ws?token={access.tokens[Role.OPERATOR]}&client=a"
        async with connect(f"{uri}&view=bench") as control, connect(uri) as view:
            shown = [json.loads(await control.recv()) for _ in range(4)]
            assert [one["type"] for one in shown] == ["standing", "state", "bench", "history"]
            assert (shown[2]["running"], shown[3]["runs"][0]["report"]) == (True, True)
            assert shown[0]["report_token"] == viewer
            assert {json.loads(await view.recv())["type"] for _ in range(5)} >= {"run", "results", "events"}
            page.send_frame()
            assert isinstance(await view.recv(), bytes)
            assert (await answer(control, do="begin", matrix="m.toml"))["refused"] == "no-lease"
            assert (await answer(control, do="stop"))["ok"] is True

    control = BenchControl(bench, place=tmp_path)
    served(rig, do, shown=control)
    control.watched.close()


def test_a_finished_run_is_shown_to_the_browser_that_opens_it_until_a_run_begins(rig: Rig, tmp_path: Path) -> None:
    old, new = (tmp_path / "logs" / f"2026010{day}T030405Z-MR-1-aaaaaa" for day in (1, 2))
    for run in (old, new):
        (run / "points").mkdir(parents=True)
    bench = Bench(tmp_path / "b.toml", "b", frozenset(), tmp_path, tmp_path / "logs", tmp_path, simulate=True)
    replace_json(rig.live / "devices.json", {"out": str(tmp_path / "logs"), "devices": []})
    seconds = iter(range(1, 10_000))
    control = BenchControl(bench, lambda: next(seconds) * 1_000_000_000, tmp_path / "no-run-yet")

    async def shown(connection: ClientConnection) -> str:
        while True:
            message = json.loads(await connection.recv())
            if message["type"] == "run":
                return str(message["name"])

    async def do(page: PageServer, access: Access) -> None:
        await page.refresh()
        uri = f"ws://127.0.0.1:{access.port}/ws?token={access.tokens[Role.VIEWER]}"
        async with connect(f"{uri}&client=a&run={old.name}") as one, connect(f"{uri}&client=b&run=../x") as other:
            assert (await shown(one), await shown(other)) == (old.name, new.name)
            control._place = tmp_path
            page.send_changes()
            assert (await shown(one), await shown(other)) == (rig.run.name, rig.run.name)

    served(rig, do, shown=control)
    control.watched.close()


def test_a_report_that_another_program_writes_appears_in_the_history(rig: Rig, tmp_path: Path) -> None:
    run = tmp_path / "logs" / "20260102T030405Z-MR-1-aaaaaa"
    (run / "points").mkdir(parents=True)
    bench = Bench(tmp_path / "b.toml", "b", frozenset(), tmp_path, tmp_path / "logs", tmp_path, simulate=True)
    seconds = iter(range(1, 10_000))
    control = BenchControl(bench, lambda: next(seconds) * 1_000_000_000, tmp_path / "no-run-yet")

    async def do(page: PageServer, access: Access) -> None:
        await page.refresh()
        uri = f"ws://127.0.0.1:{access.port}/ws?token={access.tokens[Role.VIEWER]}&client=a&view=bench"
        async def keep_changing() -> None:
            while True:
                page.send_changes()
                await asyncio.sleep(0.01)

        async with connect(uri) as browser:
            reported = []
            changing = asyncio.create_task(keep_changing())
            while len(reported) < 2:
                message = json.loads(await browser.recv())
                if message["type"] == "history":
                    reported.append(message["runs"][0]["report"])
                    (run / "report.html").write_text("x")
            changing.cancel()
        assert reported == [False, True]

    served(rig, do, shown=control)
    control.watched.close()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl to make a certificate with")
def test_over_tls_the_page_opens_by_its_name_alone(rig: Rig, tmp_path: Path) -> None:
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=DNS:localhost", "-keyout", str(key), "-out", str(cert)],
        check=True, capture_output=True,
    )  # fmt: skip
    trusting = ssl.create_default_context(cafile=str(cert))

    async def do(page: PageServer, access: Access) -> None:
        uri = f"wss://localhost:{access.port}/ws?token={access.tokens[Role.OPERATOR]}"
        assert access.url(Role.OPERATOR).startswith("https://localhost:")
        async with connect(uri, ssl=trusting, close_timeout=0.2) as operator:
            assert (await answer(operator, do="stop"))["ok"] is True
        plain = uri.replace("wss://", "ws://")
        with pytest.raises((InvalidMessage, ConnectionError, EOFError)):
            await connect(plain, open_timeout=5)
        with pytest.raises(ssl.SSLCertVerificationError):
            await connect(uri, ssl=ssl.create_default_context())

    served(rig, do, PageSettings("localhost", str(cert), str(key)))


def test_the_ring_is_only_read(rig: Rig) -> None:
    before = rig.ring.recorder_cursor

    async def do(page: PageServer, access: Access) -> None:
        async with opened(access):
            for number in range(50):
                rig.ring.append([(number, number, 1.0, number, 2, 0)] * 200)
                page.send_frame()

    served(rig, do)
    assert rig.ring.recorder_cursor == before == 0
    assert rig.ring.overruns == 0


def test_the_endurance_tests_of_a_run_are_sent_and_sent_again_after_a_block(rig: Rig) -> None:
    file = rig.run / "endurance.json"

    def write(cycles: int) -> None:
        file.write_text(json.dumps({"format": 1, "tests": [{"id": "wear", "cycles_run": cycles}]}), encoding="utf-8")

    async def cycles(connection: ClientConnection) -> int:
        while True:
            text = await connection.recv()
            reported = json.loads(text) if isinstance(text, str) else {}
            if reported.get("type") == "endurance":
                return int(reported["tests"][0]["cycles_run"])

    async def do(page: PageServer, access: Access) -> None:
        write(40)
        async with opened(access, Role.VIEWER, "v") as viewer:
            assert await cycles(viewer) == 40
            sending = asyncio.create_task(page.send())
            write(800)
            while await cycles(viewer) != 800:
                pass
            sending.cancel()

    served(rig, do)
