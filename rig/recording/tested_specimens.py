"""Which specimens were tested in a folder of runs, and with which verdict: from the names and files of the runs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from rig.campaign_folder import CampaignFolder, by_age
from rig.errors import FileProblem
from rig.text_file import read_json, stamp

RUN_NAME = re.compile(r"(\d{8}T\d{6}Z)-(.+)-[0-9a-f]{6}")


class SpecimenVerdict(StrEnum):
    """The verdict on a specimen."""

    OK = "ok"
    NOT_OK = "not-ok"
    NOT_TESTED = "not-tested"
    """A value that a band requires was not measured, or its uncertainty does not allow a decision."""


NO_BANDS = "no-bands"
"""In place of a verdict: the matrix has no acceptance bands, so nothing was to be decided."""
TESTED = frozenset({SpecimenVerdict.OK, SpecimenVerdict.NOT_OK})
"""Verdicts of a specimen that was tested; any other may be tested again at once."""
TITLES: Mapping[str, str] = {
    SpecimenVerdict.OK: "OK", SpecimenVerdict.NOT_OK: "NOT OK", SpecimenVerdict.NOT_TESTED: "NOT TESTED",
}  # fmt: skip
"""Verdict on a specimen -> as it is shown."""


@dataclass(frozen=True)
class TestedSpecimen:
    """A run with a verdict on its specimen.

    Attributes:
        run: name of the run.
        serial_number: of the specimen.
        started: when the campaign began (UTC).
        verdict: `ok`, `not-ok` or `not-tested`.
        reason: the value that decides.
        cycle_s: time from the start of the campaign to the verdict (s).
    """

    __test__ = False  # not a test class, whatever its name

    run: str
    serial_number: str
    started: datetime
    verdict: str
    reason: str
    cycle_s: float


class TestedSpecimens:
    """The runs of a folder; each verdict is read once, and again when its file has changed.

    Args:
        folder: of the runs.
    """

    __test__ = False  # not a test class, whatever its name

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, tuple[object, TestedSpecimen | None]] = {}

    def of(self, serial_number: str) -> list[TestedSpecimen]:
        """The runs of a specimen that have a verdict, the oldest first; letter case does not matter."""
        wanted = serial_number.casefold()
        named = (RUN_NAME.fullmatch(name) for name in by_age(self._folder))
        runs = [match[0] for match in named if match is not None and match[2].casefold() == wanted]
        return list(self._with_verdict(runs))

    def takt_s(self, run: str) -> float | None:
        """Time from the start of a campaign to its verdict (s); None without a verdict."""
        return next((one.cycle_s for one in self._with_verdict([run])), None)

    def since(self, begin: datetime) -> list[TestedSpecimen]:
        """All runs with a verdict that were started at or after a time (UTC), the oldest first."""
        first = f"{begin.astimezone(UTC):%Y%m%dT%H%M%SZ}"
        return list(self._with_verdict([name for name in by_age(self._folder) if name[: len(first)] >= first]))

    def _with_verdict(self, names: list[str]) -> Iterator[TestedSpecimen]:
        for name in names:
            file = CampaignFolder(self._folder / name).acceptance
            now = stamp(file)
            if name not in self._read or self._read[name][0] != now:
                self._read[name] = now, None if now is None else _tested(name, file, now[0] * 1e-9)
            if (known := self._read[name][1]) is not None:
                yield known


def counts(tested: Iterable[tuple[str, str]]) -> dict[str, int]:
    """Number of specimens by verdict: each specimen counts once, with its last verdict.

    Args:
        tested: serial number and verdict of each test, the oldest first; letter case of the number does not matter.
    """
    last = {serial_number.casefold(): verdict for serial_number, verdict in tested}
    return {verdict: list(last.values()).count(verdict) for verdict in map(str, SpecimenVerdict)}


def _tested(name: str, file: Path, written_s: float) -> TestedSpecimen | None:
    """The verdict in a file; None if the file or the name is not of this program."""
    match = RUN_NAME.fullmatch(name)
    try:
        written = read_json(file)
    except FileProblem:
        return None
    verdict = written.get("specimen")
    if match is None or not isinstance(verdict, str):
        return None
    started = datetime.strptime(match[1], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    cycle_s = max(0.0, written_s - started.timestamp())
    return TestedSpecimen(name, match[2], started, verdict, str(written.get("reason", "")), cycle_s)


def tested_before(earlier: list[TestedSpecimen], retest: str, now: datetime) -> str:
    """Why a specimen is not tested again without a request of the operator; empty if it may be tested.

    Args:
        earlier: its runs with a verdict, the oldest first.
        retest: `explicit`, `next-day` or `free`, as in `[line]` of the matrix.
        now: the time (UTC).
    """
    last = next((one for one in reversed(earlier) if one.verdict in TESTED), None)
    if last is None or retest == "free":
        return ""
    local = last.started.astimezone()
    if retest == "next-day" and local.date() < now.astimezone().date():
        return ""
    return f"{last.serial_number} was already tested on {local:%Y-%m-%d at %H:%M} ({TITLES[last.verdict]})"
