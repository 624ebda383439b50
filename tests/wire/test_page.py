"""A day at a bench, in a real browser and through its page alone: choose, start, watch, stop, resume, report."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

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
[identify]
enabled = false
"""
COUNT_INK = """id => {
  const c = document.getElementById(id), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let sum = 0;
  for (let i = 0; i < d.length; i += 4) sum = (sum * 31 + d[i] + 7 * d[i + 3]) >>> 0;
  return sum;
}"""


class BenchPage:
    """`rig page --bench` in a process, which may be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.logs = folder, folder / "logs"
        (folder / "matrix.toml").write_text(MATRIX)
        shutil.copy(ROOT / "examples" / "demo-bench.toml", folder / "bench.toml")
        self.process = self._started()
        self.url = self._address()

    def _started(self) -> subprocess.Popen[str]:
        command = [
            sys.executable, "-m", "rig.cli.main", "page", "--bench", "bench.toml", "--simulate", "--speed", "2",
            "--out", str(self.logs),
        ]  # fmt: skip
        environment = {**os.environ, "XDG_STATE_HOME": str(self.folder / "state"), "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(command, cwd=self.folder, env=environment, stderr=subprocess.PIPE, text=True)

    def _address(self) -> str:
        line = "" if self.process.stderr is None else self.process.stderr.readline()
        assert line.startswith("page: "), line
        return line.removeprefix("page: ").strip()

    def killed_and_started_again(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.process = self._started()
        assert self._address() == self.url, "the address lasts"

    def close(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate()
        return self.process.returncode

    @property
    def run(self) -> Path:
        (run,) = (folder for folder in self.logs.iterdir() if folder.is_dir())
        return run


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[BenchPage]:
    made = BenchPage(tmp_path)
    yield made
    if made.process.poll() is None:
        made.close()


def verdict(page: Page, text: str) -> None:
    page.wait_for_function(f"document.getElementById('verdict').textContent === '{text}'", timeout=WAIT_MS)


def start(page: Page) -> None:
    """Take control, choose the matrix, read its plan, enter the next specimen, start; without a mouse from there."""
    page.fill("#name", "Ada")
    page.press("#name", "Enter")
    page.click("text=matrix.toml")
    page.wait_for_function("rigBench.plan && rigBench.plan.feasible", timeout=WAIT_MS)
    assert page.evaluate("document.getElementById('plan').textContent").startswith("1 point within limits")
    low = page.evaluate("document.getElementById('start').getBoundingClientRect().bottom")
    assert low < page.viewport_size["height"], "above the fold"
    page.fill("#serial", "MR-002")
    page.press("#serial", "Enter")
    page.wait_for_url("**/run?*", timeout=WAIT_MS)


def loops_move(page: Page) -> Any:  # noqa: ANN401 - numbers of a browser
    """Wait for the motion and see it; the newest forces (N)."""
    page.wait_for_function(
        "rigPage.state.phase === 'running' && rigPage.state.cycles >= 2 && rigPage.series.has(203)", timeout=WAIT_MS
    )
    pictures = {page.evaluate(COUNT_INK, "fx")}
    for _ in range(3):
        page.wait_for_timeout(200)
        pictures.add(page.evaluate(COUNT_INK, "fx"))
    assert len(pictures) > 1, "the loops stand still"
    return page.evaluate("rigPage.series.get(1).y.slice(-200)")


def questions(page: Page) -> None:
    """Back at the bench: the stop must be confirmed before the run can be resumed; then its report is opened."""
    page.click("#to-bench")
    page.click("#resume-last")
    page.wait_for_selector("#confirm input", timeout=WAIT_MS)
    # the page was started again since somebody took control
    assert "by a browser (without control)" in page.evaluate("document.getElementById('confirm').textContent")
    page.fill("#name", "Ada")
    page.press("#name", "Enter")
    page.wait_for_function("document.getElementById('standing').textContent.startsWith('You have control')")
    assert page.is_disabled("#resume-now")
    page.check("#confirm input")
    page.wait_for_function("!document.getElementById('resume-now').disabled", timeout=WAIT_MS)
    with page.context.expect_page() as opened:
        page.click("#last-report")
    opened.value.wait_for_load_state()
    assert "MR-002" in opened.value.title()
    assert opened.value.url.partition("token=")[2] != page.url.partition("token=")[2], "a viewer's address"
    opened.value.close()


@pytest.mark.wire
@pytest.mark.skipif(CHROMIUM is None and "CI" not in os.environ, reason="no chromium on this machine")
def test_a_run_is_planned_started_watched_and_stopped_from_the_page_which_may_be_killed_meanwhile(
    bench: BenchPage
) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        page = browser.new_page(viewport={"width": 1366, "height": 768}, bypass_csp=True)  # it waits by evaluating
        page.set_default_timeout(WAIT_MS)
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        own = bench.url[:16]
        page.on("request", lambda request: wrong.append(request.url) if not request.url.startswith(own) else None)
        page.goto(bench.url)
        start(page)
        loops_move(page)
        bench.killed_and_started_again()
        page.reload()
        forces = loops_move(page)
        page.keyboard.press("s")
        verdict(page, "STOPPED")
        page.wait_for_function("!rigPage.state.running")
        page.wait_for_selector("#to-report:not([hidden])")
        questions(page)
        browser.close()
    assert [line for line in wrong if not line.startswith(("data:", "blob:", "ws://127.0.0.1"))] == []
    assert bench.close() == 0
    result = json.loads(next((bench.folder / "state").rglob("started.out")).read_text())
    assert (result["stopped_by"], result["rig_state"]) == ("operator", "safe")
    assert Path(result["campaign"]) == bench.run
    assert "MR-002" in bench.run.name
    assert json.loads((bench.run / "operator.json").read_text())["operator"] == "Ada"
    recorded = h5py.File(next((bench.run / "points").glob("p001*.h5")))
    raw = np.float32(recorded["entry/raw/force/value"][:])
    assert np.isin(np.float32(forces), raw).all(), "what was shown is what was recorded"
    truth = h5py.File(bench.run / "truth.h5")["entry/data"]
    assert np.ptp(truth["displacement"][:]) > 0.055, "it moved"
    assert np.ptp(truth["displacement"][-50:]) < 1e-3, "it stands still"
    assert np.abs(truth["current"][-20:]).max() < 0.05, "the coil is empty"
