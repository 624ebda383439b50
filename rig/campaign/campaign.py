"""A whole campaign from two files to a directory of evaluated points: `run_campaign`."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drivers import clock
from drivers.roles import State as ControllerState
from rig.bench.model import Bench
from rig.campaign import resume
from rig.campaign.confirmation import CONFIRM, REQUALIFY, confirm, confirm_all, open_stops, resume_class
from rig.campaign.endurance import EnduranceBook
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.runner import Runner
from rig.campaign.file_copies import keep_bench
from rig.campaign.live_link import LiveLink
from rig.campaign.machine_resources import devices_of, station_in_use
from rig.campaign.manual_current import check_manual_current, manual_current_of
from rig.campaign.operator_link import Signals, operator_link
from rig.campaign.preflight.proof_move import read_baseline
from rig.campaign.preflight.rest_check import tolerances_of
from rig.campaign.preflight.zero_return import current_left, zeros_returned
from rig.campaign.results import CampaignOptions, CampaignResult, Display, RigState, StopReport
from rig.campaign.resume import Stock
from rig.campaign.setup import (
    accepted,
    campaign_folder,
    check_calibrations,
    note_session,
    plan_digest,
    same_plan,
    write_description,
)
from rig.campaign.simulated_rig import rig_in_use
from rig.campaign.words import say
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.errors import FileProblem, RigError, UnknownRigState
from rig.faults.row import StopKind
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import Plan
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.journal.campaign_log import CampaignLog

DISK = frozenset({"disk-full", "dir-readonly", "fsync-error"})
TRUTH_AFTER_STOP_S = 1.0
"""What a simulated rig's truth still shows after a stop (s, its own clock): the coil empty, the rod at rest."""


@clock.restored()
def run_campaign(
    options: CampaignOptions, display: Display, live: LiveLink | None = None,
    judged: Callable[[CampaignResult], None] = lambda _result: None,
) -> CampaignResult:
    """Plan a matrix, run it on the bench or on a simulated rig, record and judge every point.

    Args:
        options: which matrix, which rig, where to.
        display: what the operator sees meanwhile.
        live: where pages read and ask; None without any.
        judged: called with the result as soon as the rig is shut down and every point has its verdict, while processes
            and files of the campaign are still being closed.

    Returns:
        How it ended; also when the rig refused at connect or preflight, was stopped, or is in an unknown state.

    Raises:
        FileProblem: matrix or bench file cannot be used, or there is no campaign to resume; nothing was connected.
        Refused: a matrix or bench that is not the resumed campaign's, a campaign that still runs, infeasible points,
            no room on the disk, a locked rig, a simulated rig that does not start.
        UnknownRigState: this process failed twice over; the station was left to stop the rig by itself.
        RigError: `options` name neither or both of bench and simulation.
    """
    if options.resume_path is not None:
        earlier = options.resume_path.resolve()
        options = resume.as_before(earlier, replace(options, resume_path=earlier))
    if (options.bench_path is None) != options.simulate:
        raise RigError("expected either a bench file or --simulate, got both or neither")
    with options.files:
        matrix, known = _as_planned(options)
    if live is not None:
        live.belongs_to((options.resume_path or options.out / "run").parent, () if known is None else devices_of(known))
    if known is not None:
        if options.resume_path is not None:
            resume.same_campaign(options.resume_path, known, matrix)
        accepted(matrix, known)
        check_manual_current(known, attended=options.attended or _paged(live) is not None)
    with operator_link(display, live) as (signals, shown), contextlib.ExitStack() as ends:
        log, locks = ends.enter_context(campaign_folder(options, matrix, known, shown))
        folder = log.path.parent
        if live is not None:
            ends.enter_context(live.following(log))
        stock, endurance = _stock(folder, options, matrix, log, shown)
        if not stock.remaining:
            ended = _nothing_left(folder, matrix, stock, endurance)
            judged(ended)
            return ended
        signals.check()
        finaliser = Finaliser.start(folder)
        ends.callback(_or_say, shown, finaliser.close)
        if options.simulate:
            shown.phase("starting the simulated rig")
        rig = ends.enter_context(rig_in_use(folder, options, matrix.specimen, shown, signals.check))
        with options.files:
            bench = Bench.load(rig.bench_path)
        start = _Start(folder, matrix, bench, accepted(matrix, bench, folder), options, stock, endurance)
        _describe(start, rig.bench_path)
        options.files.forget()
        _show_start(start, log, shown)
        signals.check()
        ended = _run(start, locks, log, finaliser, signals, shown)
        if ended.rig_state is RigState.UNKNOWN:
            rig.settle_s = _dead_men_s(bench, start.plan)
        elif ended.stopped_by is not None:
            rig.settle_s = TRUTH_AFTER_STOP_S / bench.clock.device_rate
        rig.disk_refuses = ended.stopped_by in DISK
        judged(ended)
        return ended


def _as_planned(options: CampaignOptions) -> tuple[Matrix, Bench | None]:
    """The matrix, and the bench if it is known.

    Raises:
        FileProblem: one of the files cannot be used.
        Refused: they are not those of the plan that the operator saw.
    """
    matrix = load_matrix(options.matrix_path)
    bench = None if options.bench_path is None else Bench.load(options.bench_path)
    if options.planned and options.bench_path is not None and bench is not None:
        same_plan(options.planned, plan_digest(options.matrix_path, options.bench_path, matrix, bench))
    return matrix.of_specimen(options.serial_number), bench


def _paged(live: LiveLink | None) -> LiveLink | None:
    """The live folder where a page is served with the campaign: an operator can be asked there."""
    return live if live is not None and live.paged else None


def _show_start(start: _Start, log: CampaignLog, display: Display) -> None:
    """Show the plan, overdue calibrations, and the points that are kept."""
    display.planned(start.plan)
    for warning in check_calibrations(start.bench, utc_now().date()):
        log.write("warning", slug="calibration-overdue", text=warning)
        display.message("warning", f"calibration-overdue: {warning}")
    for result in start.stock.results:
        display.point_done(result)


def _stock(
    folder: Path, options: CampaignOptions, matrix: Matrix, log: CampaignLog, display: Display
) -> tuple[Stock, EnduranceBook]:
    """What is there and what remains: all of a new campaign; what is not valid yet of an earlier one.

    Raises:
        Refused: the matrix is not the earlier campaign's, or a stop of an earlier session demands a requalification.
    """
    if options.resume_path is None:
        return Stock(matrix.points()), EnduranceBook(folder, matrix)
    resume.same_matrix(folder, matrix)
    stops = open_stops(folder)
    confirm_all(stops, options.confirmed)
    confirm(stops, options.requalified)
    display.phase("checking the previous session")
    stock = replace(resume.take_stock(folder, matrix.points()), confirmed=stops)
    endurance = EnduranceBook(folder, matrix, resume.attempts_begun(folder) if matrix.endurance else {})
    stock = resume.with_blocks_counted(stock, matrix.points(), endurance)
    confirmed = [stop.to_json() for stop in stops]
    if options.requalified:
        log.write("requalified", text=options.requalified, after=[stop.slug for stop in stops])
        display.message("info", say("requalified", text=options.requalified))
    for stop in stops:
        display.message("info", say("resume-confirms", text=stop.text))
    log.write(
        "resumed", kept=[result.id for result in stock.results], remaining=[point.id for point in stock.remaining],
        confirmed=confirmed,
    )
    if options.simulate and (names := resume.left_out(folder)):
        text = say("without-options", names=", ".join(names))
        log.write("info", text=text)
        display.message("info", text)
    for problem in (*stock.problems, *endurance.problems):
        log.write("warning", text=problem)
        display.message("warning", problem)
    display.message("info", say("resuming", kept=len(stock.results), left=len(stock.remaining)))
    endurance.save()
    return stock, endurance


def _nothing_left(folder: Path, matrix: Matrix, stock: Stock, endurance: EnduranceBook) -> CampaignResult:
    books = stock.books(matrix.points())
    books.withdraw(endurance.withdrawn)
    confirmed = tuple(stop.to_json() for stop in stock.confirmed)
    return replace(books.session(folder), confirmed=confirmed, endurance=tuple(endurance.to_json()))


def _describe(start: _Start, bench_path: Path) -> None:
    """Keep the bench file and the description of a new campaign, or enter a further session of an earlier one.

    Raises:
        Refused: they cannot be written, or the rig is not the earlier campaign's.
        FileProblem: the earlier campaign's description or the bench file cannot be read.
    """
    folder = start.folder
    if start.options.resume_path is None or resume.bench_is_new(folder):
        with start.options.files:
            keep_bench(bench_path, CampaignFolder(folder).bench)
        write_description(folder, start.bench, start.matrix, start.options)
        return
    resume.same_campaign(folder, start.bench, start.matrix)
    session = note_session(folder, start.options, start.stock.confirmed)
    with start.options.files:
        keep_bench(bench_path, CampaignFolder(folder).session_bench(session))


@dataclass(frozen=True)
class _Start:
    """What is fixed before the station starts."""

    folder: Path
    matrix: Matrix
    bench: Bench
    plan: Plan
    options: CampaignOptions
    stock: Stock
    endurance: EnduranceBook


def _or_say(display: Display, what: Callable[[], None]) -> None:
    """Do what belongs to the end of a campaign; a disk that refuses it takes nothing from the result."""
    try:
        what()
    except (OSError, FileProblem, subprocess.TimeoutExpired) as error:
        display.message("error", say("at-the-end", error=error))


def _dead_men_s(bench: Bench, plan: Plan) -> float:
    """How long the controller needs to notice a silent host, fade out and hold (wall s), with a second to spare."""
    period_s = max(1.0 / item.point.frequency_Hz for item in plan.points)
    fade_s = (bench.actuator.fade_out_cycles + 1.0) * period_s
    return bench.actuator.watchdog_s + fade_s / bench.clock.device_rate + 1.0


def _run(
    start: _Start,
    locks: tuple[int, ...],
    log: CampaignLog,
    finaliser: Finaliser,
    signals: Signals,
    display: Display,
) -> CampaignResult:
    baseline = read_baseline(start.folder, points_kept=bool(start.stock.results))
    points = tuple(item.point for item in start.plan.points)
    display.phase("starting the station")
    live = signals.live
    if live is not None:
        live.confirm = tuple(stop.to_json() for stop in start.stock.confirmed)
    stop_socket = "" if live is None else live.station_socket
    prepared = start.options.prepared.station
    with station_in_use(start.bench, start.matrix, start.folder, locks, stop_socket, prepared) as (client, config):
        campaign = CampaignContext(
            folder=start.folder,
            bench=start.bench,
            matrix=start.matrix,
            plan=start.plan,
            point_ids=tuple(point.id for point in points),
            config=config,
            client=client,
            log=log,
            display=display,
            simulated=start.options.simulate,
            stock=start.stock,
            results=start.stock.books(points),
            endurance=start.endurance,
            hand=manual_current_of(start.bench, attended=start.options.attended, live=_paged(live)),
        )
        campaign.results.withdraw(start.endurance.withdrawn)
        try:
            runner = Runner(campaign, signals, finaliser, baseline)
            runner.run()
        except Exception as error:
            client.close()
            text = f"the campaign loop failed; the station is stopping the rig: {error!r}"
            _or_say(display, lambda: log.write("ended", rig_state="unknown", text=text))
            raise UnknownRigState(text) from error
        client.close()
    result = _result_of(runner, campaign)
    for finding in result.findings:
        fields = finding.to_json()
        _or_say(display, partial(log.write, "finding", **fields))
        display.message("warning", f"{finding.slug}: {finding.text}")
    refused = runner.state.refused
    if refused is not None:
        _or_say(display, lambda: log.write("refused", slug=refused.slug, text=refused.detail))
    _or_say(display, lambda: log.write("result", **result.to_json(), detail=result.detail))
    return result


def _result_of(runner: Runner, campaign: CampaignContext) -> CampaignResult:
    """The result of a session that has ended; the zeros at its end are judged first, for the points' verdicts."""
    state = runner.state
    findings, stop = zeros_returned(runner.zeros, campaign), _stop_report(runner)
    left = current_left(runner.current_left_A)
    if left is None and stop is not None and not stop.current_zero:
        left = runner.zeros.force_left(tolerances_of(campaign.bench, campaign.plan).force_zero_N)
    not_proved = stop is not None and stop.moved and not (runner.safe or stop.current_zero)
    cause = state.refused or (None if state.latch is None else state.latch.cause)
    return replace(
        campaign.results.session(campaign.folder),
        endurance=tuple(campaign.endurance.to_json()),
        rig_state=RigState.UNKNOWN if left is not None or not_proved else state.rig_state,
        stopped_by=None if cause is None else cause.slug,
        detail="" if cause is None else cause.detail,
        refused=state.refused is not None,
        findings=findings if left is None else (*findings, left),
        stop=stop,
        confirmed=tuple(stop.to_json() for stop in campaign.stock.confirmed),
    )


def _stop_report(runner: Runner) -> StopReport | None:
    """How the campaign was stopped; None when it ran to its end or was refused."""
    state = runner.state
    if state.latch is None or state.refused is not None:
        return None
    gone = (not state.pressurised or runner.pressure == "off") and not runner.without_hydraulics
    zero = runner.current_zero or not state.moved or (state.hand_A == 0.0 and not state.hand_flows)
    classes = {resume_class(slug) for slug in {state.latch.cause.slug, *runner.stop_causes}}
    return StopReport(
        kind=str(state.latch.stop),
        slug=state.latch.cause.slug,
        proved=runner.standstill or (state.rig_state is RigState.SAFE and not state.pressurised),
        current_zero=zero and runner.current_left_A is None,
        current_left_A=runner.current_left_A,
        current_timeout_s=runner.current_timeout_s,
        pressure_off=gone,
        pressure="none" if runner.without_hydraulics else "off" if gone else runner.pressure,
        moved=state.moved,
        unfinished=state.queue[0].id if state.queue else "",
        resume=REQUALIFY if REQUALIFY in classes else CONFIRM,
        halted=state.latch.stop is StopKind.HALT or ControllerState.HALTING in runner.ended_by,
        faded=ControllerState.FADING in runner.ended_by,
    )
