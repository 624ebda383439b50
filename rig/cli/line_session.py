"""A production line: one specimen after another, each a campaign of its own, started by its serial number.

What is entered is refused in words unless the line waits for the next specimen: text that arrives during a test is
never kept for later, because the rod would move as soon as that test ends, while a person changes the specimen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.cli.words import ending
from rig.errors import (
    EXIT_DONE,
    EXIT_IDENTIFICATION,
    EXIT_NOT_ACCEPTED,
    EXIT_NOT_ALL_VALID,
    EXIT_REFUSED,
    EXIT_STOPPED,
    EXIT_UNKNOWN_STATE,
    FileProblem,
)
from rig.recording.tested_specimens import TITLES, SpecimenVerdict, TestedSpecimens, counts, tested_before

if TYPE_CHECKING:
    from rig.cli.job import JobResult
    from rig.matrix.model import Matrix

CONTINUE, RETEST, QUIT = "continue", "retest", "quit"
"""Words that an operator types."""
LONGEST_SCAN = 200
WORST_FIRST = (
    EXIT_UNKNOWN_STATE, EXIT_STOPPED, EXIT_REFUSED, EXIT_NOT_ALL_VALID, EXIT_IDENTIFICATION, EXIT_NOT_ACCEPTED,
)  # fmt: skip
"""Exit codes of a specimen's campaign, in the order in which one is the exit code of the line."""


class Answer(StrEnum):
    """What follows from an entry."""

    TEST = "test"
    REFUSED = "refused"
    CONTINUED = "continued"
    QUIT = "quit"
    NOTHING = "nothing"


@dataclass(frozen=True)
class Entry:
    """The answer to one entry.

    Attributes:
        answer: what follows.
        text: for the operator; of a test the serial number.
        slug: code of a refusal.
    """

    answer: Answer
    text: str = ""
    slug: str = ""


@dataclass(frozen=True)
class LineResult:
    """How the test of one specimen ended.

    Attributes:
        serial_number: of the specimen.
        verdict: `ok`, `not-ok` or `not-tested`.
        reason: the value that decides, or why the specimen was not tested.
        exit_code: of its campaign.
        campaign: its directory; None: it was refused before there was one.
        takt_s: from the entry of the serial number to the verdict (s).
        motion_s: duration of the points that were run, on the rig's clock (s).
        remarks: what is wrong with the test itself.
    """

    serial_number: str
    verdict: str
    reason: str
    exit_code: int
    campaign: Path | None
    takt_s: float
    motion_s: float = 0.0
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(cls, serial_number: str, job: JobResult, takt_s: float) -> LineResult:
        """Of a specimen's campaign."""
        campaign = job.campaign
        verdict, reason = (str(SpecimenVerdict.NOT_TESTED), campaign.detail) if job.specimen is None else (
            str(job.specimen.verdict), job.specimen.reason
        )
        if campaign.stop is not None or campaign.refused:
            reason = f"{campaign.stopped_by}: {campaign.detail}" if campaign.stopped_by else campaign.detail
        remarks = [text for _, text in ending(campaign, f"{RETEST} {serial_number}")]
        remarks += [] if job.error is None else [f"not identified: {job.error}"]
        return cls(
            serial_number, verdict, reason, job.exit_code, campaign.campaign, takt_s, campaign.motion_s, tuple(remarks)
        )

    def to_json(self) -> dict[str, Any]:
        """One entry of `specimens` in `rig line --json`."""
        campaign = None if self.campaign is None else str(self.campaign.resolve())
        return {**vars(self), "campaign": campaign, "remarks": list(self.remarks)}


@dataclass
class LineSession:
    """What a line has tested, and whether it takes the next serial number.

    Attributes:
        matrix: the matrix.
        tested: the runs on file.
        results: of this session.
        blocked: why no further specimen is tested until the operator continues; empty: it waits for the next one.
    """

    matrix: Matrix
    tested: TestedSpecimens
    results: list[LineResult] = field(default_factory=list)
    blocked: str = ""
    refusals: list[Entry] = field(default_factory=list)

    def entered(self, text: str, now: datetime) -> Entry:
        """The answer to an entry while no test runs.

        Args:
            text: one line of a barcode reader or of the keyboard.
            now: the time (UTC).
        """
        words = text.strip()
        if not words:
            return Entry(Answer.NOTHING)
        if words == QUIT:
            return Entry(Answer.QUIT)
        if words == CONTINUE:
            was, self.blocked = self.blocked, ""
            return Entry(Answer.CONTINUED, "the line continues" if was else "the line is ready")
        if self.blocked:
            return self._refused("line-stopped", f"{shown(words)}: {self.blocked}. Fix: inspect the rig, then type "
                                 f"`{CONTINUE}`")  # fmt: skip
        again, _, named = words.partition(" ")
        retest = again == RETEST
        return self._specimen(named.strip() if retest else words, now, retest=retest)

    def during_test(self, text: str, serial_number: str) -> Entry:
        """The refusal of an entry that arrives while a specimen is tested."""
        if not text.strip():
            return Entry(Answer.NOTHING)
        return self._refused("line-busy", f"{shown(text)}: ignored because {serial_number} is being tested. Fix: wait "
                             "for the result, change the specimen, then scan again")  # fmt: skip

    def _specimen(self, serial_number: str, now: datetime, *, retest: bool) -> Entry:
        if len(serial_number) > LONGEST_SCAN or not serial_number.isprintable():
            return self._refused("bad-serial-number", f"{shown(serial_number)}: not a serial number. Fix: check the "
                                 "settings of the barcode reader (one line for each code)")  # fmt: skip
        try:
            self.matrix.of_specimen(serial_number or "-")
        except FileProblem as error:
            text = f"not a serial number of this line: {error.problems[0]}. Fix: scan the code of the specimen"
            return self._refused("bad-serial-number", text)
        rule = "explicit" if self.matrix.line is None else self.matrix.line.retest
        before = "" if retest else tested_before(self.tested.of(serial_number), rule, now)
        if before:
            return self._refused("tested-before", f"{before}. Fix: to test it again, type `{RETEST} {serial_number}`")
        return Entry(Answer.TEST, serial_number)

    def _refused(self, slug: str, text: str) -> Entry:
        entry = Entry(Answer.REFUSED, text, slug)
        self.refusals.append(entry)
        return entry

    def take(self, result: LineResult) -> None:
        """Count a result; after a stop or in an unknown state, the line waits for the operator."""
        self.results.append(result)
        if result.exit_code == EXIT_UNKNOWN_STATE:
            self.blocked = f"the state of the rig is unknown after the test of {result.serial_number}"
        elif result.exit_code == EXIT_STOPPED:
            self.blocked = f"the test of {result.serial_number} was stopped ({result.reason})"

    @property
    def counts(self) -> dict[str, int]:
        """Number of specimens of this session by last verdict; one that was tested again counts once."""
        return counts((one.serial_number, one.verdict) for one in self.results)

    @property
    def takts_s(self) -> list[float]:
        """Takt of each test that ended with OK or NOT OK (s)."""
        return [one.takt_s for one in self.results if one.verdict != SpecimenVerdict.NOT_TESTED]

    @property
    def mean_takt_s(self) -> float:
        """Their mean; NaN without any."""
        return math.fsum(self.takts_s) / len(self.takts_s) if self.takts_s else math.nan

    @property
    def summary(self) -> str:
        """Counters and takt in one line."""
        text = "specimens: " + ", ".join(f"{TITLES[verdict]} {count}" for verdict, count in self.counts.items())
        if self.takts_s:
            text += f"; takt {self.takts_s[-1]:.1f} s, mean {self.mean_takt_s:.1f} s"
        return text

    @property
    def exit_code(self) -> int:
        """0 if every specimen is `ok`, else the worst exit code of a campaign."""
        codes = {one.exit_code for one in self.results}
        return next((code for code in WORST_FIRST if code in codes), max(codes, default=EXIT_DONE))

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig line --json`."""
        return {
            "specimens": [one.to_json() for one in self.results], "counts": self.counts,
            "takt_last_s": self.takts_s[-1] if self.takts_s else None,
            "takt_mean_s": self.mean_takt_s if self.takts_s else None,
            "refused": [{"slug": one.slug, "text": one.text} for one in self.refusals],
        }  # fmt: skip


def shown(text: str) -> str:
    """An entry as it may be shown."""
    short = text.strip()[:40]
    return "".join(sign if sign.isprintable() else "?" for sign in short) or "(empty)"


