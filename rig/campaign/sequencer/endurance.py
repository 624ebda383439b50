"""Sequencer: blocks of an endurance test.

A block stays first in the queue until its file states what is left of it: nothing moves meanwhile. An interrupted block
goes on with the cycles that are left, so that no cycle is counted twice; a stop rule that was reached ends the test,
and only its last performance points follow.
"""

from __future__ import annotations

from dataclasses import replace

from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.state import State
from rig.campaign.sequencer.stopping import Step
from rig.campaign.words import say
from rig.signals.repeated_record import RepeatedRecord
from rig.test_point import ENDURANCE, TestPoint


def awaited(state: State) -> bool:
    """Whether the current point is a block whose file is being written and counted."""
    return bool(state.queue) and state.point.kind == ENDURANCE and state.point.id in state.unjudged


def left_of(point: TestPoint, cycles_left: int) -> TestPoint:
    """A block of which only so many cycles are left."""
    step, record = point.endurance, point.record
    if isinstance(record, RepeatedRecord):
        record = record.of_cycles(cycles_left)
    done = round(point.cycles) - cycles_left
    return replace(
        point, cycles=cycles_left, record=record,
        endurance=None if step is None else step._replace(cycles_before=step.cycles_before + done),
    )


def without_rest_of(queue: tuple[TestPoint, ...], test: str, cycles_run: int) -> tuple[TestPoint, ...]:
    """The points that remain when a test ends early: of its own only the performance points at its end."""
    kept = []
    for point in queue:
        step = point.endurance
        if step is None or step.test != test:
            kept.append(point)
        elif not step.block and step.cycles_before == step.total:
            kept.append(replace(point, endurance=step._replace(cycles_before=cycles_run)))
    return tuple(kept)


def counted(state: State, event: ev.Judged, block: ev.BlockCounted) -> Step:
    """Take what the file of a block says: go on with what is left, with the next point, or end the test."""
    if event.point_id not in state.unjudged:
        return state, ()
    state = replace(state, unjudged=tuple(name for name in state.unjudged if name != event.point_id))
    if not state.queue or state.point.id != event.point_id:
        return state, ()
    point, rest = state.point, state.queue[1:]
    if block.ended_by and point.endurance is not None:
        queue = without_rest_of(rest, point.endurance.test, block.cycles_run)
        kept = {left.id for left in queue}
        gone = tuple(left.id for left in rest if left.id not in kept)
        text = say("endurance-ended", test=point.endurance.test, rule=block.ended_by, cycles=block.cycles_run)
        withdraw = act.Withdraw(point.endurance.test, gone)
        return replace(state, queue=queue), (withdraw, act.Note("info", text, code="endurance"))
    if block.cycles_left == 0:
        return replace(state, queue=rest), ()
    if state.latch is None and state.attempts.count(point.id) > state.retries:
        return replace(state, queue=rest), ()  # it cannot be recorded; its verdict says why
    return replace(state, queue=(left_of(point, block.cycles_left), *rest)), ()
