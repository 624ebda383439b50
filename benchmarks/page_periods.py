"""Whether the operator's page costs the station a period: streamed set-points left out with the page, and without it.

Called by `page.py periods`. A whole campaign, `rig run`, streams a slow sine (at 250 Hz by default) to a simulated rig
in another process, once for each row: without a page; with ten viewers; with ten viewers and the page standing still
(SIGSTOP) from the first seconds of the motion to its end; with ten viewers and the page killed then. The rows take
turns of a minute: what the machine does by itself in some minute (it leaves out 0.02 to 2 % of the set-points, page or
no page) then falls on all of them, not on one. The counts are the station's own. The viewers are one process on the
same cores: more than ten tablets would cost this machine.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from campaign_process import family, sines
from setpoints import AMPLITUDE, FREQUENCY_HZ, be_patient, has_priority, simulated_rig, stations_of
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

VIEWERS = 10
GOAL_POINTS = 0.1
"""Percentage points above the row without a page."""
TURN_MINUTES = 1.0
UNDER_WAY_S = 5.0
ROWS = ("no page", "ten viewers", "page stopped", "page killed")
SIGNALS = {"page stopped": signal.SIGSTOP, "page killed": signal.SIGKILL}


def periods(minutes: float, poll_ms: float, real_time: bool) -> dict[str, Any]:
    """Every row: set-points due and left out (of a hundred), lateness (ms), frames that the viewers got."""
    turns = max(1, round(minutes / TURN_MINUTES))
    counted: dict[str, list[dict[str, Any]]] = {row: [] for row in ROWS}
    with tempfile.TemporaryDirectory(prefix="page-periods-") as name, simulated_rig(Path(name), real_time) as bench:
        be_patient(bench, poll_ms)
        for turn in range(turns):
            folder = Path(name) / str(turn)
            folder.mkdir()
            for row in ROWS:
                counted[row].append(Campaign(row, bench, 60.0 * minutes / turns, folder).counted())
    rows = {row: _together(found) for row, found in counted.items()}
    without = rows["no page"]["left_out_percent"]
    above = {row: round(found["left_out_percent"] - without, 3) for row, found in rows.items()}
    whole = all(found["stopped_by"] is None for found in rows.values())
    within = whole and all(points <= GOAL_POINTS for points in above.values())
    return {"minutes": minutes, "turns": turns, "rows": rows, "points_above": above, "within": within}


def _together(turns: list[dict[str, Any]]) -> dict[str, Any]:
    """One row over its turns: sums of what is counted, the worst of what is late, each turn's share left out."""
    due, left_out = (sum(turn[name] for turn in turns) for name in ("due", "left_out"))
    return {
        "due": due, "left_out": left_out, "left_out_percent": round(100.0 * left_out / max(1, due), 3),
        "each_percent": [turn["left_out_percent"] for turn in turns],
        "p99_ms": max(turn["p99_ms"] for turn in turns), "worst_ms": max(turn["worst_ms"] for turn in turns),
        "frames": sum(turn["frames"] for turn in turns),
        "exit_code": max(turn["exit_code"] for turn in turns),
        "stopped_by": next((turn["stopped_by"] for turn in turns if turn["stopped_by"]), None),
        "real_time_percent": min(turn["real_time_percent"] for turn in turns),
    }  # fmt: skip


class Campaign:
    """One row's campaign, and what is done to its page meanwhile."""

    def __init__(self, row: str, bench: Path, seconds: float, folder: Path) -> None:
        self._row = row
        self._frames = 0
        matrix = folder / "matrix.toml"
        cycles = max(3, round(seconds * FREQUENCY_HZ))
        text = sines([f"{FREQUENCY_HZ:g} Hz"], ["0 A"], AMPLITUDE, cycles, identify=False)
        matrix.write_text(text, encoding="utf-8")
        self._out = folder / row.replace(" ", "-")
        self._command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--bench", str(bench), "--json"]
        self._command += ["--out", str(self._out), *(["--page"] if row != "no page" else [])]

    def counted(self) -> dict[str, Any]:
        """Run it to its end.

        Raises:
            RuntimeError: it did not stream, or there was no page to stop.
        """
        held: list[bool] = []
        hit = self._row not in SIGNALS
        with subprocess.Popen(self._command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            threading.Thread(target=self._watch, args=(running,), daemon=True).start()
            moving_s: float | None = None
            while running.poll() is None:
                time.sleep(0.5)
                held += [has_priority(process) for process in stations_of(running.pid)]
                moving_s = moving_s or (time.monotonic() if self._moves() else None)
                if not hit and moving_s and time.monotonic() - moving_s > UNDER_WAY_S:
                    os.kill(_page_of(running.pid), SIGNALS[self._row])
                    hit = True
            answer = json.loads(running.stdout.read() if running.stdout is not None else "")
        setpoints = answer.get("setpoints")
        if not setpoints or not hit:
            raise RuntimeError(f"{self._row}: the campaign ended with {running.returncode}: {answer.get('error')}")
        return {
            "due": setpoints["steps"], "left_out": setpoints["skipped"],
            "left_out_percent": round(100.0 * setpoints["skipped"] / max(1, setpoints["steps"]), 3),
            "p99_ms": round(1e3 * setpoints["p99_s"], 2), "worst_ms": round(1e3 * setpoints["worst_s"], 1),
            "frames": self._frames, "exit_code": running.returncode, "stopped_by": answer["stopped_by"],
            "real_time_percent": round(100.0 * sum(held) / max(1, len(held))),
        }  # fmt: skip

    def _moves(self) -> bool:
        """The point has begun: its own journal is being written."""
        return any(self._out.glob("*/points/*.journal"))

    def _watch(self, running: subprocess.Popen[str]) -> None:
        """Read what it says; as soon as it names its page, look at that with so many browsers."""
        for line in running.stderr or ():
            if line.startswith("page: "):
                threading.Thread(target=lambda url: asyncio.run(self._look(url)), args=(line[6:].strip(),)).start()

    async def _look(self, url: str) -> None:
        socket = url.replace("http", "ws", 1).replace("/?", "/ws?", 1)

        async def one(number: int) -> None:
            with suppress(OSError, WebSocketException):  # the end of the page is what is tried here
                async with connect(f"{socket}&client=v{number}", max_size=None) as connection:
                    async for message in connection:
                        self._frames += isinstance(message, bytes)

        await asyncio.gather(*map(one, range(VIEWERS)))


def _page_of(parent: int) -> int:
    for process in family(parent):
        if b"rig.page" in Path(f"/proc/{process}/cmdline").read_bytes():
            return process
    raise RuntimeError("the campaign has no page")


def table(found: dict[str, Any]) -> str:
    """For people."""
    names = (("set-points", 11), ("left out", 10), ("%", 8), ("points above", 14), ("worst p99", 10), ("worst", 10))
    lines = [" " * 14 + "".join(f"{name:>{width}}" for name, width in (*names, ("frames", 9)))]
    for name, row in found["rows"].items():
        lines.append(
            f"{name:<14}{row['due']:>11}{row['left_out']:>10}{row['left_out_percent']:>8.3f}"
            f"{found['points_above'][name]:>14.3f}{row['p99_ms']:>7.2f} ms{row['worst_ms']:>7.1f} ms{row['frames']:>9}"
        )
        lines.append(f"{'':14}each turn: " + ", ".join(f"{each:g}" for each in row["each_percent"]) + " %")
    early = [f"{name} ({row['stopped_by']})" for name, row in found["rows"].items() if row["stopped_by"]]
    rights = min(row["real_time_percent"] for row in found["rows"].values())
    text = "within" if found["within"] else "NOT within"
    ended = f"no answer, ended early: {', '.join(early)}" if early else f"{text} {GOAL_POINTS:g} points"
    lines.append(f"{ended}; real-time priority at least {rights} % of the time; load {os.getloadavg()[0]:.1f}")
    return "\n".join(lines)
