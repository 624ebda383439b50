"""How each row of the fault matrix is brought about from the command line only.

On the wire: `python -m simulators --fault SLUG@T`. Around the processes: signals, a full disk and the seams of the
fault suite, switched on while the second point moves. Rows of files and folders have no moment; the suite proves them.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

FAULT_SUITE = Path(__file__).parents[1] / "tests" / "faults"
sys.path.append(str(FAULT_SUITE))

from matrices import BRISK_POINTS, LONG_SECOND_POINT, ONE_LONG_POINT, TWO_POINTS  # noqa: E402 - found by the line above
from process_faults import fill_disk, seam_environment, switch_on  # noqa: E402
from watched_campaign import RIG, Campaign  # noqa: E402

from rig.clock import monotonic_ns  # noqa: E402
from rig.faults.matrix import MATRIX  # noqa: E402
from rig.faults.row import FaultRow  # noqa: E402

INTO_POINT_2_S = 3.2
"""With `BRISK_POINTS` at speed 1: the second point's cycles have begun, the rest of it is still to come."""
Inject = Callable[[Campaign, Path], int]
"""Brings a fault about in a campaign in motion, with a folder for the seams; returns the host time just before (ns)."""


@dataclass(frozen=True)
class Matrix:
    """A matrix file's text, how many points it has, the period and the motion of the last one (s)."""

    text: str
    points: int
    period_s: float
    motion_s: float


BRISK = Matrix(BRISK_POINTS, 2, 0.25, 2.0)
TWO = Matrix(TWO_POINTS, 2, 0.5, 4.0)
LONG = Matrix(LONG_SECOND_POINT, 2, 0.5, 31.0)
ONE_LONG = Matrix(ONE_LONG_POINT, 1, 0.5, 15.0)


@dataclass(frozen=True)
class Case:
    """One row as a stranger meets it.

    Attributes:
        row: the row.
        faults: arguments of the simulated rig.
        matrix: what is run.
        inject: for rows around the processes.
        program: what is run instead of `rig`.
        timed_from: "fault"; "zero", the 0 A command; "end", the end of the running program.
    """

    row: FaultRow
    faults: tuple[str, ...] = ()
    matrix: Matrix = BRISK
    inject: Inject | None = None
    program: tuple[str, ...] = (RIG,)
    timed_from: str = "fault"

    @property
    def cause(self) -> str:
        """The slug under which the campaign ends."""
        return CAUSES.get(self.row.slug, self.row.slug)


def _signal(*numbers: int) -> Inject:
    def inject(campaign: Campaign, seam: Path) -> int:
        del seam
        now_ns = monotonic_ns()
        for number in numbers:
            campaign.process.send_signal(number)
        return now_ns

    return inject


def _stand_still(campaign: Campaign, seam: Path) -> int:
    """The application is not scheduled until the rig was stopped without it."""
    del seam
    now_ns = monotonic_ns()
    campaign.process.send_signal(signal.SIGSTOP)
    campaign.wait_for("FADE_STOP")
    campaign.process.send_signal(signal.SIGCONT)
    return now_ns


def _fall_silent(campaign: Campaign, seam: Path) -> int:
    """The station is not scheduled until the controller has tripped by itself: the second time, after the proof."""
    del seam
    station, now_ns = campaign.station_pid(), monotonic_ns()
    os.kill(station, signal.SIGSTOP)
    campaign.wait_for("TRIP", "WATCHDOG", count=2)
    os.kill(station, signal.SIGCONT)
    return now_ns


def _seam(fault: str, amount: float = 1.0) -> Inject:
    return lambda _, seam: switch_on(seam, fault, amount)


AROUND: dict[str, Inject] = {
    "sigint": _signal(signal.SIGINT),
    "sigint-storm": _signal(*[signal.SIGINT] * 10),
    "sigterm": _signal(signal.SIGTERM),
    "sigkill": _signal(signal.SIGKILL),
    "host-stalled": _stand_still,
    "host-silent": _fall_silent,
    "host-suspend": _seam("host-suspend", 3600.0),
    "clock-step": _seam("clock-step", -86400.0),
    "task-dies": _seam("task-dies"),
    "fsync-error": _seam("fsync-error"),
    "disk-full": lambda campaign, _: fill_disk(campaign),
}
FROM_THE_START = frozenset({"preflight", "connect", "load", "start", "before first move"})
LONG_WAITS = frozenset({"host-stalled", "host-silent", "disk-full"})
PASSING = {"rtu-stale": "+0.5"}
"""Faults that are there for a while; the others stay."""
CAUSES = {"sigint-storm": "sigint"}
"""Rows whose stop has another one's cause: what comes after the first Ctrl-C changes nothing."""
TIMED_FROM = {"current-stuck": "zero", "stop-ignored": "end"}


def case_of(slug: str) -> Case | None:
    """How a row is brought about here; None where there is nothing to run against a moving rig."""
    row = MATRIX[slug]
    timed_from = TIMED_FROM.get(slug, "fault")
    if row.where == "wire":
        at = "" if row.limit in FROM_THE_START else f"@{INTO_POINT_2_S}{PASSING.get(slug, '')}"
        if slug == "clock-drift":
            return Case(row, ("--fault", "clock-drift@1"), ONE_LONG)
        return Case(row, ("--fault", slug + at), timed_from=timed_from)
    if slug == "slow-consumer":
        return Case(row, matrix=TWO, program=(sys.executable, str(FAULT_SUITE / "slow_disk.py")))
    if slug in AROUND:
        return Case(row, matrix=LONG if slug in LONG_WAITS else BRISK, inject=AROUND[slug])
    return None


def environment(seam: Path) -> dict[str, str]:
    """The environment in which files in `seam` switch faults on."""
    return os.environ | seam_environment(seam)
