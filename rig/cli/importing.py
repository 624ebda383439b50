"""`rig import`: tests from elsewhere become a run of ours."""

from __future__ import annotations

from pathlib import Path

import click

from rig.cli.options import Command, QuantityOption, json_option, out_option
from rig.cli.output import console, say, write_json
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID
from rig.signals.waveform import SINE, WAVEFORM_NAMES


def _pairs(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    """`quantity=column` options as a mapping.

    Raises:
        BadParameter: not of that shape, or a quantity named twice.
    """
    pairs: dict[str, str] = {}
    for text in value:
        quantity, equals, column = text.partition("=")
        if not (quantity and equals and column):
            raise click.BadParameter(f"{text!r} is not of the form displacement=x_m", ctx, param)
        if quantity in pairs:
            raise click.BadParameter(f"{quantity} is given twice", ctx, param)
        pairs[quantity] = column
    return pairs


@click.command(
    name="import",
    cls=Command,
    examples=(
        "rig import tests/*.csv --column time=t_s --column displacement=x_m --column force=force_N \\",
        "    --current-from-name '_(?P<current>[0-9.]+)A'",
        "rig import loop.csv --column time=t:ms --column displacement=x:mm --column force=F:kN --current '0.5 A'",
    ),
)
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "--column",
    "columns",
    multiple=True,
    callback=_pairs,
    metavar="QUANTITY=COLUMN",
    help="Column of time, displacement, force, current (measured) or commanded_current; unit as a suffix (x_mm) or "
    "after a colon (x:mm).",
)
@click.option("--current", type=QuantityOption("current"), help="Coil current of all files, such as '0.5 A'.")
@click.option(
    "--current-from-name", metavar="REGEX",
    help="Regular expression for the file name with a group `current` (A).",
)
@click.option(
    "--waveform", type=click.Choice(WAVEFORM_NAMES), default=SINE.name, show_default=True, help="Waveform of all files."
)
@click.option("--specimen", default="imported", show_default=True, help="Serial number of the damper.")
@click.option("--mid-stroke", type=QuantityOption("length"), help="Mid-stroke position in the displacement column.")
@out_option
@json_option
def command(
    files: tuple[Path, ...],
    columns: dict[str, str],
    current: float | None,
    current_from_name: str | None,
    waveform: str,
    specimen: str,
    mid_stroke: float | None,
    out: Path,
    as_json: bool,
) -> int:
    """Convert CSV FILES to a run, one test per file; if one file is unusable, nothing is written.

    `rig identify` and `rig report` take the run like a recorded one.
    """
    from rig.recording.importing import import_tests
    from rig.recording.run import Run

    folder = import_tests(
        files,
        columns=columns,
        out=out,
        current_A=current,
        current_from_name=current_from_name,
        waveform=waveform,
        specimen=specimen,
        mid_stroke_m=mid_stroke,
    )
    run = Run.open(folder)
    valid = sum(point.verdict == "valid" for point in run.points)
    if as_json:
        points = [
            {"id": point.id, "file": point.path, "verdict": point.verdict, "reasons": point.reasons,
             "amplitude_m": point.amplitude_m, "frequency_Hz": point.frequency_Hz, "current_A": point.current_A}
            for point in run.points
        ]  # fmt: skip
        write_json({"campaign": folder.resolve(), "points": points, "valid": valid, "total": len(points)})
    else:
        from rig.cli.display import describe

        shown = console()
        for point in run.points:
            text = describe(point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A)
            line = f"{point.id:<24}{text:<32}{'; '.join((point.verdict, *point.reasons))}"
            shown.print(line, markup=False)
        say(folder.resolve())
    return EXIT_DONE if valid == len(run.points) else EXIT_NOT_ALL_VALID
