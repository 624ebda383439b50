"""First runs next to busy processes: every one must end with exit code 0 and every point valid.

    python benchmarks/first_runs_under_load.py [--busy 2 4 8] [--repeats 2] [--only CASE...] [--json FILE]

Cases: `quick`, `rig run examples/quick.toml --simulate`; `page`, the same with `--page` and a browser tab on it (needs
Playwright and Chromium; left out without them); `demo`, `rig demo`; `cold`, `rig demo` with an empty compilation cache,
as on a new computer. `dev.py demo` is `cold` after an installation.

Each case runs next to N processes that use as much of the processors as they get. Exit code 1 when one case fails.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from campaign_process import machine

from rig.clock import machine_ns, utc_now

QUICK = Path(__file__).resolve().parent.parent / "examples" / "quick.toml"
RIG = [sys.executable, "-m", "rig.cli.main"]
RUN = ["run", str(QUICK), "--simulate", "--json"]
CASES = {"quick": RUN, "page": [*RUN, "--page"], "demo": ["demo", "--json"], "cold": ["demo", "--json"]}
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
BROWSER = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
           "--disable-background-networking", "--disable-component-update", "--disable-sync")  # fmt: skip
LONGEST_S = 900.0
TAB = re.compile(r"page: (\S+)")


@dataclass(frozen=True)
class Run:
    """How one run ended."""

    case: str
    busy: int
    exit_code: int
    valid: int
    total: int
    stopped_by: str | None
    took_s: float
    motion_s: float
    load: float

    @property
    def good(self) -> bool:
        """Exit code 0, and every point valid."""
        return self.exit_code == 0 and self.total > 0 and self.valid == self.total

    def __str__(self) -> str:
        stopped = "" if self.stopped_by is None else self.stopped_by
        return (f"{self.case:6} {self.busy:4} {self.exit_code:5} {self.valid:3}/{self.total:<3} {self.took_s:7.0f} "
                f"{self.motion_s:7.1f} {self.load:5.1f}  {stopped}")  # fmt: skip


@contextlib.contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """So many processes that never rest."""
    busy = [subprocess.Popen([sys.executable, "-S", "-E", "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


@contextlib.contextmanager
def browser_tab(address: str) -> Iterator[None]:
    """A tab of a browser that shows the page while the block runs."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(BROWSER))
        tab = browser.new_page()
        tab.goto(address, timeout=1e3 * LONGEST_S)
        try:
            yield
        finally:
            browser.close()


def run(case: str, busy: int, folder: Path) -> Run:
    """One run from beginning to end."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")} if case == "cold" else None
    command = [*RIG, *CASES[case], "--out", str(folder / "runs")]
    with busy_processes(busy):
        began_ns = machine_ns()
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        ) as process, contextlib.ExitStack() as ends:
            assert process.stderr is not None
            for line in process.stderr:
                if case == "page" and (found := TAB.search(line)):
                    ends.enter_context(browser_tab(found[1]))
                    break
            rest = threading.Thread(target=process.stderr.read, daemon=True)
            rest.start()
            assert process.stdout is not None
            output = process.stdout.read()
            exit_code = process.wait(LONGEST_S)
        took_s, load = 1e-9 * (machine_ns() - began_ns), os.getloadavg()[0]
    answer: dict[str, Any] = json.loads(output) if output.strip() else {}
    return Run(case, busy, exit_code, answer.get("valid", 0), answer.get("total", 0), answer.get("stopped_by"), took_s,
               answer.get("motion_s", 0.0), load)  # fmt: skip


def main() -> int:
    """Run every case next to every number of busy processes, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--busy", type=int, nargs="+", default=[2, 4, 8])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", choices=list(CASES), nargs="+", default=list(CASES))
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    cases = [case for case in given.only if case != "page" or CHROMIUM is not None]
    print(f"{utc_now():%Y-%m-%d}, {machine()}, load {os.getloadavg()[0]:.1f} at the start")
    print("case   busy  exit valid   wall s motion s load  stopped by")
    runs = []
    for _ in range(given.repeats):
        for busy in given.busy:
            for case in cases:
                with tempfile.TemporaryDirectory(prefix="first-runs-") as folder:
                    runs.append(run(case, busy, Path(folder)))
                print(runs[-1], flush=True)
    good = sum(one.good for one in runs)
    print(f"{good} of {len(runs)} with exit code 0 and every point valid")
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(one) for one in runs], indent=1), encoding="utf-8")
    return 0 if good == len(runs) else 1


if __name__ == "__main__":
    sys.exit(main())
