"""Where a command learns that damper models are being compiled; `rig.dampers.compiled_cache` reports it.

A module of its own, because a command sets it before it is known whether anything is compiled at all: numba is not
loaded for that.
"""

from __future__ import annotations

from collections.abc import Callable

AFTER_S = 2.0
TEXT = "Compiling damper models for this computer (first use only, up to 15 s on two idle cores) ..."

report: Callable[[str], None] | None = None
"""Called once in a process with `TEXT`, from another thread, when compiling has taken `AFTER_S` in all."""
