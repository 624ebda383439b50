"""One search of a study as a value, its key in the results file, and the list a study file stands for.

A method whose path does not depend on its budget spends the same evaluations first whatever the budget. So its cells
that differ in nothing but the budget have one seed, and one search, the longest, gives the values of them all.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rig.optimisers.fruit_fly import ContrastFruitFly
from rig.optimisers.methods import STEERED_BY_BUDGET
from rig.study.study_file import SETTINGS, Sensitivity, StudyFile

SENSITIVITY = ("N", "K", "Nres")
CURRENT = "current:"


@dataclass(frozen=True)
class SearchCell:
    """One search: which problem, which method, which repeat.

    Attributes:
        problem: Damper model, or for paper 2 `current:<A>`.
        method: As the study file writes it.
        population: Candidates a generation, N.
        budget: Evaluations, fun_evals.
        repeat: Counts from 0.
        settings: Settings beside those the method's name implies.
        marks: Smaller budgets whose values the same search gives.
    """

    problem: str
    method: str
    population: int
    budget: int
    repeat: int
    settings: Mapping[str, object] = field(default_factory=dict)
    marks: tuple[int, ...] = ()

    @property
    def key(self) -> str:
        """Name in the results file; equal cells of different tables share one search."""
        return self.key_at(self.budget)

    def key_at(self, budget: int) -> str:
        """Key of the cell that differs from this one in nothing but its budget."""
        extra = json.dumps(dict(self.settings), sort_keys=True) if self.settings else ""
        return f"{self.problem}|{self.method}|N={self.population}|fun_evals={budget}|{self.repeat}{extra}"

    @property
    def shares_searches(self) -> bool:
        """Whether cells of other budgets are the beginning or the continuation of this one's search."""
        return self.algorithm[0] not in STEERED_BY_BUDGET

    def seed(self, study_seed: int) -> int:
        """Seed of this search: the same in every session, and for all budgets where they share a search.

        Args:
            study_seed: Seed of the study.

        Returns:
            A non-negative integer.
        """
        name = self.key_at(0) if self.shares_searches else self.key
        return study_seed * 2**32 + zlib.crc32(name.encode())

    @property
    def current_A(self) -> float:
        """Current of a cell of paper 2's study."""
        return float(self.problem.removeprefix(CURRENT))

    @property
    def algorithm(self) -> tuple[str, dict[str, Any]]:
        """Name among the algorithms and their settings."""
        name, implied = SETTINGS.get(self.method, (self.method, {}))
        return name, {**implied, **self.settings}


def comparison_cells(study: StudyFile) -> Iterator[SearchCell]:
    """The product models x methods x populations x budgets x repeats.

    Args:
        study: The study.

    Yields:
        Repeat by repeat, so that an interrupted study has every setting equally often.
    """
    settings = study.comparison
    for repeat in range(settings.repeats):
        for model in settings.models:
            for method in settings.methods:
                for population in settings.populations:
                    for budget in settings.budgets:
                        yield SearchCell(model, method, population, budget, repeat)


def symmetry_cells(study: StudyFile) -> Iterator[SearchCell]:
    """Asymmetric and symmetric model, Table 3.

    Args:
        study: The study.

    Yields:
        Repeat by repeat.
    """
    if study.symmetry is None:
        return
    settings = study.symmetry
    for repeat in range(study.comparison.repeats):
        for model in ("asymmetric", "symmetric"):
            yield SearchCell(model, settings.method, settings.population, settings.budget, repeat)


def sensitivity_cells(study: StudyFile) -> Iterator[SearchCell]:
    """c-FOA with one of N, K, N_res varied, Tables 7-9.

    Args:
        study: The study.

    Yields:
        Parameter by parameter.
    """
    if study.sensitivity is not None:
        for parameter in SENSITIVITY:
            for _, cell in varied_cells(study, study.sensitivity, parameter):
                yield cell


def varied_cells(study: StudyFile, requested: Sensitivity, parameter: str) -> Iterator[tuple[int, SearchCell]]:
    """c-FOA with one parameter varied and the others at their first values.

    Args:
        study: The study.
        requested: Its values.
        parameter: One of `SENSITIVITY`.

    Yields:
        The parameter's value and a cell with it, repeat by repeat. A search of K generations has N K + 1 evaluations:
        the start counts, too.
    """
    first = {"N": requested.populations[0], "K": requested.generations[0], "Nres": requested.resolutions[0]}
    choices = {"N": requested.populations, "K": requested.generations, "Nres": requested.resolutions}[parameter]
    for repeat in range(study.comparison.repeats):
        for value in choices:
            varied = {**first, parameter: value}
            budget = varied["N"] * varied["K"] + 1
            settings = {} if varied["Nres"] == ContrastFruitFly().resolution else {"resolution": varied["Nres"]}
            yield value, SearchCell(study.comparison.models[0], "c_foa", varied["N"], budget, repeat, settings)


def current_cells(study: StudyFile) -> Iterator[SearchCell]:
    """Every genetic algorithm of paper 2 at every current.

    Args:
        study: The study.

    Yields:
        Repeat by repeat; the three-step method draws nothing, so it has one repeat.
    """
    if study.current is None:
        return
    settings = study.current
    for repeat in range(settings.repeats):
        for current_A in settings.current_A:
            for method in settings.methods:
                if method == "zhu_three_step" and repeat > 0:
                    continue
                yield SearchCell(f"{CURRENT}{current_A!r}", method, settings.population, settings.budget, repeat)


def all_cells(study: StudyFile) -> list[SearchCell]:
    """Every cell of a study's tables, each once.

    Args:
        study: The study.

    Returns:
        Cells with different keys, repeat by repeat.
    """
    cells: dict[str, SearchCell] = {}
    for source in (comparison_cells, symmetry_cells, sensitivity_cells, current_cells):
        for cell in source(study):
            cells.setdefault(cell.key, cell)
    return sorted(cells.values(), key=lambda cell: cell.repeat)


def searches(cells: Iterable[SearchCell], finished: Collection[str]) -> list[SearchCell]:
    """The searches that give every cell its result.

    Args:
        cells: Cells of a study.
        finished: Keys that have a result.

    Returns:
        Cells to run, repeat by repeat and the longest of a repeat first; `marks` are the budgets they serve besides
        their own.
    """
    groups: dict[str, list[SearchCell]] = {}
    for cell in cells:
        if cell.key not in finished:
            groups.setdefault(cell.key_at(0) if cell.shares_searches else cell.key, []).append(cell)
    todo = []
    for group in groups.values():
        *shorter, longest = sorted(group, key=lambda cell: cell.budget)
        todo.append(replace(longest, marks=tuple(cell.budget for cell in shorter)))
    return sorted(todo, key=lambda cell: (cell.repeat, -cell.budget))
