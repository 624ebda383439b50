"""The pictures in README.md, of a campaign on the simulated rig: `python3 dev.py pictures` (2 minutes; wants Chromium).

`examples/table1.toml` is run five times faster than life; the page is taken while it runs, the report at its end.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
SIZE = {"width": 1440, "height": 1270}
REPORT_SIZE = {"width": 1366, "height": 1130}
SPEED = "5"
WAIT_MS = 600_000
COLOURS = 96
WHEN = """() => Object.keys(rigPage.results).length >= 8 && rigPage.state.phase === 'running'
  && rigPage.state.cycles >= 4 && document.getElementById('verdict').textContent === 'OK'"""
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync")


def started(out: Path) -> tuple[subprocess.Popen[str], str]:
    """The campaign's process, and where its page is.

    Raises:
        RuntimeError: it ended without a page; its lines are in the message.
    """
    command = [
        sys.executable, "-m", "rig.cli.main", "run", str(ROOT / "examples" / "table1.toml"), "--simulate",
        "--speed", SPEED, "--page", "--json", "--out", str(out),
    ]  # fmt: skip
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines: list[str] = []
    for line in process.stderr or ():
        lines.append(line)
        if line.startswith("page: "):
            threading.Thread(target=lambda: list(process.stderr or ()), daemon=True).start()
            return process, line.removeprefix("page: ").strip()
    raise RuntimeError("".join(lines))


def take_page(browser: Browser, url: str, out: Path) -> None:
    """The page while the campaign runs."""
    page = browser.new_page(viewport=SIZE, color_scheme="light", bypass_csp=True)  # it waits by evaluating
    page.goto(url)
    page.wait_for_function(WHEN, timeout=WAIT_MS)
    keep(page.screenshot(), out / "page.png")
    page.close()


def take_report(browser: Browser, report: Path, out: Path) -> None:
    """The first screen of the report."""
    page = browser.new_page(viewport=REPORT_SIZE, color_scheme="light")
    page.goto(report.as_uri())
    keep(page.screenshot(), out / "report.png")
    page.close()


def keep(picture: bytes, path: Path) -> None:
    """As a PNG of few colours: a third of the size, and nobody sees a difference."""
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def main() -> int:
    """Make both; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=PICTURES)
    out: Path = parser.parse_args().out
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.stderr.write("no `chromium` on the path; on Debian: apt-get install chromium\n")
        return 2
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="pictures-") as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(ARGUMENTS))
        process, url = started(Path(folder))
        try:
            take_page(browser, url, out)
            result = json.loads(process.communicate(timeout=WAIT_MS / 1e3)[0])
        finally:
            if process.poll() is None:
                process.terminate()
        take_report(browser, Path(result["report"]), out)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
