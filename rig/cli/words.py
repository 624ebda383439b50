"""How a campaign ended, as text: cause of the stop, the rig's state, what is not finished, how to continue."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rig.campaign.confirmation import resume_command
from rig.campaign.results import NOT_RUN, RigState
from rig.campaign.stop_cause import OPERATOR, StopCause
from rig.recording.endurance import RUNNING
from rig.test_point import ENDURANCE
from rig.verdicts import INVALID, VALID

if TYPE_CHECKING:
    from rig.campaign.results import CampaignResult, PointResult, StopReport

UNKNOWN = "THE RIG'S STATE IS UNKNOWN: {not_proved} could not be confirmed. Inspect the rig before continuing."


def ending(result: CampaignResult, again: str = "") -> list[tuple[str, str]]:
    """Lines for the operator, each with its style (of rich); none for a campaign that ran to its end, all valid.

    Args:
        result: of the campaign.
        again: what the operator types to repeat the test; empty: the command that resumes this campaign.
    """
    stop = result.stop
    lines: list[tuple[str, str]] = []
    if result.rig_state == RigState.UNKNOWN:
        flows = any(finding.slug == "current-left" for finding in result.findings)
        unproved = stop.not_proved if stop is not None else ("0 A",) if flows else ()
        lines.append(("bold red", UNKNOWN.format(not_proved=" and ".join(unproved) or "standstill or 0 A")))
    if result.refused:
        lines.append(("red", f"Refused before motion: {result.stopped_by}: {result.detail}"))
        command = again or resume_command(result.campaign)
        lines.append(("", f"Once the cause has been eliminated, continue with: {command}"))
    elif stop is not None:
        command = again or resume_command(result.campaign, stop.resume)
        text = f"{stopped_by(stop, result.detail)}: {stop.state_text}. {left(stop, result)} Continue with: {command}"
        lines.append(("yellow" if stop.slug in OPERATOR else "red", text))
    elif result.stopped_by is not None:
        lines.append(("red", f"Stopped by {result.stopped_by}: {result.detail}"))
    elif result.valid < result.total:
        lines += [("yellow", text) for text in _not_valid(result, again)]
    lines += [("yellow", f"{finding.slug}: {finding.text}") for finding in result.findings]
    return lines


def _not_valid(result: CampaignResult, again: str) -> Iterator[str]:
    """Points that are not valid: those that can be run again, and blocks of endurance tests, whose cycles were run."""
    final = {test["id"] for test in result.endurance if test["state"] != RUNNING}
    blocks = sum(
        point.verdict not in {VALID, NOT_RUN} and point.point.kind == ENDURANCE and point.point.endurance is not None
        and point.point.endurance.test in final
        for point in result.points
    )
    if blocks:
        which, whose = ("1 block", "Its") if blocks == 1 else (f"{blocks} blocks", "Their")
        yield (
            f"{which} of endurance tests {'is' if blocks == 1 else 'are'} not valid; the report states the reasons. "
            f"{whose} cycles were run and are not repeated."
        )
    missing = result.total - result.valid - blocks
    if missing:
        what = "1 point is not valid. Run it" if missing == 1 else f"{missing} points are not valid. Run them"
        yield f"{what} again with: {again or resume_command(result.campaign)}"


def stopped_by(stop: StopReport, detail: str) -> str:
    """Who or what stopped the campaign."""
    if stop.slug in OPERATOR:
        return f"Stopped by operator ({detail})"
    return f"Stopped by {stop.slug} ({stop.kind}), {detail}" if detail else f"Stopped by {stop.slug} ({stop.kind})"


def left(stop: StopReport, result: CampaignResult) -> str:
    """What is not finished."""
    waiting = sum(point.verdict == NOT_RUN for point in result.points)
    parts = [f"{stop.unfinished} not finished"] if stop.unfinished else []
    if stop.unfinished and any(point.id == stop.unfinished and point.verdict == NOT_RUN for point in result.points):
        waiting -= 1
    if waiting > 0:
        parts.append("1 point not started" if waiting == 1 else f"{waiting} points not started")
    return f"{', '.join(parts) or 'All points were run'}."


def verdict_words(result: PointResult) -> str:
    """A point's verdict and its reasons; a point that the operator stopped has no fault."""
    if result.verdict == INVALID and not OPERATOR.isdisjoint(result.slugs):
        return "not finished: stopped by the operator"
    return "; ".join((result.verdict, *result.reasons))


def error_words(result: CampaignResult) -> str:
    """The `error` of `rig run --json`."""
    cause = StopCause(result.stopped_by or "", result.detail)
    return f"stopped by operator ({cause.detail})" if cause.slug in OPERATOR else cause.detail
