"""A working day at a bench through its page alone, in a real Chromium, with a picture of every step.

    python benchmarks/page_day.py --out FOLDER [--speed 5]

A simulated rig with the devices of `examples/demo-bench.toml`; the page is opened at 1366 x 768, once on a phone. From
an empty folder of runs: a matrix that does not fit, one that does, start, stop, report, resume with its question, the
next specimen, a matrix changed after its plan, history, report as PDF. At most at a speed of 5: the stop must come
within the first point. The script ends with an error where a step does not succeed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync", "--disable-dev-shm-usage"]
WAIT_MS = 300_000
CONTROL = "document.getElementById('standing').textContent.startsWith('You have control')"


class Day:
    """Steps of the day on one browser page."""

    def __init__(self, page: Page, out: Path, lab: Path) -> None:
        self._page, self._out, self._lab = page, out, lab
        self._count, self._began_s = 0, time.monotonic()
        page.set_default_timeout(WAIT_MS)
        page.on("pageerror", lambda error: sys.exit(f"error on the page: {error}"))

    def picture(self, name: str, *, whole: bool = False) -> None:
        """Take a picture."""
        self._count += 1
        self._page.wait_for_timeout(300)
        self._page.screenshot(path=str(self._out / f"{self._count:02d}-{name}.png"), full_page=whole)
        sys.stdout.write(f"{time.monotonic() - self._began_s:6.1f} s  {name}\n")

    def until(self, condition: str) -> None:
        """Wait for a condition in the page."""
        self._page.wait_for_function(condition)

    def plan(self, name: str, condition: str = "rigBench.plan") -> None:
        """Choose a matrix and wait for its plan."""
        self._page.click(f"#matrices button:has-text('{name}')")
        self.until(condition)

    def start(self, serial_number: str) -> None:
        """Start what is planned, with the keyboard, and see it move."""
        self._page.fill("#serial", serial_number)
        self._page.press("#serial", "Enter")
        self.see_it_move()

    def see_it_move(self) -> None:
        """Wait for the view of the run, and for cycles."""
        self._page.wait_for_url("**/run?*")
        self.until("rigPage.state.phase === 'running' && rigPage.state.cycles >= 2")

    def end(self, verdict: str) -> None:
        """Wait for the run's end and its report, then go back to the bench."""
        self.until(f"document.getElementById('verdict').textContent === '{verdict}'")
        self._page.wait_for_selector("#to-report:not([hidden])")
        self.picture(f"run-{verdict}")
        self._page.click("#to-bench")
        self.until(f"window.rigBench && rigBench.runs.length && {CONTROL}")

    def report(self) -> None:
        """Open the report of the last run."""
        with self._page.context.expect_page() as opened:
            self._page.click("#last-report")
        opened.value.wait_for_load_state()
        opened.value.screenshot(path=str(self._out / "report.png"))
        opened.value.close()

    def make_pdf(self) -> None:
        """Have the report of the last run written as PDF."""
        self._page.click("#history button:has-text('Make PDF')")
        self._page.wait_for_selector("#history a:has-text('PDF')")
        self.picture("pdf")

    def work(self, url: str) -> None:
        """The day."""
        page = self._page
        page.goto(url)
        self.until("document.querySelectorAll('#matrices li').length")
        self.picture("bench")
        page.fill("#name", "Ada")
        page.press("#name", "Enter")
        self.until(CONTROL)
        self.plan("too-large.toml")
        self.picture("outside-limits")
        self.plan("quick.toml", "rigBench.plan && rigBench.plan.feasible")
        self.picture("plan")
        self.start("MR-101")
        self.picture("run")
        page.keyboard.press("s")
        self.end("STOPPED")
        self.picture("bench-after-a-stop")
        self.report()
        page.click("#resume-last")
        page.wait_for_selector("#confirm input")
        self.picture("questions")
        page.focus("#confirm input")
        page.keyboard.press("Space")
        page.press("#resume-now", "Enter")
        self.see_it_move()
        self.end("OK")
        self.until("rigBench.plan && rigBench.plan.matrix === 'quick.toml'")  # the page remembers it
        matrix = self._lab / "quick.toml"
        matrix.write_text(matrix.read_text() + "# changed after it was planned\n")
        page.fill("#serial", "MR-102")
        page.press("#serial", "Enter")
        self.until("document.getElementById('verdict').textContent === 'REFUSED' && rigBench.plan")
        self.picture("changed-and-planned-anew")
        self.start("MR-102")
        self.end("OK")
        self.picture("history")
        self.make_pdf()
        page.set_viewport_size({"width": 390, "height": 844})
        self.picture("phone", whole=True)


def main() -> None:
    """Serve the page of a bench, and work at it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures and of everything else")
    parser.add_argument("--speed", default="5")
    arguments = parser.parse_args()
    out: Path = arguments.out.resolve()
    lab = out / "lab"
    lab.mkdir(parents=True)
    for name in ("quick.toml", "table1.toml", "demo-bench.toml"):
        shutil.copy(ROOT / "examples" / name, lab)
    quick = (lab / "quick.toml").read_text()
    (lab / "too-large.toml").write_text(quick.replace('["30 mm"]', '["200 mm"]'))
    command = [
        sys.executable, "-m", "rig.cli.main", "page", "--bench", str(lab / "demo-bench.toml"), "--simulate", "--speed",
        arguments.speed, "--out", str(out / "logs"),
    ]  # fmt: skip
    environment = {**os.environ, "XDG_STATE_HOME": str(out / "state")}
    server = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        line = "" if server.stderr is None else server.stderr.readline()
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1366, "height": 768}, bypass_csp=True)
            Day(page, out, lab).work(line.removeprefix("page: ").strip())
            browser.close()
    finally:
        server.terminate()
        server.communicate()
    runs = sorted(run.name for run in (out / "logs").iterdir() if run.is_dir())
    sys.stdout.write(json.dumps({"runs": runs}) + "\n")


if __name__ == "__main__":
    main()
