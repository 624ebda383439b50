"""`rig quality` over a database of 10,000 specimens, and the coverage of its intervals.

    python benchmarks/quality.py [--specimens 10000] [--studies 1000]

Charts: reading, evaluation and drawing of one value of 10,000 campaigns, each with 10 values, from the SQLite file;
CPU time, best of five. Coverage: share of simulated studies whose 95 % interval contains the true value. False alarms:
share of days without drift on which the golden-damper check signals.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from rig.document import html
from rig.process_quality import gauge_study as gauge_module
from rig.process_quality.capability import process_capability
from rig.process_quality.document import document_of
from rig.process_quality.gauge_study import gauge_study
from rig.process_quality.golden import Key, golden_check
from rig.process_quality.study import Limits, chart_study
from rig.results.connection import folder_database
from rig.results.filling import put
from rig.results.reader import ResultFilter, result_rows

QUANTITIES = ("rebound_force", "jounce_force", "energy", "damping", "coil_temperature")
CURRENTS_A = (0.0, 1.0)


def campaigns(count: int) -> Iterator[tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]]:
    random = np.random.default_rng(0)
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    for number in range(count):
        name, started = f"campaign-{number:05d}", begin + timedelta(minutes=number)
        campaign = {
            "campaign_id": name, "run": name, "station": "bench 1", "specimen": f"SP-{number:05d}", "operator": "A",
            "matrix": "m.toml", "matrix_sha256": "", "bench": "bench", "started": started, "software": "",
            "simulated": False, "imported": False, "planned_points": 2, "recorded_points": 2, "valid_points": 2,
            "bench_verdict": "valid", "specimen_verdict": "ok",
        }  # fmt: skip
        points, values = [], []
        for place, current in enumerate(CURRENTS_A):
            motion = {"motion": "sine 30 mm 1 Hz", "waveform": "sine", "amplitude_m": 0.03, "frequency_hz": 1.0,
                      "current_a": current}  # fmt: skip
            one = {"campaign_id": name, "point": f"p{place}", **motion}
            points.append({**one, "kind": "loop", "centre_m": 0.0, "cycles": 5.0, "repeat": 1, "recorded": started,
                           "verdict": "valid", "reasons": "", "lost_samples": 0, "skew_s": 0.0,
                           "skew_standard_uncertainty_s": 0.0})  # fmt: skip
            for quantity in QUANTITIES:
                values.append({**one, "quantity": quantity, "subject": "specimen", "unit": "N",
                               "point_verdict": "valid",
                               "value": 500.0 + 5.0 * random.standard_normal(), "standard_uncertainty": 1.0,
                               "repeatability_uncertainty": 1.0, "calibration_uncertainty": None})  # fmt: skip
        yield campaign, {"points": points, "characteristics": values}


def charts(count: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        with folder_database(folder) as database:
            with database.transaction() as connection:
                for campaign, children in campaigns(count):
                    put(connection, campaign, children, "digest")
            best: dict[str, float] = {}
            for _ in range(5):
                spent = [time.process_time()]
                rows = list(result_rows(database, ResultFilter(quantity="rebound_force", current_A=1.0)))
                spent.append(time.process_time())
                study = chart_study(rows, limits=Limits(low=470.0, high=530.0))
                spent.append(time.process_time())
                html.page(document_of(study, simulated=False))
                spent.append(time.process_time())
                parts = dict(zip(("read", "evaluate", "draw"), np.diff(spent), strict=True)) | {
                    "all": spent[-1] - spent[0]
                }
                best = {name: min(one, best.get(name, 9e9)) for name, one in parts.items()}
        assert len(rows) == count
        shown = ", ".join(f"{name} {1e3 * one:.0f} ms" for name, one in best.items())
        print(f"one chart of {count} campaigns, CPU: {shown}")


def coverage(studies: int) -> None:
    random = np.random.default_rng(1)
    gauge_module.DRAWS = 4000
    repeat, operator, part = 0.3, 0.2, 1.0
    gauge = float(np.hypot(repeat, operator))
    for operators, missing in product((3, 6), (0.0, 0.5)):
        inside = np.zeros(4)
        for _ in range(studies):
            values = (part * random.standard_normal((10, 1, 1)) + operator * random.standard_normal((1, operators, 1))
                      + repeat * random.standard_normal((10, operators, 3)))  # fmt: skip
            values[:, :, 1:][random.random((10, operators, 2)) < missing] = np.nan
            study = gauge_study(values)
            one, categories = study.components, 1.41 * part / gauge
            percent = 100.0 * gauge / float(np.hypot(gauge, part))
            inside += [
                one["repeatability"].low <= repeat <= one["repeatability"].high,
                one["gauge"].low <= gauge <= one["gauge"].high,
                one["gauge"].study_low <= percent <= one["gauge"].study_high,
                study.categories[1] <= categories <= study.categories[2],
            ]  # fmt: skip
        shown = zip(("repeatability", "gauge", "%GRR", "ndc"), 100.0 * inside / studies, strict=True)
        print(f"gauge study, 10 x {operators} x 3, {missing:.0%} of trials 2 and 3 missing:", end=" ")
        print(", ".join(f"{name} {share:.1f} %" for name, share in shown))
    for count in (10, 25, 50, 200):
        inside = np.zeros(4)
        for _ in range(studies):
            capable = process_capability(random.normal(0.5, 1.0, count), -4.0, 4.0)
            indices = (capable.cp, capable.cpk, capable.pp, capable.ppk)
            true = (4.0 / 3.0, 3.5 / 3.0, 4.0 / 3.0, 3.5 / 3.0)
            inside += [index is not None and index.low <= value <= index.high
                       for index, value in zip(indices, true, strict=True)]  # fmt: skip
        shown = zip(("Cp", "Cpk", "Pp", "Ppk"), 100.0 * inside / studies, strict=True)
        print(f"capability of {count} values: " + ", ".join(f"{name} {share:.1f} %" for name, share in shown))


def false_alarms(histories: int) -> None:
    random = np.random.default_rng(2)
    keys = {Key(name, "sine", current): value for current in (0.0, 1.0) for name, value in (
        ("rebound_force", 180.0 + 320.0 * current), ("jounce_force", -280.0 - 320.0 * current),
        ("energy", 46.0 + 64.0 * current), ("damping", 1840.0 + 2560.0 * current), ("measured_amplitude", 0.03),
    )}  # fmt: skip
    keys[Key("coil_temperature", "sine", 1.0)] = 25.0
    for baseline in (25, 50, 15, 8):
        signals, days = 0, baseline + 35
        for _ in range(histories):
            warmer_K = random.normal(0.0, 1.0, days)
            values = {key: value * (1.0 + 0.002 * random.standard_normal(days) - 0.005 * warmer_K * (key.quantity in {
                "rebound_force", "jounce_force", "energy", "damping"})) for key, value in keys.items()}  # fmt: skip
            values[Key("coil_temperature", "sine", 1.0)] = 25.0 + warmer_K
            signals += len(golden_check(values, baseline).findings)
        share = 100.0 * signals / (histories * (days - baseline))
        print(f"golden damper, {baseline} days in phase I: {share:.2f} % of days without drift signal")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--specimens", type=int, default=10_000)
    arguments.add_argument("--studies", type=int, default=1000)
    given = arguments.parse_args()
    charts(given.specimens)
    coverage(given.studies)
    false_alarms(max(20, given.studies // 2))


if __name__ == "__main__":
    main()
