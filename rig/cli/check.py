"""`rig check`: checks every device of a bench and reports each problem with its cause and its fix."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.cli.check_tables import check_blocks
from rig.cli.junit import junit_option, junit_report, take_check
from rig.cli.listening import listen as listened
from rig.cli.listening import listen_options
from rig.cli.options import Command, json_option
from rig.cli.output import console, show, write_json
from rig.errors import EXIT_DONE, EXIT_REFUSED

if TYPE_CHECKING:
    from rig.check.finding import CheckReport


@click.command(
    name="check",
    cls=Command,
    examples=(
        "rig check my-bench.toml",
        "rig check my-bench.toml --prove        (moves the rod by 2 mm)",
        "rig check my-bench.toml --simulate     (on a simulated rig with these devices)",
        "rig check --simulate -- --fault register-layout",
        "rig check --listen /dev/ttyUSB0        (show what a sensor sends)",
        "rig check --listen socketcan:can0 --dbc my-ecu.dbc",
    ),
)
@click.argument("bench", required=False)
@click.argument("simulator_args", nargs=-1, type=click.UNPROCESSED, metavar="[-- SIMULATOR ARGS]")
@click.option(
    "--prove", is_flag=True,
    help="Trigger the watchdog deliberately and move the rod by 2 mm at 10 mm/s and 0 A; use only if the rod can move "
         "safely.",
)
@click.option("--simulate", is_flag=True, help="Start a simulated rig (with the devices in BENCH) and check it.")
@listen_options
@junit_option
@json_option
def command(
    bench: str | None, simulator_args: tuple[str, ...], prove: bool, simulate: bool, listen: bool,
    junit: Path | None, as_json: bool, **of_listening: Any,  # noqa: ANN401 - click's, by their names
) -> int:  # fmt: skip
    """Check every device in BENCH: connection, identity, data layout, sampling rate, noise, zero and watchdog.

    Without --prove, nothing moves and no current flows, and the watchdog is triggered only while there is no pressure.
    Exit code 0: a campaign can begin; there may be warnings. Exit code 3: a check failed.

    With --listen, BENCH is a serial port, socket://HOST:PORT, a CAN bus as INTERFACE:CHANNEL, a file of captured bytes
    or a log written by `candump -l`. No data are sent, so a device that must be polled stays silent. Exit code 0: a
    format was found, or the specified format matches. Exit code 5: no format matches.
    """
    if bench is not None and bench.startswith("-"):
        simulator_args, bench = (bench, *simulator_args), None
    _only_with_listen(of_listening, listen=listen)
    if listen:
        _only_listens(others=prove or simulate or bool(simulator_args) or junit is not None)
        return listened(bench, of_listening, as_json=as_json)
    with junit_report(junit, "check", bench=bench) as report:
        checked = _checked(None if bench is None else Path(bench), simulator_args, prove=prove, simulate=simulate,
                           as_json=as_json)  # fmt: skip
        take_check(report, checked)
    return EXIT_DONE if checked.passed else EXIT_REFUSED


def _only_listens(*, others: bool) -> None:
    """Refuse checks and a simulated rig with `--listen`.

    Raises:
        UsageError: there are any.
    """
    if others:
        raise click.UsageError("--listen cannot be combined with --prove, --simulate, --junit or arguments after --")


def _only_with_listen(options: Mapping[str, object], *, listen: bool) -> None:
    """Refuse options of `--listen` without it.

    Raises:
        UsageError: with their names.
    """
    names = {"captured": "from", "given": "format"}
    given = [f"--{names.get(name, name)}" for name, value in options.items() if value is not None]
    if given and not listen:
        raise click.UsageError(f"{', '.join(given)}: only allowed with --listen")


def _checked(
    bench: Path | None, simulator_args: tuple[str, ...], *, prove: bool, simulate: bool, as_json: bool
) -> CheckReport:
    """Check the devices and show what was found.

    Raises:
        UsageError: there is no bench, or there are arguments for a simulated rig where there is none.
    """
    _check_usage(bench, simulator_args, simulate=simulate)
    # loads numpy and pyserial: not needed for the help
    from rig.bench.model import Bench
    from rig.check.check import check_bench

    shown = console(as_json=as_json)
    with tempfile.TemporaryDirectory(prefix="rig-check-") as name:
        folder = Path(name)
        given = _bench_file(bench, folder, simulator_args, simulate=simulate)
        with given as path, shown.status("reading the bench file") as line:
            report = check_bench(Bench.load(path), folder, line.update, prove=prove)
    if as_json:
        write_json(report.to_json())
    else:
        show(check_blocks(report), shown)
    return report


def _check_usage(bench: Path | None, simulator_args: tuple[str, ...], *, simulate: bool) -> None:
    """Refuse contradictions.

    Raises:
        UsageError: with what to write instead.
    """
    if bench is None and not simulate:
        raise click.UsageError("no bench specified. Fix: run rig check BENCH, rig check --simulate, or rig check "
            "--listen PORT")
    if simulator_args and not simulate:
        raise click.UsageError("arguments after --: only allowed with a simulated rig. Fix: add --simulate, or pass "
            "the arguments to `rig simulate`")


@contextmanager
def _bench_file(
    bench: Path | None, folder: Path, simulator_args: tuple[str, ...], *, simulate: bool
) -> Iterator[Path]:
    """The bench file to check; with `simulate` that of a simulated rig, which runs while the block does."""
    if bench is not None and not simulate:
        yield bench
        return
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.results import CampaignOptions
    from rig.campaign.simulated_rig import SimulatedRig, wearing
    from rig.matrix.sections import Specimen

    simulator_args = (*(wearing(bench) if bench is not None else ()), *simulator_args)
    options = CampaignOptions(folder, folder, simulate=True, simulator_args=simulator_args)
    specimen = Specimen.model_validate({"serial_number": "CHECK", "stroke": "170 mm"})
    ignore: Callable[[float], None] = lambda _: None  # noqa: E731 - the wait is not reported
    simulated = SimulatedRig.start(folder, options, specimen, ignore)
    try:
        yield simulated.bench_path
    finally:
        simulated.stop()
