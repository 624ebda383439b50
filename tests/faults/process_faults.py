"""Faults put around the processes of a campaign: signals, a full disk, and the seams at clocks, flushes and threads."""

from __future__ import annotations

import os
import resource
from pathlib import Path
from typing import TYPE_CHECKING

from rig.clock import monotonic_ns

if TYPE_CHECKING:
    from watched_campaign import Campaign, Ending

SEAMS = Path(__file__).with_name("seams")
FULL_AT_BYTES = 1 << 16


def signalled(campaign: Campaign, number: int) -> Ending:
    """Send the application a signal and wait for the end."""
    sent_ns = campaign.now_ns
    campaign.send(number)
    return campaign.finish(sent_ns)


def fill_disk(campaign: Campaign) -> int:
    """No file of the application grows beyond `FULL_AT_BYTES` from now on; returns the host time (ns)."""
    now_ns = monotonic_ns()
    resource.prlimit(campaign.process.pid, resource.RLIMIT_FSIZE, (FULL_AT_BYTES, FULL_AT_BYTES))
    return now_ns


def seam_environment(folder: Path) -> dict[str, str]:
    """Environment of processes in which files in `folder` switch faults on (`seams/sitecustomize.py`)."""
    path = os.pathsep.join(filter(None, (str(SEAMS), os.environ.get("PYTHONPATH", ""))))
    return {"RIG_TEST_SEAM": str(folder), "PYTHONPATH": path}


def switch_on(seam: Path, fault: str, amount: float = 1.0) -> int:
    """Switch a fault of the seams on; returns the host time just before (ns)."""
    now_ns = monotonic_ns()
    partial = seam / f"{fault}.tmp"
    partial.write_text(f"{amount}", encoding="utf-8")
    partial.rename(seam / fault)
    return now_ns
