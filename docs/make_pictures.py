"""Take the pictures in README.md on the simulated rig: `python3 dev.py pictures` (4 min; needs Chromium).

`examples/table1.toml` runs at twice real time. The operator's page is captured during the run. After the run, the
script captures the first screen of the report, the two printed pages for a customer, and the page of the bench with a
plan.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pypdfium2
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
PAGES = {"page": (1366, 940, 1.0), "page-phone": (390, 844, 1.0), "page-4k": (3840, 2160, 0.5)}
"""Picture of the page: width and height of the window, and the factor by which the picture is scaled."""
BENCH_SIZE = {"width": 1366, "height": 768}
REPORT_SIZE = {"width": 1366, "height": 768}
PAPER_SCALE = 1.35
"""Pixels per point of the printed pages."""
SPEED = "2"
WAIT_MS = 600_000
COLOURS = 192
WHEN = """() => Object.keys(rigPage.results).length >= 8 && rigPage.state.phase === 'running'
  && rigPage.state.cycles >= 4 && document.getElementById('verdict').textContent === 'OK'"""
SELECTED = "rigPage.selected.filter(one => one && one.series).length === 2"
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


def take_pages(browser: Browser, url: str, out: Path) -> None:
    """The page while the campaign runs, with two finished points over the running one."""
    for name, (width, height, scale) in PAGES.items():
        # The page's policy forbids evaluated scripts, by which playwright waits.
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="light", bypass_csp=True)
        page.goto(url)
        page.wait_for_function(WHEN, timeout=WAIT_MS)
        for point in ("p002", "p006"):
            page.locator(f"#matrix [aria-label='loops of {point}']").click()
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_function(SELECTED, timeout=WAIT_MS)
        page.wait_for_function(WHEN, timeout=WAIT_MS)
        keep(page.screenshot(), out / f"{name}.png", scale)
        page.close()


def take_bench(browser: Browser, runs: Path, out: Path) -> None:
    """The page of a bench with the plan of a matrix and the runs on file."""
    command = [
        sys.executable, "-m", "rig.cli.main", "page", "--bench", str(ROOT / "examples" / "demo-bench.toml"),
        "--simulate", "--speed", SPEED, "--json", "--out", str(runs),
    ]  # fmt: skip
    environment = {**os.environ, "XDG_STATE_HOME": str(runs)}
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        lines = process.stdout or ()
        url = json.loads(b"".join(line for _, line in zip(range(3), lines, strict=False)))["page"]
        page = browser.new_page(viewport=BENCH_SIZE, color_scheme="light", bypass_csp=True)
        page.goto(url)
        page.locator("#name").fill("A. Operator")
        page.locator("#take").click()
        page.locator("#matrices [data-name='table1.toml']").click()
        page.wait_for_selector("#plan table", timeout=WAIT_MS)
        page.locator("#serial").fill("MR-002")
        page.mouse.move(0, 0)
        page.evaluate("document.querySelector('footer').hidden = true")  # folders and the address of this computer
        keep(page.screenshot(), out / "page-bench.png")
        page.close()
    finally:
        process.terminate()
        process.communicate()


def take_report(browser: Browser, report: Path, out: Path) -> None:
    """The first screen of the report."""
    page = browser.new_page(viewport=REPORT_SIZE, color_scheme="light")
    page.goto(report.as_uri())
    keep(page.screenshot(), out / "report.png")
    page.close()


def take_paper(campaign: Path, out: Path) -> None:
    """The two printed pages for a customer, side by side."""
    details = ROOT / "examples" / "customer.toml"
    command = [sys.executable, "-m", "rig.cli.main", "report", str(campaign), "--pdf", "--summary", "--details",
               str(details), "--json"]  # fmt: skip
    written = json.loads(subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout)
    sheets = [sheet.render(scale=PAPER_SCALE).to_pil() for sheet in pypdfium2.PdfDocument(written["pdf"])]
    gap = 12
    both = Image.new("RGB", (sum(one.width + gap for one in sheets) + gap, sheets[0].height + 2 * gap), "#9aa5b1")
    for place, one in enumerate(sheets):
        both.paste(one, (gap + place * (one.width + gap), gap))
    content = io.BytesIO()
    both.save(content, "PNG")
    keep(content.getvalue(), out / "report-pages.png")


def keep(picture: bytes, path: Path, scale: float = 1.0) -> None:
    """Save a PNG with few colours: half the size without a visible difference."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    if scale != 1.0:
        image = image.resize((round(scale * image.width), round(scale * image.height)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def main() -> int:
    """Make all; returns the exit code."""
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
            take_pages(browser, url, out)
            result = json.loads(process.communicate(timeout=WAIT_MS / 1e3)[0])
        finally:
            if process.poll() is None:
                process.terminate()
        take_report(browser, Path(result["report"]), out)
        take_paper(Path(result["campaign"]), out)
        take_bench(browser, Path(folder), out)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
