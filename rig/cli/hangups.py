"""The end of the terminal interrupts a command as Ctrl-C does. Loads nothing, for commands without a campaign."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

NAMES = ("SIGHUP", "SIGTERM")
"""Of the signals; Windows has no SIGHUP."""


@contextmanager
def hangups_interrupt() -> Iterator[None]:
    """While the block runs, the end of the terminal or SIGTERM interrupts it as Ctrl-C does.

    A campaign has handlers of its own while it lasts; before and after it the rig is at rest.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
