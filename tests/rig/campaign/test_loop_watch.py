"""A loop that stands still lets go of the station; one that turns does not."""

from __future__ import annotations

import threading

from rig.campaign.execution.loop_watch import LOOK_S, LoopWatch


def test_a_loop_that_stands_still_lets_go_once() -> None:
    let_go = threading.Event()
    watch = LoopWatch(let_go.set, longest_s=2 * LOOK_S)
    watch.turned()
    assert let_go.wait(20.0)
    watch.end()


def test_a_loop_that_turns_is_left_alone() -> None:
    let_go, over = threading.Event(), threading.Event()
    watch = LoopWatch(let_go.set, longest_s=4 * LOOK_S)
    for _ in range(30):
        watch.turned()
        over.wait(0.1)
    watch.end()
    assert not let_go.is_set()
