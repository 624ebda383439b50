"""Serial against parallel computing, Table 6: the same search on one and on more processes."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from rig.identification.algorithms import minimise
from rig.study.result_line import result_line
from rig.study.search_cell import SearchCell
from rig.study.study_file import StudyFile
from rig.study.workbench import Workbench


def time_parallel(study: StudyFile, tests: Workbench) -> list[dict[str, Any]]:
    """Wall time of the same search on one and on more processes, Table 6.

    Args:
        study: The study; its `parallel` section says how long and on how many processes.
        tests: Has the problem.

    Returns:
        One results line for each number of processes.
    """
    if study.parallel is None:
        return []
    wanted, lines = study.parallel, []
    problem = tests.problem(study.comparison.models[0])
    for processes in wanted.processes:
        cell = SearchCell(problem.model.name, wanted.method, wanted.population, wanted.evaluations, 0)
        name, settings = cell.algorithm
        started = tests.start(cell, problem.n_parameters)
        call: dict[str, Any] = {
            "method": name, "start": started, "population": wanted.population, "bounds": tests.bounds(problem),
            "seed": 1, **settings,
        }  # fmt: skip
        if processes == 1:
            minimise(problem, budget=wanted.population, **call)
            found = minimise(problem, budget=wanted.evaluations, **call)
        else:
            with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                call |= {"executor": pool, "chunks": processes}
                minimise(problem, budget=4 * wanted.population, **call)
                found = minimise(problem, budget=wanted.evaluations, **call)
        line = result_line(cell, problem.names, found)
        lines.append({**line, "key": f"parallel|{processes}|{cell.key}", "processes": processes})
    return lines
