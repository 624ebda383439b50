"""A loop that stands still lets go of the station; one that turns does not."""

from __future__ import annotations

import threading

from rig.campaign.execution.loop_watch import LOOK_S, LoopWatch, TurnClock


def test_a_pause_of_the_loop_is_not_the_silence_of_another_process() -> None:
    """The computer was suspended for 1.6 s: the station woke with the loop and is heard first (seed 1012021)."""
    clock = TurnClock(longest_pause_s=0.5)
    clock.turn(5_000_000_000)
    clock.turn(5_400_000_000)
    assert clock.silent_ns(5_390_000_000) == 10_000_000
    clock.turn(7_010_000_000)
    assert clock.silent_ns(5_395_000_000) == 0
    for ms in range(7020, 8110, 10):
        clock.turn(1_000_000 * ms)
    assert clock.silent_ns(5_395_000_000) == 1_090_000_000, "a station that stays silent is found all the same"


def test_a_loop_that_stalls_lets_go_once() -> None:
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
