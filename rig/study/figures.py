"""Figures of a study as SVG text: box plots of every setting, convergence, parameters against current."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rig.study.paper2_tables import current_results, parameter_relations
from rig.study.search_cell import SearchCell
from rig.study.settings import TITLES, Lines, best_settings, setting_groups
from rig.study.study_file import StudyFile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_INCH = 9.0


def figures(study: StudyFile, results: Lines) -> dict[str, str]:
    """Every figure the results allow.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Name such as `figure-08` -> SVG.
    """
    drawn: dict[str, str] = {}
    groups = setting_groups(study, results)
    if groups:
        drawn["figure-08"] = _svg(_box_plots(groups))
        drawn["figure-09"] = _svg(_convergence(study, results))
    if current_results(study, results):
        drawn["paper2-figure-10"] = _svg(_error_against_evaluations(study, results))
        drawn["paper2-figure-relations"] = _svg(_against_current(study, results))
    return drawn


def _new_figure(height_inch: float) -> Figure:
    from matplotlib.figure import Figure  # heavy, and drawn without any display

    return Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]


def _box_plots(groups: Mapping[str, list[float]]) -> Figure:
    figure = _new_figure(1.0 + 0.22 * len(groups))
    axes = figure.subplots()
    axes.boxplot(list(groups.values()), orientation="horizontal", tick_labels=list(groups))
    axes.set_xscale("log")
    axes.set_xlabel("objective f(s)")
    axes.invert_yaxis()
    axes.grid(visible=True, axis="x", alpha=0.3)
    axes.tick_params(axis="y", labelsize=7)
    return figure


def _convergence(study: StudyFile, results: Lines) -> Figure:
    """Median best value against evaluations, each method at its best setting; the band holds the middle half."""
    figure = _new_figure(4.5)
    axes = figure.subplots()
    model = study.comparison.models[0]
    for method, (population, budget, _) in best_settings(study, results).items():
        cells = [SearchCell(model, method, population, budget, repeat) for repeat in range(study.comparison.repeats)]
        histories = [np.array(results[cell.key]["history"]) for cell in cells if cell.key in results]
        grid = np.linspace(population, budget, 200)
        curves = np.array([_at(history, grid) for history in histories])
        _band(axes, grid, curves, f"{TITLES[method]}, N={population}")
    axes.set_xlabel("objective evaluations")
    axes.set_ylabel("best f(s): median and middle half")
    return figure


def _error_against_evaluations(study: StudyFile, results: Lines) -> Figure:
    """Minimum fitness so far of every genetic algorithm: median over currents and repeats, and the middle half."""
    figure = _new_figure(4.0)
    axes = figure.subplots()
    for method, by_current in current_results(study, results).items():
        histories = [np.array(line["history"]) for lines in by_current.values() for line in lines]
        grid = np.linspace(
            min(history[0, 0] for history in histories), max(history[-1, 0] for history in histories), 200
        )
        _band(axes, grid, np.array([_at(history, grid) for history in histories]), TITLES[method])
    axes.set_xlabel("fitness evaluations")
    axes.set_ylabel("minimum of mean(((Fsim - Fexp) / SD(Fexp))^2)")
    return figure


def _band(axes: Axes, grid: np.ndarray, curves: np.ndarray, label: str) -> None:
    line = axes.plot(grid, np.median(curves, axis=0), label=label, marker="o" if len(set(grid)) == 1 else None)[0]
    low, high = np.percentile(curves, [25, 75], axis=0)
    axes.fill_between(grid, low, high, alpha=0.15, color=line.get_color())
    axes.set_yscale("log")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize=8)


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
    names = list(best[0]["parameters"])
    rows = -(-len(names) // 3)
    figure = _new_figure(2.2 * rows)
    grid = np.linspace(min(currents), max(currents), 101)
    lines = parameter_relations(np.array(currents), best, study.current.degree) if len(currents) > 1 else {}
    for axes, name in zip(figure.subplots(rows, 3, squeeze=False).flat, names, strict=False):
        axes.plot(currents, [line["parameters"][name] for line in best], "ko", markersize=4)
        for relation in lines.get(name, []):
            axes.plot(grid, relation.at(grid), label=relation.kind, linewidth=1)
        axes.set_title(name, fontsize=9)
        axes.set_xlabel("I / A", fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in figure.axes[len(names) :]:
        axes.set_axis_off()
    if lines:
        figure.axes[0].legend(fontsize=7)
    figure.suptitle(f"{TITLES[method]}: parameters against current", fontsize=10)
    return figure
