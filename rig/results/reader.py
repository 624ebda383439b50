"""Rows of the results database, for statistics and production: `ResultFilter`, `result_rows`, `open_results`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, case, func, literal, null, or_, select

from rig.errors import FileProblem, some
from rig.results.connection import Database, server
from rig.results.filling import Filled, filled_database
from rig.results.quantities import QUANTITIES, SPECIMEN
from rig.results.run_index import RunFilter, fits_pattern
from rig.results.schema import campaigns, characteristics, fits, parameters, stored_current

MOST_AT_ONCE = 5_000
MOST_LISTED = 5
PLAIN = re.compile(r"[^*?\[]*")


class ResultRow(NamedTuple):
    """One value of one test.

    Attributes:
        campaign: UUID of the campaign; `run` is the name of its directory.
        specimen: serial number; empty if not stated.
        station: name of the station; empty for imported tests.
        operator: person who performed the test; empty if not stated.
        matrix: name of the matrix file.
        started: start of the campaign, UTC; None if unknown.
        recorded: start of the recording of the point, UTC; None if unknown.
        point: name of the point; empty for a parameter of a fit.
        repeat: number of the repeat of the point, from 1.
        quantity: name as in `rig.results.quantities`, or the name of a parameter.
        subject: `specimen` or `bench`.
        motion: the motion in one phrase; `fit MODEL` for a parameter.
        amplitude_m, frequency_Hz, current_A: of the motion; None for a parameter.
        value: in `unit`.
        unit: SI unit.
        std: combined standard uncertainty in `unit`; None if unknown.
        repeatability_std: part of it from the variation between cycles.
        calibration_std: part of it from calibration certificates; None if not stated.
        verdict: of the point (`valid`, `suspect`, `invalid`); for a parameter, `valid` if the model fits.
        specimen_verdict: `ok`, `not-ok`, `not-tested`, or `no-bands` without acceptance bands.
        simulated: whether the rig was simulated.
    """

    campaign: str
    run: str
    specimen: str
    station: str
    operator: str
    matrix: str
    started: datetime | None
    recorded: datetime | None
    point: str
    repeat: int
    quantity: str
    subject: str
    motion: str
    amplitude_m: float | None
    frequency_Hz: float | None
    current_A: float | None
    value: float
    unit: str
    std: float | None
    repeatability_std: float | None
    calibration_std: float | None
    verdict: str
    specimen_verdict: str
    simulated: bool


@dataclass(frozen=True)
class ResultFilter:
    """Which rows are requested; None: any. In texts, `*` and `?` are wildcards.

    Attributes:
        specimen: serial number.
        date: of the start (UTC), as `RunFilter`: a year, month or day, or a range.
        quantity: name of a quantity or parameter.
        matrix: name of the matrix file.
        station: name of the station.
        operator: person who performed the test.
        campaign: UUID of the campaign or name of the run directory.
        current_A: current level (A).
        verdict: of the point.
    """

    specimen: str | None = None
    date: str | None = None
    quantity: str | None = None
    matrix: str | None = None
    station: str | None = None
    operator: str | None = None
    campaign: str | None = None
    current_A: float | None = None
    verdict: str | None = None

    def __post_init__(self) -> None:
        """Check the date.

        Raises:
            FileProblem: it is not written as expected.
        """
        RunFilter(date=self.date)

    @property
    def empty(self) -> bool:
        """Whether every row is requested."""
        return all(getattr(self, one.name) is None for one in fields(self))


@contextmanager
def open_results(
    folder: Path, url: str | None = None, report_progress: Callable[[int, int], None] = lambda _done, _total: None
) -> Iterator[tuple[Database, Filled]]:
    """The results database of a folder, brought up to date; of a server, if its address is given.

    Raises:
        FileProblem: there is no such folder, the address is not valid, or the database is of another version.
        Unreachable: the server cannot be reached.
    """
    if url is None:
        with filled_database(folder, report_progress=report_progress) as opened:
            yield opened
    else:
        with server(url, create=False) as database:
            yield database, Filled()


def unmatched(database: Database, wanted: ResultFilter) -> list[str]:
    """Which text filters match no campaign, each with the names that the database contains; empty if each matches.

    Raises:
        Unreachable: the server was lost.
    """
    problems = []
    with database.transaction(reading=True) as connection:
        for name in ("specimen", "matrix", "station", "operator"):
            text, column = getattr(wanted, name), campaigns.c[name]
            if text is None:
                continue
            known = [one for one in connection.execute(select(column).distinct().order_by(column)).scalars() if one]
            if not any(fits_pattern(one, text) for one in known):
                listed = f"known: {some([*map(repr, known)], most=MOST_LISTED)}"
                there = listed if known else "but no campaign has a value for it"
                problems.append(f"--{name}: got {text!r}, {there}")
    return problems


def result_rows(database: Database, wanted: ResultFilter | None = None) -> Iterator[ResultRow]:
    """Values of all tests that a filter selects, in the order of time: of one test after the other.

    Args:
        database: from `open_results`.
        wanted: the filter; None: every row.

    Raises:
        Unreachable: the server was lost.
        FileProblem: the file cannot be read.
    """
    wanted = wanted or ResultFilter()
    kept = _matches(wanted)
    for query in (_characteristics(wanted), _parameters(wanted)):
        if query is None:
            continue
        with database.transaction(reading=True) as connection:
            for row in connection.execution_options(yield_per=MOST_AT_ONCE).execute(query):
                result = ResultRow(*row)
                if kept(result):
                    yield result


def _or_empty(column: ColumnElement[str]) -> ColumnElement[str]:
    return func.coalesce(column, "")


def _characteristics(wanted: ResultFilter) -> Select[Any]:
    c, x = campaigns.c, characteristics.c
    query = select(
        c.campaign_id, c.run, _or_empty(c.specimen), _or_empty(c.station), c.operator, c.matrix, c.started, x.recorded,
        x.point, x.repeat, x.quantity, x.subject, x.motion, x.amplitude_m, x.frequency_hz, x.current_a, x.value, x.unit,
        x.standard_uncertainty, x.repeatability_uncertainty, x.calibration_uncertainty, x.point_verdict,
        c.specimen_verdict, c.simulated,
    ).select_from(characteristics.join(campaigns, c.campaign == x.campaign))  # fmt: skip
    conditions = [*_of_campaign(wanted), *_text(x.quantity, wanted.quantity), *_text(x.point_verdict, wanted.verdict)]
    if wanted.current_A is not None:
        conditions.append(x.current_a == stored_current(wanted.current_A))  # a range would not use the index
    return query.where(*conditions).order_by(c.started, c.campaign_id, x.point, x.quantity)


def _parameters(wanted: ResultFilter) -> Select[Any] | None:
    """The identifiable parameters; None if the filter selects values of tests only."""
    if wanted.current_A is not None or wanted.quantity in QUANTITIES:
        return None
    c, q, f = campaigns.c, parameters.c, fits.c
    joined = parameters.join(campaigns, c.campaign == q.campaign).join(fits, f.campaign == q.campaign)
    verdict = case((f.adequate.is_(False), "suspect"), else_="valid")
    query = select(
        c.campaign_id, c.run, _or_empty(c.specimen), _or_empty(c.station), c.operator, c.matrix, c.started,
        null().label("recorded"), literal("").label("point"), literal(1).label("repeat"), q.parameter,
        literal(SPECIMEN).label("subject"), (literal("fit ") + f.model).label("motion"), null().label("amplitude_m"),
        null().label("frequency_hz"), null().label("current_a"), q.value, q.unit, q.standard_uncertainty,
        q.standard_uncertainty.label("repeatability_uncertainty"), null().label("calibration_uncertainty"),
        verdict.label("verdict"), c.specimen_verdict, c.simulated,
    ).select_from(joined)  # fmt: skip
    conditions = [*_of_campaign(wanted), *_text(q.parameter, wanted.quantity), *_text(verdict, wanted.verdict)]
    return query.where(q.identifiable, q.value.is_not(None), *conditions).order_by(
        c.started, c.campaign_id, q.parameter
    )


def _of_campaign(wanted: ResultFilter) -> Iterator[ColumnElement[bool]]:
    c = campaigns.c
    yield from _text(c.specimen, wanted.specimen)
    yield from _text(c.matrix, wanted.matrix)
    yield from _text(c.station, wanted.station)
    yield from _text(c.operator, wanted.operator)
    if wanted.campaign is not None:
        yield or_(*_text(c.campaign_id, wanted.campaign), *_text(c.run, wanted.campaign))
    first, last = date_range(wanted.date)
    if first is not None:
        yield c.started >= first
    if last is not None:
        yield c.started < last


def _text(column: ColumnElement[str], wanted: str | None) -> Iterator[ColumnElement[bool]]:
    """A condition that excludes no matching row; `_matches` decides on patterns."""
    if wanted is None:
        return
    if PLAIN.fullmatch(wanted):
        yield column == wanted
    else:
        begin = PLAIN.match(wanted)
        yield column.startswith(begin[0] if begin else "", autoescape=True)


def _matches(wanted: ResultFilter) -> Callable[[ResultRow], bool]:
    """Whether a row matches the patterns of a filter."""
    names = ("specimen", "quantity", "matrix", "station", "operator", "verdict")
    patterns = [(name, text) for name in names if (text := getattr(wanted, name)) is not None]

    def matches(row: ResultRow) -> bool:
        return all(fits_pattern(getattr(row, name), text) for name, text in patterns) and (
            wanted.campaign is None or any(fits_pattern(name, wanted.campaign) for name in (row.campaign, row.run))
        )

    return matches


def date_range(date: str | None) -> tuple[datetime | None, datetime | None]:
    """Begin and end (excluded) of a date as in `RunFilter`, UTC; None: open."""
    if date is None:
        return None, None
    first, colon, last = date.partition(":")
    last = last if colon else first
    return (_begin(first) if first else None), (_end(last) if last else None)


def _begin(date: str) -> datetime:
    year, month, day = (*map(int, date.split("-")), 1, 1)[:3]
    try:
        return datetime(year, month, day, tzinfo=UTC)
    except ValueError as error:
        raise FileProblem("--date", [f"{date!r}: {error}"]) from error


def _end(date: str) -> datetime:
    begin = _begin(date)
    if len(date) == len("2026-11-23"):
        return begin + timedelta(days=1)
    months = 12 * begin.year + begin.month - 1 + (1 if "-" in date else 12)
    return begin.replace(year=months // 12, month=months % 12 + 1)
