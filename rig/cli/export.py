"""`rig export`: a run or a fit in another program's format."""

from __future__ import annotations

from pathlib import Path

import click

from rig.cli.options import Command, RunPath, json_option
from rig.cli.output import say, shown_path, write_json
from rig.errors import EXIT_DONE


class ExportCommand(Command):
    """`rig export`; its help lists the formats of the exporters, which only this help loads."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The options, and the formats."""
        # loads numpy: not needed for the help
        from rig.export.exporter import OWN

        super().format_options(ctx, formatter)
        for takes in ("run", "fit"):
            with formatter.section(f"Formats of a {takes}"):
                formatter.write_dl([(one.name, one.line) for one in OWN if one.takes == takes])


@click.command(
    name="export", cls=ExportCommand,
    examples=(
        "rig export logs/20260102T030405Z-MR-001-ab12cd --to csv --out tables",
        "rig export logs/20260102T030405Z-MR-001-ab12cd/fit.json --to json --out values",
        "rig export logs/20260102T030405Z-MR-001-ab12cd/fit.json --to c --out my-simulation",
    ),
)
@click.argument("source", type=RunPath())
@click.option(
    "--to", "name", required=True, metavar="NAME",
    help="Output format: one of the formats listed below, or a format provided by a plug-in.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), required=True,
    help="Folder for the files; created if it does not exist.",
)  # fmt: skip
@json_option
def command(source: Path, name: str, out: Path, as_json: bool) -> int:
    """Write SOURCE (a campaign folder or a fit.json file) in another format.

    With c, modelica, octave (matlab) or python, the fitted model is written as source code; with fmi (simulink), as an
    FMU 2.0 for co-simulation; with table, as a table of force vs. speed and current. With svg or png, each figure of
    the report is written to a separate file.

    `rig plugins` lists the formats that other packages provide.
    """
    # loads numpy: not needed for the help
    from rig.export import EXPORTERS, export

    files = [path.resolve() for path in export(source, name, out)]
    if as_json:
        write_json({
            "source": str(source.resolve()), "to": name, "files": [str(path) for path in files],
            "remark": EXPORTERS[name].remark or None,
        })  # fmt: skip
    else:
        for path in files:
            say(shown_path(path))
        if EXPORTERS[name].remark:
            say(EXPORTERS[name].remark)
    return EXIT_DONE
