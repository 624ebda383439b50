"""Tables of the c-FOA paper in its layout, over this study's recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rig.identification.measurement import Measurement
from rig.study.parallel_timing import parallel_key
from rig.study.search_cell import SENSITIVITY, SearchCell, comparison_cells, symmetry_cells, varied_cells
from rig.study.statistics import Summary, summarise
from rig.study.study_file import StudyFile
from rig.study.table import Cell, Table, known

Lines = Mapping[str, Mapping[str, Any]]

TITLES = {
    "c_foa": "c-FOA",
    "c_foa printed": "c-FOA as printed",
    "foa": "FOA",
    "ga": "Genetic Algorithm",
    "ga feasible": "Genetic Algorithm, feasible directions",
    "de": "Differential Evolution",
    "de 5": "Differential Evolution, strategy 5",
    "pso": "Particle Swarm Optimisation",
    "i_abc": "Artificial Bee Colony",
    "ga_standard": "Standard GA",
    "ga_kwok": "GA of Kwok et al.",
    "ga_novel": "Novel GA",
    "hybrid": "c-FOA, then least squares",
    "zhu_three_step": "Zhu et al., three steps",
}
TABLE_NUMBERS = {"ga": 10, "de": 11, "pso": 12, "i_abc": 13, "c_foa": 14}
VALUE_COLUMNS = ("BV", "MV", "SD", "repeats")
OBJECTIVE = "Objective f(s) = sum(((Fexp - F) w)^2), (12)."


def tests_table(tests: Sequence[Measurement]) -> Table:
    """Table 1: the loading conditions, amplitudes (m) by current and frequency.

    Args:
        tests: The recordings.

    Returns:
        One row for each current.
    """
    frequencies = sorted({test.frequency_Hz for test in tests})
    currents = sorted({test.nominal_current_A for test in tests})
    rows = []
    for current in currents:
        amplitudes = [
            ", ".join(
                f"{each:.4g}"
                for each in sorted(
                    {
                        test.amplitude_m
                        for test in tests
                        if (test.frequency_Hz, test.nominal_current_A) == (frequency, current)
                    }
                )
            )
            for frequency in frequencies
        ]
        rows.append((f"{current:g}", *amplitudes))
    columns = ("I / A", *(f"A / m at f = {frequency:g} Hz" for frequency in frequencies))
    return Table("table-01", "Loading conditions of the tests", columns, tuple(rows))


def best_settings(study: StudyFile, results: Lines) -> dict[str, tuple[int, int, Summary]]:
    """Population and budget with the lowest mean value of each method, as the paper's Table 2 chooses them.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Method -> population, budget, summary; methods without a result are left out.
    """
    model = study.comparison.models[0]
    found: dict[str, tuple[int, int, Summary]] = {}
    for method in study.comparison.methods:
        settings = [
            (population, budget, summary)
            for population in study.comparison.populations
            for budget in study.comparison.budgets
            if (summary := setting_summary(study, results, model, method, population, budget)) is not None
        ]
        if settings:
            found[method] = min(settings, key=lambda entry: entry[2].mean)
    return found


def setting_values(
    study: StudyFile, results: Lines, model: str, method: str, population: int, budget: int
) -> list[float]:
    """Objective values of the repeats of one setting that have results.

    Args:
        study: The study.
        results: Result lines by key.
        model: Damper model.
        method: As the study file writes it.
        population: N.
        budget: fun_evals.

    Returns:
        Values in the order of the repeats.
    """
    cells = (SearchCell(model, method, population, budget, repeat) for repeat in range(study.comparison.repeats))
    return _values(cells, results)


def setting_groups(study: StudyFile, results: Lines, *, each_search_once: bool = False) -> dict[str, list[float]]:
    """Values of every setting of the first model: method, population and budget, not only the best-tuned ones.

    Args:
        study: The study.
        results: Result lines by key.
        each_search_once: Where one search gives the values of several budgets, count it for one of them only: its
            repeats are dealt out to the budgets, so that no two groups hold values of the same search.

    Returns:
        Setting -> values; settings without a result are left out.
    """
    model, wanted = study.comparison.models[0], study.comparison
    groups: dict[str, list[float]] = {}
    for method in wanted.methods:
        for N in wanted.populations:
            for turn, budget in enumerate(wanted.budgets):
                cells = [SearchCell(model, method, N, budget, repeat) for repeat in range(wanted.repeats)]
                if each_search_once and cells[0].shares_searches:
                    cells = cells[turn :: len(wanted.budgets)]
                groups[f"{TITLES[method]}, N={N}, {budget}"] = _values(cells, results)
    return {name: values for name, values in groups.items() if values}


def setting_summary(
    study: StudyFile, results: Lines, model: str, method: str, population: int, budget: int
) -> Summary | None:
    """BV, MV and SD of one setting, None before its first result; arguments as `setting_values`."""
    values = setting_values(study, results, model, method, population, budget)
    return summarise(values) if values else None


def comparison_tables(study: StudyFile, results: Lines) -> list[Table]:
    """Table 2 (best settings) and Tables 10-14 (every setting of a method).

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Table 2 first; methods beyond the paper's get tables of their own.
    """
    best = best_settings(study, results)
    winners = tuple((TITLES[name], N, budget, *_cells(summary)) for name, (N, budget, summary) in best.items())
    note = f"{OBJECTIVE} The setting with the lowest mean of each method: chosen on the same values it is judged by."
    columns = ("method", "N", "fun_evals", *VALUE_COLUMNS)
    tables = [Table("table-02", "Best settings of each method", columns, winners, note)]
    model = study.comparison.models[0]
    for method in study.comparison.methods:
        rows = [
            (f"N={N}, fun_evals={budget}", *_cells(summary))
            for N in study.comparison.populations
            for budget in study.comparison.budgets
            if (summary := setting_summary(study, results, model, method, N, budget)) is not None
        ]
        name = f"table-{TABLE_NUMBERS[method]}" if method in TABLE_NUMBERS else f"table-x-{method.replace(' ', '-')}"
        tables.append(
            Table(name, f"{TITLES[method]}: every setting", ("setting", *VALUE_COLUMNS), tuple(rows), OBJECTIVE)
        )
    return tables


def model_tables(study: StudyFile, results: Lines) -> list[Table]:
    """Table 3 (asymmetric against symmetric) and a table of all models of the study where there are several.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        None, one or two tables.
    """
    tables = []
    if study.symmetry is not None:
        wanted = study.symmetry
        groups: dict[str, list[SearchCell]] = {}
        for cell in symmetry_cells(study):
            groups.setdefault(cell.problem, []).append(cell)
        rows = _group_rows({f"{model} model": cells for model, cells in groups.items()}, results)
        title = (
            f"{TITLES[wanted.method]}, N={wanted.population}, fun_evals={wanted.budget}: asymmetric and symmetric model"
        )
        tables.append(Table("table-03", title, ("model", *VALUE_COLUMNS), rows, OBJECTIVE))
    if len(study.comparison.models) > 1:
        several = []
        for model in study.comparison.models:
            for method in study.comparison.methods:
                N, budget = study.comparison.populations[0], study.comparison.budgets[-1]
                summary = setting_summary(study, results, model, method, N, budget)
                if summary is not None:
                    several.append((model, TITLES[method], *_cells(summary)))
        columns = ("model", "method", *VALUE_COLUMNS)
        tables.append(Table("table-x-models", "Models compared", columns, tuple(several), OBJECTIVE))
    return tables


def parameter_tables(study: StudyFile, results: Lines, units: Mapping[str, str]) -> list[Table]:
    """Table 4 (c-FOA's best parameters) and Table 5 (the best of every method side by side).

    Args:
        study: The study.
        results: Result lines by key.
        units: Parameter name -> unit.

    Returns:
        Two tables; Table 4 only when c-FOA took part.
    """
    model = study.comparison.models[0]
    winners: dict[str, Mapping[str, Any]] = {}
    for cell in comparison_cells(study):
        line = results.get(cell.key)
        if line is not None and cell.problem == model:
            held = winners.setdefault(cell.method, line)
            if line["value"] < held["value"]:
                winners[cell.method] = line
    ordered = [method for method in study.comparison.methods if method in winners]
    tables = []
    for name, methods in (("table-04", [m for m in ordered if m == "c_foa"]), ("table-05", ordered)):
        if not methods:
            continue
        names = list(winners[methods[0]]["parameters"])
        rows: list[tuple[str | float, ...]] = [("f(s)", "", *(winners[m]["value"] for m in methods))]
        rows += [(each, units.get(each, ""), *(winners[m]["parameters"][each] for m in methods)) for each in names]
        columns = ("parameter", "unit", *(TITLES[m] for m in methods))
        note = "eta (9) is not searched: with constant current it cannot be identified."
        tables.append(Table(name, "Parameters of the best fits", columns, tuple(rows), note))
    return tables


def sensitivity_tables(study: StudyFile, results: Lines) -> list[Table]:
    """Tables 7-9: c-FOA against N, K and N_res.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Three tables, or none when the study does not ask.
    """
    wanted = study.sensitivity
    if wanted is None:
        return []
    tables = []
    held = {"N": wanted.populations[0], "K": wanted.generations[0], "Nres": wanted.resolutions[0]}
    for number, parameter in enumerate(SENSITIVITY, start=7):
        groups: dict[str, list[SearchCell]] = {}
        for value, cell in varied_cells(study, wanted, parameter):
            groups.setdefault(f"{parameter} = {value}", []).append(cell)
        others = ", ".join(f"{name} = {value}" for name, value in held.items() if name != parameter)
        title = f"c-FOA against {parameter} for {others}, kappa = 5, M = 0.95 and c = 0.9"
        rows = _group_rows(groups, results)
        tables.append(Table(f"table-{number:02d}", title, ("c-FOA", *VALUE_COLUMNS), rows, OBJECTIVE))
    return tables


def parallel_table(study: StudyFile, results: Lines) -> list[Table]:
    """Table 6: seconds and efficiency of each model's population on one and more processes.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        One table, or none when nothing was timed.
    """
    if study.parallel is None:
        return []
    wanted, rows, processors = study.parallel, [], 0
    for model in wanted.models:
        keys = [parallel_key(wanted, model, processes) for processes in sorted(wanted.processes)]
        timed = [results[key] for key in keys if key in results]
        serial = next((line["seconds"] for line in timed if line["processes"] == 1), float("nan"))
        for line in timed:
            speed_up = serial / line["seconds"]
            processors = line["processors"]
            rows.append((model, _processes(line["processes"]), line["seconds"], speed_up, speed_up / line["processes"]))
    if not rows:
        return []
    title = f"Computational cost of {TITLES[wanted.method]}, N = {wanted.population}, fun_evals = {wanted.evaluations}"
    note = (
        f"Measured on {processors} processors: more processes than that cannot gain. Seconds of the search alone; "
        "workers already started and holding the recordings."
    )
    columns = ("model", "computing", "seconds", "speed-up", "efficiency")
    return [Table("table-06", title, columns, tuple(rows), note)]


def _processes(count: int) -> str:
    return "serial" if count == 1 else f"parallel, {count} processes"


def _group_rows(groups: Mapping[str, Iterable[SearchCell]], results: Lines) -> tuple[tuple[Cell, ...], ...]:
    rows: list[tuple[Cell, ...]] = []
    for name, cells in groups.items():
        values = _values(cells, results)
        if values:
            rows.append((name, *_cells(summarise(values))))
    return tuple(rows)


def _values(cells: Iterable[SearchCell], results: Lines) -> list[float]:
    return [float(results[cell.key]["value"]) for cell in cells if cell.key in results]


def _cells(summary: Summary) -> tuple[Cell, ...]:
    return summary.best, summary.mean, known(summary.deviation), summary.repeats
