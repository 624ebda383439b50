"""The whole study: from a file to tables, figures and pages; what is already there is not run again."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.jobs.choice import workers_for
from rig.study.execution import StudyProgress, run_cells
from rig.study.figures import figures
from rig.study.findings import findings
from rig.study.outputs import Table, write_outputs
from rig.study.paper1_tables import (
    SYMMETRY_TITLES,
    comparison_tables,
    model_tables,
    parallel_table,
    parameter_tables,
    sensitivity_tables,
    tests_table,
)
from rig.study.paper2_tables import current_tables
from rig.study.parallel_timing import time_parallel
from rig.study.provenance import provenance
from rig.study.results import ResultsFile
from rig.study.ride_of_fits import Rides, ride_table, rides
from rig.study.search_cell import all_cells, searches
from rig.study.settings import TITLES, KruskalWallis, best_settings, kruskal_wallis, setting_groups, setting_values
from rig.study.study_file import StudyFile, load_study
from rig.study.workbench import Workbench


@dataclass(frozen=True)
class StudyOutcome:
    """A finished study.

    Attributes:
        folder: Where everything is.
        page: The HTML page.
        tables: All tables.
        kruskal_wallis: What was compared -> test.
        facts: Name, samples, searches, wall seconds of this session.
    """

    folder: Path
    page: Path
    tables: tuple[Table, ...]
    kruskal_wallis: dict[str, KruskalWallis | None]
    facts: dict[str, Any]


def run_study(
    path: Path,
    folder: Path,
    processes: int | None = None,
    report: Callable[[StudyProgress], None] | None = None,
    scheduler: str | None = None,
) -> StudyOutcome:
    """Run a study (or its missing searches), and write its outputs.

    Args:
        path: Study file.
        folder: Folder of results and outputs; results of an earlier session of the same study are kept and completed.
        processes: Number of worker processes; None: one per processor; 1: run the searches in this process.
        report: Called at the start and after every search.
        scheduler: Address of a Dask scheduler whose workers run the searches.

    Returns:
        The finished study.

    Raises:
        FileProblem: The study file is wrong, the folder holds results of other recordings or settings, or is in use by
            another process.
        RigError: The scheduler cannot be used.
    """
    started_ns = time.monotonic_ns()
    study = load_study(path)
    bench = Workbench(study)
    folder.mkdir(parents=True, exist_ok=True)
    cells = all_cells(study)
    with ResultsFile(folder / "results.jsonl", bench.fingerprint) as results:
        total = len(searches(cells, ()))
        if searches(cells, results.lines):
            with workers_for(scheduler, processes) as workers:
                run_cells(bench, cells, results, workers, report)
        report_progress = report or (lambda progress: None)
        if study.parallel is not None:
            report_progress(StudyProgress(total, total, None, "", "timing serial and parallel computation"))
            time_parallel(study.parallel, bench, results)
        lines = dict(results.lines)
    facts = {
        "name": study.name,
        "recordings": "synthetic" if study.data.simulate else ", ".join(study.data.runs),
        "tests": len(bench.tests),
        "samples": sum(len(test.u_m) for test in bench.tests),
        "searches": total,
        "repeats": study.comparison.repeats,
        "left_out": bench.left_out,
        "made": provenance(path, folder, study.seed, bench.fingerprint, lines.values()),
    }
    report_progress(StudyProgress(total, total, None, "", "writing tables and figures"))
    minima, driven = study_minima(study, bench), rides(study, lines)
    tables = study_tables(study, bench, lines, minima, driven)
    tests = study_tests(study, lines)
    facts["findings"] = [asdict(finding) for finding in findings(study, lines, minima, tests, driven)]
    drawn = figures(study, bench, lines, driven)
    facts["wall_s"] = round((time.monotonic_ns() - started_ns) * 1e-9, 1)
    page = write_outputs(folder, study.name, tables, drawn, tests, facts)
    return StudyOutcome(folder, page, tuple(tables), tests, facts)


def study_minima(study: StudyFile, bench: Workbench) -> dict[str, float]:
    """Objective that separable least squares reaches with each model of the tables, where it can fit it.

    Args:
        study: The study.
        bench: Its recordings.

    Returns:
        Damper model -> objective.
    """
    named = {*study.comparison.models, *(SYMMETRY_TITLES if study.symmetry else ())}
    return {name: value for name in sorted(named) if (value := bench.minimum(name)) is not None}


def study_tables(
    study: StudyFile,
    bench: Workbench,
    lines: dict[str, dict[str, Any]],
    minima: Mapping[str, float],
    driven: Rides | None = None,
) -> list[Table]:
    """Every table of both papers that the results allow, in the papers' order.

    Args:
        study: The study.
        bench: Its recordings.
        lines: Result lines by key.
        minima: From `study_minima`.
        driven: From `rides`.

    Returns:
        Tables 1-14 of paper 1, then paper 2's.
    """
    model = bench.problem(study.comparison.models[0]).model
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    paper1 = [
        tests_table(bench.tests),
        *comparison_tables(study, lines, minima),
        *model_tables(study, lines, minima),
        *parameter_tables(study, lines, units),
        *parallel_table(study, lines),
        *sensitivity_tables(study, lines),
    ]
    paper1 += [ride_table(driven)] if driven is not None else []
    return [*sorted(paper1, key=lambda table: table.name), *current_tables(study, lines)]


def study_tests(study: StudyFile, lines: dict[str, dict[str, Any]]) -> dict[str, KruskalWallis | None]:
    """Kruskal-Wallis over all settings, at each budget, at each setting, and over best-tuned ones as the paper does.

    Args:
        study: The study.
        lines: Result lines by key.

    Returns:
        What was compared -> test.
    """
    settings, model = study.comparison, study.comparison.models[0]
    tests = {"all settings": _over_all_settings(study, lines)}
    for budget in settings.budgets:
        groups = {
            f"{TITLES[m]}, N={N}": setting_values(study, lines, model, m, N, budget)
            for m in settings.methods
            for N in settings.populations
        }
        tests[f"methods and populations at fun_evals={budget}"] = kruskal_wallis(groups)
    for population in settings.populations:
        for budget in settings.budgets:
            groups = {TITLES[m]: setting_values(study, lines, model, m, population, budget) for m in settings.methods}
            tests[f"methods at N={population}, fun_evals={budget}"] = kruskal_wallis(groups)
    best = best_settings(study, lines)
    tuned = {TITLES[m]: setting_values(study, lines, model, m, N, budget) for m, (N, budget, _) in best.items()}
    tests["best-tuned settings only, as the paper tests"] = kruskal_wallis(tuned)
    return tests


def _over_all_settings(study: StudyFile, lines: dict[str, dict[str, Any]]) -> KruskalWallis | None:
    note = (
        "Each search is used once: the repeats of searches that serve several budgets are divided among these budgets."
    )
    once = kruskal_wallis(setting_groups(study, lines, each_search_once=True), note)
    if once is not None:
        return once
    note = "Too few repeats to use each search once: budgets that share a search are not independent here."
    return kruskal_wallis(setting_groups(study, lines), note)
