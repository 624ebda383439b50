"""Matrix and bench file read together, so that what is wrong in both is said at once."""

from __future__ import annotations

from pathlib import Path

from rig.bench.model import Bench
from rig.errors import FileProblem, FileProblems
from rig.matrix.model import Matrix, load_matrix


def load_files(matrix_path: Path, bench_path: Path) -> tuple[Matrix, Bench]:
    """Read and check both files.

    Raises:
        FileProblem: one of them cannot be used, with every wrong entry; or they are exchanged, in one line.
        FileProblems: both cannot.
    """
    problems: list[FileProblem] = []
    matrix = bench = None
    try:
        matrix = load_matrix(matrix_path)
    except FileProblem as error:
        problems.append(error)
    try:
        bench = Bench.load(bench_path)
    except FileProblem as error:
        problems.append(error)
    if [getattr(error, "kind", "") for error in problems] == ["bench", "matrix"]:
        turned = f"rig plan {bench_path} --bench {matrix_path}"
        raise FileProblem(str(matrix_path), [f"matrix and bench file are exchanged: this is the bench file; {turned}"])
    if matrix is None or bench is None:
        raise problems[0] if len(problems) == 1 else FileProblems(problems)
    return matrix, bench
