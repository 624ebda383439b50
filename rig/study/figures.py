"""Figures of a study as SVG text, in the papers' order: those of results here, those of loops in `loop_figures`."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.study.loop_figures import (
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_INCH = 9.0
FEWEST_ERRORS = 10
DETAIL = 100.0
"""The detail of Figure 9 ends at so many times the lowest value."""
Outcomes = Mapping[str, Mapping[float, list[Mapping[str, Any]]]]
"""Method -> current (A) -> result lines."""


def figures(study: StudyFile, bench: Workbench, results: Lines, driven: Rides | None = None) -> dict[str, str]:
    """Every figure the results allow.

    Args:
        study: The study.
        bench: Its recordings.
        results: Result lines by key.
        driven: From `rides`.

    Returns:
        Name such as `figure-08` -> SVG, in the papers' order.
    """
    drawn: dict[str, Figure | None] = {
        "figure-03": motion_figure(study, _new_figure),
        "figure-04": triangle_figure(study, _new_figure),
        "figure-05": recorded_figure(bench.tests, _new_figure),
    }
    groups = setting_groups(study, results)
    if groups:
        drawn["figure-08"] = _box_plots(study, groups)
        drawn["figure-08-pair"] = _tuned_pair(study, results)
        drawn["figure-09"] = _convergence(study, results)
        drawn["figure-10"] = fitted_figure(study, results, bench.tests, "velocity", _new_figure)
        drawn["figure-11"] = fitted_figure(study, results, bench.tests, "extension", _new_figure)
    drawn |= ride_figures(driven, _new_figure) if driven is not None else {}
    outcomes = current_results(study, results)
    if study.current is not None and outcomes:
        drawn["paper2-figure-08"] = recorded_figure(list(bench.current_tests.values()), _new_figure)
        drawn["paper2-figure-10"] = _error_against_generations(outcomes)
        drawn["paper2-figure-11"] = _error_distribution(outcomes)
        tests, force, label = bench.current_tests, bench.current_force, recorded(study.current.data)
        drawn["paper2-figure-12"] = reconstructed_figure(outcomes, tests, force, label, _new_figure)
        drawn["paper2-figure-13-bars"] = _error_bars(outcomes)
        drawn["paper2-figure-relations"] = _against_current(study, results)
    return {name: _svg(figure) for name, figure in drawn.items() if figure is not None}


def _new_figure(height_inch: float) -> Figure:
    from matplotlib.figure import Figure  # heavy, and drawn without any display

    return Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]


def _box_plots(study: StudyFile, groups: Mapping[str, list[float]]) -> Figure:
    figure = _new_figure(1.0 + 0.22 * len(groups))
    axes = figure.subplots()
    axes.boxplot(list(groups.values()), orientation="horizontal", tick_labels=list(groups))
    axes.set_xscale("log")
    axes.set_xlabel(f"objective f(s) / {objective_unit(study)}")
    axes.invert_yaxis()
    axes.grid(visible=True, axis="x", alpha=0.3)
    axes.tick_params(axis="y", labelsize=7)
    return figure


def _convergence(study: StudyFile, results: Lines) -> Figure:
    """Median best value against evaluations, each method at its best setting; the band holds the middle half."""
    figure = _new_figure(5.0)
    whole, detail = figure.subplots(1, 2)
    model, lowest = study.comparison.models[0], np.inf
    for method, (population, budget, _) in best_settings(study, results).items():
        cells = [SearchCell(model, method, population, budget, repeat) for repeat in range(study.comparison.repeats)]
        histories = [np.array(results[cell.key]["history"]) for cell in cells if cell.key in results]
        grid = np.linspace(population, budget, 200)
        curves = np.array([_at(history, grid) for history in histories])
        lowest = min(lowest, float(np.min(curves)))
        for axes in (whole, detail):
            _band(axes, grid, curves, f"{TITLES[method]}, N={population}")
    for axes in (whole, detail):
        axes.set_xlabel("objective evaluations")
        axes.tick_params(labelsize=7)
    whole.set_ylabel(f"best f(s) / {objective_unit(study)}: median and middle half")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    detail.set_xlim(left=0.5 * float(whole.get_xlim()[1]))
    detail.set_ylim(0.8 * lowest, DETAIL * lowest)
    return figure


def _tuned_pair(study: StudyFile, results: Lines) -> Figure | None:
    """Best-tuned PSO beside best-tuned c-FOA, as the paper shows them; None where one of them took no part."""
    best, model = best_settings(study, results), study.comparison.models[0]
    if not {"pso", "c_foa"} <= best.keys():
        return None
    figure = _new_figure(2.2)
    axes = figure.subplots()
    settings = [(method, *best[method][:2]) for method in ("pso", "c_foa")]
    values = [setting_values(study, results, model, *setting) for setting in settings]
    labels = [f"{TITLES[method]}, N={N}, {budget}" for method, N, budget in settings]
    axes.boxplot(values, orientation="horizontal", tick_labels=labels)
    axes.set_xlabel(f"objective f(s) / {objective_unit(study)}")
    axes.grid(visible=True, axis="x", alpha=0.3)
    return figure


def _error_against_generations(outcomes: Outcomes) -> Figure:
    """Minimum fitness so far of every genetic algorithm and its running average, means over currents and repeats."""
    figure = _new_figure(4.0)
    axes = figure.subplots()
    for method, by_current in outcomes.items():
        lines = [line for repeats in by_current.values() for line in repeats if line["generations"] > 1]
        if not lines:
            continue
        histories = [np.array(line["history"]) for line in lines]
        grid = np.arange(1, max(int(line["generations"]) for line in lines) + 1)
        steps = [line["evaluations"] / max(1, line["generations"]) for line in lines]
        minima = np.mean([_at(history, grid * step) for history, step in zip(histories, steps, strict=True)], axis=0)
        drawn = axes.plot(grid, minima, label=f"{TITLES[method]}: minimum")[0]
        average = np.cumsum(minima) / grid
        axes.plot(grid, average, linestyle="--", color=drawn.get_color(), label=f"{TITLES[method]}: running average")
    axes.set_xlabel("generation")
    axes.set_ylabel("mean(((Fsim - Fexp) / SD(Fexp))^2)")
    axes.set_yscale("log")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize=7)
    return figure


def _error_distribution(outcomes: Outcomes) -> Figure | None:
    """Minimum errors of one search's generations in 10 bins, their share up to each, and what an exponential gives.

    The statistical stop of paper 2 takes them for exponentially distributed. Of long searches
    evenly spaced generations are shown.
    """
    method = "ga_novel" if "ga_novel" in outcomes else next(iter(outcomes))
    line = max((one for lines in outcomes[method].values() for one in lines), key=lambda one: len(one["history"]))
    errors = np.array(line["history"])[:, 1]
    if errors.size < FEWEST_ERRORS:
        return None
    figure = _new_figure(3.2)
    left, right = figure.subplots(1, 2)
    said = f"{TITLES[method]} at {float(line['problem'].removeprefix(CURRENT)):g} A, repeat {line['repeat'] + 1}"
    figure.suptitle(f"{said}: {errors.size} values from {line['generations']} generations", fontsize=9)
    mean = float(np.mean(errors))
    grid = np.linspace(0.0, float(errors.max()), 200)
    left.hist(errors, bins=10, density=True, alpha=0.5)
    left.plot(grid, np.exp(-grid / mean) / mean, color="C3")
    left.set_ylabel("density")
    ordered = np.sort(errors)
    right.step(ordered, np.arange(1, ordered.size + 1) / ordered.size, where="post", label=TITLES[method])
    right.plot(grid, 1.0 - np.exp(-grid / mean), color="C3", label="exponential of the same mean")
    right.set_ylabel("share up to here")
    right.legend(fontsize=7)
    for axes in (left, right):
        axes.set_xlabel("minimum error of a generation")
        axes.grid(visible=True, alpha=0.3)
    return figure


def _error_bars(outcomes: Outcomes) -> Figure:
    """MAE, SD and generations of every method, means over currents and repeats."""
    figure = _new_figure(3.0)
    titles = [TITLES[method] for method in outcomes]
    for axes, (entry, label) in zip(
        figure.subplots(1, 3), (("mae_N", "MAE / N"), ("sd_N", "SD / N"), ("generations", "generations")), strict=True
    ):
        heights = [
            float(np.mean([line[entry] for lines in by_current.values() for line in lines]))
            for by_current in outcomes.values()
        ]
        axes.barh(titles, heights)
        axes.invert_yaxis()
        axes.set_xlabel(label)
        axes.tick_params(labelsize=7)
        if axes is not figure.axes[0]:
            axes.set_yticklabels([])
    return figure


def _band(axes: Axes, grid: np.ndarray, curves: np.ndarray, label: str) -> None:
    line = axes.plot(grid, np.median(curves, axis=0), label=label, marker="o" if len(set(grid)) == 1 else None)[0]
    low, high = np.percentile(curves, [25, 75], axis=0)
    axes.fill_between(grid, low, high, alpha=0.15, color=line.get_color())
    axes.set_yscale("log")
    axes.grid(visible=True, alpha=0.3)


def _at(history: np.ndarray, evaluations: np.ndarray) -> np.ndarray:
    """Best value known after so many evaluations (a step function of the history)."""
    rows = np.searchsorted(history[:, 0], evaluations, side="right") - 1
    return np.asarray(history[np.clip(rows, 0, len(history) - 1), 1])


def _against_current(study: StudyFile, results: Lines) -> Figure:
    if study.current is None:
        raise ValueError("this study has no per-current part to draw")
    outcomes = current_results(study, results)
    method = "ga_novel" if "ga_novel" in outcomes else next(iter(outcomes))
    currents = sorted(outcomes[method])
    best = [min(outcomes[method][current], key=lambda line: float(line["value"])) for current in currents]
    names, units = list(best[0]["parameters"]), parameter_units(study.current, method)
    rows = -(-len(names) // 3)
    figure = _new_figure(2.2 * rows)
    grid = np.linspace(min(currents), max(currents), 101)
    lines = parameter_relations(np.array(currents), best, study.current.degree) if len(currents) > 1 else {}
    for axes, name in zip(figure.subplots(rows, 3, squeeze=False).flat, names, strict=False):
        axes.plot(currents, [line["parameters"][name] for line in best], "ko", markersize=4)
        for relation in lines.get(name, []):
            axes.plot(grid, relation.at(grid), label=relation.kind, linewidth=1)
        axes.set_title(f"{name} / {units[name]}", fontsize=9)
        axes.set_xlabel("I / A", fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in figure.axes[len(names) :]:
        axes.set_axis_off()
    if lines:
        figure.axes[0].legend(fontsize=7)
    figure.suptitle(f"{TITLES[method]}: parameters against current", fontsize=10)
    return figure
