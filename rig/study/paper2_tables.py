"""Tables of the novel-GA paper in its layout: errors and generations by method, parameters against current."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.dampers import model
from rig.fits.relation import Relation, relations
from rig.study.outputs import Cell, Table, known
from rig.study.recordings import BOUC_WEN_TRUTH
from rig.study.search_cell import current_cells
from rig.study.settings import TITLES, Lines
from rig.study.study_file import CurrentStudy, StudyFile

AT_THE_EDGE = 1e-3
"""Share of a box's width."""


def current_results(study: StudyFile, results: Lines) -> dict[str, dict[float, list[Mapping[str, Any]]]]:
    """Results of the per-current study.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        Method -> current (A) -> lines of its repeats; those that failed are left out.
    """
    outcomes: dict[str, dict[float, list[Mapping[str, Any]]]] = {}
    for cell in current_cells(study):
        if cell.key in results and "failed" not in results[cell.key]:
            outcomes.setdefault(cell.method, {}).setdefault(cell.current_A, []).append(results[cell.key])
    return outcomes


def current_tables(study: StudyFile, results: Lines) -> list[Table]:
    """Figure 13 and Tables 1 and 2 of paper 2, and the relations of every parameter to the current.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        No table when the study has no per-current part.
    """
    outcomes = current_results(study, results)
    if not outcomes:
        return []
    return [
        error_table(outcomes, _failures(study, results)),
        improvement_table(outcomes),
        *parameter_tables(study, outcomes),
    ]


def error_table(outcomes: Mapping[str, Mapping[float, list[Mapping[str, Any]]]], failures: str = "") -> Table:
    """MAE (21), SD (22) and generations to convergence of every method, means over currents and repeats: Figure 13.

    Args:
        outcomes: From `current_results`.
        failures: What could not be done, for the note.

    Returns:
        One row for each method.
    """
    rows = []
    for method, by_current in outcomes.items():
        lines = [line for repeats in by_current.values() for line in repeats]
        stopped = sum(line["stopped_by"] in {"statistics", "converged"} for line in lines)
        rows.append((
            TITLES[method], _mean(lines, "mae_N"), _mean(lines, "sd_N"), _mean(lines, "generations"),
            _mean(lines, "evaluations"), f"{stopped} of {len(lines)}",
        ))  # fmt: skip
    columns = ("method", "MAE / N", "SD / N", "generations", "evaluations", "converged")
    note = (
        "Means over currents and repeats. The three-step method has no generations. Not converged: the search used "
        "up its budget."
    )
    title = "Errors and generations to convergence"
    return Table("paper2-figure-13", "Paper 2, Figure 13", title, columns, tuple(rows), f"{note} {failures}".strip())


def improvement_table(outcomes: Mapping[str, Mapping[float, list[Mapping[str, Any]]]]) -> Table:
    """How much lower the novel GA's mean absolute error is than each other method's: paper 2's Table 2.

    Args:
        outcomes: From `current_results`.

    Returns:
        One row for each other method; no rows without the novel GA.
    """
    errors = {
        method: float(np.mean([line["mae_N"] for repeats in by_current.values() for line in repeats]))
        for method, by_current in outcomes.items()
    }
    novel = errors.get("ga_novel")
    rows: list[tuple[Cell, ...]] = []
    if novel is not None:
        rows = [
            (TITLES[m], error, novel, 100.0 * (1.0 - novel / error)) for m, error in errors.items() if m != "ga_novel"
        ]
    columns = ("compared with", "its MAE / N", "novel GA's MAE / N", "improvement / %")
    return Table("paper2-table-02", "Paper 2, Table 2", "Error improvement comparison", columns, tuple(rows))


def parameter_tables(study: StudyFile, outcomes: Mapping[str, Mapping[float, list[Mapping[str, Any]]]]) -> list[Table]:
    """Best parameters at every current, and their relations to it: paper 2's Table 1.

    Args:
        study: The study.
        outcomes: From `current_results`.

    Returns:
        Of synthetic recordings the truth, then two tables for each method.
    """
    if study.current is None:
        return []
    tables = _true_parameters(study.current)
    for method, by_current in outcomes.items():
        currents = sorted(by_current)
        best = [min(by_current[current], key=lambda line: float(line["value"])) for current in currents]
        names = list(best[0]["parameters"])
        units = parameter_units(study.current, method)
        rows = [(name, units[name], *(line["parameters"][name] for line in best)) for name in names]
        columns = ("parameter", "unit", *(f"I = {current:g} A" for current in currents))
        title = f"Parameter values at each input current, {TITLES[method]} (best of the repeats)"
        note = "" if method == "zhu_three_step" else _edges(study.current.boxes, dict(zip(currents, best, strict=True)))
        tables.append(Table(f"paper2-table-01-{method}", "Paper 2, Table 1", title, columns, tuple(rows), note))
        if len(currents) >= 2:
            tables.append(_relation_table(method, np.array(currents), best, study.current.degree))
    return tables


def _true_parameters(settings: CurrentStudy) -> list[Table]:
    """What synthetic recordings of a Bouc-Wen damper were made with; nothing where the model searched is another."""
    if settings.data.simulate != "bouc_wen" or settings.model != "bouc_wen":
        return []
    units, truth = parameter_units(settings, ""), BOUC_WEN_TRUTH
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            units[name],
            *(truth[name] + truth.get(f"{name}_b", 0.0) * current_A for current_A in settings.current_A),
        )
        for name in settings.boxes
    ]
    columns = ("parameter", "unit", *(f"I = {current_A:g} A" for current_A in settings.current_A))
    title = "Parameter values at each input current, true values of the synthetic recordings"
    note = (
        f"The parameters are affine in the current by construction. A = {truth['A']:g} is fixed: alpha, beta and gamma "
        "depend on it."
    )
    return [Table("paper2-table-01-truth", "Paper 2, Table 1", title, columns, tuple(rows), note)]


def parameter_units(settings: CurrentStudy, method: str) -> dict[str, str]:
    """Unit of every parameter that a method of the per-current study finds.

    Args:
        settings: The per-current study.
        method: As the study file writes it.
    """
    name = "normalized_bouc_wen" if method == "zhu_three_step" else settings.model
    return {parameter.name: parameter.unit for parameter in model(name).parameters}


def parameter_relations(current_A: np.ndarray, best: list[Mapping[str, Any]], degree: int) -> dict[str, list[Relation]]:
    """Affine, polynomial and Lagrange relation of every parameter.

    Args:
        current_A: Shape (n,).
        best: One line for each current.
        degree: Of the polynomial.

    Returns:
        Parameter name -> relations.
    """
    names = list(best[0]["parameters"])
    return {name: relations(current_A, np.array([line["parameters"][name] for line in best]), degree) for name in names}


def _relation_table(method: str, current_A: np.ndarray, best: list[Mapping[str, Any]], degree: int) -> Table:
    rows = [
        (name, relation.kind, relation.rms, known(relation.rms_left_out), str(relation))
        for name, fitted in parameter_relations(current_A, best, degree).items()
        for relation in fitted
    ]
    columns = ("parameter", "relation", "rms residual", "rms at an omitted current", "value at I (A)")
    note = (
        "SI units. The Lagrange polynomial passes through every point; the rms error at an omitted current shows how "
        "well it predicts."
    )
    title = f"Relations between the parameters and the current, {TITLES[method]}"
    return Table(f"paper2-relations-{method}", "Paper 2, relations", title, columns, tuple(rows), note)


def _edges(boxes: Mapping[str, tuple[float, float]], best: Mapping[float, Mapping[str, Any]]) -> str:
    """Which parameters ended at the edge of their box, where the best may lie outside."""
    held = [
        f"{name} at {current_A:g} A"
        for current_A, line in best.items()
        for name, value in line["parameters"].items()
        if min(value - boxes[name][0], boxes[name][1] - value) < AT_THE_EDGE * (boxes[name][1] - boxes[name][0])
    ]
    return (
        f"Parameters at the edge of the search box, so the optimum may be outside it: {', '.join(held)}."
    ) if held else ""


def _failures(study: StudyFile, results: Lines) -> str:
    failed = [
        f"{TITLES[cell.method]} at {cell.current_A:g} A failed ({results[cell.key]['failed']})."
        for cell in current_cells(study)
        if "failed" in results.get(cell.key, {})
    ]
    return " ".join(failed)


def _mean(lines: list[Mapping[str, Any]], entry: str) -> float:
    return float(np.mean([line[entry] for line in lines]))
