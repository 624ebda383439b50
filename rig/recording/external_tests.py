"""Damper tests in files of other programs: read, converted to SI, and checked for plausibility."""

from __future__ import annotations

import contextlib
import itertools
import math
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from protocols.patterns import Pattern, PatternError
from rig.display import Positive
from rig.errors import FileProblem, some
from rig.recording.file_formats.columns import (
    MOST_SHOWN,
    REQUIRED,
    ColumnChoice,
    check_choices,
    choose,
    suggestions,
    unit_stated,
)
from rig.recording.file_formats.file_layout import FileLayout
from rig.recording.file_formats.formats import open_file
from rig.recording.file_formats.named_columns import FILE_QUANTITIES, stated_columns
from rig.recording.file_formats.table_file import Break, Dialect, TableFile, check_equal_lengths
from rig.recording.file_formats.together import brought_together
from rig.signals.arrays import FloatArray
from rig.signals.cycles import cycle_rate_Hz
from rig.signals.interpolation import LARGEST_STEP_PERIODS
from rig.signals.plausibility import TestSize, doubts
from rig.signals.sample_times import SampleTimes, sample_times

MORE_SHEETS = 2
"""So many further sheets that do not fit are shown, with their first problem each."""
FEWEST_ROWS = 16
NO_TIME = "time: no column specified. Fix: write --column time=NAME, or --rate '1 kHz' if there is no time column"
DIRECTIONS = tuple(re.compile(rf"(?i)(?<![a-z])({words})(?![a-z])") for words in (
    r"reb(?:ound)?", r"comp(?:r(?:ession)?)?|jounce|bump",
))  # fmt: skip
"""Names of forces by direction: a recording has one force, a table of peak values has one for each direction."""
SLOWEST_Hz, FASTEST_Hz = 5.0, 1e6
"""Sample rates of damper tests."""
#: Largest value of each quantity, and of displacement the largest span, that a test can have; as in bench files.
LARGEST = {
    "displacement": (2.0, "m"), "force": (200e3, "N"), "current": (20.0, "A"), "commanded_current": (20.0, "A"),
    "voltage": (100.0, "V"), "temperature": (300.0, "degC"),
}
#: The unit of such numbers, probably, as a column's name is given it.
LIKELY = {
    "displacement": "mm (NAME:mm)", "force": "N, not kN (NAME:N)", "current": "mA (NAME:mA)",
    "commanded_current": "mA (NAME:mA)", "voltage": "mV (NAME:mV)",
    "temperature": "K (NAME:K)",
}
USUAL_NO_VALUE = tuple(sign * number for number in (
    999.0, 999.25, 9999.0, 9999.9, 9999.99, 32767.0, 32768.0, 65535.0, 99999.0, 999999.0,
    2147483647.0, 2147483648.0, 1e30, 9.9e37, 9.91e37, 1e38,
    float(np.finfo(np.float32).max),
) for sign in (-1.0, 1.0))  # fmt: skip
"""Numbers by which programs write that there is no value (SCPI: 9.9e37 is overflow, 9.91e37 no number)."""
EXACT = 1e22
"""Largest power of ten that is a floating-point number: pandas before 3.1 rounds larger ones twice."""
NO_VALUE_JUMP = 3.0
"""Such a number is that many times the largest step of the column away from its neighbours."""
IN_NAMES = "_(?P<current>[0-9.]+)A"
"""Usual pattern of a current in the name of a file."""
RATE = "sample-rate"
INVERTED = "signs of displacement and force inverted (compression was positive)"
DOUBTS = ("units-time", "units-displacement", "units-force", RATE)
"""What can be accepted by its slug."""


@dataclass(frozen=True)
class ImportedTest:
    """One foreign test in SI on its own time: arrays (n,), NaN where the file has no number.

    `part` names the part of its file where this holds several tests.
    """

    source: Path
    sha256: str
    time_s: FloatArray
    displacement_m: FloatArray
    force_N: FloatArray
    current_A: FloatArray
    nominal_current_A: float
    current_measured: bool
    commanded_A: FloatArray | None
    choices: Mapping[str, ColumnChoice]
    read_as: str
    temperature_degC: FloatArray | None = None
    part: str = ""
    times: SampleTimes | None = None
    """How the times were found behind the file's stamps."""
    layout: FileLayout | None = None
    """What the file looked like."""
    described: Mapping[str, str] = field(default_factory=dict)
    """What an export of this program states of the test, by the names in its list of points."""

    def extension_positive(self, positive: Positive) -> ImportedTest:
        """The test with extension and rebound positive.

        Args:
            positive: the direction in which displacement and force are positive here, with all scales applied.
        """
        if positive == "rebound":
            return self
        return replace(self, displacement_m=-self.displacement_m, force_N=-self.force_N,
                       read_as=f"{self.read_as}; {INVERTED}")


@dataclass(frozen=True)
class ImportSettings:
    """What to read of every file; see `rig.recording.importing.import_tests` for each."""

    columns: Mapping[str, str]
    current_A: float | None = None
    current_from_name: str | None = None
    rate_Hz: float | None = None
    dialect: Dialect = field(default_factory=Dialect)
    accept: tuple[str, ...] = ()
    ampere_per_volt: float = 1.0
    scales: Mapping[str, str | float] = field(default_factory=dict)
    no_value: Sequence[float] | None = None
    positive: Positive = "rebound"
    """The direction in which displacement and force are positive after the scales were applied."""
    described: Mapping[str, str] = field(default_factory=dict)
    """What is known of the test besides; see `ImportedTest.described`."""


def read_tests(files: Sequence[Path], settings: ImportSettings) -> list[ImportedTest]:
    """Read foreign tests; nothing is written.

    Raises:
        FileProblem: one line for each thing that does not fit, in any of the files.
    """
    pattern = _current_pattern(settings.current_from_name)
    unknown = [slug for slug in settings.accept if slug not in DOUBTS]
    if unknown:
        raise FileProblem("--accept", [f"got {slug!r}, expected one of {', '.join(DOUBTS)}" for slug in unknown])
    if settings.rate_Hz is not None and not 0.0 < settings.rate_Hz < np.inf:
        raise FileProblem("--rate", [f"got {settings.rate_Hz!r} Hz, expected a rate above 0"])
    if settings.positive not in get_args(Positive):
        raise FileProblem("--positive", [f"got {settings.positive!r}, expected rebound or compression"])
    twice = list(_stated_twice(files, settings))
    if twice:
        raise FileProblem("import", twice)
    tests: list[ImportedTest] = []
    problems: dict[str, list[Path]] = {}
    for file in files:
        try:
            tests += [test.extension_positive(settings.positive) for test in _read_file(Path(file), settings, pattern)]
        except FileProblem as error:
            for problem in error.problems:
                problems.setdefault(problem, []).append(Path(file))
    if not files:
        raise FileProblem("import", ["no files given"])
    if problems:
        raise FileProblem("import", grouped(problems))
    return tests


def _stated_twice(files: Sequence[Path], settings: ImportSettings) -> Iterator[str]:
    """What is told in two ways, of which one would be left out in silence, or counted twice."""
    if settings.rate_Hz is not None and "time" in settings.columns:
        time = settings.columns["time"]
        yield f"--rate and --column time={time} both specify the sample times. Fix: remove one option"
    if settings.positive == "compression" and all(_inverts(settings.scales.get(quantity)) for quantity in REQUIRED):
        yield ("--positive compression and the negative factors in --scale would invert displacement and force twice. "
            "Fix: remove either --positive compression or both factors")
    places = [Path(file).resolve() for file in files]
    for place in dict.fromkeys(place for place in places if places.count(place) > 1):
        yield (
            f"{place} is given {places.count(place)} times. Fix: specify each file only once, because duplicates would "
            "make the confidence intervals too narrow"
        )


def _inverts(scale: str | float | None) -> bool:
    """Whether a scale is a plain negative factor: a sensitivity can be negative for other reasons."""
    try:
        return scale is not None and float(scale) < 0.0
    except ValueError:
        return False


def grouped(problems: Mapping[str, Sequence[Path]]) -> list[str]:
    """One line for each problem, with the files that have it."""
    return [f"{named_files(where)}: {problem}" for problem, where in problems.items()]


def named_files(files: Sequence[Path]) -> str:
    """The first three of them, and how many more there are."""
    return some([*map(str, files)])


def _current_pattern(text: str | None) -> Pattern | None:
    if text is None:
        return None
    try:
        pattern = Pattern(text)
    except PatternError as error:
        raise FileProblem("--current-from-name", [f"{text!r} is not a valid regular expression: {error}"]) from error
    if "current" not in pattern.groups:
        raise FileProblem("--current-from-name", [f"{text!r} has no group (?P<current>...)"])
    return pattern


def _read_file(file: Path, settings: ImportSettings, pattern: Pattern | None) -> list[ImportedTest]:
    """The tests of a file.

    Raises:
        FileProblem: one line for each thing that does not fit.
    """
    tables, sha256 = _opened(file, settings)
    if len(tables) == 1:
        return _tests_of(file, sha256, tables[0][1], "", settings, pattern)
    tests: list[ImportedTest] = []
    problems: dict[str, Sequence[str]] = {}
    for name, opened in tables:
        try:
            tests += _tests_of(file, sha256, opened, name, settings, pattern)
        except FileProblem as error:
            problems[name] = error.problems
    if problems:
        raise FileProblem(str(file), list(_of_sheets(problems, [name for name, _ in tables])))
    return tests


def _of_sheets(problems: Mapping[str, Sequence[str]], sheets: Sequence[str]) -> Iterator[str]:
    """What does not fit in the sheets of a workbook, in detail in the first one only, and which sheets fit."""
    first, *more = problems
    for text in problems[first]:
        yield f"sheet {first!r}: {text}"
    for name in more[:MORE_SHEETS]:
        yield f"sheet {name!r}: {problems[name][0]}"
    if more[MORE_SHEETS:]:
        yield f"also not imported: {', '.join(f'sheet {name!r}' for name in more[MORE_SHEETS:])}"
    fitting = [name for name in sheets if name not in problems]
    if fitting:
        options = " ".join(f"--sheet {shlex.quote(name)}" for name in fitting)
        yield f"the other sheets can be imported: {options}"


def _tests_of(
    file: Path, sha256: str, opened: TableFile, name: str, settings: ImportSettings, pattern: Pattern | None
) -> list[ImportedTest]:
    """The tests of a table.

    Raises:
        FileProblem: one line for each thing that does not fit.
    """
    settings = _with_stated(file, opened, settings)
    choices = _choices(file, opened, settings)
    table, stated = _table(file, opened, choices, settings)
    if "voltage" in table:
        table.setdefault("commanded_current", table["voltage"] * settings.ampere_per_volt)
    parts, notes = _parts(opened, table["time"], settings)
    if not parts:
        raise FileProblem(str(file), [
            *notes, f"no part of the file has at least {FEWEST_ROWS} rows (read as {opened.read_as})"
        ])
    tests = []
    for number, (start, stop) in enumerate(parts, start=1):
        of_table = f"part{number}" if len(parts) > 1 else ""
        part = _Part("_".join(filter(None, (name, of_table))), of_table, start, (*notes, *stated))
        tests.append(_test(file, sha256, opened, choices, {
            quantity: values[start:stop] for quantity, values in table.items()
        }, part, settings, pattern))  # fmt: skip
    return tests


def _with_stated(file: Path, opened: TableFile, settings: ImportSettings) -> ImportSettings:
    """The settings with what the file states: its description, and columns by their names.

    Columns are taken by their names where the user does not name both displacement and force.

    Raises:
        FileProblem: several columns state the same quantity.
    """
    described = {**opened.described, **settings.described}
    current_A = settings.current_A
    if current_A is None and described.get("current_A"):
        with contextlib.suppress(ValueError):
            current_A = float(described["current_A"])
    settings = replace(settings, described=described, current_A=current_A)
    given = settings.columns
    if {*REQUIRED} <= given.keys():
        return settings
    try:
        stated = stated_columns(opened.columns, given)
    except FileProblem as error:
        raise FileProblem(str(file), error.problems) from error
    if settings.rate_Hz is not None:
        stated.pop("time", None)
    if "voltage" in given:
        stated.pop("commanded_current", None)
    columns = {**stated, **given}
    # Without any choice of the user, part of them would be of no use: a user who then names the others names all.
    return replace(settings, columns=columns) if given or {*REQUIRED} <= columns.keys() else settings


@dataclass(frozen=True)
class _Part:
    """Part of a file: its name, the part of it within its table, its first row, and what to state of other lines."""

    name: str
    of_table: str
    first_row: int
    notes: tuple[str, ...]


def _lines(breaks: Sequence[Break], row: str) -> str:
    shown = ", ".join(str(one.line) for one in breaks[:3])
    return f"{row}{'s' * (len(breaks) > 1)} {shown}{', ...' * (len(breaks) > 3)}"


def _test(
    file: Path, sha256: str, opened: TableFile, choices: Mapping[str, ColumnChoice], table: Mapping[str, FloatArray],
    part: _Part, settings: ImportSettings, pattern: Pattern | None,
) -> ImportedTest:
    """A test of a table in SI.

    Raises:
        FileProblem: one line for each thing that does not fit.
    """
    known = next((name for name in ("current", "commanded_current") if name in table), "")
    table = dict(table)
    times = uniform_times(table)
    problems = [
        *_wrong_time(opened, table["time"], choices, part.first_row), *_empty(table, choices),
        *_too_large(table, {quantity: choice.text for quantity, choice in choices.items()}),
    ]
    nominal_A = np.nan
    try:
        nominal_A = _nominal_A(" ".join((file.name, part.name)).strip(), table.get(known), settings, pattern)
    except ValueError as error:
        problems.append(str(error))
    if not problems:
        problems = list(_doubtful(table, settings.accept))
    if problems:
        where = [f"{part.of_table}:"] * bool(part.of_table)
        raise FileProblem(str(file), [*(" ".join((*where, one)) for one in problems), f"(read as {opened.read_as})"])
    assumed_A = nominal_A if "commanded_current" not in table else np.nan
    time_s = table["time"]
    current = table["current"] if "current" in table else np.full(len(time_s), assumed_A)
    time_base = [f"time base: {times.description}"] if times is not None and times.description else []
    notes = "; ".join(
        (*part.notes, *(f"{quantity} {choice.description}" for quantity, choice in choices.items()), *time_base)
    )
    return ImportedTest(
        file, sha256, time_s - time_s[0], table["displacement"], table["force"], current, nominal_A, "current" in table,
        table.get("commanded_current"), choices, f"{opened.read_as}; {notes}", table.get("temperature"), part.name,
        times, FileLayout.of(opened.read_as, opened.columns, choices, 1.0 / float(np.median(np.diff(time_s)))),
        settings.described,
    )


def uniform_times(table: dict[str, FloatArray]) -> SampleTimes | None:
    """How the times were found; where a uniform rate is behind the stamps, the table's time is that from here on."""
    stamps_s = table["time"]
    if stamps_s.size < FEWEST_ROWS or not np.all(np.isfinite(stamps_s)):
        return None
    times = sample_times(stamps_s, (table["displacement"], table["force"]))
    if times.uniform:
        table["time"] = times.time_s + stamps_s[0]
    return times


def _parts(opened: TableFile, time_s: FloatArray, settings: ImportSettings) -> tuple[list[tuple[int, int]], list[str]]:
    """First row and row after the last of each test in a file, and what is to be stated of its other lines.

    Blocks under the same heading are one test where their time goes on without a gap, otherwise a test each.
    """
    breaks = opened.breaks()
    if not breaks:
        return [(0, len(time_s))], []
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    longest_s = LARGEST_STEP_PERIODS * float(np.median(forward)) if len(forward) else 0.0
    cuts = []
    for one in breaks:
        if 0 < one.row < len(time_s):
            step_s = float(time_s[one.row] - time_s[one.row - 1])
            goes_on = "time" in settings.columns or settings.rate_Hz is None
            back = not one.count and goes_on and step_s <= 0.0  # behind blank rows another test starts
            cut = not (goes_on and 0.0 < step_s <= longest_s) if one.heading else settings.dialect.event_rows == "split"
            cuts += [one.row] * (cut or back)
    edges = [0, *sorted({*cuts}), len(time_s)]
    parts = [(start, stop) for start, stop in itertools.pairwise(edges) if stop - start >= FEWEST_ROWS]
    row = opened.row_name(0).partition(" ")[0]
    return parts, list(_notes(breaks, len(edges) - 1, parts, len(time_s), row))


def _notes(
    breaks: Sequence[Break], count: int, parts: Sequence[tuple[int, int]], rows: int, row: str
) -> Iterator[str]:
    """What to state of lines between rows, and of rows that are in no test.

    Args:
        breaks: where these lines are.
        count: parts of the file.
        parts: those that are tests.
        rows: of the file.
        row: what the file's rows are called.
    """
    headings = [one for one in breaks if one.heading and not one.other]
    others = [one for one in breaks if one.other]
    events = [one for one in breaks if one.count and not one.heading]
    if headings:
        yield f"{len(headings)} repeated heading(s) ({_lines(headings, row)})"
    if events:
        yield f"{sum(one.count for one in events)} row(s) without numbers skipped ({_lines(events, row)})"
    if others:
        yield f"{sum(one.other for one in others)} row(s) of other tables left out (after {_lines(others, row)})"
    if count > 1:
        where = "these" if headings or events else "blank"
        yield f"file split into {count} parts at {where} rows, one test each"
    elif headings:
        yield "the parts before and after these headings were joined because the time continues"
    used = sum(stop - start for start, stop in parts)
    if used < rows:
        yield f"{rows - used} rows skipped: their parts have fewer than {FEWEST_ROWS} rows"


def _opened(file: Path, settings: ImportSettings) -> tuple[list[tuple[str, TableFile]], str]:
    """The tables of a file and its SHA-256.

    Raises:
        FileProblem: it cannot be read; what is wrong with the wanted columns is said too.
    """
    try:
        return open_file(file, settings.dialect)
    except FileProblem as error:
        if not settings.columns:
            raise
        try:
            check_choices(settings.columns, settings.scales)
        except FileProblem as other:
            raise FileProblem(str(file), [*error.problems, *other.problems]) from error
        raise


def column_lists(
    file: Path, dialect: Dialect
) -> Iterator[tuple[str, list[tuple[str, str]], dict[str, str], str]]:
    """For each table of a file how it was read, its columns with their units, likely options by quantity, and a doubt.

    The doubt is whether the table is a recording or has a time; it is empty if there is none.

    Raises:
        FileProblem: the file cannot be read.
    """
    for name, opened in open_file(file, dialect)[0]:
        columns = [(one.full or one.name, unit_stated(one)) for one in opened.columns]
        hints = suggestions(opened.columns, [*REQUIRED, "time", "current"])
        doubt = "" if "time" in hints else _no_time(opened)
        yield f"{f', {name}' if name else ''}: {opened.read_as}", columns, hints, doubt


def _no_time(opened: TableFile) -> str:
    """What to do about a table in which no column was recognised as the time; empty if its format has the time."""
    places = range(len(opened.columns))
    if not places:
        return ""
    most = 0
    for place in places:
        with contextlib.suppress(FileProblem, ValueError):  # a column of texts
            most = max(most, *map(len, opened.values([place])))
        if most >= FEWEST_ROWS:
            break
    if table := _peak_values(opened, most):
        return table
    with contextlib.suppress(FileProblem):
        if opened.own_time(places[:1]) is not None:
            return ""
    return NO_TIME


def _peak_values(opened: TableFile, rows: int) -> str:
    """What to do about a table without time that is no recording; empty for any other table."""
    names = [f"{column.name} {column.full}" for column in opened.columns]
    by_direction = all(any(word.search(name) for name in names) for word in DIRECTIONS)
    if not rows or (rows >= FEWEST_ROWS and not by_direction):
        return ""
    return (
        f"{rows} rows without a time column look like a table of peak values, not like a recording of samples. Fix: "
        f"import the recorded samples of each test (displacement and force over time, at least {FEWEST_ROWS} rows)"
    )


def _choices(file: Path, opened: TableFile, settings: ImportSettings) -> dict[str, ColumnChoice]:
    """The columns to read.

    Raises:
        FileProblem: not all can be told; which ones there are is said.
    """
    try:
        check_choices(settings.columns, settings.scales)
        if {"voltage", "commanded_current"} <= settings.columns.keys():
            raise FileProblem("--column", ["voltage and commanded_current both specify the coil command. Fix: use "
                "only one of them"])
        chosen = choose(opened.columns, settings.columns, opened.is_stamps, settings.scales)
        if "time" not in chosen and settings.rate_Hz is None:
            chosen = {**_named_time(opened, [one.place for one in chosen.values()], settings), **chosen}
    except FileProblem as error:
        absent = [name for name in (*REQUIRED, "time") if name not in settings.columns]
        if not absent:
            raise FileProblem(str(file), [*error.problems, f"(read as {opened.read_as})"]) from error
        shown = [(one.full or one.name) + (f" ({one.unit})" if one.unit and one.unit not in one.full else "")
                 for one in opened.columns[:MOST_SHOWN]]  # fmt: skip
        hints = suggestions(opened.columns, absent)
        hint = " ".join(hints.values())
        timeless = "time" in absent and "time" not in hints and settings.rate_Hz is None
        doubt = _no_time(opened) if timeless else ""
        raise FileProblem(str(file), [
            *error.problems, *([doubt] if doubt else []), f"read as {opened.read_as}; its columns: {', '.join(shown)}",
            *([f"perhaps {hint}"] if hint else []),
        ]) from error  # fmt: skip
    return chosen


def _named_time(opened: TableFile, places: Sequence[int], settings: ImportSettings) -> dict[str, ColumnChoice]:
    """The column that states the time by its name, in a file whose format has no time for these columns."""
    try:
        stated = stated_columns(opened.columns, dict.fromkeys(FILE_QUANTITIES.values(), ""))
    except FileProblem:  # several do: the user has to choose, unless the format has the time
        return {}
    if not stated or opened.own_time(places) is not None:
        return {}
    return choose(opened.columns, stated, opened.is_stamps, settings.scales)


def _table(
    file: Path, opened: TableFile, choices: Mapping[str, ColumnChoice], settings: ImportSettings
) -> tuple[dict[str, FloatArray], list[str]]:
    """The columns in SI without empty rows at the end, and what is to be stated of them.

    Raises:
        FileProblem: values are no numbers, or there is no time.
    """
    places = [choice.place for choice in choices.values()]
    table, notes = {}, []
    for (quantity, choice), values in zip(choices.items(), opened.values(places), strict=True):
        values, missing = without_no_value(values, () if quantity == "time" else settings.no_value)
        notes += [f"{quantity}: {note}" for note in missing]
        with np.errstate(invalid="ignore", over="ignore"):  # damaged bytes are numbers too
            table[quantity] = values if choice.unit is None else values * choice.unit.scale + choice.unit.offset
    if "time" not in table:
        rows = len(next(iter(table.values())))
        time_s = np.arange(rows) / settings.rate_Hz if settings.rate_Hz is not None else opened.own_time(places)
        if time_s is not None and not isinstance(time_s, np.ndarray):
            return _together(file, opened, choices, table, time_s, notes)
        if time_s is None:
            hint = "".join(f"; perhaps {option}" for option in suggestions(opened.columns, ["time"]).values())
            raise FileProblem(str(file), [f"{NO_TIME}{hint}" if hint else _peak_values(opened, rows) or NO_TIME])
        table["time"] = time_s
    check_equal_lengths(file, list(table), [len(values) for values in table.values()])
    rows = len(table["time"])
    given = [values for quantity, values in table.items() if quantity != "time" or "time" in choices]
    while rows and all(np.isnan(values[rows - 1]) for values in given):
        rows -= 1
    return {quantity: values[:rows] for quantity, values in table.items()}, notes


def _together(
    file: Path, opened: TableFile, choices: Mapping[str, ColumnChoice], table: Mapping[str, FloatArray],
    times_s: Sequence[FloatArray], notes: list[str],
) -> tuple[dict[str, FloatArray], list[str]]:
    """Channels with times of their own, at the times of the displacement; what is stated of it is added to the notes.

    Raises:
        FileProblem: they do not belong together.
    """
    by_quantity = dict(zip(choices, times_s, strict=True))
    brought = brought_together(table, by_quantity)
    if brought is None:
        counts = ", ".join(f"{opened.columns[choice.place].full or choice.column} {len(by_quantity[quantity])} samples"
                         for quantity, choice in choices.items())  # fmt: skip
        raise FileProblem(str(file), [
            f"the channels were not sampled together: {counts}. Fix: first resample the channels to a common time base "
            "(MDF.resample)"
        ])  # fmt: skip
    time_s, channels = brought
    moved = [quantity for quantity in choices if not np.array_equal(by_quantity[quantity], by_quantity["displacement"])]
    return {"time": time_s, **channels}, [
        *notes, f"{', '.join(moved)} interpolated to the sample times of displacement (each channel has its own "
        "sample times)"
    ]  # fmt: skip


def without_no_value(values: FloatArray, stated: Sequence[float] | None) -> tuple[FloatArray, list[str]]:
    """A column (n,) with NaN in place of infinite values and of numbers that stand for no value, and what was found.

    Args:
        values: as read.
        stated: see `without_sentinels`.
    """
    infinite = np.isinf(values)
    notes = [f"{np.count_nonzero(infinite)} infinite value(s) read as missing"] * bool(infinite.any())
    values, missing = without_sentinels(np.where(infinite, np.nan, values) if notes else values, stated)
    return values, [*notes, *(f"{count} values of {number:g} read as missing" for number, count in missing.items())]


def without_sentinels(values: FloatArray, stated: Sequence[float] | None) -> tuple[FloatArray, dict[float, int]]:
    """Numbers by which programs write that there is no value, taken out.

    Args:
        values: as the file has them, (n,).
        stated: the numbers, where the user states them; None: the usual ones, where `_no_value` finds that they are.

    Returns:
        The values, NaN where there is none, and how often each number was found.
    """
    missing: dict[float, int] = {}
    for number in USUAL_NO_VALUE if stated is None else stated:
        here = _equal(values, number)
        if here.any() and (stated is not None or _no_value(values, number)):
            missing[float(number)] = int(np.count_nonzero(here))
    if not missing:
        return values, {}
    return np.where(_is_any(values, missing), np.nan, values), missing


def _equal(values: FloatArray, number: float) -> NDArray[np.bool_]:
    """Which values are a number as written in a file: pandas before 3.1 reads 9.9e37 as 9.900000000000001e37."""
    if abs(number) < EXACT:
        return np.asarray(values == number, np.bool_)
    near = [np.nextafter(number, -math.inf), number, np.nextafter(number, math.inf)]
    return np.asarray(np.isin(values, near), np.bool_)


def _is_any(values: FloatArray, numbers: Iterable[float]) -> NDArray[np.bool_]:
    """Which values are one of the numbers."""
    return np.asarray(np.logical_or.reduce([_equal(values, number) for number in numbers]), np.bool_)


def _no_value(values: FloatArray, number: float) -> bool:
    """Whether a usual number for no value is one in a column: beyond all others, by far or in single jumps."""
    known = np.isfinite(values) & ~_is_any(values, USUAL_NO_VALUE)
    rest = values[known]
    if len(rest) < 2:
        return bool(number < 0.0)
    beyond = max(float(np.min(rest)) - number, number - float(np.max(rest)))
    if beyond > float(np.ptp(rest)):
        return True
    places = np.flatnonzero(_equal(values, number))
    jumps = np.abs(number - np.interp(places, np.flatnonzero(known), rest))
    return beyond > 0.0 and float(np.min(jumps)) > NO_VALUE_JUMP * float(np.max(np.abs(np.diff(rest))))


def _wrong_time(
    opened: TableFile, time_s: FloatArray, choices: Mapping[str, ColumnChoice], first_row: int
) -> Iterator[str]:
    column = f", column {choices['time'].column!r}" if "time" in choices else ""
    blank = np.flatnonzero(~np.isfinite(time_s))
    if len(blank):
        yield f"{opened.row_name(int(blank[0]) + first_row)}{column}: no time ({len(blank)} such line(s))"
        return
    if len(time_s) < FEWEST_ROWS:
        yield f"{len(time_s)} rows; a test requires at least {FEWEST_ROWS}"
        return
    wrong = np.flatnonzero(~(np.diff(time_s) > 0.0))
    if len(wrong):
        row = int(wrong[0]) + 1
        yield (f"{opened.row_name(row + first_row)}: time {float(time_s[row])!r} s is not after "
            f"{float(time_s[row - 1])!r} s ({len(wrong)} such line(s)); times must increase. Fix: for "
            "samples at a constant rate, use --rate instead of the column")  # fmt: skip


def implausible(
    channels: Mapping[str, FloatArray], source: Mapping[str, str], accept: Sequence[str]
) -> Iterator[str]:
    """Sizes that no damper test has, as the import of a file refuses them.

    Args:
        channels: `time` (s) and quantities in SI, each (n,).
        source: quantity -> the column that it is.
        accept: slugs of doubts about sizes that are right all the same.
    """
    too_large = list(_too_large(channels, source))
    yield from too_large or _doubtful(channels, accept)


def _empty(table: Mapping[str, FloatArray], choices: Mapping[str, ColumnChoice]) -> Iterator[str]:
    """Columns without a single number; the time and the current have their own words."""
    for quantity, choice in choices.items():
        if quantity not in {"time", "current", "commanded_current"} and not np.any(np.isfinite(table[quantity])):
            way_out = "specify another column" if quantity in REQUIRED else "specify another column, or omit the column"
            none = f"none of {len(table[quantity])} rows contains a number"
            yield f"column {choice.text!r}, as {quantity}: {none}; {way_out}"


def _too_large(table: Mapping[str, FloatArray], source: Mapping[str, str]) -> Iterator[str]:
    """Values that no damper test has: a wrong unit or a wrong column."""
    for quantity, (limit, unit) in LARGEST.items():
        values = table.get(quantity)
        if quantity not in source or values is None or not np.any(np.isfinite(values)):
            continue
        spans = quantity == "displacement"
        verb = "spans" if spans else "reaches"
        size = float(np.nanmax(values) - np.nanmin(values) if spans else np.nanmax(np.abs(values)))
        if size > limit:
            yield (
                f"column {source[quantity]!r}, as {quantity}, {verb} {size:.4g} {unit}; expected at most {limit:g} "
                f"{unit}: check the unit and the column of {quantity}. The numbers are probably in {LIKELY[quantity]}"
            )


def current_hint(files: Sequence[Path]) -> str:
    """The option that states the current: by the names of the files, if all contain one, else to be filled in."""
    pattern = Pattern(IN_NAMES)
    for file in files:
        try:
            _nominal_A(file.name, None, ImportSettings({}), pattern)
        except ValueError:
            return "--current '... A'"
    return f"--current-from-name '{IN_NAMES}'"


def _nominal_A(
    name: str, known: FloatArray | None, settings: ImportSettings, pattern: Pattern | None
) -> float:
    """The test's current: of its column, the name of its file and part, or as given.

    Raises:
        ValueError: none of them tells it.
    """
    if known is not None:
        if not np.any(np.isfinite(known)):
            raise ValueError("the current column does not contain any numbers")
        return float(np.nanmedian(known))
    if pattern is None and settings.current_A is None:
        raise ValueError(
            "unknown coil current. Fix: name a column (--column current=i_A), a value (--current '0.5 A') or the "
            f"pattern of the file name (--current-from-name '{IN_NAMES}')",
        )
    if pattern is None:
        return float(settings.current_A or 0.0)
    named = pattern.search(name)
    if named is None:
        raise ValueError(f"the file name does not match {pattern.text!r}, so it states no current")
    try:
        value = float((named["current"] or "").replace(",", "."))
    except ValueError as error:
        raise ValueError(f"the file name states the current {named['current']!r}, which is not a number") from error
    if not abs(value) <= LARGEST["current"][0]:
        raise ValueError(f"the file name states {value:g} A; expected at most {LARGEST['current'][0]:g} A")
    return value


def _doubtful(table: Mapping[str, FloatArray], accept: Sequence[str]) -> Iterator[str]:
    """Rates, strokes and forces that hardly any damper test has, unless they are accepted."""
    time_s, x, force = table["time"], table["displacement"], table["force"]
    rate_Hz = float(1.0 / np.median(np.diff(time_s)))
    if not SLOWEST_Hz <= rate_Hz <= FASTEST_Hz and RATE not in accept:
        yield (f"{RATE}: {rate_Hz:.4g} samples per second; damper tests are sampled at {SLOWEST_Hz:g} Hz "
            f"to {FASTEST_Hz:g} Hz. Fix: check the unit of the time, or use --accept {RATE}")  # fmt: skip
    if not (np.any(np.isfinite(x)) and np.any(np.isfinite(force))):
        return
    frequency_Hz = cycle_rate_Hz(time_s, x)
    span = float(np.nanmax(x) - np.nanmin(x))
    size = TestSize(
        span_m=span, force_N=float(np.nanmax(np.abs(force - np.nanmean(force)))),
        cycle_s=None if frequency_Hz is None else 1.0 / frequency_Hz,
        speed_m_s=None if frequency_Hz is None else 2.0 * np.pi * frequency_Hz * span / 2.0,
    )
    for doubt in doubts(size):
        if doubt.slug not in accept:
            yield (f"{doubt.slug}: {doubt.value:.4g} {doubt.taken_as} is implausible for a damper test; "
                f"the numbers are probably in {doubt.likely}. Fix: write the unit after the column name "
                f"and a colon, or use --accept {doubt.slug}")  # fmt: skip
