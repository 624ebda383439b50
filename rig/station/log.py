"""Lines for readers of the station's log. A full disk or a closed pipe must never prevent a stop."""

from __future__ import annotations

import contextlib
import os
import traceback

STANDARD_ERROR = 2


def say(line: str) -> None:
    """Write a line to standard error, unbuffered; what cannot be written is lost, and nothing else is."""
    # There is no reader left; what matters goes over the link as well.
    with contextlib.suppress(OSError):
        os.write(STANDARD_ERROR, f"{line}\n".encode(errors="replace"))


def say_error() -> None:
    """Write the traceback of the exception that is being handled."""
    say(traceback.format_exc())
