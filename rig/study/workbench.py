"""Runs one search of a study: builds the problem once a process, searches, and says what a results line holds.

Paper 2's searches, too: one test at one current, a Bouc-Wen model without affine terms, its fitness and its boxes.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers.algebraic import ColumnModel
from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement, thinned
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.problem import FixedParameters, Problem
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import solve_separable
from rig.identification.models.three_steps import identify
from rig.optimisers import Result, minimise
from rig.optimisers.search import Callback
from rig.study.recordings import content_hash, measurements, one_a_current
from rig.study.results import error_summary, failure_line, force_errors, result_line
from rig.study.search_cell import CURRENT, SearchCell
from rig.study.study_file import LED, CurrentStudy, StudyFile

CURRENT_FIXED: dict[str, dict[str, float]] = {
    "bouc_wen": {"c0_b": 0.0, "alpha_b": 0.0, "A": 40.0},
    "normalized_bouc_wen": {"kv_b": 0.0, "kw_b": 0.0},
}
"""Held when one current is fitted: the affine terms, and A, which is redundant with alpha."""


def current_objective(test: Measurement, settings: CurrentStudy) -> FixedParameters:
    """Paper 2's fitness of one test: mean(((F_sim - F_exp) / SD(F_exp))^2).

    Args:
        test: The recording, at constant current.
        settings: Its model.

    Returns:
        The objective over the parameters that one current can tell.
    """
    problem = Problem([test], settings.model, "1")
    measured_N = test.force_N[test.scored]
    scale = 1.0 / (len(measured_N) * float(np.var(measured_N, ddof=1)))
    return FixedParameters(problem, CURRENT_FIXED[settings.model], scale)


def current_box(settings: CurrentStudy, names: Sequence[str]) -> FloatArray:
    """Search box of the per-current study.

    Args:
        settings: Its model and boxes.
        names: Free parameters.

    Returns:
        Shape (p, 2).
    """
    return np.array([settings.boxes[name] for name in names])


def three_steps(cell: SearchCell, test: Measurement) -> dict[str, Any]:
    """Zhu's three steps on one test, as a results line.

    Args:
        cell: The search.
        test: The recording.

    Returns:
        A line of the results file; `evaluations` are integrations of the transitions. Where the loop has no saturated
        branch or too few samples, a line that says so.
    """
    started_ns = time.monotonic_ns()
    try:
        fit = identify(*(samples[test.scored] for samples in (test.u_m, test.v_m_s, test.force_N)))
    except IdentificationFailed as error:
        return failure_line(cell, f"{test.id}: {error}")
    seconds = (time.monotonic_ns() - started_ns) * 1e-9
    names = ("kx", "kv", "kw", "f0", "rho", "sigma", "n")
    values = {name: float(getattr(fit, name)) for name in names}
    force_N = modelled_force(damper_model("normalized_bouc_wen"), {**values, "kv_b": 0.0, "kw_b": 0.0}, test)
    error_N = (test.force_N - force_N)[test.scored]
    value = float(np.mean(error_N**2) / np.var(test.force_N[test.scored], ddof=1))
    history = np.array([[fit.evaluations, value]])
    result = Result(np.array(list(values.values())), value, fit.evaluations, history, 0, "converged", seconds)
    return result_line(cell, names, result, **error_summary(error_N))


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
        self.tests = [thinned(test, study.data.keep_every) for test in tests]
        self.current_tests: dict[float, Measurement] = {}
        if study.current is not None:
            settings = study.current
            recorded, left_out = measurements(settings.data, study.seed, settings.current_A)
            self.current_tests = one_a_current(recorded, settings.current_A)
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
            settings = self.study.comparison
            self._problems[model] = Problem(self.tests, model, settings.weight, settings.hysteresis)
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
        if not isinstance(problem.model, ColumnModel):
            return None
        try:
            solution = solve_separable(self.tests, problem.model, Weighting(problem.weight), non_negative=frozenset())
        except IdentificationFailed:
            return None
        return problem.objective(problem.vector(solution.values))

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
        result = minimise(
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
        return result_line(cell, problem.names, result, **force_errors(problem, result.best))

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

    def current_force(self, method: str, line: Mapping[str, Any], test: Measurement) -> FloatArray:
        """Force (N), shape (n,), of a result of the per-current study on a recording.

        Args:
            method: As the study file writes it.
            line: Its result.
            test: The recording.

        Raises:
            ValueError: The study has no per-current part.
        """
        if self.study.current is None:
            raise ValueError("this study has no [per_current] section")
        name = "normalized_bouc_wen" if method == "zhu_three_step" else self.study.current.model
        return modelled_force(damper_model(name), {**CURRENT_FIXED[name], **line["parameters"]}, test)

    def _run_current(self, cell: SearchCell, callback: Callback | None) -> dict[str, Any]:
        requested = self.study.current
        if requested is None:
            raise ValueError(f"{cell.key}: the study has no [per_current] section")
        test = self.current_tests[cell.current_A]
        if cell.method == "zhu_three_step":
            return three_steps(cell, test)
        objective = current_objective(test, requested)
        name, settings = cell.algorithm
        result = minimise(
            objective,
            method=name,
            bounds=current_box(requested, objective.names),
            population=cell.population,
            budget=cell.budget,
            seed=cell.seed(self.study.seed),
            callback=callback,
            marks=cell.marks,
            **settings,
        )
        whole = objective.whole(result.best[None, :])[0]
        return result_line(cell, objective.names, result, **force_errors(objective.problem, whole))
