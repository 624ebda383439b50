"""`rig run`: a matrix on a rig, real or simulated, recorded and identified."""

from __future__ import annotations

import contextlib
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.campaign_folder import CampaignFolder
from rig.cli.delivering import address_for, address_of_run, delivery_to, results_option
from rig.cli.hangups import hangups_interrupt
from rig.cli.hybrid_tables import hybrid_numbers, show_hybrid_tests
from rig.cli.junit import junit_option, junit_report, take_campaign, take_specimen
from rig.cli.options import (
    Command,
    ResumedRun,
    RunPath,
    bench_option,
    json_option,
    out_option,
    seed_option,
    speed_option,
)
from rig.cli.output import console, show, shown_path, write_json
from rig.cli.page import live_link, page_options, page_settings
from rig.errors import FileProblem
from rig.text_file import FirstRead

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from rig.cli.job import JobResult
    from rig.cli.page import RunLink
    from rig.matrix.model import Matrix


@click.command(
    name="run",
    cls=Command,
    examples=(
        "rig run examples/table1.toml --bench my-bench.toml",
        "rig run examples/table1.toml --simulate --speed 50",
        "rig run examples/quick.toml --simulate -- --fault coil-open-short@3",
        "rig run examples/table1.toml --bench my-bench.toml --serial-number MR-002",
        "rig run examples/hybrid-quarter.toml --simulate    (real-time hybrid test)",
        "rig run --resume logs/20260102T030405Z-MR-001-ab12cd",
    ),
)
@click.argument("matrix", type=click.Path(path_type=Path), required=False)
@click.argument("simulator_args", nargs=-1, type=click.UNPROCESSED, metavar="[-- SIMULATOR ARGS]")
@bench_option
@click.option("--simulate", is_flag=True, help="Start a simulated rig (with the devices in the --bench file) and run "
                                               "the matrix on it.")
@speed_option
@seed_option
@click.option("--real-time", is_flag=True,
              help="Apply the timing limits of real hardware: the simulated rig does not wait while the computer is "
                   "busy.")
@click.option(
    "--resume", type=ResumedRun(), metavar="RUN",
    help="Resume campaign RUN; valid points are kept.",
)
@click.option(
    "--requalified", metavar="TEXT",
    help="With --resume, after a stop that requires requalification (e-stop, broken coil): description "
         "of what was checked or replaced.",
)
@click.option("--serial-number", metavar="TEXT", help="Serial number of the specimen, in place of the one in the "
                                                      "matrix file.")
@click.option(
    "--drives", type=RunPath(), metavar="RUN",
    help="With [matrix.iterate]: start from the commands stored in an earlier run with the same specimen and bench.",
)
# Options of the page of a bench (docs/maintainers/decisions/page-that-operates.md): what its operator has seen.
@click.option("--planned", metavar="SHA256", hidden=True)
@click.option("--confirmed", metavar="CODES", hidden=True)
@click.option("--operated", is_flag=True, hidden=True)
@click.option("--page", "page", is_flag=True, help="Serve the operator's page; its address is printed as `page: URL`.")
@page_options
@click.option("--hold", is_flag=True, help="With --page: wait until the operator presses Start on the page.")
@click.option("--stay", is_flag=True, help="With --page: keep serving the page after the campaign ends, until "
                                           "'Close the page' is clicked or Ctrl-C is pressed.")
@click.option("--hybrid", "must_be_hybrid", is_flag=True, hidden=True)  # `rig run FILE` of earlier versions
@results_option("after the run")
@click.option("--no-identify", is_flag=True, help="Record only; ignore [identify] in the matrix file.")
@out_option
@junit_option
@json_option
def command(
    matrix: Path | None,
    simulator_args: tuple[str, ...],
    bench: Path | None,
    simulate: bool,
    speed: float | None,
    seed: int | None,
    real_time: bool,
    resume: Path | None,
    requalified: str | None,
    no_identify: bool,
    serial_number: str | None,
    drives: Path | None,
    planned: str | None, confirmed: str | None, operated: bool,
    page: bool,
    page_address: str | None,
    page_cert: Path | None, page_key: Path | None,
    hold: bool, stay: bool, results_url: str | None,
    out: Path, junit: Path | None, as_json: bool, must_be_hybrid: bool,
) -> int:
    """Run MATRIX on a rig: check the rig, record every point, identify the damper and write the report.

    Ctrl-C stops the rig: the coil current goes to 0 A and the controller ramps down the motion; finished points are
    kept. Ctrl-Z pauses the campaign after the current point; a second Ctrl-Z resumes it. With --page, both
    functions are also available in a browser.

    --resume repeats all preflight checks, keeps the valid points and runs the remaining points. The resumed campaign
    uses the same bench, or a simulated rig if the campaign was simulated. By using --resume, you confirm that the cause
    of the stop (printed by the command) has been investigated and eliminated.
    """
    with junit_report(junit, "run", matrix=matrix, bench=bench, resume=resume) as report:
        if resume is not None and matrix is not None and str(matrix).startswith("-"):
            matrix, simulator_args = None, (str(matrix), *simulator_args)
        if real_time:
            simulator_args = (*simulator_args, "--real-time")
        check_usage(simulator_args, bench, speed, seed, resume, simulate=simulate, real_time=real_time)
        _check_specimen(serial_number, drives, resume)
        words = _requalified(requalified, resume)
        settings = page_settings(page_address, page_cert, page_key, enabled=page, hold=hold, stay=stay)
        # loads numpy and pyserial: not needed for the help
        from rig.campaign.results import CampaignOptions
        from rig.campaign.setup import plan_digest, same_plan
        from rig.cli.analysis_check import check_analysis, check_specimen
        from rig.cli.job import PreparedRun, run_job
        from rig.matrix.model import load_files, load_matrix

        path, files = _matrix_path(matrix, resume), FirstRead()
        with files:
            tests, known = (load_matrix(path), None) if bench is None else load_files(path, bench)
            if planned is not None and bench is not None and known is not None:
                same_plan(planned, plan_digest(path, bench, tests, known))
        tests = tests.of_specimen(serial_number or "")
        if must_be_hybrid:
            _refuse_without_hybrid(tests, path)
        simulator_args = following(tests, simulator_args, usual=simulate and bench is None and resume is None)
        simulator_args = (*specimens_of(tests, simulate=simulate and resume is None), *simulator_args)
        with files:
            bench, simulator_args = rig_of(bench, simulator_args, simulate=simulate)
            check_specimen(path, tests, fitted=not no_identify)
        identify = tests.identify
        if not no_identify:
            check_analysis(path, tests)
        options = CampaignOptions(
            matrix_path=path,
            out=out,
            bench_path=bench,
            simulate=simulate,
            speed=_speed(speed, resume),
            seed=0 if seed is None else seed,
            simulator_args=simulator_args,
            resume_path=resume, requalified=words,
            attended=_attended(as_json=as_json),
            serial_number=serial_number or "",
            confirmed=None if confirmed is None else frozenset(filter(None, confirmed.split(","))),
            planned=planned or "", drives_path=drives, files=files,
        )
        loaded = click.get_current_context().find_object(PreparedRun)
        options = options if loaded is None else replace(options, prepared=loaded.processes)
        shown = console(as_json=as_json)
        wanted = identify if tests.wants_fit and not no_identify else None
        results_url = address_for(results_url, known)
        if results_url is None and resume is not None:
            results_url = address_of_run(resume)
        with live_link(settings, held=hold, operated=operated) as live, delivery_to(results_url) as delivery:
            analyst = None if loaded is None else loaded.analyst
            result = run_job(options, wanted, shown, live, report, analyst=analyst)
            take_campaign(report, result.campaign, None if wanted is None else (result.fit is not None, result.error))
            take_specimen(report, result.specimen)
            delivered = None if delivery is None else delivery.deliver(result.campaign.campaign.parent)
            _show(result, shown, delivered, as_json=as_json, page=live.url, hybrid=tests.hybrid is not None)
            if stay:
                _stay(live, result)
        return result.exit_code


def _refuse_without_hybrid(tests: Matrix, path: Path) -> None:
    """Refuse a matrix without a hybrid test, as `rig hybrid` did.

    Raises:
        FileProblem: it has none.
    """
    if tests.hybrid is None:
        text = "has no [hybrid] table, which defines the car and the road for a hybrid test; see docs/files.md"
        raise FileProblem(str(path), [text])


def _stay(live: RunLink, result: JobResult) -> None:
    """Wait with the page until an operator closes it or the terminal is closed."""
    with hangups_interrupt():
        live.stay(result.campaign)


def _show(
    result: JobResult, shown: Console, delivered: Mapping[str, Any] | None, *, as_json: bool, page: str | None,
    hybrid: bool,
) -> None:
    """Say how it ended, for people or as JSON.

    The reader of the output may have closed it meanwhile: the exit code still states how the campaign ended.
    """
    from rig.cli.words import ending

    numbers = hybrid_numbers(result) if hybrid else {}
    with contextlib.suppress(OSError):
        if hybrid and not as_json:
            show_hybrid_tests(numbers, shown)
        if as_json:
            for style, text in ending(result.campaign):
                shown.print(text, style=style, soft_wrap=True, markup=False)
            write_json(result.to_json() | {"delivery": delivered} | numbers | ({} if page is None else {"page": page}))
        else:
            show_result(result, shown)
            if delivered is not None:
                style = "none" if delivered["error"] is None else "yellow"
                shown.print(f"results   {delivered['line']}", style=style, soft_wrap=True, markup=False)


def _attended(*, as_json: bool) -> bool:
    """Whether an operator can read and answer prompts."""
    return not as_json and sys.stdin.isatty() and sys.stdout.isatty()


def rig_of(
    bench: Path | None, simulator_args: tuple[str, ...], *, simulate: bool
) -> tuple[Path | None, tuple[str, ...]]:
    """Bench file and arguments of the simulated rig; one with the devices of a bench file writes its own."""
    if bench is None or not simulate:
        return bench, simulator_args
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.simulated_rig import wearing

    return None, (*wearing(bench), *simulator_args)


def following(tests: Matrix, simulator_args: tuple[str, ...], *, usual: bool) -> tuple[str, ...]:
    """Arguments of the usual simulated rig: it follows set-points where the matrix needs that, unless one is named."""
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.simulated_rig import STREAMED

    named = any(argument.partition("=")[0] in {"--actuator", "--register-map"} for argument in simulator_args)
    records = bool(tests.sweep.signals) or any(test.is_record for test in tests.endurance)
    follows = usual and (records or tests.hybrid is not None) and not named
    return (f"--actuator={STREAMED}", *simulator_args) if follows else simulator_args


def specimens_of(tests: Matrix, *, simulate: bool) -> tuple[str, ...]:
    """Arguments with which a simulated rig emulates the specimens that the matrix names."""
    file = None if tests.line is None else tests.line.simulated
    return (f"--specimens={file}",) if simulate and file is not None else ()


def _requalified(text: str | None, resume: Path | None) -> str:
    """What was checked or replaced, on one line; empty when nothing was said.

    Raises:
        UsageError: it says nothing, is too long, or there is nothing to resume.
    """
    if text is None:
        return ""
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.confirmation import LONGEST_TEXT

    words = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    if resume is None:
        raise click.UsageError("--requalified requires --resume RUN")
    if not words or len(words) > LONGEST_TEXT:
        raise click.UsageError(f"--requalified: describe in 1 to {LONGEST_TEXT} characters what was checked or "
            "replaced")
    return words


def _matrix_path(matrix: Path | None, resume: Path | None) -> Path:
    """The matrix file: the one given, or the resumed campaign's own.

    Raises:
        UsageError: neither is given.
    """
    if matrix is not None:
        return matrix
    if resume is None:
        raise click.UsageError("no matrix specified. Fix: use rig run MATRIX --bench FILE or rig run --resume RUN")
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.setup import described

    described(resume)
    return CampaignFolder(resume).matrix


def _speed(speed: float | None, resume: Path | None) -> float:
    """The simulated rig's speed: as asked for, as in the resumed campaign, or 1."""
    if speed is not None:
        return speed
    if resume is None:
        return 1.0
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.resume import speed_before

    return speed_before(resume)


def check_usage(
    simulator_args: tuple[str, ...],
    bench: Path | None,
    speed: float | None,
    seed: int | None,
    resume: Path | None,
    *,
    simulate: bool,
    real_time: bool,
) -> None:
    """Refuse contradictions before anything is read.

    Raises:
        UsageError: with what to write instead.
    """
    if bench is None and not simulate and resume is None:
        raise click.UsageError("specify --bench FILE, --simulate, or both (to simulate the devices of that bench)")
    if resume is not None and simulate and bench is not None:
        raise click.UsageError("a resumed campaign uses its original simulated rig. Fix: remove --bench")
    if resume is not None and seed is not None:
        raise click.UsageError("a resumed campaign uses its original seed. Fix: remove --seed")
    if speed is not None and not math.isfinite(speed):
        raise click.UsageError("--speed: expected a number from 0.01 to 1000")
    if simulator_args and not simulator_args[0].startswith("-"):
        raise click.UsageError(f"specify only one matrix: unexpected argument {simulator_args[0]}")
    given = {
        "--speed": speed is not None, "--seed": seed is not None, "--real-time": real_time,
        "arguments after --": bool(simulator_args),
    }
    for name, present in given.items():
        if present and not simulate and (resume is None or bench is not None):
            raise click.UsageError(f"{name}: only allowed with a simulated rig. Fix: add --simulate, or pass {name} to "
                                   "`rig simulate`")  # fmt: skip


def _check_specimen(serial_number: str | None, drives: Path | None, resume: Path | None) -> None:
    """Refuse another specimen, or the commands of another run, in the middle of a campaign.

    Raises:
        UsageError: one is given for a resumed campaign.
    """
    if drives is not None and resume is not None:
        raise click.UsageError("a resumed campaign starts from its own stored commands. Fix: remove --drives")
    if serial_number is not None and resume is not None:
        raise click.UsageError("a resumed campaign keeps its specimen. Fix: remove --serial-number")


def show_result(result: JobResult, shown: Console) -> None:
    """Say how the job ended: fit and forces first, then what an operator looks for: verdict, error, paths."""
    error = None
    if result.fit is not None:
        from rig.cli.fit_tables import fit_error, fit_summary  # both load numpy
        from rig.fits.fit_record import FitRecord

        fit = FitRecord.load(result.fit)
        show(fit_summary(fit), shown)
        error = fit_error(fit)
    show_ending(result, shown, error)


def show_ending(result: JobResult, shown: Console, fit_error: str | None) -> None:
    """The end of a job: force tables, verdict of the points, stop, error of the fit, paths."""
    from rich.text import Text

    # loads numpy and pyserial: not needed for the help
    from rig.cli.words import ending
    from rig.jobs.time_left import duration

    campaign = result.campaign
    if result.report is not None:
        from rig.cli.force_tables import force_blocks
        from rig.files.run_display import run_display
        from rig.recording.run import Run
        from rig.report.cover import terms_of

        tables = result.force_tables
        if tables:
            shown.print()
            terms = terms_of(Run.open(campaign.campaign))
            show(force_blocks(tables, run_display(campaign.campaign), terms), shown)
            shown.print()
        if tests := result.response:
            from rig.report.response import response_blocks

            show(response_blocks(tests, run_display(campaign.campaign), narrow=True), shown)
            shown.print()
    if not campaign.refused:
        colour = "green" if campaign.valid == campaign.total else "yellow"
        line = Text(f"{campaign.valid} of {campaign.total} points valid", style=colour)
        if campaign.motion_s > 0.0:
            wall, motion = duration(campaign.wall_s), duration(campaign.motion_s)
            line.append(f"; {wall} from the first point to the last, for {motion} of motion; start and evaluation are "
                        "not included", style="none")
        shown.print(line)
    for style, text in ending(campaign):
        shown.print(Text(text, style=style), soft_wrap=True)
    if result.specimen is not None:
        # loads numpy: not needed for the help
        from rig.cli.comparison_tables import specimen_blocks
        from rig.files.run_display import run_display

        show(specimen_blocks(result.specimen, run_display(campaign.campaign)), shown)
    if fit_error is not None:
        shown.print(Text(fit_error))
    if result.error is not None:
        shown.print(Text(f"not identified: {result.error}", style="red"))
    show_paths(result, shown)


def show_paths(result: JobResult, shown: Console) -> None:
    """Say where everything is."""
    from rich.text import Text

    for name, path in (("campaign", result.campaign.campaign), ("fit", result.fit), ("report", result.report)):
        if path is not None:
            shown.print(Text(f"{name:<9} {shown_path(path)}"), soft_wrap=True)
