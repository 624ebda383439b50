"""Figures of a study, in the papers' order: those of results here, those of loops in `loop_figures`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.document.figure import Axis, Figure, Panels, Style, Trace, area, bar, box_plot
from rig.document.style import FITTED, category_colour
from rig.study.loop_figures import (
    HALF,
    WHOLE,
    fitted_figure,
    motion_figure,
    reconstructed_figure,
    recorded,
    recorded_figure,
    triangle_figure,
)
from rig.study.paper2_tables import current_results, parameter_relations, parameter_units
from rig.study.ride_of_fits import Rides, ride_figures
from rig.study.search_cell import CURRENT, SearchCell
from rig.study.settings import TITLES, Lines, best_settings, objective_unit, setting_groups, setting_values
from rig.study.study_file import StudyFile
from rig.study.workbench import Workbench

FEWEST_ERRORS = 10
BINS = 10
DETAIL = 100.0
"""The detail of Figure 9 ends at so many times the lowest value."""
Outcomes = Mapping[str, Mapping[float, list[Mapping[str, Any]]]]
"""Method -> current (A) -> result lines."""
Drawn = Figure | Panels


def figures(study: StudyFile, bench: Workbench, results: Lines, driven: Rides | None = None) -> dict[str, Drawn]:
    """Every figure the results allow.

    Args:
        study: The study.
        bench: Its recordings.
        results: Result lines by key.
        driven: From `rides`.

    Returns:
        Name such as `figure-08` -> figure, in the papers' order.
    """
    drawn: dict[str, Drawn | None] = {
        "figure-03": motion_figure(study), "figure-04": triangle_figure(study),
        "figure-05": recorded_figure(bench.tests),
    }  # fmt: skip
    groups = setting_groups(study, results)
    if groups:
        drawn["figure-08"] = _box_plots(study, groups)
        drawn["figure-08-pair"] = _tuned_pair(study, results)
        drawn["figure-09"] = _convergence(study, results)
        drawn["figure-10"] = fitted_figure(study, results, bench.tests, "velocity")
        drawn["figure-11"] = fitted_figure(study, results, bench.tests, "extension")
    drawn |= ride_figures(driven) if driven is not None else {}
    outcomes = current_results(study, results)
    if study.current is not None and outcomes:
        drawn["paper2-figure-08"] = recorded_figure(list(bench.current_tests.values()))
        drawn["paper2-figure-10"] = _error_against_generations(outcomes)
        drawn["paper2-figure-11"] = _error_distribution(outcomes)
        tests, force, label = bench.current_tests, bench.current_force, recorded(study.current.data)
        drawn["paper2-figure-12"] = reconstructed_figure(outcomes, tests, force, label)
        drawn["paper2-figure-13-bars"] = _error_bars(outcomes)
        drawn["paper2-figure-relations"] = _against_current(study, results)
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _box_plots(study: StudyFile, groups: Mapping[str, list[float]], *, log: bool = True) -> Figure:
    """One box for each setting."""
    known = {name: values for name, values in groups.items() if values}
    traces = [trace for place, values in enumerate(known.values()) for trace in box_plot(values, place)]
    objective = Axis("Objective f(s)", objective_unit(study), log=log)
    return Figure(objective, Axis(names=tuple(known)), traces, WHOLE, 60 + 24 * len(known), "Objective of each setting")


def _convergence(study: StudyFile, results: Lines) -> Panels:
    """Median best value against evaluations, each method at its best setting; the band holds the middle half."""
    model, lowest, traces, ends = study.comparison.models[0], np.inf, [], [0.0, 0.0]
    for place, (method, (population, budget, _)) in enumerate(best_settings(study, results).items()):
        cells = [SearchCell(model, method, population, budget, repeat) for repeat in range(study.comparison.repeats)]
        histories = [np.array(results[cell.key]["history"]) for cell in cells if cell.key in results]
        grid = np.linspace(population, budget, 200)
        curves = np.array([_at(history, grid) for history in histories])
        lowest, ends = min(lowest, float(np.min(curves))), [0.0, max(ends[1], budget)]
        low, middle, high = np.percentile(curves, [25, 50, 75], axis=0)
        colour = category_colour(place)
        name = f"{TITLES[method]}, N={population}"
        traces += [area(grid, low, high, colour), Trace(grid, middle, name=name, colour=colour)]
    evaluations, unit = "Objective evaluations", objective_unit(study)
    best = Axis("Best f(s): median and quartiles", unit, log=True)
    detail = Axis("Best f(s), enlarged", unit, (0.8 * lowest, DETAIL * lowest), log=True)
    return Panels((
        Figure(Axis(evaluations), best, traces, HALF, 340, legend=True),
        Figure(Axis(evaluations, limits=(0.5 * ends[1], 1.03 * ends[1])), detail, traces, HALF, 340),
    ), title="Convergence of each method at its best setting")  # fmt: skip


def _tuned_pair(study: StudyFile, results: Lines) -> Figure | None:
    """Best-tuned PSO and best-tuned c-FOA, as the paper shows them; None where one of them took no part."""
    best, model = best_settings(study, results), study.comparison.models[0]
    if not {"pso", "c_foa"} <= best.keys():
        return None
    settings = [(method, *best[method][:2]) for method in ("pso", "c_foa")]
    groups = {
        f"{TITLES[method]}, N={N}, {budget}": setting_values(study, results, model, method, N, budget)
        for method, N, budget in settings
    }
    return _box_plots(study, groups, log=False)


def _error_against_generations(outcomes: Outcomes) -> Figure:
    """Minimum fitness so far of every genetic algorithm and its running average, means over currents and repeats."""
    traces = []
    for place, (method, by_current) in enumerate(outcomes.items()):
        lines = [line for repeats in by_current.values() for line in repeats if line["generations"] > 1]
        if not lines:
            continue
        histories = [np.array(line["history"]) for line in lines]
        grid = np.arange(1.0, max(int(line["generations"]) for line in lines) + 1)
        steps = [line["evaluations"] / max(1, line["generations"]) for line in lines]
        minima = np.mean([_at(history, grid * step) for history, step in zip(histories, steps, strict=True)], axis=0)
        average, colour = np.cumsum(minima) / grid, category_colour(place)
        traces += [
            Trace(grid, minima, name=f"{TITLES[method]}: minimum", colour=colour),
            Trace(grid, average, Style.FITTED, f"{TITLES[method]}: running average", colour),
        ]
    error = Axis("mean(((Fsim - Fexp) / SD(Fexp))^2)", log=True)
    return Figure(Axis("Generation"), error, traces, WHOLE, 340, "Error vs. generations", legend=True)


def _error_distribution(outcomes: Outcomes) -> Panels | None:
    """Minimum errors of one search's generations in 10 bins, their share up to each, and an exponential distribution.

    The statistical stop of paper 2 takes them for exponentially distributed. Of long searches
    evenly spaced generations are shown.
    """
    method = "ga_novel" if "ga_novel" in outcomes else next(iter(outcomes))
    line = max((one for lines in outcomes[method].values() for one in lines), key=lambda one: len(one["history"]))
    errors = np.array(line["history"])[:, 1]
    if errors.size < FEWEST_ERRORS:
        return None
    searched = f"{TITLES[method]} at {float(line['problem'].removeprefix(CURRENT)):g} A, repeat {line['repeat'] + 1}"
    mean, grid = float(np.mean(errors)), np.linspace(0.0, float(errors.max()), 200)
    density, edges = np.histogram(errors, BINS, density=True)
    steps = Trace(
        np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(density, 2), [0.0]]), Style.AREA, "generations"
    )
    ordered = np.sort(errors)
    share = np.arange(1, ordered.size + 1) / ordered.size
    error = Axis("Minimum error of a generation")
    return Panels((
        Figure(error, Axis("Density"), [steps, Trace(grid, np.exp(-grid / mean) / mean, colour=FITTED)], HALF, 280),
        Figure(error, Axis("Cumulative share"), [
            Trace(np.repeat(ordered, 2)[1:], np.repeat(share, 2)[:-1], name=TITLES[method]),
            Trace(grid, 1.0 - np.exp(-grid / mean), name="exponential distribution, same mean", colour=FITTED),
        ], HALF, 280, legend=True),
    ), title=f"{searched}: {errors.size} values from {line['generations']} generations")  # fmt: skip


def _error_bars(outcomes: Outcomes) -> Panels:
    """MAE, SD and generations of every method, means over currents and repeats."""
    titles = tuple(TITLES[method] for method in outcomes)
    made = []
    for entry, axis in (("mae_N", Axis("MAE", "N")), ("sd_N", Axis("SD", "N")), ("generations", Axis("Generations"))):
        means = [
            float(np.mean([line[entry] for lines in by_current.values() for line in lines]))
            for by_current in outcomes.values()
        ]
        bars = [bar(mean, place) for place, mean in enumerate(means)]
        limits = (0.0, 1.05 * max([*means, 1e-9]))
        along = Axis(axis.quantity, axis.unit, limits)
        made.append(Figure(along, Axis(names=titles), bars, WHOLE // 2, 60 + 24 * len(titles)))
    return Panels(tuple(made), title="Errors and generations of each method")


def _at(history: np.ndarray, evaluations: np.ndarray) -> np.ndarray:
    """Best value known after so many evaluations (a step function of the history)."""
    rows = np.searchsorted(history[:, 0], evaluations, side="right") - 1
    return np.asarray(history[np.clip(rows, 0, len(history) - 1), 1])


def _against_current(study: StudyFile, results: Lines) -> Panels:
    if study.current is None:
        raise ValueError("this study has no [per_current] section to plot")
    outcomes = current_results(study, results)
    method = "ga_novel" if "ga_novel" in outcomes else next(iter(outcomes))
    currents = sorted(outcomes[method])
    best = [min(outcomes[method][current], key=lambda line: float(line["value"])) for current in currents]
    names, units = list(best[0]["parameters"]), parameter_units(study.current, method)
    grid = np.linspace(min(currents), max(currents), 101)
    lines = parameter_relations(np.array(currents), best, study.current.degree) if len(currents) > 1 else {}
    made = []
    for name in names:
        values = np.array([line["parameters"][name] for line in best])
        traces = [Trace(np.array(currents), values, Style.POINTS, "best at each current", "#111111")]
        traces += [
            Trace(grid, relation.at(grid), name=relation.kind, colour=category_colour(place))
            for place, relation in enumerate(lines.get(name, []))
        ]
        unit = "" if units[name] == "1" else units[name]
        made.append(Figure(Axis("I", "A"), Axis(name, unit), traces, WHOLE // 3, 200, legend=name == names[0]))
    return Panels(tuple(made), 3, f"{TITLES[method]}: parameters vs. current")
