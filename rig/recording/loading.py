"""Tests from anywhere as a run: campaign folders, files of this or other programs, tables in memory, lists of them."""

from __future__ import annotations

import csv
import glob
import math
import os
import re
import shlex
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from rig.campaign_folder import CampaignFolder, run_path
from rig.errors import DataWarning, FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, grouped, read_tests
from rig.recording.file_formats.columns import choose
from rig.recording.file_formats.named_columns import FILE_QUANTITIES, named_quantity
from rig.recording.file_formats.table_file import TableColumn
from rig.recording.imported_signs import SignedLoop, doubtful_signs
from rig.recording.importing import Described, points_of, told_apart
from rig.recording.load_options import OPTIONS, LoadKeywords, LoadOptions
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.recording.table_columns import check_current, table_channels
from rig.recording.views import DESCRIBED
from rig.signals.free_motion import RANDOM
from rig.signals.waveform import WAVEFORM_NAMES
from rig.text_file import read_text
from rig.verdicts import VERDICTS

if TYPE_CHECKING:
    import pandas as pd

    from rig.recording.load_options import Source

ENDINGS = frozenset((
    ".csv", ".txt", ".dat", ".tsv", ".asc", ".parquet", ".nc", ".xlsx", ".xlsm", ".mat", ".h5", ".hdf5", ".mf4", ".mdf",
    ".tdms", ".lvm", ".rsp", ".drv", ".rpc", ".tim", ".xls", ".xlsb", ".ods",
))  # fmt: skip
"""Of files that are taken from a folder; a file that is named may have any."""
LIST_OF_POINTS = "points.csv"
"""What our CSV export lists its points in."""
ONE_COLUMN = r"--column (?:'[^']*'|[^\s'(),]+)"
LIST_LIMIT_BYTES = 1 << 24
CHANNEL = {"time": "time", **{quantity: channel for channel, quantity in FILE_QUANTITIES.items()}}
"""Quantity -> channel of a point, and the name of a table's column."""


def load(source: Source, **options: Unpack[LoadKeywords]) -> Run:
    """Tests as a run, which can be indexed, plotted, and passed to `identify`.

    Args:
        source: a campaign's folder; a folder of files of tests; a file of this or another program, or a pattern such as
            `tests/*.csv`; a table in memory (a pandas `DataFrame`, or a mapping of columns), one row a sample; a run or
            a point; or a list of these. Of a mapping of names to tables, each table is a test of that name.
        **options: what is stated of tests that are not recordings of this program: see `LoadOptions`.

    Returns:
        The run; the points of several sources in the order of the sources.

    Raises:
        FileProblem: something cannot be read; one line for each problem in any of the files.
        TypeError: there is no such option.
    """
    return merged(runs_of(source, LoadOptions.of(options)))


def merged(runs: Sequence[Run]) -> Run:
    """Several runs as one, whose folder and description are those of the first."""
    if len(runs) == 1:
        return runs[0]
    return replace(
        runs[0], points=tuple(point for run in runs for point in run.points),
        apart=tuple(point for run in runs for point in run.apart),
        unreadable=tuple(line for run in runs for line in run.unreadable),
    )  # fmt: skip


def runs_of(source: Source, options: LoadOptions) -> list[Run]:
    """The runs that a source holds; those of other programs' files and of tables that follow each other are one.

    Raises:
        FileProblem: something cannot be read, or is no test.
    """
    runs: list[Run] = []
    single = list(_flat(source, options))
    files = [one for one in single if isinstance(one, Path)]
    tables = [one for one in single if isinstance(one, _NamedTable)]
    stated = _stated(options)
    if stated and not files and not tables:
        raise FileProblem("load", [
            f"got {', '.join(stated)}, which applies only to files and tables from other programs, but the source "
            "contains only recorded tests. Fix: omit this"
        ])  # fmt: skip
    current_A = _currents(options, len(files) + len(tables))
    foreign: list[RecordedPoint] = []
    if files:
        foreign += _points_of_files(files, current_A[: len(files)], options)
    for table, one_A in zip(tables, current_A[len(files) :], strict=True):
        foreign += _points_of_table(table, one_A, options)
    for one in single:
        if isinstance(one, Run):
            runs.append(one)
        elif isinstance(one, RecordedPoint):
            runs.append(Run(Run.NOWHERE, (one,)))
    loops = [SignedLoop(one.id, one.displacement_m, one.force_N) for one in foreign if one.has_frequency]
    for text in doubtful_signs(loops, options.positive, option="positive='compression'"):
        warnings.warn(text, DataWarning, stacklevel=3)
    if foreign:
        described = {} if options.specimen is None else {"specimen": options.specimen}
        folder = Path(os.path.commonpath([file.resolve().parent for file in files])) if files else Run.NOWHERE
        names = told_apart(point.id for point in foreign)
        own = tuple(replace(point, id=name) for point, name in zip(foreign, names, strict=True))
        runs.append(Run(folder, own, described))
    if not runs:
        raise FileProblem("load", ["got an empty list, expected tests: folders, files, tables or runs"])
    return runs


def _stated(options: LoadOptions) -> list[str]:
    """Names of the options that differ from their defaults."""
    usual = LoadOptions()
    return [
        name for name in OPTIONS if (getattr(options, name) is not None if name in {"current_A", "no_value"}
                                     else getattr(options, name) != getattr(usual, name))
    ]  # fmt: skip


def _currents(options: LoadOptions, count: int) -> list[float | None]:
    """The coil current of each of so many files or tables (A).

    Raises:
        FileProblem: there is another number of currents, or one is not a number.
    """
    current_A = options.current_A
    if current_A is None:
        return [None] * count
    given = list(current_A) if isinstance(current_A, (Sequence, np.ndarray)) else [current_A] * count
    if len(given) != count:
        raise FileProblem("load", [f"current_A: got {len(given)} currents for {count} files or tables"])
    for one in given:
        check_current(one, "load")
    return [float(one) for one in given]


@dataclass(frozen=True)
class _NamedTable:
    name: str
    frame: pd.DataFrame


def _flat(source: Any, options: LoadOptions) -> Iterable[Run | RecordedPoint | Path | _NamedTable]:  # noqa: ANN401 - see Source
    """The single sources: runs, points, files of other programs, tables with a name each.

    Raises:
        FileProblem: a source is none of these, or there is nothing at a path.
    """
    if isinstance(source, (Run, RecordedPoint)):
        yield source
    elif isinstance(source, (str, os.PathLike)):
        yield from _at(Path(source))
    elif _is_table(source):
        yield from _tables("table", _frame(source), options)
    elif isinstance(source, Mapping):
        for name, table in source.items():
            yield from _tables(str(name), _frame(table), options)
    elif isinstance(source, Iterable) and not isinstance(source, (bytes, np.ndarray)):
        for place, one in enumerate(source):
            if _is_table(one):
                yield from _tables(f"table{place + 1}", _frame(one), options)
            else:
                yield from _flat(one, options)
    else:
        raise FileProblem("load", [
            f"got {type(source).__name__}, expected a folder, a file, a pandas DataFrame, a mapping of columns, a run, "
            "or a list of these"
        ])  # fmt: skip


def _is_table(source: object) -> bool:
    """Whether it is one table: of pandas, of a library that converts to pandas, or a mapping of columns."""
    if isinstance(source, Mapping) and not hasattr(source, "to_dataframe"):
        return bool(source) and not any(_is_table(one) for one in source.values())
    if isinstance(source, (Run, RecordedPoint)):
        return False
    return hasattr(source, "columns") or hasattr(source, "to_dataframe")


def _frame(table: Any) -> pd.DataFrame:  # noqa: ANN401 - whatever is a table
    """A table of any kind as one of pandas.

    Raises:
        FileProblem: it cannot be converted.
    """
    import pandas as pd

    if isinstance(table, pd.DataFrame):
        return table
    try:
        if hasattr(table, "to_dataframe"):  # of xarray
            return table.drop_vars(DESCRIBED, errors="ignore").to_dataframe()  # type: ignore[no-any-return]  # a foreign object
        if hasattr(table, "to_pandas"):  # of polars, pyarrow
            return table.to_pandas()  # type: ignore[no-any-return]  # a foreign object
        return pd.DataFrame({str(name): np.asarray(values) for name, values in table.items()})
    except (ValueError, TypeError, AttributeError, ImportError) as error:
        raise FileProblem("table", [f"cannot be converted to a pandas DataFrame: {error}"]) from error


def _at(path: Path) -> Iterable[Run | Path]:
    """What a path names: a run, or files of other programs.

    Raises:
        FileProblem: there is nothing, or nothing that can be read.
    """
    text = str(path)
    if not path.exists() and glob.has_magic(text):
        matching = [Path(one) for one in sorted(glob.glob(text))]
        if not matching:
            raise FileProblem(text, ["no file matches this pattern"])
        for one in matching:
            yield from _at(one)
        return
    path = run_path(path)
    if not path.exists():
        raise FileProblem(text, ["no such file or folder"])
    if path.is_file():
        if path.suffix == ".json":
            raise FileProblem(text, ["got a JSON file, expected tests. Fix: load a fit with rig.load_fit"])
        yield _own_point(path) or path
        return
    if CampaignFolder.found(path).points.is_dir():
        yield Run.open(path)
        return
    files = sorted(one for one in path.iterdir() if one.suffix.lower() in ENDINGS and one.is_file())
    files = [one for one in files if not (one.name == LIST_OF_POINTS and _listed(one))]
    if not files:
        raise FileProblem(text, [
            f"contains neither a campaign (points/*.h5) nor test files ({', '.join(sorted(ENDINGS))})"
        ])  # fmt: skip
    for one in files:
        yield _own_point(one) or one


def _own_point(path: Path) -> Run | None:
    """A point's file as a run of one; None for another program's HDF5 file or anything else.

    Raises:
        FileProblem: it lies in a campaign's folder of points, and cannot be read.
    """
    if path.suffix != ".h5":
        return None
    try:
        return Run.open(path)
    except FileProblem:
        if path.parent.name == CampaignFolder.points:
            raise
        return None


def _points_of_files(
    files: Sequence[Path], current_A: Sequence[float | None], options: LoadOptions
) -> list[RecordedPoint]:
    """The tests in other programs' files, and in our own exports.

    Raises:
        FileProblem: one line for each problem in any of the files.
    """
    tests: list[ImportedTest] = []
    problems: dict[str, list[Path]] = {}
    places = [file.resolve() for file in files]
    given = Counter(places)
    twice = sorted({str(file) for file, place in zip(files, places, strict=True) if given[place] > 1})
    exports = {file.parent for file in files if file.suffix == ".csv"}
    lists = {folder: _listed(folder / LIST_OF_POINTS) for folder in exports}
    for file, one_A in zip(files, current_A, strict=True):
        settings = ImportSettings(
            options.columns, one_A, options.current_from_name, options.rate_Hz, options.dialect, tuple(options.accept),
            scales=options.scales, no_value=options.no_value, positive=options.positive,
            described=lists[file.parent].get(file.stem, {}) if file.suffix == ".csv" else {},
        )  # fmt: skip
        try:
            tests += read_tests([file], settings)
        except FileProblem as error:
            for problem in error.problems:
                problems.setdefault(_in_python(problem.removeprefix(f"{file}: ")), []).append(file)
    if problems or twice:
        way_out = "In Python, specify the columns with rig.load(FILES, columns={'displacement': 'NAME:mm', 'force': "\
            "'NAME:N', 'time': 'NAME:s'}, current_A=0.5)"
        columns = any("column" in problem or "current" in problem for problem in problems)
        raise FileProblem("load", [
            *(f"{file} is given more than once. Fix: specify each file only once" for file in twice),
            *grouped(problems), *([way_out] if columns else []),
        ])  # fmt: skip
    return [point for test in tests for point in _points_of_test(test, options)]


def _in_python(problem: str) -> str:
    """A problem of a file with the arguments of `load` in place of the options of `rig import`."""

    def columns(found: re.Match[str]) -> str:
        pairs = dict(text.split("=", 1) for text in shlex.split(found[0]) if text != "--column")
        return f"columns={pairs!r}"

    text = re.sub(rf"{ONE_COLUMN}(?: {ONE_COLUMN})*", columns, problem)
    text = re.sub(r"--current '([0-9.]+) A'", r"current_A=\1", text)
    return re.sub(r"--current-from-name (?=')", "current_from_name=", text).replace("--rate", "rate_Hz")


def _points_of_test(test: ImportedTest, options: LoadOptions) -> list[RecordedPoint]:
    """The points of a test; what our own export states of it is kept."""
    stated, waveform = test.described, options.waveform
    nominal_A = _number(stated.get("current_A"))
    if nominal_A is not None:
        measured = test.current_measured and stated.get("current_source", "measured") == "measured"
        test = replace(test, nominal_current_A=nominal_A, current_measured=measured)
    if stated.get("waveform"):
        waveform = stated["waveform"] if stated["waveform"] in WAVEFORM_NAMES else RANDOM
    described = Described(waveform, options.specimen or "imported", options.mid_stroke_m, positive=options.positive)
    points = points_of([test], described)
    if len(points) != 1 or not stated:
        return points
    (point,) = points
    skew_std_s = _number(stated.get("skew_std_s"))
    if skew_std_s is not None:
        point = replace(point, skew_std_s=skew_std_s)
    verdict = stated.get("verdict")
    if verdict in VERDICTS:  # by the checks of the recording, which saw more than the export states
        reasons = () if verdict == "valid" else (*point.reasons, f"exported with the verdict {verdict}")
        point = replace(point, verdict=verdict, reasons=reasons)
    return [point]


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _listed(file: Path) -> dict[str, dict[str, str]]:
    """Name of each point in the list that our CSV export writes -> what it states; empty where it is no such list."""
    if not file.is_file():
        return {}
    try:
        rows = list(csv.DictReader(read_text(file, LIST_LIMIT_BYTES).splitlines()))
    except (FileProblem, csv.Error):
        return {}
    if not rows or not {"id", "waveform", "current_A", "verdict"} <= rows[0].keys():
        return {}
    return {str(row["id"]): {name: value or "" for name, value in row.items() if name} for row in rows}


def _tables(name: str, frame: pd.DataFrame, options: LoadOptions) -> Iterable[_NamedTable]:
    """The tests of a table: one for each value of the column that tells them apart.

    Raises:
        FileProblem: the table has no such column.
    """
    if options.by is None and "point" in frame.index.names and frame.index.nlevels > 1:  # `Run.to_xarray`
        for point, rows in frame.groupby(level="point", sort=False):
            yield _NamedTable(str(point), rows.dropna(subset="time_s").reset_index(drop=True))
        return
    if options.by is None:
        yield _NamedTable(name, frame)
        return
    if options.by not in frame.columns:
        raise FileProblem(name, [f"by={options.by!r}: the table has no such column; its columns: {list(frame)}"])
    for value, rows in frame.groupby(options.by, sort=False):
        part = rows.drop(columns=options.by)
        part.attrs = dict(frame.attrs)
        yield _NamedTable(str(value), part)


def _points_of_table(table: _NamedTable, current_A: float | None, options: LoadOptions) -> list[RecordedPoint]:
    """The points of a table in memory.

    Raises:
        FileProblem: it is no test.
    """
    name = table.name
    if not len(table.frame):
        raise FileProblem(name, ["the table has no rows"])
    frame, units = _with_own_columns(table, options)
    channels, times = table_channels(frame, name, units, tuple(options.accept))
    measured_A, commanded_A = channels.get("current"), channels.get("commanded_current")
    known_A = measured_A if measured_A is not None else commanded_A
    if known_A is not None and not np.any(np.isfinite(known_A)):
        known_A = None
    nominal_A = current_A if known_A is None else float(np.nanmedian(known_A))
    if nominal_A is None:
        raise FileProblem(name, [
            "the table has no column with the coil current (`current_A`). Fix: add the column, or state the current of "
            "the test with current_A=0.5"
        ])  # fmt: skip
    time_s = channels["time"]
    test = ImportedTest(
        source=Path(name), sha256="", time_s=time_s - time_s[0], displacement_m=channels["displacement"],
        force_N=channels["force"], nominal_current_A=nominal_A, current_measured=measured_A is not None,
        current_A=measured_A if measured_A is not None else np.full(
            len(time_s), np.nan if commanded_A is not None else nominal_A),
        commanded_A=commanded_A, choices={}, read_as="table in memory", times=times,
        temperature_degC=channels.get("coil_temperature"),
    )  # fmt: skip
    return _points_of_test(test.extension_positive(options.positive), options)


def _with_own_columns(table: _NamedTable, options: LoadOptions) -> tuple[pd.DataFrame, dict[str, str]]:
    """A table in which the columns that the user names have the names of their quantities, and the units of these.

    Raises:
        FileProblem: (without the table's name) one line for each that is not there, or whose unit is not known.
    """
    frame, units = table.frame, dict(options.units)
    unknown = [quantity for quantity in options.columns if quantity not in CHANNEL]
    if unknown:
        known = ", ".join(CHANNEL)
        raise FileProblem(table.name, [f"columns: got {name!r}, expected one of {known}" for name in unknown])
    stated = frame.attrs.get("units", {})
    names = [str(column) for column in frame]
    columns = [TableColumn(name, str(units.get(name, stated.get(name, "")))) for name in names]
    try:
        chosen = choose(columns, options.columns, lambda place: frame.dtypes.iloc[place].kind not in "biuf")
    except FileProblem as error:
        raise FileProblem(table.name, error.problems) from error
    for quantity, choice in chosen.items():
        channel, label = CHANNEL[quantity], names[choice.place]
        rivals = [name for name in names if name != label and (quantity_named := named_quantity(name)) is not None
                  and quantity_named.channel == channel and name in frame]  # fmt: skip
        frame = frame.drop(columns=rivals).rename(columns={label: channel})
        units = {name: unit for name, unit in units.items() if name not in {label, *rivals}}
        if choice.unit is not None:
            units[channel] = choice.unit_name
    return frame, units
