"""The endurance tests of a run: cycles, wear and its forecast, and the performance points over the cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.matrix.model import load_matrix
from rig.recording.endurance import EnduranceLedger, ledgers_of, performance_points, piece_of
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.signals.wear_trend import StopRule
from rig.test_point import ENDURANCE, TestPoint


@dataclass(frozen=True)
class EnduranceTest:
    """One test of a run.

    Attributes:
        ledger: its blocks and their wear.
        planned: cycles of the whole test.
        motion: of its blocks.
        performance: performance points with the cycles run before each, in order of the cycles.
    """

    ledger: EnduranceLedger
    planned: int
    motion: TestPoint
    performance: tuple[tuple[int, RecordedPoint], ...]

    def to_json(self) -> dict[str, Any]:
        """One entry of `endurance` in `rig run --json`."""
        return self.ledger.to_json(self.planned)


def endurance_tests(run: Run) -> tuple[EnduranceTest, ...]:
    """Every endurance test of a run that was begun, in the order of the matrix file.

    Raises:
        FileProblem: a file of a block cannot be read.
    """
    blocks = [point for point in run.points if point.kind == ENDURANCE and point.path is not None]
    if not blocks:
        return ()
    pieces = [piece for point in blocks if point.path is not None and (piece := piece_of(point, point.path))]
    firsts = {point.endurance.test: (point, point.endurance) for point in reversed(blocks) if point.endurance}
    return tuple(
        EnduranceTest(
            ledger, firsts[name][1].total, firsts[name][0],
            tuple(sorted(performance_points(run.points, name), key=lambda entry: entry[0])),
        )
        for name, ledger in ledgers_of(pieces, _rules(run)).items() if name in firsts
    )  # fmt: skip


def _rules(run: Run) -> dict[str, tuple[Sequence[StopRule], int]]:
    """Stop rules and running-in of each test, by the run's matrix file; empty where it cannot be read."""
    file = CampaignFolder(run.path).matrix
    try:
        tests = load_matrix(file).endurance_tests if file.is_file() else {}
    except FileProblem:
        return {}
    return {name: (test.stop.rules, test.run_in) for name, test in tests.items()}
