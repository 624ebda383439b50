"""One fault as a row of data, and its possible consequences."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, EXIT_REFUSED, EXIT_STOPPED, EXIT_UNKNOWN_STATE, EXIT_USAGE

PROVED_BY = "test_every_row.py::test_every_row_ends_as_the_matrix_says"
UNUSABLE_FILES = frozenset({"config-absurd"})
"""Refused while the file is read, as every file with wrong entries: the user corrects the file, not the rig."""


class StopKind(StrEnum):
    """How the rig is stopped, weakest first; the values are those of files and JSON.

    FADE_OUT (S2): current to 0 A, the controller fades out, hold powered. HALT (SO), where the position is no longer
    trusted: current to 0 A and the controller's open-loop halt ramp. PRESSURE_OFF (S1): as FADE_OUT, then hydraulics
    off.
    """

    FADE_OUT = "S2"
    HALT = "SO"
    PRESSURE_OFF = "S1"

    @property
    def severity(self) -> int:
        """Rank: a stop under way is only ever replaced by one of a higher rank."""
        return list(StopKind).index(self)


class Ending(StrEnum):
    """How a fault ends that stops nothing."""

    WARN = "W"
    INVALID = "P"
    """The running point is invalid."""
    REFUSE = "R"
    """Refused before anything moves."""


EXIT_CODES = {Ending.WARN: EXIT_DONE, Ending.INVALID: EXIT_NOT_ALL_VALID, Ending.REFUSE: EXIT_REFUSED}


@dataclass(frozen=True, kw_only=True)
class FaultRow:
    """One fault.

    A row with `where` stands in the fault matrix; a row with a `code` is something the station trips on or warns of.

    Attributes:
        slug: name in options, events, journal and test ids.
        end: how the fault ends when it stays.
        fault: what goes wrong.
        where: "wire", injected by the simulated rig (`--fault SLUG@T`), or "process", injected around the processes.
        place: what is hit: "modbus", "rtu", "controller", "can", "ecu", "sensor", "specimen" on the wire; "signal",
            "silence", "starvation", "clock", "disk", "port look-up", "process", "file" around it.
        detected_by: how the host notices, by the matrix.
        limit_s: longest time from the fault to the stop command or flag (s), at speed 1 with real-time rights; None
            where an occasion is the limit.
        occasion: what the time counts from, or the occasion itself ("preflight", "load").
        reaction: R refuse, W warn, P invalid point, S2, S1, SO stops, HW the hard-wired chain; in words.
        disk: J journal and INVALID, K the last flush survives, N a refusal record only.
        resume: a automatic, c the operator confirms, n re-qualify.
        reason: why a row without a test cannot have one on an ordinary machine.
        code: of the ring's `TRIP` record, unique; 0 where the station has no detector.
        detector: who in the station sees it, and how.
        halt: a FADE_OUT whose stop is the halt ramp, because a hard limit was hit.
        current_stays: a current is measured until the end, and no command takes it away: the rig's state is unknown.
    """

    slug: str
    end: StopKind | Ending
    fault: str = ""
    where: str = ""
    place: str = ""
    detected_by: str = ""
    limit_s: float | None = None
    occasion: str = ""
    reaction: str = ""
    disk: str = ""
    resume: str = ""
    reason: str = ""
    code: int = 0
    detector: str = ""
    halt: bool = False
    current_stays: bool = False

    @property
    def stop(self) -> StopKind | None:
        """The stop that the station makes of it; None where it only warns, spoils or refuses."""
        return self.end if isinstance(self.end, StopKind) else None

    @property
    def limit(self) -> str:
        """The limit for people: a time, an occasion, or a time from an occasion."""
        if self.limit_s is None:
            return self.occasion
        time = f"{1e3 * self.limit_s:g}ms" if self.limit_s < 1.0 else f"{self.limit_s:g}s"
        return f"{self.occasion}{time}"

    @property
    def exit_code(self) -> int:
        """Exit code of `rig run` when the fault stays: the end's, but for a file of no use that of bad files."""
        if self.slug in UNUSABLE_FILES:
            return EXIT_USAGE
        if self.current_stays:
            return EXIT_UNKNOWN_STATE
        return EXIT_CODES[self.end] if isinstance(self.end, Ending) else EXIT_STOPPED

    @property
    def tested(self) -> bool:
        """The fault suite proves its end state."""
        return bool(self.where) and not self.reason

    @property
    def test(self) -> str:
        """File and test in `tests/faults` that prove the end state; empty where there is none."""
        return f"{PROVED_BY}[{self.slug}]" if self.tested else ""
