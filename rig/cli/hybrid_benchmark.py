"""`rig benchmark`: the published benchmark of real-time hybrid simulation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rig.cli.options import Command, json_option
from rig.cli.output import console, say, show, write_json
from rig.document.blocks import Block, Column, Head, Paragraph, Row, table
from rig.errors import EXIT_DONE, EXIT_REFUSED
from rig.hybrid.published import CRITERIA

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rig.hybrid.benchmark import Result
    from rig.hybrid.earthquake import Earthquake

    Outcome = tuple[list[Result], dict[str, Any]]
    """Results, and how they came about: plants, steps of latency, and on wires how the steps went."""

RATES = ("4096", "1024", "250")
NAMES = ("none", "sample", "polynomial", "inverse", "ats", "adaptive-model")
PLANTS, PLANTS_ON_WIRES = 20, 1
CASES = (1, 2, 3, 4)
SEED = 2020
DESCRIPTION = (
    "J1: delay of the specimen relative to the target, in ms. RMS in %: J2 tracking; J4, J6, J7 floors 1, 2, 3.",
    "Peak in %: J3 tracking; J5, J8, J9 floors 1, 2, 3. The floors are compared with those of the complete building.",
    "Each value is the mean over all plants. Published values: Silva et al. 2020, Table 3, El Centro x 0.4, "
    "nominal plant.",
)


@click.command(
    name="benchmark",
    cls=Command,
    examples=(
        "rig benchmark --rate 250",
        "rig benchmark --case 1 --earthquake el-centro.csv --json",
        "rig benchmark --wires --plants 5",
    ),
)
@click.option("--case", "cases", type=click.IntRange(1, 4), multiple=True, help="Building case of the benchmark.  "
    "[default: all four]")
@click.option(
    "--rate", "rates", type=click.Choice(RATES), multiple=True, help="Integration steps per second.  [default: all "
    "rates]"
)
@click.option(
    "--compensator",
    "compensators",
    type=click.Choice(NAMES),
    multiple=True,
    help="Delay compensator.  [default: all]",
)
@click.option(
    "--plants", type=click.IntRange(1, 1000), help="Number of perturbed plants per case.  [default: 20; with --wires: "
    "1]"
)
@click.option("--seed", type=click.IntRange(0), default=SEED, show_default=True, help="Random seed for plants and "
    "noise.")
@click.option("--wires", is_flag=True, help="Run in real time at 250 Hz over Modbus TCP to a simulated rig.")
@click.option(
    "--earthquake",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="Your own earthquake record: one line per sample, with time (s) and acceleration (m/s^2).  [default: a "
    "synthesised record]",
)
@click.option(
    "--intensity",
    type=click.FloatRange(0.0, 100.0, min_open=True),
    default=0.4,
    show_default=True,
    help="Scale factor for your earthquake record.",
)
@click.option(
    "--latency-steps",
    type=click.IntRange(0, 20),
    default=0,
    show_default=True,
    help="Number of steps between a measurement and the arrival of the command based on that measurement.",
)
@json_option
def command(seed: int, as_json: bool, **options: Any) -> int:  # noqa: ANN401 - click's, by their names
    """Run the real-time hybrid simulation benchmark of Silva et al. (2020).

    Criteria J1 to J9 for six delay compensators are shown next to the published values. The exit code is 3 if this
    program's own compensator (adaptive-model) does not meet its targets.

    Without --wires, the benchmark runs in a single process. With --wires, the benchmark controls a simulated rig over
    Modbus TCP. Each plant and compensator then takes 45 s, and the default compensator is adaptive-model.
    """
    return _benchmark(BenchmarkOptions(**options), seed, as_json=as_json)


class BenchmarkOptions(NamedTuple):
    """What is asked of the benchmark, by the names of the options."""

    cases: tuple[int, ...]
    rates: tuple[str, ...]
    compensators: tuple[str, ...]
    plants: int | None
    wires: bool
    earthquake: Path | None
    intensity: float
    latency_steps: int


def _benchmark(options: BenchmarkOptions, seed: int, *, as_json: bool) -> int:
    # loads numpy: not needed for the help
    from rig.hybrid.earthquake import read, synthesised

    motion = synthesised() if options.earthquake is None else read(options.earthquake, options.intensity)
    results, how = (_on_wires if options.wires else _in_process)(options, motion, seed, as_json)
    code = EXIT_REFUSED if any(result.refused for result in results) else EXIT_DONE
    if as_json:
        answer = {"benchmark": "Silva et al. 2020", "earthquake": motion.name, "seed": seed, **how}
        write_json({**answer, "results": [_plain(result) for result in results], "exit_code": code})
        return code
    _show(results, motion.name)
    if (wires := how["wires"]) is not None:
        priority = "" if wires["real_time"] else ", without real-time priority"
        say(f"{wires['late_steps']} of {wires['steps']} steps late; 99 % within {wires['p99_step_ms']:.2g} ms, worst "
            f"{wires['worst_step_ms']:.2g} ms{priority}")  # fmt: skip
    return code


def _in_process(options: BenchmarkOptions, motion: Earthquake, seed: int, as_json: bool) -> Outcome:
    # loads numba and numpy: not needed for the help
    from rig.hybrid.benchmark import run_benchmark

    problems = [(case, int(rate)) for case in options.cases or CASES for rate in options.rates or RATES]
    plants, latency = options.plants or PLANTS, options.latency_steps
    results = run_benchmark(problems, options.compensators or NAMES, motion, plants, seed, latency)
    return _shown(results, as_json), {"plants": plants, "latency_steps": latency, "wires": None}


def _on_wires(options: BenchmarkOptions, motion: Earthquake, seed: int, as_json: bool) -> Outcome:
    """As `_in_process`.

    Raises:
        UsageError: another rate or latency than that of the wires.
    """
    if set(options.rates) - {"250"} or options.latency_steps:
        raise click.UsageError("--wires runs 250 steps per second and measures the latency. Fix: omit --rate and "
                               "--latency-steps")  # fmt: skip
    # loads numba and numpy: not needed for the help
    from rig.campaign.wired_benchmark import LATENCY_STEPS, Wires
    from rig.station.process import real_time_priority

    problem, wires, plants = real_time_priority(True), Wires(), options.plants or PLANTS_ON_WIRES
    compensators = options.compensators or NAMES[-1:]
    results = _shown(wires.results(options.cases or CASES, compensators, motion, plants, seed), as_json)
    went = {**wires.count.to_json(), "real_time": problem is None}
    return results, {"plants": plants, "latency_steps": LATENCY_STEPS, "wires": went}


def _shown(results: Iterator[Result], as_json: bool) -> list[Result]:
    """All of them; where the answer is no JSON each is told as it comes."""
    kept: list[Result] = []
    for result in results:
        kept.append(result)
        if not as_json:
            say(f"case {result.case}, {result.rate_Hz} Hz, {result.compensator}: done", err=True)
    return kept


def _plain(result: Result) -> dict[str, Any]:
    return {
        "case": result.case, "rate_Hz": result.rate_Hz, "compensator": result.compensator, "plants": result.plants,
        "criteria": result.criteria, "worst": result.worst, "published": result.published,
        "required": result.required, "asked": result.required,
        "stopped": result.stopped, "first_stop_s": result.first_stop_s, "verdict": result.verdict,
        "critical_delay_ms": result.critical_delay_ms,
    }  # fmt: skip


def _show(results: list[Result], earthquake: str) -> None:
    head: list[Head] = ["case", "Hz", "compensator", *(Column(name, "", True) for name in CRITERIA), "verdict"]
    rows = []
    for result in results:
        named = (str(result.case), str(result.rate_Hz), result.compensator)
        rows.append(Row((*named, *_cells(result.criteria), _verdict(result))))
        if result.published:
            rows.append(Row(("", "", "  published", *_cells(result.published), ""), faded=True))
    delays = {result.case: f"{result.critical_delay_ms:.1f} ms (case {result.case})" for result in results}
    blocks: list[Block] = [
        table(head, rows, title=f"Earthquake: {earthquake}"),
        Paragraph(f"The test becomes unstable if the specimen's force is delayed by {', '.join(delays.values())}."),
        *(Paragraph(line) for line in DESCRIPTION),
    ]
    show(blocks, console())


def _cells(values: dict[str, float]) -> list[str]:
    return [f"{values[name]:.1f}" if name in values else "" for name in CRITERIA]


def _verdict(result: Result) -> str:
    if result.stopped:
        return f"unstable in {result.stopped} of {result.plants} plants, first after {result.first_stop_s:.1f} s"
    limits = ", ".join(f"{name} {result.criteria[name]:.1f} of {limit:g} %" for name, limit in result.required.items())
    return f"{result.verdict}: {limits}" if limits else ""
