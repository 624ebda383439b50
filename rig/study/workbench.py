"""Runs one search of a study: builds the problem once a process, searches, and says what a results line holds."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig.dampers.algebraic import AlgebraicModel
from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement
from rig.identification.models.problem import Problem
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import solve_separable
from rig.optimisers import minimise
from rig.optimisers.search import Callback
from rig.study.per_current import current_box, current_objective, three_steps
from rig.study.recordings import content_hash, measurements, one_a_current, thinned
from rig.study.result_line import force_errors, result_line
from rig.study.search_cell import CURRENT, SearchCell
from rig.study.study_file import LED, StudyFile

WIDE_BOUND = 1e4


class Workbench:
    """Everything one process needs to run any search of a study; problems are built when first asked for.

    Attributes:
        study: The study.
        tests: Recordings of the comparison.
        current_tests: Recordings of the per-current study, one for each current (A).
        left_out: One line for each recorded point that cannot be used.
    """

    def __init__(self, study: StudyFile) -> None:
        self.study = study
        tests, self.left_out = measurements(study.data, study.seed)
        self.tests = [thinned(each, study.data.keep_every) for each in tests]
        self.current_tests: dict[float, Measurement] = {}
        if study.current is not None:
            wanted = study.current
            found, left_out = measurements(wanted.data, study.seed, wanted.current_A)
            self.current_tests = one_a_current(found, wanted.current_A)
            self.left_out += left_out
        self._problems: dict[str, Problem] = {}

    @property
    def fingerprint(self) -> str:
        """Hash of the study's decisions and of its recordings' content."""
        return f"{self.study.fingerprint}-{content_hash([*self.tests, *self.current_tests.values()])}"

    def problem(self, model: str) -> Problem:
        """The comparison's problem with one damper model.

        Args:
            model: Name of a damper model.

        Returns:
            Always the same object for the same name.
        """
        if model not in self._problems:
            wanted = self.study.comparison
            self._problems[model] = Problem(self.tests, model, wanted.weight, wanted.hysteresis)
        return self._problems[model]

    def minimum(self, model: str) -> float | None:
        """Objective where the structure of the model leads: what every search of the comparison is to be held against.

        Args:
            model: Name of a damper model.

        Returns:
            The value `separable` reaches, without bounds; None for models with internal states, and where the
            recordings are too few for it.
        """
        problem = self.problem(model)
        if not isinstance(problem.model, AlgebraicModel):
            return None
        try:
            found = solve_separable(self.tests, problem.model, Weighting(problem.weight), non_negative=frozenset())
        except IdentificationFailed:
            return None
        return problem.objective(problem.vector(found.values))

    def run(self, cell: SearchCell, callback: Callback | None = None) -> dict[str, Any]:
        """Run one search.

        Args:
            cell: The search.
            callback: Called after every generation; True ends the search.

        Returns:
            A line of the results file.
        """
        if cell.problem.startswith(CURRENT):
            return self._run_current(cell, callback)
        problem = self.problem(cell.problem)
        name, settings = cell.algorithm
        found = minimise(
            problem,
            method=name,
            start=self.start(cell, problem.n_parameters),
            bounds=self.bounds(problem),
            population=cell.population,
            budget=cell.budget,
            seed=cell.seed(self.study.seed),
            callback=callback,
            marks=cell.marks,
            **settings,
        )
        return result_line(cell, problem.names, found, **force_errors(problem, found.best))

    def start(self, cell: SearchCell, size: int) -> FloatArray | None:
        """Where a search starts: all ones for c-FOA and those it is to lead, else what the algorithm draws by itself.

        Args:
            cell: The search.
            size: Number of parameters.

        Returns:
            Shape (size,), or None.
        """
        led = cell.algorithm[0] in LED
        return np.ones(size) if led and self.study.comparison.start == "ones" else None

    def bounds(self, problem: Problem) -> FloatArray | None:
        """The box of the comparison.

        Args:
            problem: The problem.

        Returns:
            Shape (p, 2), or None when the search is unbounded.
        """
        match self.study.comparison.bounds:
            case "none":
                return None
            case "wide":
                return np.tile([-WIDE_BOUND, WIDE_BOUND], (problem.n_parameters, 1))
            case _:
                return problem.bounds

    def _run_current(self, cell: SearchCell, callback: Callback | None) -> dict[str, Any]:
        wanted = self.study.current
        if wanted is None:
            raise ValueError(f"{cell.key}: the study has no per-current part")
        test = self.current_tests[cell.current_A]
        if cell.method == "zhu_three_step":
            return three_steps(cell, test)
        objective = current_objective(test, wanted)
        name, settings = cell.algorithm
        found = minimise(
            objective,
            method=name,
            bounds=current_box(wanted, objective.names),
            population=cell.population,
            budget=cell.budget,
            seed=cell.seed(self.study.seed),
            callback=callback,
            marks=cell.marks,
            **settings,
        )
        whole = objective.whole(found.best[None, :])[0]
        return result_line(cell, objective.names, found, **force_errors(objective.problem, whole))
