"""Values of the comparison's settings: a setting is a method with a population and a budget."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rig.study.search_cell import SearchCell
from rig.study.statistics import Summary, summarise
from rig.study.study_file import StudyFile

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
    return values_of(cells, results)


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
                groups[f"{TITLES[method]}, N={N}, {budget}"] = values_of(cells, results)
    return {name: values for name, values in groups.items() if values}


def setting_summary(
    study: StudyFile, results: Lines, model: str, method: str, population: int, budget: int
) -> Summary | None:
    """BV, MV and SD of one setting, None before its first result; arguments as `setting_values`."""
    values = setting_values(study, results, model, method, population, budget)
    return summarise(values) if values else None


def values_of(cells: Iterable[SearchCell], results: Lines) -> list[float]:
    """Objective values of those cells that have a result, in their order."""
    return [float(results[cell.key]["value"]) for cell in cells if cell.key in results]
