"""`rig hybrid --benchmark`: the published benchmark of hybrid tests, in process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.cli.options import Command, json_option
from rig.cli.output import console, say, write_json
from rig.errors import EXIT_DONE, EXIT_REFUSED

if TYPE_CHECKING:
    from rig.hybrid.benchmark import Result

RATES = ("4096", "1024", "250")
NAMES = ("none", "sample", "polynomial", "inverse", "ats", "adaptive-model")
SEED = 2020
DESCRIPTION = (
    "J1: delay of the specimen behind its target, ms. RMS in %: J2 tracking; J4, J6, J7 floors 1, 2, 3.",
    "Peak in %: J3 tracking; J5, J8, J9 floors 1, 2, 3. The floors are compared with the whole building's.",
    "Means over the plants. Published: Silva et al. 2020, Table 3, El Centro x 0.4, nominal plant.",
)


@click.command(
    name="hybrid",
    cls=Command,
    examples=("rig hybrid --benchmark --rate 250", "rig hybrid --benchmark --case 1 --earthquake el-centro.csv --json"),
)
@click.option(
    "--benchmark", is_flag=True, required=True, help="The benchmark problem of Silva et al. 2020, in process."
)
@click.option("--case", "cases", type=click.IntRange(1, 4), multiple=True, help="Building case.  [default: all four]")
@click.option("--rate", "rates", type=click.Choice(RATES), multiple=True, help="Steps a second.  [default: all three]")
@click.option(
    "--compensator",
    "compensators",
    type=click.Choice(NAMES),
    multiple=True,
    help="What compensates the delay.  [default: all]",
)
@click.option("--plants", type=click.IntRange(1, 1000), default=20, show_default=True, help="Perturbed plants a case.")
@click.option("--seed", type=click.IntRange(0), default=SEED, show_default=True, help="Of plants and noise.")
@click.option(
    "--earthquake",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="Your record: lines of time (s) and acceleration (m/s^2).  [default: synthesised]",
)
@click.option(
    "--intensity",
    type=click.FloatRange(0.0, 100.0, min_open=True),
    default=0.4,
    show_default=True,
    help="Factor on your record.",
)
@click.option(
    "--latency-steps",
    type=click.IntRange(0, 20),
    default=0,
    show_default=True,
    help="Steps from a measurement to the arrival of the command that follows from it.",
)
@json_option
def command(
    benchmark: bool, cases: tuple[int, ...], rates: tuple[str, ...], compensators: tuple[str, ...], plants: int,
    seed: int, earthquake: Path | None, intensity: float, latency_steps: int, as_json: bool,
) -> int:  # fmt: skip
    """Run the published benchmark of real-time hybrid tests: criteria J1 to J9 beside the published ones.

    Exit code 3 when what is asked of this program's own compensator (adaptive-model) is not reached.
    """
    del benchmark
    from rig.hybrid.benchmark import run_benchmark
    from rig.hybrid.earthquake import read, synthesised

    motion = synthesised() if earthquake is None else read(earthquake, intensity)
    problems = [(case, int(rate)) for case in cases or (1, 2, 3, 4) for rate in rates or RATES]
    results: list[Result] = []
    for result in run_benchmark(problems, compensators or NAMES, motion, plants, seed, latency_steps):
        results.append(result)
        if not as_json:
            say(f"case {result.case}, {result.rate_Hz} Hz, {result.compensator}: done", err=True)
    refused = [result for result in results if result.refused]
    code = EXIT_REFUSED if refused else EXIT_DONE
    if as_json:
        answer = {"benchmark": "Silva et al. 2020", "earthquake": motion.name, "seed": seed, "plants": plants}
        answer["latency_steps"] = latency_steps
        write_json({**answer, "results": [_plain(result) for result in results], "exit_code": code})
    else:
        _show(results, motion.name)
    return code


def _plain(result: Result) -> dict[str, Any]:
    return {
        "case": result.case, "rate_Hz": result.rate_Hz, "compensator": result.compensator, "plants": result.plants,
        "criteria": result.criteria, "worst": result.worst, "published": result.published, "asked": result.asked,
        "stopped": result.stopped, "first_stop_s": result.first_stop_s, "verdict": result.verdict,
        "critical_delay_ms": result.critical_delay_ms,
    }  # fmt: skip


def _show(results: list[Result], earthquake: str) -> None:
    from rich.table import Table

    from rig.hybrid.published import CRITERIA

    table = Table(title=f"earthquake: {earthquake}", title_justify="left")
    for heading in ("case", "Hz", "compensator"):
        table.add_column(heading, no_wrap=True)
    for heading in CRITERIA:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict")
    for result in results:
        row = [str(result.case), str(result.rate_Hz), result.compensator]
        table.add_row(*row, *_cells(result.criteria), _said(result))
        if result.published:
            table.add_row("", "", "  published", *_cells(result.published), "", style="dim")
    shown = console()
    shown.print(table)
    delays = {result.case: f"{result.critical_delay_ms:.1f} ms (case {result.case})" for result in results}
    shown.print(f"unstable where the specimen's force is late by {', '.join(delays.values())}")
    for line in DESCRIPTION:
        shown.print(line)


def _cells(values: dict[str, float]) -> list[str]:
    from rig.hybrid.published import CRITERIA

    return [f"{values[name]:.1f}" if name in values else "" for name in CRITERIA]


def _said(result: Result) -> str:
    if result.stopped:
        return f"unstable: {result.stopped} of {result.plants}, from {result.first_stop_s:.1f} s"
    limits = ", ".join(f"{name} {result.criteria[name]:.1f} of {limit:g} %" for name, limit in result.asked.items())
    return f"{result.verdict}: {limits}" if limits else ""
