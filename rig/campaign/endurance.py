"""The endurance tests of a running campaign: count of their cycles, stop rules, and `endurance.json`."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rig.bench.model import Bench
from rig.campaign.sequencer.endurance import left_of, without_rest_of
from rig.campaign.sequencer.event import BlockCounted
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.matrix.model import Matrix
from rig.recording.atomic_write import write_text_durably
from rig.recording.endurance import BlockPiece, EnduranceLedger, ledgers_of, read_piece, read_pieces
from rig.recording.point_files import attempt_name, names_in
from rig.test_point import ENDURANCE, TestPoint

FORMAT = 1
FLUSH_S = 0.15
"""Longest time for which recorded samples are not yet on the disk."""


LOSS_NOTICED_S = 1.0
"""Until a station has noticed that its application is gone."""


class EnduranceBook:
    """Counts the cycles of a campaign's endurance tests, by the files of their blocks.

    Args:
        folder: the campaign's directory.
        matrix: with the tests.
        begun: attempts at each block of earlier sessions, by id of the point.

    Attributes:
        problems: files that could not be read, one line each.
    """

    def __init__(self, folder: Path, matrix: Matrix, begun: Mapping[str, int] | None = None) -> None:
        self._folder = CampaignFolder(folder)
        self._tests = matrix.endurance_tests
        self._withdrawn: dict[str, tuple[str, ...]] = {}
        self.problems: list[str] = []
        pieces: list[BlockPiece] = []
        if self._tests and self._folder.points.is_dir():
            pieces, self.problems = read_pieces(self._folder.points)
        rules = {name: (test.stop.rules, test.run_in) for name, test in self._tests.items()}
        self._ledgers = ledgers_of(pieces, rules)
        self._lose(matrix.points() if self._tests else (), begun or {})

    def _lose(self, points: Iterable[TestPoint], begun: Mapping[str, int]) -> None:
        """Enter the attempts of which no file exists."""
        files: dict[str, int] = {}
        for ledger in self._ledgers.values():
            for piece in ledger.pieces:
                files[piece.point] = files.get(piece.point, 0) + 1
        for point in points:
            if point.kind != ENDURANCE:
                continue
            for number in range(begun.get(point.id, 0) - files.get(point.id, 0)):
                self.ledger(point).lose(f"{point.id} {number}", round(point.cycles))

    def __bool__(self) -> bool:
        """Whether the campaign has an endurance test."""
        return bool(self._tests)

    def ledger(self, point: TestPoint) -> EnduranceLedger:
        """Of the test of a block.

        Raises:
            KeyError: the point belongs to no test of the matrix.
        """
        return self._ledgers["" if point.endurance is None else point.endurance.test]

    def remaining(self, points: Iterable[TestPoint]) -> tuple[TestPoint, ...]:
        """The points that are still to be run: blocks with the cycles that are left, none of a test that has ended.

        Args:
            points: those of the matrix, in order, whose verdict does not say that they are done.
        """
        queue = [left for point in points if (left := self._left(point)) is not None]
        for name, ledger in self._ledgers.items():
            if ledger.reached:
                kept = without_rest_of(tuple(queue), name, ledger.cycles_run)
                ids = {point.id for point in kept}
                self.withdraw(name, tuple(point.id for point in queue if point.id not in ids))
                queue = list(kept)
        return tuple(queue)

    def _left(self, point: TestPoint) -> TestPoint | None:
        if point.kind != ENDURANCE or point.endurance is None:
            return point
        run = self.ledger(point).run_of(point.endurance.block)
        left = point.endurance.block_cycles - run
        return None if left <= 0 else left_of(point, left)

    def withdraw(self, test: str, points: Collection[str]) -> None:
        """Note the points (ids) of a test that are not run, since it has ended."""
        self._withdrawn[test] = tuple(points)

    @property
    def withdrawn(self) -> frozenset[str]:
        """Ids of the points that are not run."""
        return frozenset(point for points in self._withdrawn.values() for point in points)

    def count(self, point: TestPoint, file: Path | None) -> BlockCounted:
        """Count the cycles of a block's finished file.

        Args:
            point: the block, as it was begun.
            file: its file; None: it could not be written, so that its cycles are counted as run without a record.
        """
        ledger, step = self.ledger(point), point.endurance
        try:
            piece = None if file is None else read_piece(file)
        except FileProblem as error:
            self.problems += error.problems
            piece = None
        if piece is None or step is None:
            ledger.lose(f"{point.id} after {len(ledger.pieces)} files", round(point.cycles))
            return BlockCounted(round(point.cycles), ledger.cycles_run)
        ledger.add(piece)
        left = max(0, step.block_cycles - ledger.run_of(step.block))
        return BlockCounted(left, ledger.cycles_run, ledger.reached)

    def begun(self, point: TestPoint, bench: Bench) -> TestPoint:
        """A block as it is recorded: with the cycles that can be run at most once its recording is cut off.

        The bench's watchdogs bound them: the station notices a dead application, the controller a dead station.
        """
        if point.endurance is None or point.kind != ENDURANCE:
            return point
        silent_s = FLUSH_S + 2.0 * bench.actuator.watchdog_s + LOSS_NOTICED_S
        cycles = silent_s * bench.clock.device_rate * point.frequency_Hz
        if point.cyclic:  # a record is halted, not faded out
            cycles += bench.actuator.fade_out_cycles
        return replace(point, endurance=point.endurance._replace(unseen_cycles=math.ceil(cycles)))

    def name_of(self, point: TestPoint, ids: Collection[str]) -> str:
        """A name of which no file exists yet: every piece of a block keeps its own file."""
        taken, attempt = names_in(self._folder.points), 1
        while (name := attempt_name(point.id, attempt, ids)) in taken:
            attempt += 1
        return name

    def to_json(self) -> list[dict[str, Any]]:
        """The tests in numbers, the keys of `endurance` in `rig run --json`."""
        return [
            self._ledgers[name].to_json(test.cycles) | {"withdrawn": list(self._withdrawn.get(name, ()))}
            for name, test in self._tests.items()
        ]

    def summary(self, point: TestPoint) -> str:
        """One line for the operator: cycles, and how far each stop rule is."""
        ledger = self.ledger(point)
        shown = ledger.to_json(self._tests[ledger.test].cycles)
        return summary_of(shown)

    def save(self) -> None:
        """Write `endurance.json`; it can be made from the files at any time, so that a full disk stops nothing here."""
        if self._tests:
            text = json.dumps({"format": FORMAT, "tests": self.to_json()}, indent=1, allow_nan=False)
            with contextlib.suppress(OSError):
                write_text_durably(self._folder.endurance, text + "\n")


def summary_of(test: Mapping[str, Any]) -> str:
    """An endurance test in one line.

    Args:
        test: one entry of `endurance` in `rig run --json`.
    """
    parts = [f"{test['id']}: {test['cycles_run']:,} of {test['cycles_planned']:,} cycles"]
    if test["cycles_unrecorded_at_most"]:
        parts.append(f"up to {test['cycles_unrecorded_at_most']:,} more cycles ran without a record")
    for rule in test["rules"]:
        if rule["value"] is not None or rule.get("not_evaluated"):
            parts.append(rule["text"])
    return "; ".join(parts)
