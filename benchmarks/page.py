"""What the operator's page costs and how fast it is: processor, memory, Stop, pointer, a sample's way to the screen.

    python benchmarks/page.py [--seconds 30] [--viewers 1] [--stops 200] [--bench] [--no-browser] [--json]
    python benchmarks/page.py periods [--minutes 5] [--poll-ms 4] [--no-real-time] [--json]

`periods` is another question: whether the page costs the station any of its periods (`page_periods.py`).
A ring is filled here as a station fills it (3 sensors x 250 Hz, controller and ECU 100 Hz); the page is a process as
`rig run --page` starts it, with `--bench` that of `rig page --bench`.
A stop is timed from a browser's end of the WebSocket to the station's call that stops the
rig; `stop_latency.py` has the way from there to the wire.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import platform
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from page_periods import periods, table
from websockets.asyncio.client import connect
from websockets.sync.client import connect as connect_now

from drivers.ring import Channel, Record, RingWriter
from rig.campaign.live_link import LiveLink
from rig.clock import monotonic_ns
from rig.page.settings import PageSettings
from rig.page.started import PageProcess
from rig.recording.journal.campaign_log import CampaignLog
from rig.station.live_folder import replace_json
from rig.station.stop_socket import StopSocket

WARM_S = 3.0
LISTS = "[rigPage.latencies_ms, rigPage.pointer_ms, rigPage.frames_ms]"
CHROMIUM_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]


class Feed:
    """A station's records, written in real time."""

    def __init__(self, ring: RingWriter, link: LiveLink) -> None:
        self._ring, self._link = ring, link
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write no more."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        tick, next_ns = 0, monotonic_ns()
        while not self._ending.is_set():
            next_ns += 4_000_000
            self._ring.append(self._records(tick))
            if tick % 25 == 0:
                self._link.display.progress("p001", tick // 125, 100.0, {})
            tick += 1
            time.sleep(max(0.0, (next_ns - monotonic_ns()) * 1e-9))

    @staticmethod
    def _records(tick: int) -> list[Record]:
        now_ns, angle = monotonic_ns(), 2.0 * math.pi * tick / 125.0
        values = {
            Channel.DISPLACEMENT: 0.05 * math.sin(angle), Channel.FORCE: 800.0 * math.cos(angle),
            Channel.AUXILIARY_1: 25.0,
        }
        records: list[Record] = [(now_ns, 4000 * tick, value, tick, channel, 0) for channel, value in values.items()]
        if tick % 5 < 2:
            for channel in (20, 21, 22, 23, 24, 25, 26, 27, 29, 30, 31, 32, 10, 12, 14, 15, 16):
                records.append((now_ns, 4000 * tick, 1.0, tick, channel, 0))
        return records


def processor_s(pid: int) -> float:
    """On a processor, all threads, by the scheduler's own count (ticks of 10 ms are too coarse for this)."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((thread / "schedstat").read_text().split()[0]) for thread in threads) * 1e-9


def resident_MB(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1e3


def socket_of(url: str) -> str:
    parts = urlsplit(url)
    return f"ws://{parts.netloc}/ws?{parts.query}"


async def looked_at(url: str, viewers: int, seconds: float) -> list[int]:
    """Frames that each of so many viewers got."""

    async def look(number: int) -> int:
        frames, end_ns = 0, monotonic_ns() + int(seconds * 1e9)
        async with connect(f"{socket_of(url)}&client=v{number}", max_size=None) as connection:
            while monotonic_ns() < end_ns:
                frames += isinstance(await connection.recv(), bytes)
        return frames

    return list(await asyncio.gather(*(look(number) for number in range(viewers))))


class BenchPage:
    """`rig page --bench` as a process; the campaign whose folder is in `out` is its own."""

    def __init__(self, out: Path) -> None:
        root = Path(__file__).resolve().parents[1]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.cli.main", "page", "--bench", str(root / "examples" / "demo-bench.toml"),
             "--simulate", "--json", "--out", str(out)],
            cwd=root, env={**os.environ, "XDG_STATE_HOME": str(out)}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        lines = self._process.stdout or ()
        self.url = str(json.loads(b"".join(line for _, line in zip(range(3), lines, strict=False)))["page"])
        self.pid = self._process.pid

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.communicate()


def cost(folder: Path, seconds: float, viewers: int, browser: bool, *, bench: bool = False) -> dict[str, object]:
    run = folder / "run"
    run.mkdir()
    ring = RingWriter(folder / "ring", 1 << 16)
    sensor = {"rate_Hz": 250.0, "stale_after_s": 0.1}
    replace_json(run / "station.json", {
        "ring_path": str(ring.path), "device_rate": 1.0, "load_cell": sensor, "lvdt": sensor,
        "limits": {"force_N": 5000.0, "position_m": [-0.085, 0.085], "speed_m_s": 0.8},
    })  # fmt: skip
    with ExitStack() as ends:
        link = LiveLink()
        ends.callback(link.close)
        log = CampaignLog(run)
        ends.enter_context(link.following(log))
        link.belongs_to(folder, ())
        link.display.phase("running")
        feed = Feed(ring, link)
        ends.callback(feed.close)
        page = BenchPage(folder) if bench else PageProcess.start(PageSettings(live=str(link.folder)))
        ends.callback(page.close)
        found: dict[str, object] = {}
        asyncio.run(looked_at(page.url, viewers, WARM_S))
        before_s, began_ns = processor_s(page.pid), monotonic_ns()
        frames = asyncio.run(looked_at(page.url, viewers, seconds))
        spent_s = processor_s(page.pid) - before_s
        wall_s = (monotonic_ns() - began_ns) * 1e-9
        found["core_percent"] = round(100.0 * spent_s / wall_s, 2)
        found["frames_per_s"] = round(min(frames) / wall_s, 1)
        if browser:
            found |= drawn(page.url, seconds)
        found["resident_MB"] = round(resident_MB(page.pid), 1)
    return found


def drawn(url: str, seconds: float) -> dict[str, object]:
    """In Chromium, with the pointer moving over a loop.

    Ages of the newest sample when a frame had been drawn (ms), times from the pointer's event to its values (ms), times
    to draw a frame (ms), and frames drawn in a second.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS)
        page = chromium.new_page(viewport={"width": 1366, "height": 768}, bypass_csp=True)
        page.goto(url)
        page.wait_for_timeout(1e3 * WARM_S)
        page.evaluate(f"{LISTS}.forEach(list => list.length = 0)")
        box = page.locator("#plot-fx .u-over").bounding_box() or {}
        began_ns = monotonic_ns()
        while (monotonic_ns() - began_ns) * 1e-9 < seconds:
            share = 0.2 + 0.6 * ((monotonic_ns() - began_ns) * 1e-9 % 1.0)
            page.mouse.move(box["x"] + share * box["width"], box["y"] + share * box["height"])
            page.wait_for_timeout(50)
        ages_ms, pointer_ms, frames_ms = page.evaluate(LISTS)
        wall_s = (monotonic_ns() - began_ns) * 1e-9
        chromium.close()
    return {
        "sample_to_pixel_ms": quantiles(ages_ms), "pointer_to_values_ms": quantiles(pointer_ms),
        "draw_ms": quantiles(frames_ms), "drawn_per_s": round(len(frames_ms) / wall_s, 1),
    }


def stops(count: int) -> list[float]:
    """From a click at a browser's end to the call that stops the rig, at the station's end (ms)."""
    heard: queue.SimpleQueue[int] = queue.SimpleQueue()
    taken_ms: list[float] = []
    with ExitStack() as ends:
        link = LiveLink()
        ends.callback(link.close)
        door = StopSocket(Path(link.station_socket), lambda _: heard.put(monotonic_ns()))
        ends.callback(door.close)
        page = PageProcess.start(PageSettings(live=str(link.folder)))
        ends.callback(page.close)
        connection = ends.enter_context(connect_now(f"{socket_of(page.url)}&client=s", max_size=None))
        threading.Thread(target=lambda: list(connection), daemon=True).start()
        while len(taken_ms) < count:
            clicked_ns = monotonic_ns()
            connection.send('{"do": "stop"}')
            taken_ms.append((heard.get(timeout=10.0) - clicked_ns) * 1e-6)
            link.take()
            time.sleep(0.05)
    return taken_ms


def quantiles(values: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(values, [50, 99])
    return {"n": len(values), "p50": round(float(p50), 1), "p99": round(float(p99), 1), "worst": round(max(values), 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="?", choices=("cost", "periods"), default="cost")
    parser.add_argument("--minutes", type=float, default=5.0, help="of each row of periods")
    parser.add_argument("--poll-ms", type=float, default=4.0, help="periods: the station's")
    parser.add_argument("--no-real-time", action="store_true", help="periods: the station without real-time priority")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--viewers", type=int, default=1)
    parser.add_argument("--stops", type=int, default=200)
    parser.add_argument("--bench", action="store_true", help="the page of a bench instead of a run's")
    parser.add_argument("--no-browser", action="store_true")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    if arguments.what == "periods":
        counted = periods(arguments.minutes, arguments.poll_ms, not arguments.no_real_time)
        print(json.dumps(counted) if arguments.json else table(counted))
        return
    browser = not arguments.no_browser and shutil.which("chromium") is not None
    with tempfile.TemporaryDirectory() as folder:
        found = {"machine": platform.machine(), "cores": os.cpu_count(), "load": round(os.getloadavg()[0], 1)}
        found |= cost(Path(folder), arguments.seconds, arguments.viewers, browser, bench=arguments.bench)
        if arguments.stops:
            found["stop_ms"] = quantiles(stops(arguments.stops))
    if arguments.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:<20}{value}")


if __name__ == "__main__":
    main()
