"""One search of a study as a value, its key in the results file, and the list a study file stands for."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rig.study.study_file import SETTINGS, StudyFile


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
    """

    problem: str
    method: str
    population: int
    budget: int
    repeat: int
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Name in the results file; equal cells of different tables share one search."""
        extra = json.dumps(dict(self.settings), sort_keys=True) if self.settings else ""
        return f"{self.problem}|{self.method}|N={self.population}|fun_evals={self.budget}|{self.repeat}{extra}"

    def seed(self, study_seed: int) -> int:
        """Seed of this search: its own, the same in every session.

        Args:
            study_seed: Seed of the study.

        Returns:
            A non-negative integer.
        """
        return study_seed * 2**32 + zlib.crc32(self.key.encode())

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
    wanted = study.comparison
    for repeat in range(wanted.repeats):
        for model in wanted.models:
            for method in wanted.methods:
                for population in wanted.populations:
                    for budget in wanted.budgets:
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
    wanted = study.symmetry
    for repeat in range(study.comparison.repeats):
        for model in ("asymmetric", "symmetric"):
            yield SearchCell(model, wanted.method, wanted.population, wanted.budget, repeat)


def sensitivity_cells(study: StudyFile, parameter: str | None = None) -> Iterator[SearchCell]:
    """c-FOA with one of N, K, N_res varied and the others at their first values, Tables 7-9.

    Args:
        study: The study.
        parameter: `N`, `K` or `Nres`; None for all three.

    Yields:
        Repeat by repeat. A search of K generations has N K + 1 evaluations: the start counts, too.
    """
    if study.sensitivity is None:
        return
    wanted = study.sensitivity
    model = study.comparison.models[0]
    N, K, resolution = wanted.populations[0], wanted.generations[0], wanted.resolutions[0]
    settings = {
        "N": [(each, K, resolution) for each in wanted.populations],
        "K": [(N, each, resolution) for each in wanted.generations],
        "Nres": [(N, K, each) for each in wanted.resolutions],
    }
    for repeat in range(study.comparison.repeats):
        for name, choices in settings.items():
            if parameter not in {None, name}:
                continue
            for population, generations, each in choices:
                budget = population * generations + 1
                yield SearchCell(model, "c_foa", population, budget, repeat, {"resolution": each})


def current_cells(study: StudyFile) -> Iterator[SearchCell]:
    """Every genetic algorithm of paper 2 at every current.

    Args:
        study: The study.

    Yields:
        Repeat by repeat; the three-step method draws nothing, so it has one repeat.
    """
    if study.current is None:
        return
    wanted = study.current
    for repeat in range(wanted.repeats):
        for current_A in wanted.current_A:
            for method in wanted.methods:
                if method == "zhu_three_step" and repeat > 0:
                    continue
                yield SearchCell(f"current:{current_A:g}", method, wanted.population, wanted.budget, repeat)


def all_cells(study: StudyFile) -> list[SearchCell]:
    """Every search of a study, each once.

    Args:
        study: The study.

    Returns:
        Cells with different keys, in the order in which they are run.
    """
    cells: dict[str, SearchCell] = {}
    for source in (comparison_cells, symmetry_cells, sensitivity_cells, current_cells):
        for cell in source(study):
            cells.setdefault(cell.key, cell)
    return sorted(cells.values(), key=lambda cell: cell.repeat)
