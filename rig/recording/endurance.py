"""Endurance tests of a campaign by the files of their blocks: cycles run, recorded and missing; wear; forecasts.

The files are the only record: each states its block, the cycles before it, and how many cycles it holds. A block that
was interrupted has several files, one for each piece.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rig.campaign_folder import CampaignFolder
from rig.document.figure import thinned
from rig.errors import FileProblem
from rig.fits.plain import plain
from rig.recording.hdf5.reading import read_cycles
from rig.recording.point_files import FILE, OLD_FILE
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.program_cycles import PROGRAM_CYCLE
from rig.signals.wear_trend import (
    FEWEST_CYCLES,
    NO_SECTIONS,
    QUANTITIES,
    Forecast,
    Sections,
    StopRule,
    baseline_of,
    changes,
    forecast,
    reached_by,
    sections_of,
    uncertainty_of,
    why_not_evaluated,
)
from rig.test_point import ENDURANCE, EnduranceStep
from rig.text_file import read_json

READ = frozenset({"number", PROGRAM_CYCLE, *QUANTITIES})
"""Statistics of the cycles that the sections are made from."""
MOST_IN_TREND = 200
"""Sections of a trend that `endurance.json` lists."""
RUNNING, COMPLETE, ENDED = "running", "complete", "ended by a stop rule"


@dataclass(frozen=True)
class BlockPiece:
    """What one file holds of a block.

    Attributes:
        point: id of the block's point.
        step: its position in the test, the cycles before this piece included.
        run: cycles that were run.
        recorded: those with statistics.
        unseen: cycles that can have been run at most after the recording was cut off.
        verdict: of the file.
        sections: of its cycles; none of a piece of a block with too few cycles to be compared.
        file: its name.
        reasons: for the verdict.
    """

    point: str
    step: EnduranceStep
    run: int
    recorded: int
    unseen: int
    verdict: str
    sections: Sections
    file: str = ""
    reasons: tuple[str, ...] = ()


def read_piece(file: Path) -> BlockPiece | None:
    """What a file holds of a block of an endurance test; None of another point.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    return piece_of(RecordedPoint.open(file, whole=False), file)


def piece_of(recorded: RecordedPoint, file: Path) -> BlockPiece | None:
    """As `read_piece`, of a file whose description was read.

    Raises:
        FileProblem: the file cannot be trusted.
    """
    step, counted = recorded.endurance, recorded.quality.endurance
    if recorded.kind != ENDURANCE or step is None or counted is None:
        return None
    columns = read_cycles(file, READ) or {}
    numbers = np.asarray(columns.get("number", ()), np.float64)
    nothing = np.full(numbers.size, np.nan)
    statistics = {name: np.asarray(columns.get(name, nothing), np.float64) for name in QUANTITIES}
    program = recorded.repeated_program
    groups = None if program is None else program.groups_of(
        np.asarray(columns.get(PROGRAM_CYCLE, nothing), np.float64)
    )
    # A short remainder of an interrupted block runs on a damper that has cooled: its median ends no test.
    judged = numbers.size >= min(FEWEST_CYCLES, step.block_cycles)
    return BlockPiece(
        str(recorded.provenance.get("point", recorded.id)), step, counted.cycles_run or 0,
        counted.cycles_recorded or 0, counted.unseen_cycles or 0, recorded.verdict,
        sections_of(numbers, step.block, statistics, groups) if judged else NO_SECTIONS, file.name,
        tuple(recorded.reasons),
    )


def read_pieces(points: Path) -> tuple[list[BlockPiece], list[str]]:
    """The pieces of all endurance tests in a campaign's `points/`, each recording once, and why files were left out."""
    pieces: dict[str, BlockPiece] = {}
    problems: list[str] = []
    for file in sorted(file for ending in (FILE, OLD_FILE) for file in points.glob(f"*{ending}")):
        try:
            recorded = RecordedPoint.open(file, whole=False)
            piece = piece_of(recorded, file)
        except FileProblem as error:
            problems += [f"{points.name}/{file.name}: {problem}" for problem in error.problems]
            continue
        if piece is not None:
            pieces.setdefault(str(recorded.provenance.get("journal_check") or file.name), piece)
    return list(pieces.values()), problems


class FollowedRule(NamedTuple):
    """A stop rule over an endurance test.

    Attributes:
        sections: those that are compared, (n,).
        change: of each section toward the limit (n,).
        forecast: when the limit will be reached.
        uncertainty: half width of the 95 % interval of the last change; not-a-number where it is unknown.
    """

    sections: Sections
    change: FloatArray
    forecast: Forecast
    uncertainty: float

    @property
    def last(self) -> float | None:
        """Change of the last section in which it is known, since the last one may have no statistics; None: of none."""
        return _last_known(self.change)


class EnduranceLedger:
    """The pieces of one endurance test.

    Args:
        test: its id.
        rules: stop rules.
        run_in: cycles of the running-in.
    """

    def __init__(self, test: str, rules: Sequence[StopRule] = (), run_in: int = 0) -> None:
        self.test = test
        self.rules = tuple(rules)
        self._run_in = run_in
        self._pieces: list[BlockPiece] = []
        self._lost: dict[str, int] = {}
        self._joined: Sections | None = None
        self._followed: dict[StopRule, FollowedRule] = {}

    def add(self, piece: BlockPiece) -> None:
        """Enter a piece; one of a file that is known already replaces it."""
        self._followed.clear()
        follows = not self._pieces or _place(piece) > _place(self._pieces[-1])
        if not follows:
            self._pieces = [known for known in self._pieces if known.file != piece.file]
        self._pieces.append(piece)
        if not follows:
            self._pieces.sort(key=_place)
            self._joined = None
        elif self._joined is not None:  # thousands of blocks are entered one after the other
            self._joined = Sections.joined([self._joined, piece.sections])

    def lose(self, attempt: str, cycles: int) -> None:
        """Enter an attempt at a block of which no file exists: at most so many cycles were run."""
        self._lost[attempt] = cycles

    @property
    def pieces(self) -> tuple[BlockPiece, ...]:
        """In the order of their cycles."""
        return tuple(self._pieces)

    @property
    def cycles_run(self) -> int:
        """Cycles that are known to have been run."""
        return sum(piece.run for piece in self._pieces)

    @property
    def cycles_recorded(self) -> int:
        """Cycles with statistics."""
        return sum(piece.recorded for piece in self._pieces)

    @property
    def unrecorded_at_most(self) -> int:
        """Cycles that can have been run at most after recordings were cut off; they are in no other count."""
        return sum(piece.unseen for piece in self._pieces) + sum(self._lost.values())

    def run_of(self, block: int) -> int:
        """Cycles that were run of one block."""
        return sum(piece.run for piece in self._pieces if piece.step.block == block)

    @property
    def sections(self) -> Sections:
        """Medians over all cycles that were recorded."""
        if self._joined is None:
            self._joined = Sections.joined([piece.sections for piece in self._pieces])
        return self._joined

    @property
    def reached(self) -> str:
        """Name of the stop rule that the last known section has reached; empty where it has reached none."""
        groups = [sections for sections in self.sections.groups if len(sections)]
        for rule in self.rules:
            if any(reached_by(rule, sections, self._run_in) for sections in groups):
                return rule.name
        return ""

    def to_json(self, planned: int) -> dict[str, Any]:
        """The test in numbers: one entry of `endurance` in `rig run --json`.

        Args:
            planned: cycles of the whole test.
        """
        levels = [self._level_json(group) for group in self.sections.groups if len(group)]
        highest = levels[-1] if levels else {}
        reached, run = self.reached, self.cycles_run
        return {
            "id": self.test,
            "state": ENDED if reached else COMPLETE if run >= planned else RUNNING,
            "ended_by": reached or None,
            "cycles_planned": planned, "cycles_run": run, "cycles_recorded": self.cycles_recorded,
            "cycles_unrecorded_at_most": self.unrecorded_at_most,
            "pieces": len(self._pieces), "run_in_cycles": self._run_in,
            "baseline": highest.get("baseline"), "last": highest.get("last"),
            "levels": levels if len(levels) > 1 else [],
            "rules": [self._rule_json(rule) for rule in self.rules],
            "trend": [self._trend_json(group) for group in self.sections.groups if len(group)],
        }  # fmt: skip

    @staticmethod
    def _trend_json(group: Sections) -> dict[str, Any]:
        """Medians of the sections of cycles at one current, thinned evenly; None where one is not known."""
        rows = thinned(len(group), MOST_IN_TREND)
        known = np.isfinite(group.medians["current"])
        level = float(np.median(group.medians["current"][known])) if np.any(known) else None
        columns = {name: plain(group.medians[name][rows].tolist()) for name in QUANTITIES}
        return {"current_A": level, "cycle": [round(number) for number in group.cycle[rows].tolist()], **columns}

    def _level_json(self, group: Sections) -> dict[str, Any]:
        return {
            "baseline": plain(baseline_of(group, self._run_in)),
            "last": plain({name: values[-1] for name, values in group.medians.items()}),
        }

    def _rule_json(self, rule: StopRule) -> dict[str, Any]:
        followed = self.followed(rule)
        value, expected, why = followed.last, followed.forecast, self.why_not_evaluated(rule)
        return {
            "name": rule.name, "limit": rule.limit, "relative": rule.kind.relative, "value": value,
            "uncertainty": plain(followed.uncertainty), "reached": expected.state == "reached",
            "forecast": {**expected._asdict(), "reason": expected.reason or None},
            "text": rule_text(rule, followed, why), "not_evaluated": why or None,
        }

    def why_not_evaluated(self, rule: StopRule) -> str:
        """Why a rule is evaluated for none of the cycles although they were measured; otherwise empty."""
        reasons = [why_not_evaluated(rule, group, self._run_in) for group in self.sections.groups if len(group)]
        return reasons[0] if reasons and all(reasons) else ""

    def followed(self, rule: StopRule) -> FollowedRule:
        """How far each section is toward a rule's limit, and when it will be reached.

        Cycles are compared with those of the same current: of several, the group that has reached its limit or is
        nearest to it counts.

        Args:
            rule: one of the test's.
        """
        if rule not in self._followed:
            self._followed[rule] = self._follow(rule)
        return self._followed[rule]

    def _follow(self, rule: StopRule) -> FollowedRule:
        followed = []
        for sections in self.sections.groups:
            change = changes(rule, sections, baseline_of(sections, self._run_in))
            last, reached = _last_known(change), len(sections) > 0 and reached_by(rule, sections, self._run_in)
            followed.append(((reached, -np.inf if last is None else last), sections, change))
        (reached, _), sections, change = max(followed, key=lambda one: one[0])
        after = sections.cycle > self._run_in
        expected = forecast(sections.cycle[after], change[after], rule.limit)
        if expected.state == "reached" and not reached:
            expected = Forecast("uncertain")
        return FollowedRule(sections, change, expected, uncertainty_of(rule, sections, self._run_in))


def withdrawn_points(folder: Path) -> frozenset[str]:
    """Ids of points that a campaign did not run, since a stop rule ended their test, by its `endurance.json`."""
    file = CampaignFolder(folder).endurance
    if not file.is_file():
        return frozenset()
    try:
        tests = read_json(file)["tests"]
        return frozenset(str(point) for test in tests for point in test["withdrawn"])
    except (FileProblem, KeyError, TypeError):
        return frozenset()


def _place(piece: BlockPiece) -> tuple[int, int, str]:
    return piece.step.block, piece.step.cycles_before, piece.file


def ledgers_of(
    pieces: Iterable[BlockPiece], tests: Mapping[str, tuple[Sequence[StopRule], int]]
) -> dict[str, EnduranceLedger]:
    """A ledger for each test of these pieces and each stated one.

    Args:
        pieces: of all tests.
        tests: rules and running-in by id of the test.
    """
    ledgers = {name: EnduranceLedger(name, rules, run_in) for name, (rules, run_in) in tests.items()}
    for piece in pieces:
        ledgers.setdefault(piece.step.test, EnduranceLedger(piece.step.test)).add(piece)
    return ledgers


def performance_points(points: Iterable[RecordedPoint], test: str) -> Iterator[tuple[int, RecordedPoint]]:
    """The performance points of a test and those before its first cycle, with the cycles run before each.

    Before the first cycle are the points outside any test whose motion and current one of the others has.
    """
    points = [point for point in points if point.kind != ENDURANCE and point.verdict != "invalid"]
    later = [point for point in points if point.endurance is not None and point.endurance.test == test]
    motions = {_motion(point) for point in later}
    yield from ((0, point) for point in points if point.endurance is None and _motion(point) in motions)
    yield from ((point.endurance.cycles_before, point) for point in later if point.endurance is not None)


def _motion(point: RecordedPoint) -> tuple[object, ...]:
    return point.kind, point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A, point.repeat


def rule_text(rule: StopRule, followed: FollowedRule, why: str = "") -> str:
    """How far a stop rule is, and when it will be reached, or why that is not known.

    Args:
        rule: the rule.
        followed: the rule over the test.
        why: why the rule is not evaluated; empty where it is.
    """
    scale, unit = (100.0, "%") if rule.kind.relative else (1.0, "degC")
    limit, value, expected = f"limit {scale * rule.limit:.3g} {unit}", followed.last, followed.forecast
    if why and value is None:
        return f"{rule.kind.words} not evaluated ({limit}): {why}"
    if value is None:
        return f"{rule.kind.words} unknown ({limit}): {'no baseline yet' if rule.kind.relative else 'not measured'}"
    about = f" ± {scale * followed.uncertainty:.2g}" if np.isfinite(followed.uncertainty) else ""
    text = f"{rule.kind.words} {scale * value or 0.0:.3g}{about} {unit} ({limit}"
    if why:
        return f"{text}, not evaluated yet: {why})"
    if expected.cycles is not None and expected.state == "trend":
        cycles, low, high = (float(f"{one or 0.0:.3g}") for one in (expected.cycles, expected.low, expected.high))
        text += f", forecast after {cycles:,.0f} cycles, 95 % interval {low:,.0f} to {high:,.0f}"
    elif expected.reason:
        text += f", no forecast: {expected.reason}"
    return f"{text})"


def _last_known(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known[-1]) if known.size else None
