"""Where a command learns that damper models are being compiled; `rig.dampers.compiled_cache` reports it.

A module of its own, because a command sets it before it is known whether anything is compiled at all: numba is not
loaded for that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

TEXT = "Compiling damper models for this computer (first use only, up to 15 s on two idle cores) ..."


@dataclass
class Notice:
    """What is done while models are compiled.

    Attributes:
        report: called once in a process with `TEXT`, from another thread; None: nothing is reported.
        after_s: time spent on compiling, in all, after which it is called (s).
    """

    report: Callable[[str], None] | None = None
    after_s: float = 2.0


NOTICE = Notice()
