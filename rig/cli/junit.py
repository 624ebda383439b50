"""JUnit XML of a command (`--junit FILE`), so that a CI server shows points, devices and scenarios as tests.

The file is valid at any time: it is replaced as a whole whenever a test has ended. Until the command has ended, it
contains the error `unfinished`, which remains in it if the command is killed: a killed run is never a success.
"""

from __future__ import annotations

import platform
import re
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import click

from rig.cli.output import say
from rig.clock import utc_now
from rig.errors import FileProblem, RigError
from rig.recording.atomic_write import write_durably
from rig.recording.tested_specimens import SpecimenVerdict
from rig.verdicts import VALID

if TYPE_CHECKING:
    from rig.campaign.results import CampaignResult, Display, PointResult
    from rig.check.finding import CheckReport, DeviceReport
    from rig.comparison.specimen import SpecimenResult
    from rig.matrix.plan import Plan
    from rig.test_point import TestPoint

NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot contain."""
LEAST_APART_S = 0.5
"""Between two intermediate files: there may be thousands of tests."""
UNFINISHED = "unfinished"


class Outcome(StrEnum):
    """How a test ended; the values are the elements of JUnit XML, that of a passed test excepted."""

    PASSED = "passed"
    FAILURE = "failure"
    """The test was made and did not pass."""
    ERROR = "error"
    """The test could not be made."""
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Case:
    """One test.

    Attributes:
        name: of the test.
        outcome: how it ended.
        kind: slug of the first cause; empty if it passed.
        text: the causes, one a line.
        time_s: how long it took (s).
    """

    name: str
    outcome: Outcome = Outcome.PASSED
    kind: str = ""
    text: str = ""
    time_s: float = 0.0


@dataclass
class JUnitReport:
    """The file of one command.

    Attributes:
        path: of the file; None: nothing is written.
        suite: name of the suite, such as `rig run`.
        cases: tests by a key of the caller, in the order of the file.
        properties: what was tested, by name.
        output: what else the command found, one a line.
    """

    path: Path | None
    suite: str
    cases: dict[str, Case] = field(default_factory=dict)
    properties: dict[str, str] = field(default_factory=dict)
    output: list[str] = field(default_factory=list)
    _started: str = field(default_factory=lambda: f"{utc_now():%Y-%m-%dT%H:%M:%S}")
    _began_s: float = field(default_factory=time.monotonic)
    _written_s: float = -LEAST_APART_S

    def write(self, end: Case | None = None) -> None:
        """Replace the file.

        Args:
            end: shown after the tests; what ended the command early, or that it has not ended.

        Raises:
            OSError: it cannot be written.
        """
        if self.path is not None:
            cases = [*self.cases.values(), *([] if end is None else [end])]
            write_durably(self.path, self._xml(cases))
            self._written_s = time.monotonic()

    def write_so_far(self) -> None:
        """Replace the file while tests remain; at most every 0.5 s. An error shows at the end of the command."""
        if time.monotonic() - self._written_s >= LEAST_APART_S:
            with suppress(OSError):
                self.write(_not_ended())

    def complete(self) -> None:
        """Replace the file with the results of all tests. An error is a warning: the exit code states the results."""
        try:
            self.write()
        except OSError as error:
            with suppress(OSError):
                say(f"warning: {self.path}: the JUnit file cannot be written: {error.strerror or error}", err=True)

    def _xml(self, cases: list[Case]) -> bytes:
        counts = {outcome: sum(case.outcome is outcome for case in cases) for outcome in Outcome}
        root = ElementTree.Element("testsuites")
        suite = ElementTree.SubElement(root, "testsuite", {
            "id": "0", "package": "rig", "name": _token(self.suite), "timestamp": self._started,
            "hostname": _token(platform.node()) or "localhost", "tests": str(len(cases)),
            "failures": str(counts[Outcome.FAILURE]), "errors": str(counts[Outcome.ERROR]),
            "skipped": str(counts[Outcome.SKIPPED]), "time": f"{time.monotonic() - self._began_s:.3f}",
        })  # fmt: skip
        properties = ElementTree.SubElement(suite, "properties")
        for name, value in self.properties.items():
            ElementTree.SubElement(properties, "property", name=_token(name), value=_clean(value))
        for case in cases:
            element = ElementTree.SubElement(suite, "testcase", {
                "classname": _token(self.suite).replace(" ", "."), "name": _token(case.name) or "test",
                "time": f"{case.time_s:.3f}",
            })  # fmt: skip
            if case.outcome is not Outcome.PASSED:
                attributes = {"message": _clean(case.text.partition("\n")[0])}
                attributes |= {} if case.outcome is Outcome.SKIPPED else {"type": _clean(case.kind or case.outcome)}
                ElementTree.SubElement(element, case.outcome.value, attributes).text = _clean(case.text)
        ElementTree.SubElement(suite, "system-out").text = _clean("\n".join(self.output))
        ElementTree.SubElement(suite, "system-err")
        ElementTree.indent(root)
        xml: bytes = ElementTree.tostring(root, "utf-8", xml_declaration=True)
        return xml + b"\n"


@contextmanager
def junit_report(path: Path | None, command: str, **properties: object) -> Iterator[JUnitReport]:
    """The JUnit file of a command: written at the start, completed when the block ends, however it ends.

    Args:
        path: of the file; None: nothing is written.
        command: its name.
        properties: what it works on; None is left out.

    Raises:
        FileProblem: the file cannot be written at the start; nothing else was done.
        BaseException: that of the block.
    """
    report = JUnitReport(path, f"rig {command}")
    report.properties = {name: str(value) for name, value in properties.items() if value is not None}
    try:
        report.write(_not_ended())
    except OSError as error:
        text = f"the JUnit file cannot be written: {error.strerror or error}. Fix: specify another file with --junit"
        raise FileProblem(str(path), [text]) from error
    try:
        yield report
    except BaseException as error:
        with suppress(OSError):
            report.write(_ended_by(error))
        raise
    report.complete()


junit_option = click.option(
    "--junit", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="Also write the results as JUnit XML, for a CI server.",
)


def _not_ended() -> Case:
    return Case(UNFINISHED, Outcome.ERROR, UNFINISHED, "the command is still running or was killed")


def _ended_by(error: BaseException) -> Case:
    if isinstance(error, click.ClickException):
        return Case("command", Outcome.ERROR, RigError.slug, error.format_message())
    slug = error.slug if isinstance(error, RigError) else type(error).__name__
    stopped = isinstance(error, (KeyboardInterrupt, click.Abort))
    return Case("command", Outcome.ERROR, slug, "stopped by operator" if stopped else str(error) or slug)


def _clean(text: str) -> str:
    return NOT_XML.sub("?", text)


def _token(text: str) -> str:
    return " ".join(_clean(text).split())


class JUnitDisplay:
    """The display of a campaign, with the file written beside it. Implements `rig.campaign.results.Display`."""

    def __init__(self, display: Display, report: JUnitReport) -> None:
        self._report = report
        self.phase, self.progress, self.message = display.phase, display.progress, display.message
        self._planned, self._point_done = display.planned, display.point_done
        self._last_s = time.monotonic()

    def planned(self, plan: Plan) -> None:
        """The plan was accepted: its points are to be run."""
        self._planned(plan)
        points = [planned.point for planned in plan.points]
        self._report.cases = {
            point.id: Case(_point_name(point), Outcome.SKIPPED, text="not run") for point in points
        }
        self._report.write_so_far()

    def point_done(self, result: PointResult) -> None:
        """A point has its verdict; of several attempts the last one counts until the end."""
        self._point_done(result)
        now_s = time.monotonic()
        self._report.cases[result.id] = point_case(result, now_s - self._last_s)
        self._last_s = now_s
        self._report.write_so_far()


def _point_name(point: TestPoint) -> str:
    """The name of a point's test, the same in a plan and in a run, so that a CI server shows its history."""
    return f"{point.id} {point.described}"


def point_case(point: PointResult, time_s: float, result: CampaignResult | None = None) -> Case:
    """A point as a test: a failure with its reasons, skipped if it was not run.

    Args:
        point: the point.
        time_s: how long it took (s).
        result: of the campaign, once it has ended: the point that was stopped is an error with the cause of the stop.
    """
    # both load numpy: not needed for the help
    from rig.campaign.results import NOT_RUN
    from rig.cli.words import error_words

    name = _point_name(point.point)
    if point.verdict == VALID:
        return Case(name, time_s=time_s)
    stop = None if result is None else result.stop
    if result is not None and stop is not None and stop.unfinished == point.id:
        return Case(name, Outcome.ERROR, stop.slug, "\n".join([error_words(result), *point.reasons]), time_s)
    if point.verdict == NOT_RUN:
        cause = result.stopped_by if result is not None else None
        return Case(name, Outcome.SKIPPED, text=f"not run: {cause}" if cause else "not run")
    slug = point.slugs[0] if point.reasons else point.verdict
    return Case(name, Outcome.FAILURE, slug, "\n".join([point.verdict, *point.reasons]), time_s)


def take_campaign(report: JUnitReport, result: CampaignResult, identified: tuple[bool, str | None] | None) -> None:
    """Put the result of a campaign and its identification into the report.

    Args:
        report: of the command.
        result: of the campaign.
        identified: whether there is a fit, and why there is none (None: the campaign was stopped before); None if no
            fit was requested.
    """
    # loads numpy: not needed for the help
    from rig.cli.words import error_words

    times_s = {name: case.time_s for name, case in report.cases.items()}
    report.cases = {point.id: point_case(point, times_s.get(point.id, 0.0), result) for point in result.points}
    report.properties["campaign"] = str(result.campaign)
    report.properties["rig_state"] = str(result.rig_state)
    report.output += [f"{finding.slug}: {finding.text}" for finding in result.findings]
    campaign = Case("campaign", time_s=result.wall_s)
    if result.stopped_by is not None or result.refused or result.detail:
        state = "" if result.stop is None else f"\n{result.stop.state_text}"
        campaign = Case("campaign", Outcome.ERROR, result.stopped_by or "refused", f"{error_words(result)}{state}")
    report.cases["campaign"] = campaign
    if identified is not None:
        fitted, error = identified
        skipped = not fitted and error is None
        outcome = Outcome.SKIPPED if skipped else Outcome.PASSED if error is None else Outcome.FAILURE
        text = error or "not run" * skipped
        report.cases["identification"] = Case("identification", outcome, "identification" * (not skipped), text)
    report.complete()  # the page may stay open for hours


def take_specimen(report: JUnitReport, specimen: SpecimenResult | None) -> None:
    """Put the verdict on the specimen into the report; nothing if the matrix has no acceptance bands."""
    if specimen is None:
        return
    outcomes = {SpecimenVerdict.OK: Outcome.PASSED, SpecimenVerdict.NOT_OK: Outcome.FAILURE}
    outcome, passed = outcomes.get(specimen.verdict, Outcome.ERROR), specimen.verdict == SpecimenVerdict.OK
    kind, text = ("", "") if passed else (str(specimen.verdict), specimen.reason)
    report.cases["specimen"] = Case(f"specimen {specimen.serial_number}".rstrip(), outcome, kind, text)
    report.complete()


def take_check(report: JUnitReport, check: CheckReport) -> None:
    """Put the devices of a check into the report: a failure with what failed and how to fix it."""
    report.properties["bench"] = check.bench
    report.cases = {device.name: _device_case(device) for device in check.devices}
    report.output += [
        f"{device.name}: {finding.severity.name.lower()}: {finding.slug}: {finding.text} -> {finding.fix}"
        for device in check.devices for finding in device.findings if finding.severity.name != "FAILED"
    ]


def _device_case(device: DeviceReport) -> Case:
    failed = [finding for finding in device.findings if finding.severity.name == "FAILED"]
    lines = [line for finding in failed for line in (f"{finding.slug}: {finding.text}", f"Fix: {finding.fix}")]
    return Case(device.name, Outcome.FAILURE, failed[0].slug, "\n".join(lines)) if failed else Case(device.name)


def take_plan(report: JUnitReport, plan: Plan) -> None:
    """Put the points of a plan into the report: a failure with the reasons if a point is outside the limits."""
    for planned in plan.planned_points:
        text = "\n".join(planned.reasons)
        outcome = Outcome.PASSED if planned.feasible else Outcome.FAILURE
        slug = "" if planned.feasible else planned.causes[0].slug
        report.cases[planned.point.id] = Case(_point_name(planned.point), outcome, slug, text)
    report.output += plan.warnings


def take_scenario(
    report: JUnitReport, seed: int, failed: Iterable[tuple[str, str, float]], repeat: str, time_s: float
) -> None:
    """Put a scenario into the report: a failure with the checks that failed (name, message, time in s)."""
    checks = list(failed)
    lines = [f"{at_s:.3f} s: {name}: {text}" for name, text, at_s in checks]
    case = Case(f"seed {seed}", time_s=time_s)
    if checks:
        case = Case(case.name, Outcome.FAILURE, checks[0][0], "\n".join([*lines, f"Repeat: {repeat}"]), time_s)
    report.cases[f"{seed}"] = case
    report.write_so_far()

