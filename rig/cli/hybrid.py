"""`rig hybrid`: a hybrid test of the damper in a computed car; `--benchmark`: the published benchmark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rig.cli.options import Command, json_option, out_option
from rig.cli.output import console, say, write_json
from rig.errors import EXIT_DONE, EXIT_REFUSED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from rig.cli.job import JobResult
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
    "J1: delay of the specimen behind its target, ms. RMS in %: J2 tracking; J4, J6, J7 floors 1, 2, 3.",
    "Peak in %: J3 tracking; J5, J8, J9 floors 1, 2, 3. The floors are compared with the whole building's.",
    "Means over the plants. Published: Silva et al. 2020, Table 3, El Centro x 0.4, nominal plant.",
)


@click.command(
    name="hybrid",
    cls=Command,
    examples=(
        "rig hybrid examples/hybrid-quarter.toml --simulate",
        "rig hybrid my-hybrid.toml --bench my-bench.toml",
        "rig hybrid --benchmark --rate 250",
        "rig hybrid --benchmark --case 1 --earthquake el-centro.csv --json",
        "rig hybrid --benchmark --wires --plants 5",
    ),
)
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.argument("simulator_args", nargs=-1, type=click.UNPROCESSED, metavar="[-- SIMULATOR ARGS]")
@click.option("--bench", type=click.Path(path_type=Path), help="Bench file of the rig.")
@click.option("--simulate", is_flag=True, help="Start a simulated rig that follows set-points and test on it.")
@click.option("--seed", type=click.IntRange(0), help="Of the simulated rig; with --benchmark of plants and noise.")
@out_option
@click.option("--benchmark", is_flag=True, help="The benchmark problem of Silva et al. 2020.")
@click.option("--case", "cases", type=click.IntRange(1, 4), multiple=True, help="Building case.  [default: all four]")
@click.option("--rate", "rates", type=click.Choice(RATES), multiple=True, help="Steps a second.  [default: all three]")
@click.option(
    "--compensator",
    "compensators",
    type=click.Choice(NAMES),
    multiple=True,
    help="What compensates the delay.  [default: all]",
)
@click.option("--plants", type=click.IntRange(1, 1000), help="Perturbed plants a case.  [default: 20; with --wires 1]")
@click.option("--wires", is_flag=True, help="The benchmark through a simulated rig's Modbus, 250 Hz, in real time.")
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
    file: Path | None, simulator_args: tuple[str, ...], bench: Path | None, simulate: bool, seed: int | None,
    out: Path, benchmark: bool, as_json: bool, **of_benchmark: Any,  # noqa: ANN401 - click's, by their names
) -> int:  # fmt: skip
    """Test the damper in a computed car: FILE says which (a matrix file with [hybrid]), on a rig, real or simulated.

    The car is computed, the damper is moved as its corner of the car moves, and its measured force acts on the car. A
    campaign like any other: planned, recorded, reported, resumed with `rig run --resume`. Exit code 3 where the test
    would not be stable or the rig cannot do it; nothing moves then.

    With --benchmark: criteria J1 to J9 of the published benchmark beside the published ones. Exit code 3 when what is
    asked of this program's own compensator (adaptive-model) is not reached. All in process, or with --wires the plant
    behind Modbus TCP: 45 s for each plant and compensator (by default adaptive-model alone).
    """
    if benchmark:
        _without_a_rig(alone=file is None and bench is None and not simulate)
        return _benchmark(BenchmarkOptions(**of_benchmark), SEED if seed is None else seed, as_json=as_json)
    return run_hybrid(Asked(_given(file), bench, simulate, seed, simulator_args, out), as_json=as_json)


def _without_a_rig(*, alone: bool) -> None:
    """Refuse a benchmark with a rig.

    Raises:
        UsageError: a file or a rig is given.
    """
    if not alone:
        raise click.UsageError("--benchmark brings its own plant: leave FILE, --bench and --simulate out")


def _given(file: Path | None) -> Path:
    """The test's file.

    Raises:
        UsageError: there is none.
    """
    if file is None:
        raise click.UsageError("which test? rig hybrid FILE --bench BENCH, or --simulate; or rig hybrid --benchmark")
    return file


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


def _benchmark(asked: BenchmarkOptions, seed: int, *, as_json: bool) -> int:
    from rig.hybrid.earthquake import read, synthesised

    motion = synthesised() if asked.earthquake is None else read(asked.earthquake, asked.intensity)
    results, how = (_on_wires if asked.wires else _in_process)(asked, motion, seed, as_json)
    code = EXIT_REFUSED if any(result.refused for result in results) else EXIT_DONE
    if as_json:
        answer = {"benchmark": "Silva et al. 2020", "earthquake": motion.name, "seed": seed, **how}
        write_json({**answer, "results": [_plain(result) for result in results], "exit_code": code})
        return code
    _show(results, motion.name)
    if (wires := how["wires"]) is not None:
        say(f"{wires['late_steps']} of {wires['steps']} steps late; 99 % within {wires['p99_step_ms']:.2g} ms, worst "
            f"{wires['worst_step_ms']:.2g} ms{'' if wires['real_time'] else ', without real-time rights'}")  # fmt: skip
    return code


def _in_process(asked: BenchmarkOptions, motion: Earthquake, seed: int, as_json: bool) -> Outcome:
    from rig.hybrid.benchmark import run_benchmark

    problems = [(case, int(rate)) for case in asked.cases or CASES for rate in asked.rates or RATES]
    plants, latency = asked.plants or PLANTS, asked.latency_steps
    results = run_benchmark(problems, asked.compensators or NAMES, motion, plants, seed, latency)
    return _told(results, as_json), {"plants": plants, "latency_steps": latency, "wires": None}


def _on_wires(asked: BenchmarkOptions, motion: Earthquake, seed: int, as_json: bool) -> Outcome:
    """As `_in_process`.

    Raises:
        UsageError: another rate or latency than that of the wires.
    """
    if set(asked.rates) - {"250"} or asked.latency_steps:
        raise click.UsageError("--wires: 250 steps a second, and what the wires are late by: leave --rate and "
                               "--latency-steps out")  # fmt: skip
    from rig.campaign.wired_benchmark import LATENCY_STEPS, Wires
    from rig.station.process import real_time_priority

    lacking, wires, plants = real_time_priority(True), Wires(), asked.plants or PLANTS_ON_WIRES
    compensators = asked.compensators or NAMES[-1:]
    results = _told(wires.results(asked.cases or CASES, compensators, motion, plants, seed), as_json)
    went = {**wires.count.to_json(), "real_time": lacking is None}
    return results, {"plants": plants, "latency_steps": LATENCY_STEPS, "wires": went}


def _told(results: Iterator[Result], as_json: bool) -> list[Result]:
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
    from rig.cli.run import following, rig_of
    from rig.errors import FileProblem
    from rig.matrix.model import load_files, load_matrix

    matrix = load_matrix(asked.file) if asked.bench is None else load_files(asked.file, asked.bench)[0]
    if matrix.hybrid is None:
        text = "has no table [hybrid], which says what car and road the damper is tested in; docs/files.md describes it"
        raise FileProblem(str(asked.file), [text])
    simulator_args = following(matrix, asked.simulator_args, usual=asked.simulate and asked.bench is None)
    bench, simulator_args = rig_of(asked.bench, simulator_args, simulate=asked.simulate)
    shown = console(as_json=as_json)
    options = CampaignOptions(
        matrix_path=asked.file, out=asked.out, bench_path=bench, simulate=asked.simulate, speed=1.0,
        seed=asked.seed or 0, simulator_args=simulator_args,
    )
    result = run_job(options, None, shown)
    numbers = _numbers(result)
    if as_json:
        write_json({**result.to_json(), **numbers})
    else:
        from rig.cli.run import show_result

        _show_tests(numbers, shown)
        show_result(result, shown)
    return result.exit_code


def _numbers(result: JobResult) -> dict[str, Any]:
    """What `hybrid.json` says; the same keys without values where there is none."""
    from rig.characteristics.hybrid_tests import FILE, answer

    path = Path(result.campaign.campaign) / FILE
    if not path.is_file():
        return answer(())
    numbers: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return numbers


def _show_tests(numbers: dict[str, Any], shown: Console) -> None:
    from rich.table import Table

    table = Table()
    shares = ("tracking %", "body to 3 Hz %", "energy error %")
    for heading in ("compensation", "law", "delay ms", *shares, "late", "verdict"):
        table.add_column(heading, justify="left" if heading in {"compensation", "law", "verdict"} else "right")
    for test in numbers["tests"]:
        percent = (100.0 * value if value is not None else None for value in (
            test["tracking_nrms"], test["reference_error"], test["energy_error"]
        ))  # fmt: skip
        cells = ["-" if value is None else f"{value:.3g}" for value in (test["delay_ms"], *percent)]
        late = "-" if test["late_steps"] is None else f"{test['late_steps']} of {test['steps']}"
        table.add_row(test["compensation"], test["law"], *cells, late, test["verdict"])
    if numbers["tests"]:
        shown.print(table)
