"""A hybrid test from the command line: its file checked, run as a campaign, its numbers shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rig.cli.output import console, write_json

if TYPE_CHECKING:
    from rich.console import Console

    from rig.cli.job import JobResult

FOLLOWS = ("--actuator", "setpoints")
"""The simulated rig's controller without a function generator."""


class Asked(NamedTuple):
    """What is asked for on the command line."""

    file: Path
    bench: Path | None
    simulate: bool
    seed: int | None
    simulator_args: tuple[str, ...]
    out: Path


def run_hybrid(asked: Asked, *, as_json: bool) -> int:
    """Run the tests of a file; the exit code is the campaign's.

    Raises:
        UsageError: there is no rig, or there are arguments for a simulated one where there is none.
        FileProblem: the file cannot be used, or has no `[hybrid]`.
        RigError: as `rig run`.
    """
    if asked.bench is None and not asked.simulate:
        raise click.UsageError("give --bench FILE, or --simulate")
    if not asked.simulate and (asked.simulator_args or asked.seed is not None):
        raise click.UsageError("--seed and arguments after -- belong to the simulated rig: give --simulate")
    from rig.campaign.results import CampaignOptions
    from rig.cli.job import run_job
    from rig.errors import FileProblem
    from rig.matrix.model import load_files, load_matrix

    matrix = load_matrix(asked.file) if asked.bench is None else load_files(asked.file, asked.bench)[0]
    if matrix.hybrid is None:
        text = "has no table [hybrid], which says what car and road the damper is tested in; docs/files.md describes it"
        raise FileProblem(str(asked.file), [text])
    bench, simulator_args = _rig(asked)
    shown = console(as_json=as_json)
    options = CampaignOptions(
        matrix_path=asked.file, out=asked.out, bench_path=bench, simulate=asked.simulate, speed=1.0,
        seed=asked.seed or 0, simulator_args=simulator_args,
    )
    result = run_job(options, None, shown)
    found = _numbers(result)
    if as_json:
        write_json({**result.to_json(), **found})
    else:
        from rig.cli.run import show_result

        _show(found, shown)
        show_result(result, shown)
    return result.exit_code


def _rig(asked: Asked) -> tuple[Path | None, tuple[str, ...]]:
    """Bench file, and arguments of the simulated rig: with the devices of a bench file, or one that follows."""
    if not asked.simulate:
        return asked.bench, ()
    if asked.bench is None:
        return None, (*FOLLOWS, *asked.simulator_args)
    from rig.campaign.simulated_rig import wearing

    return None, (*wearing(asked.bench), *asked.simulator_args)


def _numbers(result: JobResult) -> dict[str, Any]:
    """What `hybrid.json` says; the same keys without values where there is none."""
    from rig.characteristics.hybrid_tests import FILE, answer

    path = Path(result.campaign.campaign) / FILE
    if not path.is_file():
        return answer(())
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _show(found: dict[str, Any], shown: Console) -> None:
    from rich.table import Table

    table = Table()
    for heading in ("compensation", "delay ms", "tracking %", "body to 3 Hz %", "energy error %", "late", "verdict"):
        table.add_column(heading, justify="left" if heading in {"compensation", "verdict"} else "right")
    for test in found["tests"]:
        shares = (100.0 * value if value is not None else None for value in (
            test["tracking_nrms"], test["reference_error"], test["energy_error"]
        ))  # fmt: skip
        cells = ["-" if value is None else f"{value:.3g}" for value in (test["delay_ms"], *shares)]
        late = "-" if test["late_steps"] is None else f"{test['late_steps']} of {test['steps']}"
        table.add_row(test["compensation"], *cells, late, test["verdict"])
    if found["tests"]:
        shown.print(table)
