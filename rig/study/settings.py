"""Values of the comparison's settings (a method with a population and a budget), and statistics over their repeats."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.study.post_hoc import Pair, dunn
from rig.study.search_cell import SearchCell, comparison_cells
from rig.study.study_file import StudyFile

Lines = Mapping[str, Mapping[str, Any]]

MOST_PAIRED = 12
"""Settings compared pair by pair after a test of them all; more have more pairs than a reader can use."""
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


def objective_unit(study: StudyFile) -> str:
    """Unit of the objective (12): of (force times velocity)^2, or of force^2 where nothing weights it.

    Args:
        study: The study.
    """
    return "W^2" if study.comparison.weight == "v" else "N^2"


def best_settings(study: StudyFile, results: Lines) -> dict[str, tuple[int, int, Summary]]:
    """Population and budget with the lowest mean value of each method, as the paper's Table 2 chooses them.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Method -> population, budget, summary; methods without a result are left out.
    """
    model = study.comparison.models[0]
    best: dict[str, tuple[int, int, Summary]] = {}
    for method in study.comparison.methods:
        settings = [
            (population, budget, summary)
            for population in study.comparison.populations
            for budget in study.comparison.budgets
            if (summary := setting_summary(study, results, model, method, population, budget)) is not None
        ]
        if settings:
            best[method] = min(settings, key=lambda entry: entry[2].mean)
    return best


def best_lines(study: StudyFile, results: Lines) -> dict[str, Mapping[str, Any]]:
    """The search that ended lowest, of every method, over all its settings with the first model.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Method -> result line, in the study file's order; methods without a result are left out.
    """
    by_method: dict[str, list[Mapping[str, Any]]] = {method: [] for method in study.comparison.methods}
    for cell in comparison_cells(study):
        if cell.problem == study.comparison.models[0] and cell.key in results:
            by_method[cell.method].append(results[cell.key])
    return {method: min(lines, key=lambda line: float(line["value"])) for method, lines in by_method.items() if lines}


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
    model, settings = study.comparison.models[0], study.comparison
    groups: dict[str, list[float]] = {}
    for method in settings.methods:
        for N in settings.populations:
            for turn, budget in enumerate(settings.budgets):
                cells = [SearchCell(model, method, N, budget, repeat) for repeat in range(settings.repeats)]
                if each_search_once and cells[0].shares_searches:
                    cells = cells[turn :: len(settings.budgets)]
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


@dataclass(frozen=True)
class Summary:
    """What the papers state of repeated searches.

    Attributes:
        best: BV, lowest objective value.
        mean: MV.
        deviation: SD with N - 1; nan for a single repeat.
        median: Median, beside the papers.
        repeats: How many.
    """

    best: float
    mean: float
    deviation: float
    median: float
    repeats: int


def summarise(values: Sequence[float]) -> Summary:
    """BV, MV, SD and median of repeats.

    Args:
        values: Objective values, at least one.

    Returns:
        The summary.

    Raises:
        ValueError: There is no value.
    """
    if not values:
        raise ValueError("no repeats to summarise")
    array = np.asarray(values, dtype=np.float64)
    deviation = float(np.std(array, ddof=1)) if len(array) > 1 else float("nan")
    return Summary(float(array.min()), float(array.mean()), deviation, float(np.median(array)), len(array))


@dataclass(frozen=True)
class KruskalWallis:
    """Rank test of the hypothesis that every setting draws from one distribution.

    Attributes:
        statistic: H, corrected for ties.
        p: Probability of so large an H under the hypothesis.
        mean_ranks: Mean rank of each setting over all values together, lower is better.
        note: What the reader must know of the values; empty when nothing.
        pairs: Dunn's test of every two settings, with Holm's correction; none where there are more than `MOST_PAIRED`
            settings.
    """

    statistic: float
    p: float
    mean_ranks: Mapping[str, float]
    note: str = ""
    pairs: tuple[Pair, ...] = ()


def kruskal_wallis(groups: Mapping[str, Sequence[float]], note: str = "") -> KruskalWallis | None:
    """Kruskal-Wallis test over settings.

    Args:
        groups: Values of each setting, independent of each other.
        note: Kept with the test.

    Returns:
        The test; None when there are fewer than two settings, a setting has fewer than two values, or all values are
        equal.
    """
    from scipy.stats import kruskal, rankdata  # only studies need SciPy's statistics

    values = [np.asarray(group, dtype=np.float64) for group in groups.values()]
    if len(values) < 2 or min(len(group) for group in values) < 2:
        return None
    pooled = np.concatenate(values)
    if np.all(pooled == pooled[0]):
        return None
    outcome = kruskal(*values)
    ranks = np.split(rankdata(pooled), np.cumsum([len(group) for group in values])[:-1])
    mean_ranks = {name: float(np.mean(part)) for name, part in zip(groups, ranks, strict=True)}
    pairs = dunn(groups) if len(groups) <= MOST_PAIRED else ()
    return KruskalWallis(float(outcome.statistic), float(outcome.pvalue), mean_ranks, note, pairs)
