"""`rig plan`: every point with its verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.campaign_folder import LOGS
from rig.cli.junit import junit_option, junit_report, take_plan
from rig.cli.options import Command, json_option
from rig.cli.output import console, write_json
from rig.clock import utc_now
from rig.errors import EXIT_DONE, EXIT_REFUSED

if TYPE_CHECKING:
    from rig.bench.model import Bench
    from rig.matrix.model import Matrix
    from rig.matrix.plan import Plan


def planned(matrix: Path, bench: Path, out: Path = LOGS) -> tuple[Plan, Matrix, Bench]:
    """The plan of a matrix file on a bench, and what both files contain.

    Args:
        matrix: the matrix file.
        bench: the bench file.
        out: folder in which the run would be created; the disk space of an endurance test is checked there.

    Raises:
        FileProblem: a file cannot be used, or what is to be identified cannot be.
        Refused: the bench does not meet a requirement of the matrix, or the disk is too small for an endurance test.
    """
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.setup import check_requirements, check_room
    from rig.cli.analysis_check import check_analysis, check_specimen
    from rig.matrix.model import load_files
    from rig.matrix.plan import plan

    tests, loaded = load_files(matrix, bench)
    check_analysis(matrix, tests)
    check_specimen(matrix, tests)
    check_requirements(loaded, tests)
    overdue = tuple(f"the calibration of {name} is overdue" for name in loaded.overdue(utc_now().date()))
    result = plan(tests, loaded)
    if tests.endurance:
        folder = next(place for place in (out.absolute(), *out.absolute().parents) if place.is_dir())
        check_room(folder, result, loaded, tests)
    return replace(result, warnings=(*result.warnings, *overdue)), tests, loaded


@click.command(
    name="plan",
    cls=Command,
    examples=(
        "rig plan examples/table1.toml --bench examples/demo-bench.toml",
        "rig plan long.toml --bench my-bench.toml --all | less",
    ),
)
@click.argument("matrix", type=click.Path(path_type=Path))
@click.option("--bench", type=click.Path(path_type=Path), required=True, help="Bench file of the rig.")
@click.option(
    "--all", "everything", is_flag=True,
    help="Show every point. By default, long plans are summarised by group.",
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default=LOGS, show_default=True,
    help="Folder in which the run would be created; the disk space for endurance tests is checked there.",
)
@junit_option
@json_option
def command(matrix: Path, bench: Path, everything: bool, out: Path, junit: Path | None, as_json: bool) -> int:
    """Check every point of MATRIX against the limits of a bench, without connecting to any device.

    For each point outside the limits, the output shows the reasons and the largest amplitude within the limits; the
    exit code is then 3. The exit code is also 3 if the bench does not meet a requirement of the matrix, as with `rig
    run`.
    """
    # loads numpy: not needed for the help
    from rig.cli.tables import PlanText

    with junit_report(junit, "plan", matrix=matrix, bench=bench) as report:
        result = planned(matrix, bench, out)[0]
        take_plan(report, result)
    if as_json:
        write_json(result.to_json())
    else:
        console().print(PlanText(result, everything))
    return EXIT_DONE if result.feasible else EXIT_REFUSED
