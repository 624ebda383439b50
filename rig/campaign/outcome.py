"""How a session ended, as a value: from the sequencer's last state and the books."""

from __future__ import annotations

from pathlib import Path

from rig.campaign.confirmation import CONFIRM, REQUALIFY, resume_class
from rig.campaign.options import CampaignResult, StopReport
from rig.campaign.resume import Stock
from rig.campaign.runner import Runner
from rig.campaign.state import RigState


def result_of(runner: Runner, folder: Path, stock: Stock) -> CampaignResult:
    """The result of a session that has ended.

    Args:
        runner: what ran it.
        folder: the campaign's directory.
        stock: what was kept of earlier sessions.
    """
    state, ledger = runner.state, runner.ledger
    cause = state.refused or (None if state.latch is None else state.latch.cause)
    return CampaignResult(
        campaign=folder,
        points=ledger.all_results(),
        valid=ledger.valid,
        total=len(ledger.points),
        rig_state=str(RigState(state.rig_state)),
        stopped_by=None if cause is None else cause.slug,
        detail="" if cause is None else cause.detail,
        refused=state.refused is not None,
        wall_s=ledger.wall_s,
        motion_s=ledger.motion_s,
        start_temperature_degC=ledger.start_temperature_degC,
        waits=tuple(ledger.waits),
        findings=runner.zeros.findings(),
        stop=_stop_report(runner),
        confirmed=tuple(stop.to_json() for stop in stock.confirmed),
    )


def _stop_report(runner: Runner) -> StopReport | None:
    """How the campaign was stopped; None when it ran to its end or was refused."""
    state = runner.state
    if state.latch is None or state.refused is not None:
        return None
    classes = {resume_class(slug) for slug in {state.latch.cause.slug, *runner.stop_causes}}
    return StopReport(
        kind=str(state.latch.stop),
        slug=state.latch.cause.slug,
        proved=state.rig_state is RigState.SAFE and (state.stopped or not state.pressurised),
        current_zero=runner.current_zero or not state.moved,
        pressure_off=state.rig_state is RigState.SAFE and not state.pressurised,
        moved=state.moved,
        unfinished=state.queue[0].id if state.queue else "",
        resume=REQUALIFY if REQUALIFY in classes else CONFIRM,
    )
