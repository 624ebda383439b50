"""A whole job, as in `rig run` and `rig demo`: campaign, then identification and report in a separate process."""

from __future__ import annotations

import contextlib
import json
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from drivers.processes import own_program
from rig.campaign.campaign import run_campaign
from rig.campaign_folder import CampaignFolder
from rig.cli.hangups import hangups_interrupt
from rig.cli.junit import JUnitDisplay, JUnitReport
from rig.cli.output import status_line
from rig.cli.words import error_words
from rig.errors import EXIT_DONE, EXIT_IDENTIFICATION, EXIT_NOT_ACCEPTED, EXIT_NOT_ALL_VALID, FileProblem
from rig.matrix.acceptance_table import has_acceptance
from rig.recording.tested_specimens import SpecimenVerdict
from rig.text_file import read_json

if TYPE_CHECKING:
    from rich.console import Console

    from rig.campaign.results import CampaignOptions, CampaignResult, Display, PointResult, PreparedProcesses
    from rig.characteristics.force_table import ForceTable
    from rig.cli.page import RunLink
    from rig.comparison.specimen import SpecimenResult
    from rig.matrix.sections import Identify


LONGEST_NOTES = 2000


@dataclass(frozen=True)
class JobResult:
    """A campaign's result and what was made of it; `fit` and `report` are None when there is none.

    `error` says why there is no fit, `report_error` why there is no report, though they were wanted. `specimen` is the
    verdict on the specimen; None if the matrix has no acceptance bands.
    """

    campaign: CampaignResult
    fit: Path | None = None
    report: Path | None = None
    error: str | None = None
    report_error: str | None = None
    specimen: SpecimenResult | None = None

    @property
    def exit_code(self) -> int:
        """The campaign's own code first (7, 3, 4, 5), 6 for a missing fit, 8 for a specimen that is not `ok`."""
        if self.campaign.exit_code != EXIT_DONE:
            return self.campaign.exit_code
        if self.error is not None:
            return EXIT_IDENTIFICATION
        return EXIT_DONE if self.specimen is None or self.specimen.verdict == SpecimenVerdict.OK else EXIT_NOT_ACCEPTED

    @property
    def force_tables(self) -> tuple[ForceTable, ...]:
        """Force over velocity, as written with the report; empty where it cannot be read."""
        from rig.cli.force_tables import recorded_tables  # loads numba: only after a run

        try:
            return recorded_tables(self.campaign.campaign)
        except (FileProblem, LookupError, TypeError):  # of an earlier version, or written over since
            return ()

    @property
    def response(self) -> list[dict[str, Any]]:
        """The response tests, as written with the report; empty where there are none."""
        numbers: list[dict[str, Any]] = []
        with contextlib.suppress(FileProblem):
            numbers = read_json(CampaignFolder(self.campaign.campaign).characteristics).get("response", [])
        return numbers

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig run --json`."""
        acceptance = None if self.specimen is None else self.specimen.acceptance
        error = {"error": error_words(self.campaign)} if self.campaign.detail else {}
        return {
            **self.campaign.to_json(),
            **error,
            "force_tables": None if self.report is None else [one.to_json() for one in self.force_tables],
            "response": None if self.report is None else self.response,
            "fit": None if self.fit is None else str(self.fit),
            "report": None if self.report is None else str(self.report),
            "identification_error": self.error,
            "report_error": self.report_error,
            "specimen": None if self.specimen is None else str(self.specimen.verdict),
            "specimen_reason": None if self.specimen is None else self.specimen.reason,
            "acceptance": None if acceptance is None else acceptance.to_json(),
        }


class Analyst:
    """The application's end of `rig.cli.analyst`; started early so that its imports happen during the motion.

    Attributes:
        notes: what it reported on standard error, once it has ended.
    """

    def __init__(self) -> None:
        self.notes = ""
        self._asked = False
        self._log = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - lives as long as the process that writes it
        self._process = subprocess.Popen(
            own_program("rig.cli.analyst"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._process.kill()
        self._process.communicate()
        self._log.seek(0)
        self.notes = self._log.read()[-LONGEST_NOTES:].strip()
        self._log.close()

    @property
    def lives(self) -> bool:
        """Whether it can take a request."""
        return self._process.poll() is None and not self._asked

    def evaluate(self, run: Path, identify: Identify | None) -> None:
        """Request the evaluation of a run; `answer` waits for it.

        Args:
            run: the campaign's directory.
            identify: what is to be fitted; None: nothing.
        """
        settings = None if identify is None else identify.model_dump(exclude={"enabled"})
        self._send({"do": "evaluate", "run": str(run), "identify": settings})

    def report(self, run: Path) -> None:
        """Request the report of a run; `answer` waits for it."""
        self._send({"do": "report", "run": str(run)})

    def finish(self, run: Path) -> None:
        """Have the report of a run written and the results database updated; what fails is reported in `notes`."""
        self._send({"do": "finish", "run": str(run)}, answered=False)

    def answer(self) -> dict[str, Any]:
        """The answer to the last request.

        Returns:
            The keys of `rig.cli.analyst`'s answer; only `ended`, the reason, if the operator or a fault ended the
            process.
        """
        try:
            line = self._process.stdout.readline() if self._process.stdout else ""
            answer: dict[str, Any] = json.loads(line)
        except KeyboardInterrupt:
            self._process.kill()
            return {"ended": "interrupted by the operator"}
        except (OSError, ValueError):
            self._process.kill()
            code = self._process.wait()
            self._log.seek(0)
            tail = self._log.read()[-LONGEST_NOTES:].strip()
            return {"ended": f"the identification process ended unexpectedly (exit code {code})\n{tail}"}
        self._asked = False
        return answer

    def _send(self, request: Mapping[str, Any], *, answered: bool = True) -> None:
        """Send a request; a process that has ended shows in its answer."""
        self._asked = answered
        with contextlib.suppress(OSError, ValueError):  # closed, or its pipe is
            print(json.dumps(request), file=self._process.stdin, flush=True)


@dataclass
class PreparedRun:
    """What a run that was loaded in advance finds already (`rig.cli.prepared_run`): the object of its click context.

    Attributes:
        processes: of the campaign.
        analyst: the process that evaluates; None: it is started with the campaign.
    """

    processes: PreparedProcesses
    analyst: Analyst | None = None


@dataclass(frozen=True)
class LineParts:
    """What a production line shares among its campaigns.

    Attributes:
        analyst: the process that evaluates all of them.
        display: makes the display of a campaign from the usual one.
    """

    analyst: Analyst
    display: Callable[[Display], Display]


def run_job(
    options: CampaignOptions, identify: Identify | None, console: Console, live: RunLink | None = None,
    junit: JUnitReport | None = None, line: LineParts | None = None, analyst: Analyst | None = None,
) -> JobResult:
    """Run a campaign with its display, then identify what it recorded (unless it was stopped) and report it.

    Args:
        options: of the campaign.
        identify: what is to be fitted; None: nothing.
        console: where the display is shown.
        live: the page; None: there is none.
        junit: takes the points as they end; None: nothing is written.
        line: of a production line, whose reports are written after the verdict; None: a single campaign.
        analyst: of a single campaign, if it was started in advance.

    Raises:
        RigError: refused before a campaign directory exists.
    """
    from rig.cli.display import display_for

    own = (analyst or Analyst()) if line is None else contextlib.nullcontext(line.analyst)
    with hangups_interrupt(), own as analyst:

        def judged(result: CampaignResult) -> None:
            """Begin the evaluation while the campaign is closed."""
            if _recorded(result):
                analyst.evaluate(result.campaign, _fitted(result, identify))

        with display_for(console) as display:
            shown: Display = display if junit is None or junit.path is None else JUnitDisplay(display, junit)
            shown = shown if line is None else line.display(shown)
            result = run_campaign(options, shown, None if live is None else live.link, judged)
        if live is not None:
            live.ended(result)
        if not _recorded(result):
            specimen = _untested(result.campaign, result.detail)
            if live is not None:
                live.evaluated(specimen)
            return JobResult(result, specimen=specimen)
        fitted = _fitted(result, identify) is not None
        with status_line(console, "identifying the damper" if fitted else "evaluating the points"):
            answer = analyst.answer()
        specimen = _specimen(result.campaign, answer)
        if live is not None:
            live.evaluated(specimen)
        report = dict[str, Any]()
        if line is not None:
            analyst.finish(result.campaign)
        elif "ended" in answer:
            report = answer
        else:
            with status_line(console, "writing the report"):
                analyst.report(result.campaign)
                report = analyst.answer()
    report_error = report.get("report_error", report.get("ended"))
    if report_error is not None:
        with contextlib.suppress(OSError):
            text = f"warning: the report could not be written: {report_error}"
            console.print(text, style="yellow", markup=False)
    fit, path = (None if name is None else Path(name) for name in (answer.get("fit"), report.get("report")))
    error = answer.get("error", answer.get("ended") if fitted else None)
    return JobResult(result, fit, path, error, report_error, specimen)


def _fitted(result: CampaignResult, identify: Identify | None) -> Identify | None:
    """What is to be fitted to the points of a campaign; None: it was stopped, or no point can be used."""
    finished = result.exit_code in {EXIT_DONE, EXIT_NOT_ALL_VALID}
    return identify if finished and any(point.verdict != "invalid" for point in _recorded(result)) else None


def _recorded(result: CampaignResult) -> list[PointResult]:
    """Points with a file."""
    return [point for point in result.points if point.file is not None]


def _specimen(run: Path, answer: Mapping[str, Any]) -> SpecimenResult | None:
    """The verdict on the specimen in the answer of the analyst."""
    if "specimen" not in answer:
        return _untested(run, str(answer.get("ended")))
    if answer["specimen"] is None:
        return None
    from rig.comparison.specimen import SpecimenResult  # loads numba: only where there are bands

    return SpecimenResult.from_json(answer["specimen"])


def _untested(run: Path, reason: str) -> SpecimenResult | None:
    """The verdict on a specimen that could not be evaluated; None if the matrix has no acceptance bands."""
    if not has_acceptance(run):
        return None
    from rig.comparison.specimen import untested  # loads numba: only where there are bands

    return untested(run, reason or "no point was recorded")
