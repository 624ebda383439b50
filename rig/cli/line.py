"""`rig line`: test one specimen after another, each started by its serial number."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.cli.delivering import WAIT_S, address_for, delivery_to, results_option
from rig.cli.hangups import hangups_interrupt
from rig.cli.options import Command, bench_option, json_option, out_option, seed_option, speed_option
from rig.cli.output import console, show, write_json
from rig.cli.run import check_usage, following, rig_of, specimens_of
from rig.clock import utc_now
from rig.errors import EXIT_STOPPED, EXIT_UNKNOWN_STATE, FileProblem, RigError, UnknownRigState
from rig.recording.tested_specimens import TITLES, SpecimenVerdict, TestedSpecimens

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from rig.campaign.results import CampaignOptions
    from rig.cli.job import Analyst, JobResult
    from rig.cli.line_entries import Entries
    from rig.cli.line_session import LineResult, LineSession
    from rig.matrix.model import Matrix

LETTERS = {
    "O": (" ### ", "#   #", "#   #", "#   #", " ### "), "K": ("#   #", "#  # ", "###  ", "#  # ", "#   #"),
    "N": ("#   #", "##  #", "# # #", "#  ##", "#   #"), "T": ("#####", "  #  ", "  #  ", "  #  ", "  #  "),
    "E": ("#####", "#    ", "#### ", "#    ", "#####"), "S": (" ####", "#    ", " ### ", "    #", "#### "),
    "D": ("#### ", "#   #", "#   #", "#   #", "#### "), " ": ("  ", "  ", "  ", "  ", "  "),
}  # fmt: skip
"""Large letters of the verdicts, which can be read from a distance."""
STYLES: Mapping[str, str] = {
    SpecimenVerdict.OK: "bold white on green", SpecimenVerdict.NOT_OK: "bold white on red",
    SpecimenVerdict.NOT_TESTED: "bold black on yellow",
}  # fmt: skip
MARGIN = 2


@click.command(
    name="line",
    cls=Command,
    examples=(
        "rig line examples/line.toml --bench my-bench.toml",
        "rig line examples/line.toml --bench my-bench.toml --reader /dev/ttyACM0",
        "printf 'MR-101\\nMR-102\\nMR-103\\n' | rig line examples/line.toml --simulate --speed 5",
    ),
)
@click.argument("matrix", type=click.Path(path_type=Path))
@click.argument("simulator_args", nargs=-1, type=click.UNPROCESSED, metavar="[-- SIMULATOR ARGS]")
@bench_option
@click.option("--simulate", is_flag=True, help="Test simulated specimens on a simulated rig (with the devices in the "
                                               "--bench file).")
@speed_option
@seed_option
@click.option("--reader", metavar="PORT", help="Serial port of a barcode reader. Not required for a reader in "
                                               "keyboard mode.")
@results_option("after each test")
@click.option("--no-identify", is_flag=True, help="Record and evaluate only; ignore [identify] in the matrix file.")
@out_option
@json_option
def command(
    matrix: Path, simulator_args: tuple[str, ...], bench: Path | None, simulate: bool, speed: float | None,
    seed: int | None, reader: str | None, results_url: str | None, no_identify: bool, out: Path, as_json: bool,
) -> int:
    """Test one specimen after another with MATRIX; each test is started by the serial number of the specimen.

    Mount a specimen, then scan or type its serial number: the test starts at once. Every test is a separate campaign
    with all preflight checks; at its end, the coil current is 0 A and the hydraulics are off. The matrix requires
    acceptance bands ([acceptance]); the result is shown as OK, NOT OK or NOT TESTED.

    Any input during a test is refused. After a stop, type `continue` once the cause has been eliminated. `retest
    SERIAL` tests a specimen again. `quit`, the end of the input or Ctrl-C between two tests ends the command.
    """
    check_usage(simulator_args, bench, speed, seed, None, simulate=simulate, real_time=False)
    # loads numpy and pyserial: not needed for the help
    from rig.cli.analysis_check import check_analysis, check_specimen
    from rig.cli.job import Analyst
    from rig.cli.line_entries import Entries
    from rig.cli.line_session import LineSession
    from rig.matrix.model import load_files, load_matrix

    tests, known = (load_matrix(matrix), None) if bench is None else load_files(matrix, bench)
    _require_bands(matrix, tests)
    check_specimen(matrix, tests, fitted=not no_identify)
    if not no_identify:
        check_analysis(matrix, tests)
    arguments = following(tests, simulator_args, usual=simulate and bench is None)
    bench, arguments = rig_of(bench, arguments, simulate=simulate)
    arguments = (*specimens_of(tests, simulate=simulate), *arguments)
    # loads numpy: not needed for the help
    from rig.campaign.results import CampaignOptions, PreparedProcesses

    options = CampaignOptions(
        matrix_path=matrix, out=out, bench_path=bench, simulate=simulate, speed=1.0 if speed is None else speed,
        seed=0 if seed is None else seed, simulator_args=arguments,
        prepared=PreparedProcesses.new(simulate=simulate),
    )  # fmt: skip
    session, shown = LineSession(tests, TestedSpecimens(out)), console(as_json=as_json)
    with hangups_interrupt(), contextlib.ExitStack() as ends:
        ends.callback(options.prepared.close)
        options.prepared.prepare()
        line = _Line(session, options, shown, Entries(reader), None if no_identify else tests, ends, Analyst)
        line.results_url = address_for(results_url, known)
        with contextlib.suppress(KeyboardInterrupt):
            line.run()
    line.show_notes()
    delivered = line.delivered(wait_s=WAIT_S) if session.results else None
    if as_json:
        write_json(session.to_json() | {"delivery": delivered})
    elif delivered is not None:
        shown.print(delivered["line"], markup=False, soft_wrap=True)
    return session.exit_code


def _require_bands(matrix: Path, tests: Matrix) -> None:
    """Refuse a matrix that ends without a verdict on the specimen.

    Raises:
        FileProblem: it has no `[acceptance]`.
    """
    if tests.acceptance is None:
        text = "acceptance: missing; `rig line` requires acceptance bands. Fix: write a table [acceptance] with bands"
        raise FileProblem(str(matrix), [text])


class _Line:
    """The line on a terminal.

    Args:
        session: what was tested.
        options: of every campaign, without the serial number.
        shown: where it is shown.
        entries: the sources of serial numbers.
        fitted: the matrix whose `[identify]` is done; None: nothing is fitted.
        ends: takes what must be closed at the end.
        analyst: starts the process that evaluates.

    Attributes:
        results_url: server to which results are delivered; None: none.
    """

    results_url: str | None = None

    def __init__(
        self, session: LineSession, options: CampaignOptions, shown: Console, entries: Entries,
        fitted: Matrix | None, ends: contextlib.ExitStack, analyst: type[Analyst],
    ) -> None:
        self._session = session
        self._options = options
        self._shown = shown
        self._entries: Entries | None = entries
        self._identify = fitted.identify if fitted is not None and fitted.wants_fit else None
        self._ends = ends
        self._new_analyst = analyst
        self._analyst = ends.enter_context(analyst())
        self._digest = session.matrix.digest

    def run(self) -> None:
        """Test specimens until the input ends."""
        entries = self._entries
        if entries is None:
            return
        listed = entries.list_at_once() if self._options.simulate else None
        if listed is not None:
            self._entries = None  # the list of a rehearsal: there is no reader
            for text in listed:
                if not self._enter(text):
                    return
            return
        self._say("Mount a specimen, then scan its serial number. The test starts at once.", "bold")
        while (typed := entries.next()) is not None:
            if typed.text is None:
                self._say(f"{typed.source}: the barcode reader no longer responds. Fix: check its connection", "red")
            elif not self._enter(typed.text):
                return

    def delivered(self, wait_s: float = 0.0) -> dict[str, Any] | None:
        """Deliver the results in a separate process: an unreachable server delays no test; None without a server."""
        with delivery_to(self.results_url) as delivery:
            return None if delivery is None else delivery.deliver(self._options.out, wait_s)

    def show_notes(self) -> None:
        """Show what failed after a verdict: a report or the results database."""
        if self._analyst.notes:
            self._say(self._analyst.notes, "yellow")

    def _enter(self, text: str) -> bool:
        """Take one entry; False where the line ends."""
        from rig.cli.line_session import Answer  # its module is loaded by then

        entry = self._session.entered(text, utc_now())
        if entry.answer is Answer.QUIT:
            return False
        if entry.answer is Answer.TEST:
            return self._test(entry.text)
        if entry.text:
            self._say(entry.text, "red" if entry.answer is Answer.REFUSED else "green")
        return True

    def _test(self, serial_number: str) -> bool:
        """Test a specimen; False where the line must end."""
        from rig.cli.line_session import LineResult  # its module is loaded by then

        self._say(f"Testing {serial_number}", "bold")
        untested = str(SpecimenVerdict.NOT_TESTED)
        began_s = time.monotonic()
        try:
            job = self._job(serial_number)
            result = LineResult.of(serial_number, job, time.monotonic() - began_s)
        except UnknownRigState as error:
            result = LineResult(serial_number, untested, str(error), EXIT_UNKNOWN_STATE, None, 0.0)
        except RigError as error:
            result = LineResult(serial_number, untested, str(error), error.exit_code, None, 0.0)
        except KeyboardInterrupt:  # after the motion: the campaign itself takes Ctrl-C as a stop
            result = LineResult(serial_number, untested, "interrupted by the operator", EXIT_STOPPED, None, 0.0)
        self._session.take(result)
        try:
            self._show(result)
        finally:
            self._warn(result)
        self.delivered()
        self._options.prepared.prepare()
        self._refuse_rest(serial_number)
        self._ask_for_next(result)
        return result.exit_code != EXIT_UNKNOWN_STATE

    def _job(self, serial_number: str) -> JobResult:
        """The campaign of a specimen.

        Raises:
            FileProblem: the matrix was changed meanwhile.
            RigError: it was refused before it had a directory.
        """
        # loads numpy: not needed for the help
        from rig.cli.job import LineParts, run_job
        from rig.cli.line_entries import WatchingDisplay
        from rig.cli.page import live_link
        from rig.matrix.model import load_matrix
        from rig.text_file import FirstRead

        if not self._analyst.lives:
            self._analyst = self._ends.enter_context(self._new_analyst())
        files = FirstRead()
        with files:
            if load_matrix(self._options.matrix_path).digest != self._digest:
                raise FileProblem(str(self._options.matrix_path), [
                    "the matrix file or a file that it names was changed after the start of the line. Fix: type "
                    "`quit`, check the change, then start the line again"
                ])
        options = replace(self._options, serial_number=serial_number, files=files)
        line = LineParts(self._analyst, lambda display: WatchingDisplay(
            display, self._entries, lambda text: self._session.during_test(text, serial_number).text,
            self._options.prepared.prepare,
        ))
        with live_link(None) as live:
            return run_job(options, self._identify, self._shown, live, None, line)

    def _refuse_rest(self, serial_number: str) -> None:
        """Refuse what arrived until the result was shown: the specimen has not been changed yet."""
        for typed in () if self._entries is None else self._entries.arrived():
            if text := self._session.during_test(typed.text or "", serial_number).text:
                self._say(text, "red")

    def _show(self, result: LineResult) -> None:
        """The verdict in large letters, the reason, what to do, and the counters."""
        from rich.text import Text

        from rig.cli.comparison_tables import specimen_blocks

        # loads numpy and pyserial: not needed for the help
        from rig.comparison.specimen import read_specimen
        from rig.files.run_display import run_display

        style = STYLES[result.verdict]
        width = min(self._shown.width, 80)
        with contextlib.suppress(OSError):
            for row in ("", *large(TITLES[result.verdict], self._shown.width), ""):
                self._shown.print(Text(f"{' ' * MARGIN}{row}".ljust(width), style=style))
            shown = False
            if result.campaign is not None and result.exit_code not in {EXIT_STOPPED, EXIT_UNKNOWN_STATE}:
                with contextlib.suppress(FileProblem):
                    specimen = read_specimen(result.campaign)
                    show(specimen_blocks(specimen, run_display(result.campaign)), self._shown)
                    shown = True
            if not shown:
                self._say(f"{result.serial_number}: {result.reason}", "red")
            for remark in result.remarks:
                self._say(remark, "yellow")
            self._say(f"{self._session.summary}. Takt of {result.serial_number}: {result.takt_s:.1f} s", "")

    def _warn(self, result: LineResult) -> None:
        """What must be known at once, whatever fails afterwards."""
        if result.exit_code == EXIT_UNKNOWN_STATE:
            self._say("THE STATE OF THE RIG IS UNKNOWN. The line ends. Inspect the rig.", "bold red")
        elif self._session.blocked and result.exit_code == EXIT_STOPPED:
            self._say("The line is stopped. Eliminate the cause, then type `continue`.", "bold red")

    def _ask_for_next(self, result: LineResult) -> None:
        """Ask for a specimen: only once nothing that is entered is refused as entered during a test."""
        stopped = self._session.blocked and result.exit_code == EXIT_STOPPED
        if self._entries is not None and not stopped and result.exit_code != EXIT_UNKNOWN_STATE:
            self._say("Change the specimen, then scan the next serial number.", "bold")

    def _say(self, text: str, style: str) -> None:
        with contextlib.suppress(OSError):
            self._shown.print(text, style=style, soft_wrap=True, markup=False)


def large(text: str, width: int) -> list[str]:
    """A text in large letters; as it is where the terminal is too narrow."""
    rows = ["  ".join(LETTERS[letter][row] for letter in text) for row in range(5)]
    return rows if len(rows[0]) + 2 * MARGIN <= width else [text]
