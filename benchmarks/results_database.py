"""The results database with 10,000 specimens: time of every query of a dashboard; stations that write at once.

    python benchmarks/results_database.py [--specimens 10000] [--part charts] [--results URL]

The campaigns are synthetic rows (5 points with 17 quantities, a fit with 9 parameters, 6 accepted values, 2
calibrations). Ten processes write 1,000 of them into one SQLite file at the same time, each campaign twice, within 15
minutes, and the rows are counted. With --results, the database on the server must be empty: the rows are delivered to
it by ten processes at the same time, each with its own folder, and counted.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select, text

from rig.errors import FileProblem
from rig.results.connection import Database, folder_database, server
from rig.results.content import Content
from rig.results.delivery import deliver
from rig.results.filling import optimise, put
from rig.results.quantities import QUANTITIES
from rig.results.reader import ResultFilter, result_rows
from rig.results.schema import RESULTS

DASHBOARD = Path(__file__).parents[1] / "examples" / "grafana" / "damper-tests.json"
STATIONS, POINTS, REPEATS = 10, 5, 5
BATCH = 50
WRITTEN, LONGEST_S = 1_000, 900.0
"""Campaigns that the writers of one SQLite file write, each of them twice, and the time that they have for it (s)."""
OTHER_TESTS = ("gas_", "friction_", "coil_rate", "response_", "endurance_", "hybrid_")
NAMES = [name for name in QUANTITIES if not name.startswith(OTHER_TESTS)]
PARAMETERS = ("Fya", "Fyb", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus", "Kb", "beta", "delta")
FIRST = datetime(2026, 1, 1, tzinfo=UTC)
CHOSEN = {
    "${__from:date:iso}": "2025-01-01T00:00:00.000Z", "${__to:date:iso}": "2035-12-31T00:00:00.000Z",
    "${quantity}": "rebound_force", "${motion}": "sine 30 mm 2 Hz", "${current}": "0.5", "${parameter}": "Fya",
    "${simulated}": "excluded",
}  # fmt: skip


def contents(count: int) -> Iterator[Content]:
    draw = random.Random(1)
    for number in range(count):
        started = FIRST + timedelta(minutes=20 * number)
        campaign_id = f"{number:08x}-0000-5000-8000-000000000000"
        row = {
            "campaign_id": campaign_id, "run": f"{started:%Y%m%dT%H%M%SZ}-MR-{number:05d}-{number:06x}",
            "station": f"line {number % STATIONS}", "specimen": f"MR-{number:05d}", "operator": f"person {number % 3}",
            "matrix": "line.toml", "matrix_sha256": "a" * 64, "bench": "bench", "started": started,
            "software": "mr-damper-rig 1.0.0", "simulated": False, "imported": False, "planned_points": POINTS,
            "recorded_points": POINTS, "valid_points": POINTS, "bench_verdict": "valid",
            "specimen_verdict": "not-ok" if number % 50 == 0 else "ok",
        }  # fmt: skip
        children: dict[str, list[dict[str, Any]]] = {name: [] for name in (
            "points", "characteristics", "fits", "parameters", "verdicts", "calibrations",
        )}  # fmt: skip
        for point in range(POINTS):
            motion = {"motion": "sine 30 mm 2 Hz", "waveform": "sine", "amplitude_m": 0.03, "frequency_hz": 2.0,
                      "current_a": 0.5 * point}  # fmt: skip
            children["points"].append({
                "point": f"p{point:03d}", "kind": "loop", **motion, "centre_m": 0.0,
                "cycles": 7.0, "repeat": 1, "recorded": started, "verdict": "valid", "reasons": "", "lost_samples": 0,
                "skew_s": 0.0, "skew_standard_uncertainty_s": 1e-4,
            })  # fmt: skip
            children["characteristics"] += [{
                "point": f"p{point:03d}", "quantity": name, "subject": QUANTITIES[name].subject, **motion,
                "recorded": started, "point_verdict": "valid", "repeat": 1, "value": 1000.0 + draw.gauss(0.0, 10.0),
                "unit": QUANTITIES[name].unit, "standard_uncertainty": 2.0, "repeatability_uncertainty": 1.0,
                "calibration_uncertainty": 1.7,
            } for name in NAMES]  # fmt: skip
        children["fits"] = [{"model": "asymmetric", "method": "separable", "adequate": True,
                             "rmse_n": 5.0, "nrmse_percent": 0.9, "tests": POINTS, "sha256": "b" * 64}]  # fmt: skip
        children["parameters"] = [{
            "parameter": name, "value": draw.gauss(100.0, 5.0), "unit": "N",
            "standard_uncertainty": 1.0, "low": 98.0, "high": 102.0, "identifiable": True, "reason": "",
        } for name in PARAMETERS]  # fmt: skip
        children["verdicts"] = [{
            "subject": subject, "item": item, "verdict": verdict, "reason": "",
            "bands": "", "decision": "", "quantity": "rebound_force", "location": "sine, 30 mm, 2 Hz, 0.5 A",
            "value": 1000.0, "expanded_uncertainty": 4.0, "low": 900.0, "high": 1100.0, "margin": 100.0, "unit": "N",
        } for subject, item, verdict in (
            ("bench", 0, "valid"), ("specimen", 0, row["specimen_verdict"]),
            *(("specimen", item, "fail" if item == 1 and number % 50 == 0 else "pass") for item in range(1, 7)),
        )]  # fmt: skip
        children["calibrations"] = [{
            "channel": channel, "sensor": channel, "serial_number": f"S{number % STATIONS}",
            "certificate": "C-1", "due": "2027-01-01", "overdue": False, "sensitivity": 1.0, "offset_value": 0.0,
            "uncertainty_percent": 0.2, "range_value": 10.0, "unit": "N",
        } for channel in ("force", "displacement")]  # fmt: skip
        yield Content(row, children)


def fill(database: Database, made: list[Content]) -> None:
    """Insert many campaigns at once, as `put` does one after the other."""
    shared = {"filled_by": "benchmark", "filled": datetime.now(UTC)}
    with database.transaction() as connection:
        for name in ("station", "specimen"):
            known = [{name: value} for value in sorted({one.campaign[name] for one in made})]
            connection.execute(insert(RESULTS.tables[f"{name}s"]), known)
        rows = [{**one.campaign, "digest": one.digest, **shared} for one in made]
        connection.execute(insert(RESULTS.tables["campaigns"]), rows)
        numbers = {row.campaign_id: row.campaign for row in connection.execute(select(RESULTS.tables["campaigns"]))}
        for name in made[0].children:
            connection.execute(insert(RESULTS.tables[name]), [
                {**row, "campaign": numbers[one.campaign_id]} for one in made for row in one.children[name]
            ])


def queries() -> dict[str, str]:
    dashboard = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    found = {panel["title"]: panel["targets"][0]["rawSql"] for panel in dashboard["panels"]}
    found |= {f"variable {one['name']}": one["query"] for one in dashboard["templating"]["list"]
              if one["type"] == "query"}  # fmt: skip
    found["all results of one specimen"] = "SELECT * FROM results WHERE specimen = 'MR-00777'"
    found["mean of every quantity"] = "SELECT quantity, count(*), avg(value) FROM characteristics GROUP BY quantity"
    for name, value in CHOSEN.items():
        found = {title: query.replace(name, value) for title, query in found.items()}
    return found


def measure(database: Database, what: str) -> None:
    slowest = 0.0
    for title, query in queries().items():
        took, used = [], []
        with database.transaction(reading=True) as connection:
            for _ in range(REPEATS):
                begun, begun_cpu = time.perf_counter(), time.process_time()
                rows = len(connection.exec_driver_sql(query).all())
                took.append(time.perf_counter() - begun)
                used.append(time.process_time() - begun_cpu)
        slowest = max(slowest, statistics.median(took))
        print(f"{what}: {title}: {rows} rows, median {statistics.median(took):.3f} s, "
              f"best {min(took):.3f} s, own CPU {min(used):.3f} s")  # fmt: skip
    for wanted in (ResultFilter(quantity="energy", current_A=0.5), ResultFilter(specimen="MR-00777"),
                   ResultFilter(date="2026-02-03")):  # fmt: skip
        begun, begun_cpu = time.perf_counter(), time.process_time()
        rows = sum(1 for _ in result_rows(database, wanted))
        given = {name: value for name, value in vars(wanted).items() if value is not None}
        print(f"{what}: reader {given}: {rows} rows, {time.perf_counter() - begun:.3f} s, "
              f"own CPU {time.process_time() - begun_cpu:.3f} s")  # fmt: skip
    print(f"{what}: slowest chart {slowest:.3f} s")


def write_all(folder: Path, made: list[Content]) -> None:
    """Write campaigns in batches as `rig results` does, and all of them a second time.

    SQLite does not serve writers in the order of their arrival: one that waits for too long tries again, as the next
    update would.
    """
    waiting = [made[first : first + BATCH] for first in range(0, len(made), BATCH)] * 2
    deadline_s = time.monotonic() + LONGEST_S
    while waiting:
        if time.monotonic() > deadline_s:
            sys.exit(f"{len(waiting)} batches not written within {LONGEST_S:g} s")
        try:
            with folder_database(folder) as database, database.transaction() as connection:
                for one in waiting[0]:
                    put(connection, one.campaign, one.children, one.digest)
        except FileProblem:  # the file was locked for too long
            continue
        waiting.pop(0)


def many_writers(made: list[Content], root: Path) -> None:
    folder, begun = root / "shared", time.perf_counter()
    folder.mkdir()
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=write_all, args=(folder, made[number::STATIONS])) for number in range(STATIONS)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    took = time.perf_counter() - begun
    assert [writer.exitcode for writer in writers] == [0] * STATIONS
    with folder_database(folder) as database:
        count(database, made, f"SQLite: {STATIONS} writers at once, every campaign twice: {took:.1f} s")


def count(database: Database, made: list[Content], what: str) -> None:
    """Compare the number of rows with what was written."""
    with database.transaction(reading=True) as connection:
        counts = {
            name: connection.execute(text(f"SELECT count(*) FROM {name}")).scalar_one() for name in RESULTS.tables
        }
        digests = set(connection.execute(text("SELECT digest FROM campaigns")).scalars())
    expected = {name: sum(len(one.children[name]) for one in made) for name in made[0].children}
    expected |= {"campaigns": len(made)}
    assert all(counts[name] == number for name, number in expected.items()), (counts, expected)
    assert digests == {one.digest for one in made}
    print(f"{what}; {len(made)} campaigns, nothing lost, nothing twice: {counts}")


def station(folder: Path, url: str) -> None:
    with folder_database(folder) as database:
        state = deliver(database, url)
    print(json.dumps(state.to_json()))


def many_stations(made: list[Content], url: str, root: Path) -> None:
    folders = []
    for number in range(STATIONS):
        folder = root / f"station{number}"
        folder.mkdir()
        with folder_database(folder) as database:
            fill(database, made[number::STATIONS])
        folders.append(folder)
    begun = time.perf_counter()
    command = [sys.executable, __file__, "--station"]
    started = [
        subprocess.Popen([*command, str(folder), "--results", url], stdout=subprocess.PIPE) for folder in folders
    ]
    states = [json.loads(process.communicate()[0]) for process in started]
    took = time.perf_counter() - begun
    assert all(state["waiting"] == 0 and state["error"] is None for state in states), states
    with server(url) as database:
        count(database, made, f"PostgreSQL: {STATIONS} stations at once: {took:.1f} s")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--specimens", type=int, default=10_000)
    arguments.add_argument("--results", metavar="URL")
    arguments.add_argument("--part", choices=("charts", "writers", "stations"), help="do only this part")
    arguments.add_argument("--station", type=Path, help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.station is not None:
        station(given.station, given.results)
        return
    with tempfile.TemporaryDirectory(prefix="results-") as place:
        root, made = Path(place), list(contents(given.specimens))
        if given.part in {None, "charts"}:
            charts(made, root)
        if given.part in {None, "writers"}:
            many_writers(made[:WRITTEN], root)
        if given.part in {None, "stations"} and given.results is not None:
            many_stations(made, given.results, root)
            with server(given.results) as database:
                optimise(database)
                measure(database, "PostgreSQL")


def charts(made: list[Content], root: Path) -> None:
    """Fill one SQLite file and measure every query."""
    begun = time.perf_counter()
    with folder_database(root) as database:
        fill(database, made)
        optimise(database)
        print(f"SQLite: {len(made)} campaigns written in {time.perf_counter() - begun:.1f} s, "
              f"{Path(database.place).stat().st_size / 1e6:.0f} MB")  # fmt: skip
        measure(database, "SQLite")


if __name__ == "__main__":
    main()
