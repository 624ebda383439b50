"""What holds for every test."""

from __future__ import annotations

import signal

# A shell that starts a program in the background has it ignore Ctrl-C, and so would every process these tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)
