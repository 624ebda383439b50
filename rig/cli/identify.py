"""`rig identify`: a damper model fitted to recorded or imported runs."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rig.cli.output import Command, console, json_option, write_json
from rig.errors import EXIT_DONE


@click.command(
    name="identify",
    cls=Command,
    examples=(
        "rig identify logs/20260102T030405Z-MR-001-ab12cd",
        "rig identify SINE_RUN --holdout TRIANGLE_RUN --json",
        "rig identify RUN --model all --holdout frequency_Hz=2",
    ),
)
@click.argument("runs", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--model", default="asymmetric", show_default=True, help="Damper model, or `all` to let the data choose.")
@click.option("--method", default="separable", show_default=True, help="Identification method.")
@click.option("--holdout", help="What the fit must not see and is scored on: a run, or a filter (waveform=triangle).")
@click.option(
    "--weight", type=click.Choice(["1", "v"]), default="1", show_default=True,
    help="Weight of a residual: 1, or the speed as in the paper's objective.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of methods that draw lots.")
@click.option("--budget", type=click.IntRange(1), help="Most evaluations of the objective (methods that search).")
@json_option
def command(
    runs: tuple[Path, ...],
    model: str,
    method: str,
    holdout: str | None,
    weight: str,
    seed: int,
    budget: int | None,
    as_json: bool,
) -> int:
    """Fit a damper model to RUNS (campaign directories) and write fit.json into the first.

    Says what the data cannot identify instead of guessing it; exit 6 when nothing can be fitted.
    """
    from rig.identification import identify_run

    fit = identify_run(runs, model=model, method=method, holdout=holdout, weight=weight, seed=seed, budget=budget)
    found = fit.to_json()
    if as_json:
        write_json(found)
        return EXIT_DONE
    from rig.cli.tables import fit_tables

    shown = console()
    for part in fit_tables(json.loads(json.dumps(found))):
        shown.print(part)
    click.echo((runs[0] / "fit.json").resolve())
    return EXIT_DONE
