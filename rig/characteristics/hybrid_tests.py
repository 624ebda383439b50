"""The hybrid tests of a run: each compared with the whole car computed, which is written beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.hybrid.assessment import Assessment, Record, assess
from rig.matrix.assumed_damper import AssumedDamper
from rig.matrix.hybrid_table import HybridTable
from rig.matrix.model import load_matrix
from rig.recording.atomic_write import inner_folder, write_text_durably
from rig.recording.journal.campaign_log import read_lines
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray
from rig.test_point import HYBRID
from rig.vehicle.laws import Law, law_named
from rig.vehicle.motion import Ride

COLUMNS = (
    "time_s", "target_m", "seen_m", "body_m", "wheel_m", "reference_extension_m", "reference_body_m",
    "reference_wheel_m",
)
"""Of the file beside a test."""

@dataclass(frozen=True)
class HybridTest:
    """One test of a run.

    Attributes:
        id: of its point.
        compensator: what led the set-points.
        law: what commanded the current.
        verdict: of its point.
        record: its course; None where too little was recorded.
        numbers: what the record says; None where there is none.
        reported: what the station said of it: steps, delay (s), energy share, late set-points.
    """

    id: str
    compensator: str
    law: Law
    verdict: str
    record: Record | None
    numbers: Assessment | None
    reported: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """The keys of one entry of `tests` in `hybrid.json` and `rig run --json`."""
        numbers, reported = self.numbers, self.reported
        delay_s = reported.get("delay_s")
        return {
            "id": self.id,
            "compensation": self.compensator,
            "law": self.law,
            "verdict": self.verdict,
            "steps": reported.get("steps", 0),
            "late_steps": reported.get("late_steps"),
            "p99_step_ms": reported.get("p99_step_ms"),
            "delay_ms": None if delay_s is None else 1e3 * delay_s,
            "energy_error": reported.get("energy_share"),
            "tracking_nrms": None if numbers is None else numbers.tracking_nrms,
            "reference_error": None if numbers is None else numbers.reference_error,
            "hop_error": None if numbers is None else numbers.hop_error,
            "criteria": {} if numbers is None else numbers.criteria,
        }


def hybrid_tests(run: Run) -> tuple[HybridTest, ...]:
    """Every hybrid test of a run that was recorded, in the run's order; none where the run has none.

    Raises:
        FileProblem: the run's matrix file cannot be read.
    """
    points = [point for point in run.points if point.kind == HYBRID]
    if not points:
        return ()
    matrix = load_matrix(CampaignFolder(run.path).matrix)
    assumed = matrix.specimen.assumed
    if matrix.hybrid is None or assumed is None:
        raise FileProblem(str(CampaignFolder(run.path).matrix), ["has no [hybrid] table, but the run contains hybrid "
            "tests"])
    lines = read_lines(run.path)
    return tuple(_test(point, matrix.hybrid, assumed, lines) for point in points)


def write_hybrid(run: Run, tests: Sequence[HybridTest]) -> Path:
    """Write `hybrid.json`, and beside it the course of each test with its reference: `reference/ID.csv`.

    Raises:
        OSError: the disk refuses.
    """
    folder = inner_folder(run.path, CampaignFolder.reference)
    for test in tests:
        if test.record is not None:
            rows = [",".join(COLUMNS), *(",".join(f"{value:.9g}" for value in row) for row in _rows(test.record))]
            write_text_durably(folder / f"{test.id}.csv", "\n".join(rows) + "\n")
    path = CampaignFolder(run.path).hybrid
    write_text_durably(path, json.dumps(answer(tests), indent=1, allow_nan=False) + "\n")
    return path


def answer(tests: Sequence[HybridTest]) -> dict[str, Any]:
    """The numbers of the first test, which is the compensated one as far as there is one, and of all."""
    entries = [test.to_json() for test in tests]
    led = next((entry for entry in entries if entry["compensation"] != "none"), entries[0] if entries else {})
    names = (
        "steps", "late_steps", "p99_step_ms", "tracking_nrms", "reference_error", "hop_error", "delay_ms",
    )
    return {**{name: led.get(name) for name in names}, "criteria": led.get("criteria", {}), "tests": entries}


def _rows(record: Record) -> Iterator[FloatArray]:
    columns = (record.time_s, record.target_m, record.measured_m, record.body_m, record.wheel_m)
    yield from np.column_stack([*columns, record.reference_m])


def _test(
    point: RecordedPoint, table: HybridTable, prior: AssumedDamper, lines: Sequence[Mapping[str, Any]]
) -> HybridTest:
    raw = {name: point.raw(f"hybrid_{name}") for name in ("time", "target", "seen", "body", "wheel")}
    compensator = str(point.id).removeprefix("hybrid-").partition("-")[0]
    law = law_named(point.law)
    verdict = point.quality.verdict.verdict
    times = raw["time"]
    if times is None or any(values is None for values in raw.values()):
        return HybridTest(point.id, compensator, law, verdict, None, None, {})
    reported = {
        **_reported(lines, int(times["host_ns"][0]), int(times["host_ns"][-1])), "steps": int(times["sequence"][-1]),
    }  # fmt: skip
    columns = {name: values for name, values in raw.items() if values is not None}
    record = _record(columns, table.quarter_car(prior, law).reference())
    numbers = None if record is None else assess(record)
    return HybridTest(point.id, compensator, law, verdict, record, numbers, reported)


def _record(raw: Mapping[str, Mapping[str, Any]], reference: tuple[float, Ride]) -> Record | None:
    """Everything on equal steps of the test's own time."""
    count = min(len(values["value"]) for values in raw.values())
    columns = {name: np.asarray(values["value"], np.float64)[:count] for name, values in raw.items()}
    # While set-points wait for the rod or the computer, the test's own time stands still: one sample of each instant.
    going = np.concatenate(([True], np.diff(columns["time"]) != 0.0)) if count else np.zeros(0, bool)
    columns = {name: values[going] for name, values in columns.items()}
    count, test_s = len(columns["time"]), columns["time"]
    known = np.isfinite(columns["seen"])
    if count < 3 or not np.all(np.diff(test_s) > 0.0) or not known.any():
        return None
    time_s = np.arange(test_s[0], test_s[-1], float(np.median(np.diff(test_s))))
    reference_step_s, ride = reference
    whole_s = np.arange(len(ride.time_s)) * reference_step_s
    targets = np.column_stack([
        np.interp(time_s, whole_s, values)
        for values in (ride.extension_m[:, 0], ride.place[:, 0], ride.place[:, 1])
    ])
    target, body, wheel = (np.interp(time_s, test_s, columns[name]) for name in ("target", "body", "wheel"))
    seen = np.interp(time_s, test_s[known], columns["seen"][known])
    return Record(time_s, target, seen, body, wheel, targets)


def _reported(lines: Sequence[Mapping[str, Any]], first_ns: int, last_ns: int) -> dict[str, Any]:
    """What the station said of the test recorded between two host times: its last word, and the set-points' counts.

    Counts of set-points are those of the whole motion, delay measurement and return included; the lateness is that of
    all set-points of the session so far.
    """
    reported: dict[str, Any] = {}
    before = {"late": 0, "steps": 0}
    for line in lines:
        at_ns = line.get("t_ns")
        if line.get("event") != "station" or not isinstance(at_ns, int):
            continue
        if line.get("what") == "hybrid" and first_ns <= at_ns:
            if at_ns > last_ns and line.get("phase") == "probe":
                break
            reported |= {name: line.get(name) for name in ("delay_s", "energy_share")}
        if line.get("what") == "setpoints":
            if at_ns < first_ns:
                before = {name: int(line.get(name) or 0) for name in before}
            elif "late_steps" not in reported:
                p99_s = line.get("p99_s")
                same_session = int(line.get("steps") or 0) >= before["steps"]  # a new one counts from 0
                reported["late_steps"] = int(line.get("late") or 0) - (before["late"] if same_session else 0)
                reported["p99_step_ms"] = 1e3 * p99_s if isinstance(p99_s, float) and math.isfinite(p99_s) else None
    return reported
