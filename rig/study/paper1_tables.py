"""Tables of the c-FOA paper in its layout, over this study's recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rig.dampers import parameter_set
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.models.problem import unmirrored
from rig.study import printed_values
from rig.study.outputs import Cell, Table, known
from rig.study.parallel_timing import parallel_key
from rig.study.search_cell import SENSITIVITY, SearchCell, symmetry_cells, varied_cells
from rig.study.settings import (
    TITLES,
    Lines,
    Summary,
    best_lines,
    best_settings,
    objective_unit,
    setting_summary,
    summarise,
    values_of,
)
from rig.study.study_file import StudyFile

TABLE_NUMBERS = {"ga": 10, "de": 11, "pso": 12, "i_abc": 13, "c_foa": 14}
VALUE_COLUMNS = ("BV", "MV", "SD", "repeats")
PRINTED_COLUMNS = ("BV printed", "MV printed", "SD printed")
NOT_PUBLIC = (
    "Printed: values from the paper for its own recordings, which are not public; compare orders, not magnitudes."
)
SYMMETRY_TITLES = {
    "asymmetric": "Asymmetric model: Ca_minus \N{NOT EQUAL TO} Ca_plus, Cb_minus \N{NOT EQUAL TO} Cb_plus",
    "symmetric": "Symmetric model: Ca_minus = Ca_plus, Cb_minus = Cb_plus",
}
LAMBDA = "The printed lambda, for which the paper gives no unit, is interpreted as delta."
MIRRORED = (
    "beta is positive by convention: if beta, delta, Fya and Fyb all change sign, the force does not change (tanh is "
    "odd), so a search may end at either solution."
)


def _objective(study: StudyFile) -> str:
    weight = "v" if study.comparison.weight == "v" else "1"
    return (
        f"Objective f(s) = sum(((Fexp - F) w)^2) (equation 12), w = {weight}; BV, MV and SD in {objective_unit(study)}."
    )


def tests_table(tests: Sequence[Measurement]) -> Table:
    """Table 1: the loading conditions, amplitudes (m) by current and frequency.

    Args:
        tests: The recordings.

    Returns:
        One row for each current.
    """
    groups = set_of(tests)
    currents, motions = groups.currents, groups.motions
    frequencies = motions.frequencies_Hz
    rows = []
    for level, current in enumerate(currents.names_A):
        members = currents.members(level)
        amplitudes = [
            ", ".join(
                f"{amplitude_m:.4g}"
                for amplitude_m in sorted(
                    {motions.amplitude_m(number) for number in members if motions.frequency_Hz(number) == frequency}
                )
            )
            for frequency in frequencies
        ]
        rows.append((f"{current:g}", *amplitudes))
    columns = ("I / A", *(f"A / m at f = {frequency:g} Hz" for frequency in frequencies))
    return Table("table-01", "Table 1", "Loading conditions of the tests on the MR damper", columns, tuple(rows))


def comparison_tables(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> list[Table]:
    """Table 2 (best settings) and Tables 10-14 (every setting of a method).

    Args:
        study: The study.
        results: Result lines by key.
        minima: Damper model -> objective value that separable least squares reaches, for the notes.

    Returns:
        Table 2 first; methods beyond the paper's get tables of their own.
    """
    best = best_settings(study, results)
    winners = tuple(
        (TITLES[name], N, budget, *_cells(summary), *_printed(_best_printed(name)))
        for name, (N, budget, summary) in best.items()
    )
    note = (
        f"{_objective(study)} {_lowest(minima, study.comparison.models[:1])} Each method is shown at its setting with "
        f"the lowest mean, chosen on the same values. {NOT_PUBLIC} The printed values are those of the paper's best "
        "settings."
    )
    columns = ("method", "N", "fun_evals", *VALUE_COLUMNS, *PRINTED_COLUMNS)
    title = _statistics(study, ", ".join(TITLES[method] for method in best))
    tables = [Table("table-02", "Table 2", title, columns, winners, note)]
    model, printed = study.comparison.models[0], printed_values.SETTINGS
    for method in study.comparison.methods:
        rows = [
            (f"N={N}, fun_evals={budget}", *_cells(summary), *_printed(printed.get((_printed_as(method), N, budget))))
            for N in study.comparison.populations
            for budget in study.comparison.budgets
            if (summary := setting_summary(study, results, model, method, N, budget)) is not None
        ]
        number = TABLE_NUMBERS.get(method)
        name = f"table-x-{method.replace(' ', '-')}" if number is None else f"table-{number}"
        heading = f"Not in the papers: {TITLES[method]}" if number is None else f"Table {number}"
        title = _statistics(study, TITLES[method])
        headings = (TITLES[method], *VALUE_COLUMNS, *PRINTED_COLUMNS)
        tables.append(Table(name, heading, title, headings, tuple(rows), f"{_objective(study)} {NOT_PUBLIC}"))
    return tables


def model_tables(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> list[Table]:
    """Table 3 (asymmetric against symmetric) and a table of all models of the study where there are several.

    Args:
        study: The study.
        results: Result lines by key.
        minima: Damper model -> objective value that separable least squares reaches, for the notes.

    Returns:
        None, one or two tables.
    """
    tables = []
    if study.symmetry is not None:
        settings = study.symmetry
        groups: dict[str, list[SearchCell]] = {}
        for cell in symmetry_cells(study):
            groups.setdefault(cell.problem, []).append(cell)
        rows = tuple(
            (
                SYMMETRY_TITLES[model], settings.population, settings.budget, *_cells(summarise(values)),
                *_printed(printed_values.SYMMETRY[model] if settings.method == "c_foa" else None),
            )
            for model, cells in groups.items()
            if (values := values_of(cells, results))
        )
        name = TITLES[settings.method]
        title = _statistics(study, f"{name} using an asymmetric and a symmetric model")
        note = f"{_objective(study)} {_lowest(minima, SYMMETRY_TITLES)} {NOT_PUBLIC}"
        columns = (name, "N", "fun_evals", *VALUE_COLUMNS, *PRINTED_COLUMNS)
        tables.append(Table("table-03", "Table 3", title, columns, rows, note))
    if len(study.comparison.models) > 1:
        several = []
        for model in study.comparison.models:
            for method in study.comparison.methods:
                N, budget = study.comparison.populations[0], study.comparison.budgets[-1]
                summary = setting_summary(study, results, model, method, N, budget)
                if summary is not None:
                    several.append((model, TITLES[method], *_cells(summary)))
        heading = "Not in the papers: models"
        headings = ("model", "method", *VALUE_COLUMNS)
        tables.append(Table("table-x-models", heading, "Models compared", headings, tuple(several), _objective(study)))
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
    winners = best_lines(study, results)
    ordered = list(winners)
    tables = []
    for number, methods in ((4, [m for m in ordered if m == "c_foa"]), (5, ordered)):
        if not methods:
            continue
        fits = [winners[method] for method in methods]
        truth = _truth(study)
        rows: list[tuple[Cell, ...]] = [("", "f(s)", objective_unit(study), *(fit["value"] for fit in fits))]
        printed_fits = {method: fit for method, fit in printed_values.FITS[number].items() if method in methods}
        printed_sets = [parameter_set(name).values for name, _ in printed_fits.values()]
        values = [unmirrored(fit["parameters"]) for fit in fits]
        for place, (name, unit) in enumerate(units.items(), start=1):
            printed = [one.get(name) for one in printed_sets]
            rows.append((place, name, unit, *(one.get(name) for one in values), *_known(truth, name), *printed))
        rows[0] = (*rows[0], *_known(truth, "f(s)"), *(value for _, value in printed_fits.values()))
        titles = ", ".join(TITLES[method] for method in methods)
        columns = ("No.", "parameter", "unit", *(TITLES[method] for method in methods))
        columns += ("truth",) if truth else ()
        columns += tuple(f"{TITLES[method]} printed" for method in printed_fits)
        note = (
            "eta (equation 9) is not identified because this is not possible at constant current."
        ) if "eta" in units else ""
        note += f" The values are from the best of all settings. {MIRRORED} {LAMBDA} {NOT_PUBLIC}"
        note += " Truth: the values that generated the synthetic recordings, which also contain noise." if truth else ""
        title = f"Optimised model parameter values using {titles}"
        tables.append(Table(f"table-{number:02d}", f"Table {number}", title, columns, tuple(rows), note))
    return tables


def sensitivity_tables(study: StudyFile, results: Lines) -> list[Table]:
    """Tables 7-9: c-FOA against N, K and N_res.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Three tables, or none when the study does not ask.
    """
    settings = study.sensitivity
    if settings is None:
        return []
    tables = []
    held = {"N": settings.populations[0], "K": settings.generations[0], "Nres": settings.resolutions[0]}
    for number, parameter in enumerate(SENSITIVITY, start=7):
        groups: dict[str, list[SearchCell]] = {}
        for value, cell in sorted(varied_cells(study, settings, parameter), key=lambda entry: entry[0]):
            groups.setdefault(f"{parameter} = {value}", []).append(cell)
        others = ", ".join(f"{name} = {value}" for name, value in held.items() if name != parameter)
        title = _statistics(study, f"c-FOA for {', '.join(groups)}, {others}, kappa = 5, M = 0.95 and c = 0.9")
        printed = {f"{parameter} = {value}": row for value, row in printed_values.SENSITIVITY[parameter].items()}
        rows = tuple(
            (name, *_cells(summarise(values)), *_printed(printed.get(name)))
            for name, cells in groups.items()
            if (values := values_of(cells, results))
        )
        columns, note = ("c-FOA", *VALUE_COLUMNS, *PRINTED_COLUMNS), f"{_objective(study)} {NOT_PUBLIC}"
        tables.append(Table(f"table-{number:02d}", f"Table {number}", title, columns, rows, note))
    return tables


def parallel_table(study: StudyFile, results: Lines) -> list[Table]:
    """Table 6: seconds and efficiency of each model's population on one and more processes.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        One table, or none when nothing was timed.
    """
    settings = study.parallel
    if settings is None:
        return []
    counts, rows, processors = sorted(settings.processes), [], 0
    for model in settings.models:
        lines = [results.get(parallel_key(settings, model, count)) for count in counts]
        seconds = [None if line is None else float(line["seconds"]) for line in lines]
        processors = max([processors, *(line["processors"] for line in lines if line is not None)])
        speed_up = [_ratio(seconds[0] if counts[0] == 1 else None, duration_s) for duration_s in seconds]
        rows += [
            (model, "time / s", *seconds),
            (model, "speed-up", *speed_up),
            (model, "efficiency", *(_ratio(gain, float(count)) for gain, count in zip(speed_up, counts, strict=True))),
        ]
    if processors == 0:
        return []
    printed_s = [printed_values.PARALLEL_S.get(count) for count in counts]
    rows.append(("as printed (asymmetric, MATLAB)", "time / s", *printed_s))
    title = (
        f"Computational cost of the fitting problem with {TITLES[settings.method]}, serial and parallel (N = "
        f"{settings.population}, fun_evals = {settings.evaluations})"
    )
    note = (
        f"Measured on {processors} processors: using more processes than processors brings no gain. The times are for "
        "the search only, with the workers already started and the recordings loaded. Each run was timed once, so "
        "other load on the computer affects the result."
    )
    parallel = (f"parallel computing with {count} processes" if count > 1 else "serial computing" for count in counts)
    return [Table("table-06", "Table 6", title, ("model", "computational burden", *parallel), tuple(rows), note)]


def _best_printed(method: str) -> printed_values.Triple | None:
    return printed_values.BEST.get(_printed_as(method), (0, 0, None))[2]


def _printed_as(method: str) -> str:
    return printed_values.PRINTED_AS.get(method, method)


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below


def _printed(values: printed_values.Triple | None) -> tuple[Cell, ...]:
    return (None, None, None) if values is None else values


def _cells(summary: Summary) -> tuple[Cell, ...]:
    return summary.best, summary.mean, known(summary.deviation), summary.repeats


def _lowest(minima: Mapping[str, float], models: Iterable[str]) -> str:
    known = [f"{minima[model]:.3e} for the {model} model" for model in models if model in minima]
    return f"Separable least squares reaches {', '.join(known)}." if known else ""


def _truth(study: StudyFile) -> Mapping[str, float]:
    """Parameters that synthetic recordings were made with, where the first model has them; none of recorded runs."""
    if study.data.simulate != "table1":
        return {}
    truth = parameter_set(study.data.truth)
    return truth.values if truth.model == study.comparison.models[0] else {}


def _known(truth: Mapping[str, float], name: str) -> tuple[Cell, ...]:
    return (truth.get(name),) if truth else ()


def _statistics(study: StudyFile, what: str) -> str:
    return (
        f"Statistical analysis of the results of {study.comparison.repeats} independent optimisations with {what}. BV: "
        "best value, MV: mean value, SD: standard deviation"
    )
