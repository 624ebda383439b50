"""A real browser opens the page of a running campaign, sees its loops move, and stops it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium")
ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
)  # fmt: skip
WAIT_MS = 120_000
MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
mid_stroke = "0 mm"
prior = "demo"
[matrix]
waveform = ["sine"]
amplitude = ["30 mm"]
frequency = ["1 Hz"]
current = ["1 A"]
cycles = 400
"""
COUNT_INK = """id => {
  const c = document.getElementById(id), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let sum = 0;
  for (let i = 0; i < d.length; i += 4) sum = (sum * 31 + d[i] + 7 * d[i + 3]) >>> 0;
  return sum;
}"""


class RunningCampaign:
    """`rig run --simulate --page` in a process, its lines read as they come."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "matrix.toml").write_text(MATRIX)
        command = [
            sys.executable, "-m", "rig.cli.main", "run", str(folder / "matrix.toml"), "--simulate", "--speed", "2",
            "--page", "--no-identify", "--json", "--out", str(folder / "out"),
        ]  # fmt: skip
        self.process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        self.url = ""
        self._known = threading.Event()
        self.lines: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self.process.stderr or ():
            self.lines.append(line)
            if line.startswith("page: "):
                self.url = line.removeprefix("page: ").strip()
                self._known.set()

    def opened(self) -> str:
        assert self._known.wait(WAIT_MS / 1e3), self.lines
        return self.url

    def result(self) -> dict[str, Any]:
        output, _ = self.process.communicate(timeout=WAIT_MS / 1e3)
        return dict(json.loads(output))


@pytest.fixture
def running(tmp_path: Path) -> Iterator[RunningCampaign]:
    made = RunningCampaign(tmp_path)
    yield made
    if made.process.poll() is None:
        made.process.terminate()
        made.process.communicate()


@pytest.mark.wire
@pytest.mark.skipif(CHROMIUM is None and "CI" not in os.environ, reason="no chromium on this machine")
def test_a_browser_sees_the_loops_move_and_stops_the_rig(running: RunningCampaign) -> None:
    from playwright.sync_api import sync_playwright

    url = running.opened()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        page = browser.new_page(viewport={"width": 1366, "height": 768}, bypass_csp=True)  # it waits by evaluating
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if not request.url.startswith(url[:16]) else None)
        page.goto(url)
        page.wait_for_function(
            "rigPage.state.phase === 'running' && rigPage.state.cycles >= 2 && rigPage.series.has(203)", timeout=WAIT_MS
        )
        pictures = {page.evaluate(COUNT_INK, "fx")}
        for _ in range(3):
            page.wait_for_timeout(200)
            pictures.add(page.evaluate(COUNT_INK, "fx"))
        assert len(pictures) > 1, "the loops stand still"
        forces = page.evaluate("rigPage.series.get(1).y.slice(-200)")
        page.keyboard.press("s")
        page.wait_for_function("document.getElementById('verdict').textContent === 'STOPPED'", timeout=WAIT_MS)
        browser.close()
    assert [line for line in wrong if not line.startswith(("data:", "blob:", "ws://127.0.0.1"))] == []
    result = running.result()
    assert (running.process.returncode, result["stopped_by"], result["rig_state"]) == (4, "operator", "safe")
    assert result["page"] == url
    recorded = h5py.File(next(Path(result["campaign"], "points").glob("p001*.h5")))
    raw = np.float32(recorded["entry/raw/force/value"][:])
    assert np.isin(np.float32(forces), raw).all(), "what was shown is what was recorded"
    truth = h5py.File(Path(result["campaign"], "truth.h5"))["entry/data"]
    assert np.ptp(truth["displacement"][:]) > 0.055, "it moved"
    assert np.ptp(truth["displacement"][-50:]) < 1e-3, "it stands still"
    assert np.abs(truth["current"][-20:]).max() < 0.05, "the coil is empty"
