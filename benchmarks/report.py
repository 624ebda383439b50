"""What a report costs: CPU seconds, megabytes and pages of the page, the PDF and the summary of one campaign.

    python benchmarks/report.py RUN           a recorded campaign
    python benchmarks/report.py               Table 1 (20 points), recorded first on the simulated rig at speed 50

Limits: the page of a 20-point campaign in under 5 s and 3 MB, its summary on 2 pages.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from campaign_process import run

from rig.document.pdf import pdf
from rig.recording.run import Run
from rig.report.document import written_report

T = TypeVar("T")
TABLE_1 = Path(__file__).resolve().parent.parent / "examples" / "table1.toml"
MB = 1e6


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What was made, and the CPU time (s) of the second of two runs: the first one loads the libraries."""
    make()
    before = time.process_time()
    made = make()
    return made, time.process_time() - before


def run_report(folder: Path) -> None:
    (page, document), page_s = timed(lambda: written_report(folder))
    paper, paper_s = timed(lambda: pdf(document))
    summary, summary_s = timed(lambda: pdf(document.sheets))
    print(f"{len(Run.open(folder).points)} points")
    print(f"page  {page_s:.2f} s of CPU, {page.stat().st_size / MB:.2f} MB")
    print(f"PDF   {paper_s:.2f} s of CPU, {len(paper) / MB:.2f} MB, {pages_of(paper)} pages")
    print(f"summary {summary_s:.2f} s of CPU, {len(summary) / MB:.2f} MB, {pages_of(summary)} pages")


def pages_of(paper: bytes) -> int:
    return len(re.findall(rb"/Type\s*/Page\b", paper))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="?", type=Path)
    given = parser.parse_args().run
    if given is not None:
        run_report(given)
        return
    with tempfile.TemporaryDirectory() as folder:
        answer = run(TABLE_1, Path(folder), speed=50.0)
        run_report(Path(answer.json["campaign"]))


if __name__ == "__main__":
    main()
