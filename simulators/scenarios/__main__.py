"""`rig scenarios`: campaigns drawn from a range of seeds, in as many processes as there are cores."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.cli.junit import junit_option, junit_report, take_scenario
from rig.cli.main import answered
from rig.cli.options import Command, json_option, scheduler_option
from rig.cli.output import console, say, write_json
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID
from rig.jobs.workers import WorkersFailed

if TYPE_CHECKING:
    from rig.cli.junit import JUnitReport
    from simulators.scenarios.request import ScenarioRequest

FILE = click.Path(path_type=Path)


@click.command(
    cls=Command,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    examples=(
        "rig scenarios --seeds 0:1000 --bench my-bench.toml --matrix my-matrix.toml",
        "rig scenarios --seeds 17 --event estop@3 --event power-cut@9",
        "rig scenarios --seeds 17 --shrink",
    ),
)
@click.option("--seeds", default="0:20", show_default=True, metavar="FIRST:END",
              help="Range of scenarios to run (END is excluded); a single number runs one scenario.")
@click.option("--bench", type=FILE, help="Your bench file instead of the default simulated rig.")
@click.option("--matrix", type=FILE, help="Your matrix file instead of random ones.")
@click.option("--event", "events", multiple=True, metavar="WHAT[@T[+D]]",
              help="Event to inject instead of random events (repeatable); the event lasts D s. Rows of the fault "
                   "matrix begin T s after the first cycle begins; other events (application-killed, power-cut, ...) "
                   "begin T s after the start.")
@click.option("--happening", multiple=True, hidden=True)  # name of earlier versions, kept until 2.0
@click.option("--actuator", type=click.Choice(["tcp", "rtu"]),
              help="How the controller is connected.  [default: as your bench or the events require, otherwise random]")
@click.option("--until", type=float, metavar="S", help="End each scenario after S simulated seconds and omit "
    "the checks.")
@click.option("--trace", type=FILE, help="Write every step of a single scenario to this file.")
@click.option("--shrink", is_flag=True, help="Reduce each failing scenario to the smallest one that still fails.")
@click.option("--jobs", type=click.IntRange(1, 1024), default=os.cpu_count() or 1, show_default=True,
              help="Number of parallel processes.")
@scheduler_option
@junit_option
@json_option
def command(
    seeds: str, bench: Path | None, matrix: Path | None, events: tuple[str, ...], happening: tuple[str, ...],
    junit: Path | None, as_json: bool, **ways: Any,  # noqa: ANN401 - click's own
) -> int:  # fmt: skip
    """Run campaigns in random scenarios and check the safety and data rules in each scenario.

    The whole program runs in virtual time with simulated devices. The seed determines the events in a scenario (faults,
    killed processes, power cuts, a full disk, operator signals). Running the same seed again repeats the scenario step
    by step.

    The exit code is 5 if a check fails in any scenario.
    """
    # loads numba and numpy: not needed for the help
    from simulators.scenarios.request import Files, request_for, seeds_of

    if happening:
        say("rig: `--happening` is now `--event`; the old name will be removed in 2.0", err=True)
    with junit_report(junit, "scenarios", seeds=seeds, bench=bench, matrix=matrix) as report:
        seed_range = seeds_of(seeds)
        _check_usage(seed_range, ways)
        request = request_for(Files(matrix, bench), (*events, *happening), ways["until"], ways["actuator"] or "")
        _check_trace(ways["trace"], request)
        return _run(seed_range, request, ways, report, as_json=as_json)


def _check_usage(seeds: range, ways: dict[str, Any]) -> None:
    """Refuse contradictions.

    Raises:
        UsageError: with what to write instead.
    """
    if ways["trace"] is not None and len(seeds) > 1:
        raise click.UsageError(f"--trace accepts only one scenario. Fix: --seeds {seeds[0]}")
    if ways["trace"] is not None and ways["scheduler"] is not None:
        raise click.UsageError("--trace writes a file on this computer, so the scenario must run on it. Fix: omit "
            "--scheduler")
    if ways["shrink"] and (ways["until"] is not None or ways["trace"] is not None):
        raise click.UsageError("--shrink requires a complete scenario and cannot be combined with --until or --trace")


def _check_trace(path: Path | None, request: ScenarioRequest) -> None:
    """Refuse to write over one of the user's files.

    Raises:
        BadParameter: it is one of them.
    """
    for given in (request.files.matrix, request.files.bench):
        if path is not None and given is not None and path.exists() and path.samefile(given):
            words = f"{path} is already used for --matrix or --bench. Fix: specify another file"
            raise click.BadParameter(words, param_hint="--trace")


def _run(
    seeds: range, request: ScenarioRequest, ways: dict[str, Any], report: JUnitReport, *, as_json: bool
) -> int:
    """Run all scenarios, with progress on standard error.

    Raises:
        KeyboardInterrupt: Ctrl-C; finished scenarios are reported.
        WorkersFailed: likewise, with the seeds of unfinished scenarios.
    """
    # loads numba and numpy: not needed for the help
    from simulators.scenarios.output import ProgressOutput
    from simulators.scenarios.runs import every, in_a_worker
    from simulators.scenarios.shrink import show_smallest
    from simulators.scenarios.tracing import traced

    shown, trace = console(as_json=True), ways["trace"]
    telling = ProgressOutput(len(seeds), request, shown, bar=trace is None)
    try:
        with telling:
            run = (
                every(seeds, request, ways["jobs"], ways["scheduler"])
                if trace is None
                else [in_a_worker(traced, seeds[0], request, trace)]
            )
            for scenario in run:
                telling.ended(scenario)
                take_scenario(report, scenario.seed, scenario.failed, request.again(scenario.seed), scenario.wall_s)
        for seed in telling.failed_seeds if ways["shrink"] else ():
            in_a_worker(show_smallest, seed, request)
    except (KeyboardInterrupt, WorkersFailed) as stop:
        shown.print(telling.summary(), soft_wrap=True)
        if isinstance(stop, WorkersFailed) and (unfinished := telling.unfinished(seeds)):
            raise WorkersFailed(f"{stop}\nnot finished: seeds {unfinished}") from stop
        raise
    if as_json:
        write_json(telling.answer())
    console(as_json=as_json).print(telling.summary(), soft_wrap=True)
    return EXIT_NOT_ALL_VALID if telling.failed else EXIT_DONE


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that nothing is left behind
    sys.exit(answered(command, sys.argv[1:], "rig scenarios"))
