"""Notice to a command that it has to wait.

Damper models are being compiled (reported by `rig.dampers.compiled_cache`), or no worker of a Dask scheduler is
connected yet (`rig.jobs.cluster`).

This is a separate module, because a command sets the notice before it is known whether anything is compiled; numba is
not loaded for this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

TEXT = "Compiling damper models for this computer (first use only, up to 15 s on two idle cores) ..."


@dataclass
class Notice:
    """Callback for the reason of a wait.

    Attributes:
        report: called with one line of text: once per process with `TEXT`, from another thread, and once per connection
            to a scheduler without workers; None: nothing is reported.
        after_s: total compilation time after which `report` is called (s).
    """

    report: Callable[[str], None] | None = None
    after_s: float = 2.0


NOTICE = Notice()
