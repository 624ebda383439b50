"""The operator's signals become events and nothing else."""

from __future__ import annotations

import os
import signal
import threading

from rig.campaign.operator_link import operator_signals
from rig.campaign.sequencer import event as ev
from rig.faults.row import StopKind


def test_signals_become_aborts_in_order_and_the_process_lives() -> None:
    with operator_signals() as signals:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), number)
        aborts = signals.take()
        assert signals.take() == []
    assert all(isinstance(abort, ev.Abort) for abort in aborts)
    kinds = [(abort.stop, abort.cause.slug) for abort in aborts if isinstance(abort, ev.Abort)]
    pressure_off = (StopKind.PRESSURE_OFF, "sigterm")
    assert kinds == [(StopKind.FADE_OUT, "sigint"), pressure_off, pressure_off]


def test_handlers_are_given_back() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with operator_signals():
        assert signal.getsignal(signal.SIGINT) not in before
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


def test_outside_the_main_thread_nothing_is_caught_and_nothing_breaks() -> None:
    before, seen = signal.getsignal(signal.SIGINT), []

    def enter() -> None:
        with operator_signals() as signals:
            seen.append((signal.getsignal(signal.SIGINT), signals.take()))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert seen == [(before, [])]
