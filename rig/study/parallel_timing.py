"""Serial against parallel computing, Table 6: the same search on one and on more processes."""

from __future__ import annotations

import os
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from rig.optimisers import Result, minimise
from rig.study.results import ResultsFile, result_line
from rig.study.search_cell import SearchCell
from rig.study.study_file import Parallel
from rig.study.workbench import Workbench

WARM_GENERATIONS = 4


def parallel_key(settings: Parallel, model: str, processes: int) -> str:
    """Key of one timing in the results file; another method, population or length is another timing.

    Args:
        settings: Method, population and evaluations.
        model: Damper model.
        processes: How many.

    Returns:
        The key; it begins with `parallel|`.
    """
    return f"parallel|{processes}|{_cell(settings, model).key}"


def time_parallel(settings: Parallel, bench: Workbench, results: ResultsFile) -> None:
    """Wall time of the same search on one and on more processes, where it is not known yet.

    Args:
        settings: What is timed.
        bench: Has the problems.
        results: Gets one line for each model and number of processes.
    """
    for model in settings.models:
        for processes in settings.processes:
            key = parallel_key(settings, model, processes)
            if key in results:
                continue
            if processes == 1:
                line = _timed(settings, bench, model, None)
            else:
                with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                    line = _timed(settings, bench, model, pool, processes)
            results.add({**line, "key": key, "processes": processes, "processors": os.cpu_count() or 1})


def _cell(settings: Parallel, model: str) -> SearchCell:
    return SearchCell(model, settings.method, settings.population, settings.evaluations, 0)


def _timed(
    requested: Parallel, bench: Workbench, model: str, executor: Executor | None, chunks: int = 1
) -> dict[str, Any]:
    problem, cell = bench.problem(model), _cell(requested, model)
    name, settings = cell.algorithm

    def search(budget: int) -> Result:
        return minimise(
            problem,
            method=name,
            start=bench.start(cell, problem.n_parameters),
            bounds=bench.bounds(problem),
            population=requested.population,
            budget=budget,
            seed=1,
            executor=executor,
            chunks=chunks,
            **settings,
        )

    search(WARM_GENERATIONS * requested.population)
    return result_line(cell, problem.names, search(requested.evaluations))
