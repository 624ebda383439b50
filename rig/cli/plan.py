"""`rig plan`: every point with its verdict."""

from __future__ import annotations

from pathlib import Path

import click

from rig.cli.output import Command, console, json_option, write_json
from rig.clock import utc_now
from rig.errors import EXIT_DONE, EXIT_REFUSED


@click.command(
    name="plan",
    cls=Command,
    examples=("rig plan examples/table1.toml --bench examples/demo-bench.toml",),
)
@click.argument("matrix", type=click.Path(path_type=Path))
@click.option("--bench", type=click.Path(path_type=Path), required=True, help="Bench file of the rig.")
@json_option
def command(matrix: Path, bench: Path, as_json: bool) -> int:
    """Judge every point of MATRIX on a bench; exit 3 if any cannot be done, with what would fit."""
    from rig.cli.analysis_check import check_analysis
    from rig.cli.tables import plan_table
    from rig.matrix.files import load_files
    from rig.matrix.plan import plan

    tests, loaded = load_files(matrix, bench)
    check_analysis(matrix, tests)
    result = plan(tests, loaded)
    overdue = [f"the calibration of {name} is overdue" for name in loaded.overdue(utc_now().date())]
    if as_json:
        write_json({**result.to_json(), "warnings": overdue})
    else:
        shown = console()
        for part in plan_table(result):
            shown.print(part)
        for text in overdue:
            shown.print(f"warning: {text}", style="yellow")
    return EXIT_DONE if result.feasible else EXIT_REFUSED
