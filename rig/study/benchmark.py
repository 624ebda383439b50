"""The public benchmark: every model and method on open recordings, with split and scorer fixed for all entries.

An entry is fitted to what a split gives it and scored on the rest: NRMSE, 100 x RMSE / max|F - mean F| of each unseen
test, averaged over all of them; and the share of the unseen force's variance that is explained.
"""

from __future__ import annotations

import hashlib
import importlib.util
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers.catalogue import MODELS
from rig.dampers.covered import in_words
from rig.errors import RigError
from rig.fits.entries import ErrorSummary, TestError, mean_within
from rig.identification import Measurement, Method, identify
from rig.identification.models.coverage import beyond, covered_by
from rig.identification.models.measurement import first_cycle, spaced, thinned
from rig.identification.models.solving import THREE_STEPS, known_methods, solve
from rig.identification.models.undetermined import examine
from rig.identification.reference import references
from rig.identification.uncertainty.scoring import score, with_extrapolations
from rig.jobs.choice import workers_for
from rig.jobs.time_left import TimeLeft
from rig.jobs.workers import Job
from rig.plugins import DAMPER_MODELS, METHODS
from rig.plugins import found as plug_ins
from rig.study.benchmark_file import SEPARABLE, BenchmarkFile, load_benchmark
from rig.study.execution import StudyProgress
from rig.study.open_recordings import Fold, Found, find_all, folds_of, variance_percent
from rig.study.outputs import Table, write_outputs
from rig.study.provenance import SOFTWARE, provenance
from rig.study.results import ResultsFile

REFERENCE = "reference"
SEARCHED_A_CYCLE = 125
SEARCHED_OF_RECORD = 5000
COLUMNS = (
    "recordings", "model", "method", "validation NRMSE / % of peak", "validation variance explained / %",
    "worst test / % of peak", "without extrapolated tests / % of peak", "fitted NRMSE / % of peak", "evaluations",
    "CPU / s", "note",
)  # fmt: skip
EARLIER_NAMES = {
    "validation NRMSE / % of peak": "unseen NRMSE / % of peak",
    "validation variance explained / %": "unseen variance explained / %",
    "without extrapolated tests / % of peak": "without those beyond the data / % of peak",
}
SCORER = (
    "NRMSE of a test: 100 x RMSE / max|F - mean F|; the tables show the mean over all validation tests. Models are "
    "simulated in open loop: the inputs are motion and current, never a measured force. Methods other than separable "
    "are fitted to one cycle of each test, or to every n-th sample of a record without cycles, and are evaluated on "
    "all samples. Extrapolated: validation tests with a displacement, velocity, current or temperature outside the "
    "range of the fitted tests of the split."
)


@dataclass(frozen=True)
class BenchmarkOutcome:
    """A finished benchmark.

    Attributes:
        page: the HTML page.
        table: all entries, best first within their recordings.
        facts: name, tests, entries, what is lacking, wall seconds.
    """

    page: Path
    table: Table
    facts: dict[str, Any]


def run_benchmark(
    path: Path,
    folder: Path,
    processes: int | None = None,
    report: Callable[[StudyProgress], None] | None = None,
    scheduler: str | None = None,
) -> BenchmarkOutcome:
    """Run a benchmark (or its missing entries), and write its table and page.

    Args:
        path: benchmark file.
        folder: folder of the results; entries with a result are not run again.
        processes: number of worker processes; None: one per processor; 1: fit the entries in this process.
        report: called at the start and after every entry.
        scheduler: address of a Dask scheduler whose workers fit the entries; they need the recordings under the same
            path.

    Raises:
        FileProblem: the file is wrong, no recordings are complete (the message names their sources), or the folder
            contains results of another benchmark.
        RigError: the scheduler or its workers cannot be used.
    """
    started_ns = time.monotonic_ns()
    benchmark = load_benchmark(path)
    sets = find_all(benchmark, path.absolute().parent)
    folder.mkdir(parents=True, exist_ok=True)
    entries = [(one, *pair) for one in sets if one.complete for pair in competitors(benchmark)]
    report_progress = report or (lambda progress: None)
    with ResultsFile(folder / "results.jsonl", benchmark.fingerprint) as results:
        todo = [entry for entry in entries if _key(*entry) not in results]
        done = len(entries) - len(todo)
        report_progress(StudyProgress(done, len(entries), None, "", "fits"))
        clock = TimeLeft(len(todo))
        for line in _lines(benchmark, todo, scheduler, processes):
            results.add(line)
            done += 1
            left_s = clock.after(done - len(entries) + len(todo))
            report_progress(StudyProgress(done, len(entries), left_s, str(line["key"]), "fits"))
        lines = [results.lines[_key(*entry)] for entry in entries]
    table = benchmark_table(sets, lines)
    missing = [one.missing_message for one in sets if not one.complete]
    facts = {
        "name": benchmark.name,
        "summary": f"{len(entries)} entries; {sum(one.complete for one in sets)} of {len(sets)} data sets.",
        "recordings": [_source(one) for one in sets],
        "entries": len(entries),
        "left_out": missing,
        "made": provenance(path, folder, benchmark.benchmark.seed, benchmark.fingerprint, lines)
        | {"plug_ins": sorted({code for _, *pair in entries if (code := code_of(*pair))})},
        "wall_s": round((time.monotonic_ns() - started_ns) * 1e-9, 1),
    }
    return BenchmarkOutcome(write_outputs(folder, benchmark.name, [table], {}, {}, facts), table, facts)


def _lines(
    benchmark: BenchmarkFile, todo: Sequence[tuple[Found, str, str]], scheduler: str | None, processes: int | None
) -> Iterator[dict[str, Any]]:
    """Results in order of completion."""
    if not todo:
        return
    files = {one.folder / name for one, _, _ in todo for name in one.recordings.files}
    with workers_for(scheduler, processes) as workers:
        workers.check_files(sorted(files))
        for _, line in workers.results(Job(_key(*entry), run_entry, (benchmark, *entry)) for entry in todo):
            yield line


def competitors(benchmark: BenchmarkFile) -> list[tuple[str, str]]:
    """Model and method of every entry: all models by separable, the searched ones by every other method.

    The three steps identify the normalised Bouc-Wen model only.
    """
    chosen = benchmark.benchmark
    models = tuple(MODELS) if chosen.models == "all" else chosen.models
    methods = known_methods() if chosen.methods == "all" else chosen.methods
    pairs = [(REFERENCE, REFERENCE)]
    pairs += [(name, SEPARABLE) for name in models if SEPARABLE in methods]
    return pairs + [
        (name, method)
        for name in chosen.searched
        for method in methods
        if method != SEPARABLE and (method != THREE_STEPS or name == "normalized_bouc_wen")
    ]


def _key(found: Found, model: str, method: str) -> str:
    """Name of a result: of a plug-in with its version and code, so that an improved one is fitted again."""
    code = code_of(model, method)
    return f"{found.recordings.name}|{model}|{method}" + (f"@{code}" if code else "")


@cache
def code_of(model: str, method: str) -> str:
    """Package, version and checksum of the code of the plug-ins that an entry consists of; empty for none.

    Args:
        model: Damper model.
        method: Method, or `reference`.
    """
    brought = [one for one in plug_ins(DAMPER_MODELS) if one.name == model]
    brought += [one for one in plug_ins(METHODS) if one.name == method]
    return ", ".join(f"{one.package} {one.version} ({_checksum(one.target)})" for one in brought)


def _checksum(target: str) -> str:
    """Of all Python files of the package that an entry point `package.module:object` lies in."""
    spec = importlib.util.find_spec(target.partition(":")[0].partition(".")[0])
    if spec is None:
        return ""
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    files = sorted(file for folder in folders for file in folder.rglob("*.py"))
    files = files or ([Path(spec.origin)] if spec.origin else [])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]


def run_entry(benchmark: BenchmarkFile, found: Found, model: str, method: str) -> dict[str, Any]:
    """In a worker: fit and score one entry on every split.

    Returns:
        A line of the results file; its `rows` are lines of the table. What a plug-in raises is its row's note.
    """
    began_s = time.process_time()
    line: dict[str, Any] = {"key": _key(found, model, method), "marks": {}, "software": SOFTWARE}
    try:
        folds = _folds(found)
        if method == REFERENCE:
            rows = _reference_rows(folds)
        else:
            rows = [_row(model, method, [_scored(benchmark, fold, model, method) for fold in folds])]
    except RigError as error:
        rows = [{"model": model, "method": method, "note": str(error)[:300]}]
    except Exception as error:  # of a plug-in: whatever foreign code raises is told as its own failure
        code = code_of(model, method)
        if not code:
            raise
        note = f"{code} failed: {type(error).__name__}: {error}"
        rows = [{"model": model, "method": method, "note": note[:300]}]
    for row in rows:
        row["cpu_s"] = round(time.process_time() - began_s, 2)
    return {**line, "seconds": rows[0]["cpu_s"], "rows": rows}


_read: dict[tuple[Path, str], list[Fold]] = {}


def _folds(found: Found) -> list[Fold]:
    """The splits, which a process reads once."""
    key = found.folder, found.recordings.name
    if key not in _read:
        _read[key] = folds_of(found)
    return _read[key]


@dataclass(frozen=True)
class _Scored:
    seen: ErrorSummary
    unseen: ErrorSummary
    evaluations: int


def _scored(benchmark: BenchmarkFile, fold: Fold, model: str, method: str) -> _Scored:
    chosen = benchmark.benchmark
    if method == SEPARABLE:
        fit = identify(fold.fitted, model=model, holdout=fold.unseen, diagnose=False)
        if fit.holdout is None:
            raise RigError("holdout: no test was held out")
        return _Scored(fit.error, fit.holdout, fit.evaluations)
    settings = Method(method, weight="1", budget=chosen.budget, population=chosen.population, seed=chosen.seed)
    damper, tests = damper_model(model), [_sampled(test) for test in fold.fitted]
    solution = solve(damper, tests, settings, examine(damper, tests))
    values = dict(solution.values)
    covered = covered_by(fold.fitted)
    unseen = with_extrapolations(score(damper, values, fold.unseen), [beyond(covered, test) for test in fold.unseen])
    return _Scored(score(damper, values, tests), unseen, solution.evaluations)


def _sampled(test: Measurement) -> Measurement:
    """What a search sees of a test."""
    if test.samples_per_cycle > 0:
        return spaced(first_cycle(test), SEARCHED_A_CYCLE)
    return thinned(test, max(1, test.u_m.size // SEARCHED_OF_RECORD))


def _row(model: str, method: str, scored: Sequence[_Scored]) -> dict[str, Any]:
    tests = [test for one in scored for test in one.unseen.per_test]
    worst = max(tests, key=lambda test: test.nrmse_percent_of_peak)
    return {
        "model": model,
        "method": method,
        "unseen": float(np.mean([test.nrmse_percent_of_peak for test in tests])),
        "variance": 100.0 * float(np.mean([one.unseen.r_squared for one in scored])),
        "worst": worst.nrmse_percent_of_peak,
        "within": mean_within([(test.nrmse_percent_of_peak, test.beyond) for test in tests]),
        "seen": float(np.mean([one.seen.nrmse_percent_of_peak for one in scored])),
        "evaluations": sum(one.evaluations for one in scored),
        "note": f"worst: {worst.id}{_beyond(worst)}" if len(tests) > 1 else "",
    }


def _beyond(test: TestError) -> str:
    """In what a test lies beyond the data of its fit."""
    text = in_words(test.beyond or ())
    return f" (extrapolated: {text})" if text else ""


def _reference_rows(folds: Sequence[Fold]) -> list[dict[str, Any]]:
    """The mean cycle and the regression, on the same splits; neither is a model."""
    predicted = [references(fold.fitted, fold.unseen, [fold.fitted]) for fold in folds]
    rows = []
    for place, title in enumerate(("mean cycle of each validation test (noise floor)", "gradient boosting")):
        errors = [one[place].holdout_nrmse_percent_of_peak for one in predicted]
        counts = [len(fold.unseen) for fold in folds]
        known = [(error, count) for error, count in zip(errors, counts, strict=True) if error is not None]
        row: dict[str, Any] = {"model": title, "method": "no model", "note": predicted[0][place].reason}
        if known:
            row["unseen"] = float(np.average([error for error, _ in known], weights=[count for _, count in known]))
        single = folds[0].unseen[0] if len(folds) == 1 and len(folds[0].unseen) == 1 else None
        if known and single is not None:
            row["variance"] = variance_percent(single, row["unseen"])
        rows.append(row)
    return rows


def benchmark_table(found: Sequence[Found], lines: Sequence[Mapping[str, Any]]) -> Table:
    """One table: entries best first within their recordings, published results among them.

    Args:
        found: the recordings, in the file's order.
        lines: results of the entries.
    """
    rows = []
    for one in found:
        name = one.recordings.name
        entries = [row for line in lines if line["key"].startswith(f"{name}|") for row in line["rows"]]
        entries += [
            {"model": "published", "method": other.who, "unseen": other.nrmse_percent,
             "variance": other.variance_percent, "note": other.note}
            for other in one.recordings.published
        ]  # fmt: skip
        entries.sort(key=lambda row: _rank(one, row))
        keys = ("model", "method", "unseen", "variance", "worst", "within", "seen", "evaluations", "cpu_s", "note")
        rows += [(name, *(row.get(key) for key in keys)) for row in entries]
    title = "Models and methods on open recordings, evaluated on validation tests"
    return Table("benchmark", "Benchmark", title, COLUMNS, tuple(rows), SCORER, EARLIER_NAMES)


def _rank(one: Found, row: Mapping[str, Any]) -> tuple[bool, float]:
    """By the variance where the motion is random, for which others publish it; else by the error."""
    key, sign = ("variance", -1.0) if one.recordings.waveform == "random" else ("unseen", 1.0)
    value = row.get(key)
    return value is None, 0.0 if value is None else sign * float(value)


def _source(one: Found) -> dict[str, Any]:
    recordings = one.recordings
    return {
        "name": recordings.name, "title": recordings.title, "source": recordings.source, "licence": recordings.licence,
        "split": recordings.split, "complete": one.complete, "files": dict(recordings.files),
    }  # fmt: skip
