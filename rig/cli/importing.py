"""`rig import`: convert test files of other programs to a run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click
from click.core import ParameterSource

from rig.cli.options import Command, QuantityOption, RunPath, json_option, out_option
from rig.cli.output import console, say, show, shown_path, status_line, write_json
from rig.display import Positive
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, EXIT_USAGE, FileProblem, RigError
from rig.recording.run import Run
from rig.signals.waveform import SINE, WAVEFORM_NAMES

if TYPE_CHECKING:
    from rig.characteristics.force_table import ForceTable
    from rig.recording.external_tests import ImportedTest
    from rig.recording.quality.point_quality import RecordQuality
    from rig.recording.quality.verdict import Section


FIELDS = {"rate": "rate_Hz", "current": "current_A", "mid_stroke": "mid_stroke_m"}
"""Names of options whose field in the import's settings has the unit in its name."""
SHEET = re.compile(r"sheet '[^']*'")
"""A sheet in the text of how a workbook was read."""
OTHER_SHARE = 0.25
"""Of a record: a larger share of ramps and other motion is stated on the screen, of less only in JSON and file."""


def _pairs(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    """`quantity=column` options as a mapping.

    Raises:
        BadParameter: not of that shape, or a quantity named twice.
    """
    pairs: dict[str, str] = {}
    for text in value:
        quantity, equals, column = text.partition("=")
        if not (quantity and equals and column):
            raise click.BadParameter(f"got {text!r}, expected a form such as displacement=x_m", ctx, param)
        if quantity in pairs:
            raise click.BadParameter(f"{quantity}: specified twice", ctx, param)
        pairs[quantity] = column
    return pairs


def _numbers(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[float, ...] | None:
    """The numbers that stand for no value; None where the option is not given.

    Raises:
        BadParameter: no number.
    """
    try:
        return None if not value else tuple(float(text) for text in value if text != "none")
    except ValueError as error:
        raise click.BadParameter(f"got {value!r}, expected numbers, or none", ctx, param) from error


def _sheets(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> str | tuple[str, ...] | None:
    """One name, or several; None where the option is not given.

    Raises:
        BadParameter: `all` together with names.
    """
    if "all" in value and len(value) > 1:
        raise click.BadParameter("got all and further names, expected either all or names of sheets", ctx, param)
    return value if len(value) > 1 else next(iter(value), None)


def _separator(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """One sign, or the words tab and space.

    Raises:
        BadParameter: anything else.
    """
    sign = {"tab": "\t", "\\t": "\t", "space": " "}.get(value or "", value)
    if sign is not None and (len(sign) != 1 or sign in '."\n\r' or sign.isalnum()):
        raise click.BadParameter(f"got {value!r}, expected a single character, tab or space", ctx, param)
    return sign


@click.command(
    name="import",
    cls=Command,
    examples=(
        "rig import tests/*.csv --column time=t_s --column displacement=x_m --column force=force_N "
        "--current-from-name '_(?P<current>[0-9.]+)A'",
        "rig import loop.csv --column time=t:ms --column displacement=x:mm --column force=F:kN --current '0.5 A'",
        "rig import random.csv --waveform random --column time=t:s --column displacement=x:mm --column force=F:N "
        "--column voltage=u:V",
        "rig import tests/new.csv --like last --current '0.5 A'",
        "rig import run7.mf4 --column displacement=Stroke --column force=LoadCell --column current=I_coil",
        "rig import old.txt --dry-run --separator ';' --decimal , --column time=Zeit --column displacement=Weg "
        "--column force=Kraft --current '0 A'",
    ),
)
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "--column",
    "columns",
    multiple=True,
    callback=_pairs,
    metavar="QUANTITY=COLUMN",
    help="Column for time, displacement, force, current (measured), commanded_current, temperature or voltage (of the "
    "driver): the column's name, #3 for the third column, or GROUP/NAME in MDF and TDMS files. The unit is taken from "
    "the file, from a suffix (x_mm) or from the text after a colon (x:mm).",
)
@click.option(
    "--like", "like", type=RunPath(), metavar="RUN",
    help="Reuse the options of this imported run (columns, units, scales, layout), except --current, --specimen and "
        "--date. Options of this command take precedence. Differences between the files are shown. A file is rejected "
        "if its units or factors contradict the options.",
)
@click.option(
    "--scale", "scales", multiple=True, callback=_pairs, metavar="QUANTITY=FACTOR",
    help="Factor by which to multiply the values in a column, such as force=-1 (if compression is positive); or the "
    "sensor's sensitivity: 'force=500 N/V', 'force=0.25 N/count', 'displacement=2 mV/mm'.",
)
@click.option(
    "--no-value", "no_value", multiple=True, callback=_numbers, metavar="NUMBER",
    help="Number that marks a missing value, instead of the usual numbers (-9999, 999.25, 9.9e37, ...); "
    "none: all numbers are valid values.",
)
@click.option(
    "--rate", type=QuantityOption("frequency"), help="Sampling rate, such as '1 kHz', if there is no time column."
)
@click.option("--separator", callback=_separator, metavar="SIGN", help="CSV: column separator (one character, tab or "
    "space).")
@click.option("--decimal", type=click.Choice([".", ","]),
              help="Decimal separator of a CSV file, or of the text cells of a workbook.")
@click.option(
    "--thousands", type=click.Choice([",", ".", "'", "space", "none"]),
    help="CSV: thousands separator (space includes the no-break space).",
)
@click.option(
    "--event-rows", type=click.Choice(["refuse", "skip", "split"]), default="refuse", show_default=True,
    help="CSV, workbook: how to treat rows of text between or after rows of numbers (reject the file, skip these rows, "
    "or split the file at these rows into several tests).",
)
@click.option("--sheet", multiple=True, callback=_sheets, metavar="NAME",
              help="Excel: sheet that contains a test. Repeat the option for several sheets, or use * as a wildcard; "
                  "all: one test for each sheet that contains a table.")
@click.option("--encoding", metavar="NAME", help="CSV: character encoding, such as cp1252 or utf-16-le.")
@click.option("--header-line", type=click.IntRange(0, 2000), help="CSV: line number of the column names; 0 if "
    "there is no such line.")
@click.option("--units-line", type=click.IntRange(0, 2000), help="CSV: line number of the units; 0 if there is no "
    "such line.")
@click.option(
    "--accept", multiple=True, metavar="CODE",
    help="Accept implausible magnitudes reported with this code: units-time, units-displacement, units-force, "
    "sample-rate.",
)
@click.option("--dry-run", is_flag=True, help="Read, check and show the data, but write no files.")
@click.option("--current", type=QuantityOption("current"), help="Coil current for all files, such as '0.5 A'.")
@click.option(
    "--current-from-name", metavar="REGEX",
    help="Regular expression that extracts the current from the file name, in a group named `current` (A).",
)
@click.option(
    "--waveform", type=click.Choice((*WAVEFORM_NAMES, "random")), default=SINE.name, show_default=True,
    help="Waveform for all files; random: motion without cycles.",
)
@click.option(
    "--ampere-per-volt", type=click.FloatRange(0.0, 100.0, min_open=True), default=1.0, show_default=True,
    help="Commanded driver current (A) per volt in the `voltage` column.",
)
@click.option(
    "--positive", type=click.Choice(get_args(Positive)), default="rebound", show_default=True,
    help="Direction in which displacement and force are positive in the files, after --scale has been applied. "
        "With compression, the signs of both are inverted.",
)
@click.option("--details", type=click.Path(path_type=Path), metavar="FILE",
              help="TOML file with a [display] table (units, signs) and a [report] table (customer, ...) for all "
                  "reports of the run.")
@click.option("--date", metavar="DATE",
              help="Date of the tests, such as 2026-03-05 or '2026-03-05 14:30' (local time), for the report and the "
                  "lists of runs.")
@click.option("--specimen", default="imported", show_default=True, help="Serial number of the damper.")
@click.option("--mid-stroke", type=QuantityOption("length"), help="Value of the displacement column at mid-stroke.")
@out_option
@json_option
@click.pass_context
def command(
    ctx: click.Context, /, files: tuple[Path, ...], like: Path | None, specimen: str, date: str | None,
    details: Path | None, dry_run: bool, out: Path, as_json: bool, **options: Any,  # noqa: ANN401 - one for each field of the import's settings
) -> int:
    """Convert FILES (CSV, LVM, Excel, MATLAB, HDF5, MF4, TDMS, RPC III) to a run; if one fails, none are converted.

    The layout of a CSV file (separators, encoding, header lines, time stamps) is detected and shown; options override
    the detected layout. Without --column, the command lists the file's columns. `rig identify` and `rig report` treat
    an imported run like a recorded one.
    """
    from rig.recording.imported_signs import convention, doubtful_signs, signed_loops
    from rig.recording.importing import Described, details_files, read_like, write_run
    from rig.recording.motion_parts import every_part
    from rig.recording.tested_on import tested_on

    given = _given(ctx, options)
    if details is not None:
        details_files(details)  # a wrong entry is reported before the files are read
    if date is not None:
        tested_on(date)  # the same
    try:
        with status_line(console(as_json=True), f"reading {len(files)} file{'s' * (len(files) > 1)}"):
            tests, preset, differences = read_like(files, given, like)
    except FileProblem as problem:
        return _show_columns(files, options, problem, listed=not as_json and like is None and "columns" not in given)
    positive = preset.settings.positive
    doubts = doubtful_signs(signed_loops(tests, preset.waveform), positive)
    if not as_json:
        _show_how_read(tests)
        console().print(convention(positive), markup=False, soft_wrap=True)
    for text in doubts:
        console(as_json=as_json).print(f"warning: {text}", style="yellow", markup=False, soft_wrap=True)
    for text in differences if not as_json else ():
        console().print(f"differs from {preset.run}: {text}", style="yellow", markup=False, soft_wrap=True)
    compared: dict[str, object] = {"positive": positive, "warnings": doubts}
    if like is not None:
        compared["like"] = {"run": preset.run, "differences": differences}
    if dry_run:
        parts = every_part(tests, preset.waveform)
        for part in parts if not as_json else ():
            end_s = float(part.test.time_s[-1])
            motion = f", motion {part.number} of {part.count}" if part.number else ""
            named = f", {part.test.part}" if part.test.part else ""
            say(f"{part.test.source}{named}{motion}: {part.start_s:.4g} to {part.start_s + end_s:.4g} s, "
                f"{len(part.test.time_s)} rows, {round(part.test.nominal_current_A, 3) + 0.0:.4g} A")
        if as_json:
            listed = [{"file": part.test.source, "part": part.test.part, "read_as": part.test.read_as,
                       "rows": len(part.test.time_s), "current_A": part.test.nominal_current_A,
                       "motion": part.number or None, "start_s": part.start_s} for part in parts]  # fmt: skip
            write_json({"campaign": None, "points": listed, "total": len(parts), **compared})
        return EXIT_DONE
    described = Described.of(preset, specimen, differences, details, date)
    with status_line(console(as_json=True), f"checking and writing {len(tests)} test{'s' * (len(tests) > 1)}"):
        folder = write_run(tests, out, described)
    return _show(folder, as_json, compared)


def _show_how_read(tests: Sequence[ImportedTest]) -> None:
    """One line for each way in which files were read, with the files, and under it the columns."""
    # loads h5py: not needed for the help
    from rig.recording.external_tests import named_files

    groups: dict[str, dict[str, Path]] = {}
    for test in tests:
        groups.setdefault(SHEET.sub("sheet ...", test.read_as), {})[test.read_as + str(test.source)] = test.source
    count = len({test.source for test in tests})
    for read_as, ways in groups.items():
        files = dict.fromkeys(ways.values())
        where = f"all {count} files" if len(files) == count > 1 else named_files([*files])
        sheets = {named[0] for way in ways if (named := SHEET.search(way))}
        shown = f"{len(sheets)} sheets" if len(sheets) > 1 else next(iter(sheets), "")
        dialect, *columns = read_as.replace("sheet ...", shown, 1).split("; ")
        console().print("\n  ".join((f"{where}: {dialect}", *columns)), markup=False, soft_wrap=True)


def _given(ctx: click.Context, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that the user specified, by the names of the import's settings."""
    given = {FIELDS.get(name, name): value for name, value in options.items()
             if ctx.get_parameter_source(name) not in {None, ParameterSource.DEFAULT}}  # fmt: skip
    if "thousands" in given:
        given["thousands"] = {"space": " ", "none": ""}.get(given["thousands"], given["thousands"])
    return given


def _show_columns(files: Sequence[Path], options: Mapping[str, Any], problem: FileProblem, *, listed: bool) -> int:
    """List the columns of the first file and the next command, if no columns were specified and these are missing.

    Raises:
        FileProblem: the problem that was given, if it is another one or nothing is to be listed.
    """
    # load h5py: not needed for the help
    from rig.recording.external_tests import NO_TIME, column_lists, current_hint
    from rig.recording.file_formats.columns import no_column
    from rig.recording.file_formats.table_file import Dialect

    absent = (no_column("displacement"), no_column("force"))
    if not listed or not any(text in line for text in absent for line in problem.problems):
        raise problem
    stated = {name: options[name] for name in vars(Dialect()) if options.get(name) is not None}
    shown = console()
    # of several sheets the one that most resembles a test
    title, columns, hints, doubt = max(column_lists(files[0], Dialect(**stated)), key=lambda listed: len(listed[2]))
    shown.print(f"{files[0]}{title}; its columns:", markup=False, soft_wrap=True)
    width = max(len(name) for name, _ in columns)
    for number, (name, unit) in enumerate(columns, 1):
        shown.print(f"  #{number:<4} {name:<{width}}  {unit or 'no unit: write NAME:UNIT'}", markup=False,
                    soft_wrap=True)
    if doubt and options.get("rate") is None:
        shown.print(doubt, markup=False, soft_wrap=True)
        if doubt != NO_TIME:  # no column helps
            shown.print("Nothing was imported.")
            return EXIT_USAGE
    chosen = [hints.get(quantity) or f"--column {quantity}=NAME" for quantity in ("time", "displacement", "force")]
    chosen.append(hints.get("current") or current_hint(files))
    sheets = [stated["sheet"]] if isinstance(stated.get("sheet"), str) else stated.get("sheet", ())
    chosen += [f"--sheet {shlex.quote(sheet)}" for sheet in sheets]
    shown.print(f"Nothing was imported. Specify the columns:\n  rig import {_as_typed(files)} {' '.join(chosen)}",
                markup=False, soft_wrap=True)
    return EXIT_USAGE


def _as_typed(files: Sequence[Path]) -> str:
    """The files for a shell: as a pattern, if one matches exactly these and they are more than three."""
    folder, suffix = files[0].parent, files[0].suffix
    if len(files) > 3 and {*files} == {*folder.glob(f"*{suffix}")}:
        return f"{shlex.quote(str(folder))}/*{suffix}"
    # A name that begins with a dash would be an option.
    return shlex.join(f"./{file}" if str(file).startswith("-") else str(file) for file in files)


def _show(folder: Path, as_json: bool, compared: Mapping[str, object]) -> int:
    run = Run.open(folder)
    tables = _force_tables(run)
    valid = sum(point.verdict == "valid" for point in run.points)
    if as_json:
        points = [
            {"id": point.id, "file": point.path, "verdict": point.verdict, "reasons": point.reasons,
             "amplitude_m": point.amplitude_m, "frequency_Hz": point.frequency_Hz, "current_A": point.current_A,
             "read_as": str(point.provenance.get("read_as", "")), "time_base": _values(point.quality.time),
             "record": _values(point.quality.record)}
            for point in run.points
        ]  # fmt: skip
        write_json({"campaign": folder.resolve(), "points": points, "valid": valid, "total": len(points),
                    "force_tables": [one.to_json() for one in tables], **compared})  # fmt: skip
    else:
        # load numba, pyserial and pydantic: not needed for the help
        from rig.cli.display import described
        from rig.cli.force_tables import force_blocks
        from rig.report.cover import terms_of

        shown = console()
        for point in run.points:
            text = described(point, run.display)
            line = f"{point.id:<23} {text:<31} {'; '.join((point.verdict, *point.reasons))}"
            shown.print(line, markup=False, soft_wrap=True)
            if point.quality.record is not None and (use := _use(point.quality.record)):
                shown.print(f"  {use}", markup=False, soft_wrap=True)
        if tables:
            shown.print()
            show(force_blocks(tables, run.display, terms_of(run)), shown)
            shown.print()
        say(shown_path(folder))
    return EXIT_DONE if valid == len(run.points) else EXIT_NOT_ALL_VALID


def _force_tables(run: Run) -> Sequence[ForceTable]:
    """Force over velocity of the loops; empty where nothing was measured that can be evaluated."""
    from rig.characteristics import characterise  # loads numba: not needed for the help

    try:
        return characterise(run).force_tables
    except RigError:  # `rig report` states it; the tests were imported all the same
        return ()


def _values(section: Section | None) -> dict[str, object] | None:
    """A section of a point's quality as JSON; None where there is none."""
    return None if section is None else dict(vars(section))


def _use(record: RecordQuality) -> str:
    """How much of a record a test uses; empty where it is nearly all that moves."""
    record_s, used_s, other_s = record.record_s or 0.0, record.used_s or 0.0, record.other_s or 0.0
    if not record.motions and other_s <= OTHER_SHARE * record_s:
        return ""
    part = f"motion {record.motion} of {record.motions}, " if record.motions else ""
    others = f": {record.other_motions}" if record.other_motions and record.motion == 1 else ""
    return (
        f"{part}used {used_s:.3g} of {record_s:.3g} s ({100.0 * used_s / record_s:.0f} %), "
        f"rest {record.rest_s or 0.0:.3g} s, ramps or other motions {other_s:.3g} s{others}"
    )
