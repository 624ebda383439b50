"""Every row of the fault matrix as a stranger sees it: when it is noticed, when the rig is stopped, how it ends.

    python benchmarks/detection_times.py [SLUG...] [--repeats 5] [--resume] [--json FILE]

Each run starts `python -m simulators --real-time` and, on the bench file that prints, `rig run`, both at speed 1.
The fault comes while the second point moves; another seed each time. What happened is read from the truth file, the
journal and the points' files. Exit code 1 when a row does not end as the matrix says. Times are compared with the row's
maximum, which holds on a quiet machine with real-time rights; one that is exceeded is marked and fails nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from fault_case import Case, case_of, environment
from fault_outcome import Disturbed, Outcome, outcome_of
from watched_campaign import Campaign, Ending, resumed, wait_until

from rig.faults.matrix import MATRIX
from rig.faults.row import FaultRow

SETTLE_S = 1.0
"""What a stopped rig's truth still shows (its own clock): the coil empty, the rod at rest."""
START_S, STOP_S, AT_REST_S = 120.0, 60.0, 20.0
IN_MOTION_S = 0.8
FLAGGED_FIRST = ("W", "as 20")
"""Rows whose maximum is the flag's: the stop comes when it stays."""
SAMPLE_S, COUNTS_SAMPLES_S = 0.004, 0.012
COLUMNS = (
    "row", "limit", "runs",
    "detected, ms: min / median / p95 / max", "stop on the wire, ms", "standstill, ms", "0 A, ms",
    "stop", "ends as its row says",
)  # fmt: skip


def start_rig(place: Path, seed: int, *arguments: str) -> tuple[subprocess.Popen[str], Path]:
    """`python -m simulators` as a process of its own; returns it and the bench file it printed."""
    command = [sys.executable, "-m", "simulators", "--real-time", "--seed", str(seed)]
    command += ["--truth", str(place / "truth.h5"), *arguments]
    rig = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )
    assert rig.stdout is not None
    bench = rig.stdout.readline().strip()
    assert bench, f"{command} did not start"
    return rig, Path(bench)


def run_case(case: Case, place: Path, seed: int) -> Ending:
    """One fault from beginning to end."""
    matrix, out, seam = place / "matrix.toml", place / "out", place / "seam"
    matrix.write_text(case.matrix.text, encoding="utf-8")
    out.mkdir()
    seam.mkdir()
    rig, bench = start_rig(place, seed, *case.faults)
    try:
        command = [
            *case.program,
            "run",
            str(matrix),
            "--bench",
            str(bench),
            "--out",
            str(out),
            "--no-identify",
            "--json",
        ]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(seam)
        )
        campaign = Campaign(process, out, place / "truth.h5")
        injected_ns = None
        if case.inject is not None:
            try:
                campaign.wait_for("START", count=2)
                campaign.run_on(IN_MOTION_S)
            except AssertionError as error:
                raise Disturbed(str(error)[-200:]) from error
            injected_ns = case.inject(campaign, seam)
        ending = campaign.finish(injected_ns)
        if case.row.slug == "sigkill":
            wait_until(lambda: campaign.happened("HYDRAULICS_OFF"), "the station's stop", AT_REST_S)
        settled_s = campaign.simulated_s + SETTLE_S
        wait_until(lambda: campaign.simulated_s >= settled_s, "the rig's clock", AT_REST_S)
    finally:
        rig.send_signal(signal.SIGTERM)
        rig.wait(STOP_S)
    return ending


def resumes(ending: Ending, place: Path) -> list[str]:
    """What is wrong with continuing the campaign on a sound rig."""
    (place / "again").mkdir()
    kept = (ending.folder / "points" / "p001.h5").read_bytes()
    rig, bench = start_rig(place / "again", 0)
    try:
        code, answer = resumed(ending.folder, "--bench", str(bench))
    finally:
        rig.send_signal(signal.SIGTERM)
        rig.wait(STOP_S)
    wrong = [] if code == 0 else [f"resumed with exit {code}: {answer.get('stopped_by') or answer.get('error')}"]
    if (ending.folder / "points" / "p001.h5").read_bytes() != kept:
        wrong.append("p001 was changed by resuming")
    return wrong


def measure(slug: str, repeats: int, *, resume: bool) -> list[Outcome]:
    """All runs of one row; one that a busy machine disturbed before the fault is told of and repeated."""
    case = case_of(slug)
    if case is None:
        return []
    outcomes: list[Outcome] = []
    count = 1 if case.row.end == "R" else repeats
    for seed in range(1, 2 * count + 3):
        if len(outcomes) == count:
            break
        with tempfile.TemporaryDirectory(prefix="fault-") as name:
            place = Path(name)
            try:
                ending = run_case(case, place, seed)
                outcome = outcome_of(case, ending)
            except Disturbed as disturbance:
                print(f"{slug}: run {seed} disturbed by {disturbance}", file=sys.stderr, flush=True)
                continue
            if resume and not outcomes and case.row.end in {"S2", "S1", "SO", "P"} and not outcome.wrong:
                outcome.wrong += resumes(ending, place)
            outcomes.append(outcome)
    return outcomes


def in_ms(values: list[float]) -> str:
    """Smallest, median, 95th percentile and largest, in ms; a dash where there is nothing."""
    found = [1e3 * value for value in values if not math.isnan(value)]
    if not found:
        return "-"
    return " / ".join(f"{value:.0f}" for value in (min(found), *np.percentile(found, [50, 95]), max(found)))


def limit_s(row: FaultRow) -> float:
    """The row's maximum (s): twice as long on a serial line; a fault falls between two samples; inf without a time."""
    if row.limit_s is None:
        return math.inf
    between = SAMPLE_S if row.place == "sensor" and row.limit_s <= COUNTS_SAMPLES_S else 0.0
    return row.limit_s * (2.0 if row.place == "rtu" else 1.0) + between


def line(slug: str, outcomes: list[Outcome]) -> str:
    """A row of the table."""
    row = MATRIX[slug]
    stops = [each.stop_s for each in outcomes]
    counted = [each.detected_s for each in outcomes] if row.reaction.startswith(FLAGGED_FIRST) else stops
    late = any(time_s > limit_s(row) for time_s in counted)
    wrong = [problem for each in outcomes for problem in each.wrong]
    verdict = "; ".join(sorted(set(wrong))) if wrong else "late" if late else "ok"
    rest = [
        max((1e3 * getattr(each, name) for each in outcomes), default=math.nan)
        for name in ("standstill_s", "current_s")
    ]
    shown = " | ".join("-" if math.isnan(value) else f"{value:.0f}" for value in rest)
    detected = in_ms([each.detected_s for each in outcomes])
    return (
        f"| {slug} | {row.limit} | {len(outcomes)} | {detected} | {in_ms(stops)} | {shown} | {row.end} | {verdict} |"
    )


def main() -> int:
    """Run the rows, print the table as it grows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slugs", nargs="*", metavar="SLUG", help="rows; all without")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--resume", action="store_true", help="also continue each stopped campaign on a sound rig")
    parser.add_argument("--json", type=Path, help="write every run's times here")
    given = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    found: dict[str, list[Outcome]] = {}
    for slug in given.slugs or MATRIX:
        found[slug] = measure(slug, given.repeats, resume=given.resume)
        if found[slug]:
            print(line(slug, found[slug]), flush=True)
    print(f"\nload {os.getloadavg()[0]:.1f}; proved by the fault suite alone: "
          f"{', '.join(slug for slug, each in found.items() if not each) or 'none'}")  # fmt: skip
    if given.json is not None:
        runs = {slug: [asdict(each) for each in outcomes] for slug, outcomes in found.items()}
        given.json.write_text(json.dumps(runs, indent=1), encoding="utf-8")
    return int(any(each.wrong for outcomes in found.values() for each in outcomes))


if __name__ == "__main__":
    sys.exit(main())
