"""Interlocks on the coil's current and on its bus; pure, no clock, no I/O."""

from __future__ import annotations

import math

from drivers.ecu import EcuCounters
from protocols.ecu import CoilStatus
from rig.station.interlocks import CONSECUTIVE, Finding

SETTLED_STATUSES = 15
"""Status frames (10 ms each on the ECU's clock) that a new set-point is given before it is compared."""
ZERO_A = 0.05
TRACKING_A = 0.05
TRACKING_SHARE = 0.05
LATE = 4
"""Three repeated status frames, each followed by a fresh one."""
FULL_BUS = 0.7
BUS_WINDOW_NS = 50_000_000


class CurrentJudge:
    """Compares the measured current with the commanded one, once a new set-point has had its time.

    Args (construction):
        patience_ns: wall time which a command and its effect may take on the wires.
    """

    def __init__(self, patience_ns: int) -> None:
        self._patience_ns = patience_ns
        self._set_point = (math.nan, 0)
        self._since_ns = 0
        self._statuses = 0
        self._off = 0

    def judge(self, status: CoilStatus, commanded_A: float, t_ns: int, set_points: int = 0) -> list[Finding]:
        """Take one status.

        Args:
            status: the ECU's status.
            commanded_A: what the command frames ask for (A).
            t_ns: host arrival of the status.
            set_points: how many there were so far: one may come and go between two statuses, its current does not.
        """
        if self._set_point != (commanded_A, set_points):
            self._set_point, self._since_ns, self._statuses, self._off = (commanded_A, set_points), t_ns, 0, 0
        self._statuses += 1
        if self._statuses <= SETTLED_STATUSES or t_ns - self._since_ns < self._patience_ns:
            return []
        allowed_A = ZERO_A if commanded_A == 0.0 else TRACKING_A + TRACKING_SHARE * abs(commanded_A)
        error_A = abs(status.current_A - commanded_A)
        self._off = self._off + 1 if error_A > allowed_A else 0
        if self._off != CONSECUTIVE:
            return []
        slug = "current-stuck" if commanded_A == 0.0 else "current-tracking"
        detail = f"measured {status.current_A:.3f} A, commanded {commanded_A:.3f} A, allowed {allowed_A:.3f} A apart"
        return [Finding(slug, detail, t_ns, status.current_A, commanded_A)]


class BusJudge:
    """Follows what the ECU's driver counts: frames dropped, repeated, left out, and what others send.

    Args (construction):
        bitrate: of the bus, bit/s.
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._bad = 0
        self._duplicates = 0
        self._lost = 0
        self._foreign = 0
        self._bits = 0
        self._window_ns = 0

    def forget_foreign(self, counted: EcuCounters) -> None:
        """Other senders on our command id count from now on."""
        self._foreign = counted.foreign_commands

    def judge(self, counted: EcuCounters, t_ns: int) -> list[Finding]:
        """Take the counters as they stand after a read that ended at `t_ns` (host monotonic)."""
        findings = [*self._frames(counted, t_ns), *self._load(counted, t_ns)]
        if counted.foreign_commands > self._foreign:
            detail = f"{counted.foreign_commands - self._foreign} frames of another sender on our command id"
            findings.append(Finding("can-foreign", detail, t_ns))
        return findings

    def _frames(self, counted: EcuCounters, t_ns: int) -> list[Finding]:
        findings = []
        bad = counted.bad_checks + counted.malformed
        if counted.bad_in_a_row > 0 and (bad > self._bad or counted.bad_in_a_row >= CONSECUTIVE):
            malformed = counted.malformed_in_a_row == counted.bad_in_a_row
            slug, wrong = ("can-malformed", "length or kind") if malformed else ("ecu-crc", "counter, CRC or length")
            detail = f"{counted.bad_in_a_row} ECU status frames in a row with a wrong {wrong}, thrown away"
            few = counted.bad_in_a_row < CONSECUTIVE
            findings.append(Finding(slug, detail, t_ns, counted.bad_in_a_row, CONSECUTIVE, warns=few))
        self._bad = bad
        if counted.gaps_in_a_row >= CONSECUTIVE:
            detail = f"{counted.gaps_in_a_row} ECU status frames in a row whose counter left some out"
            findings.append(Finding("ecu-crc", detail, t_ns, counted.gaps_in_a_row, CONSECUTIVE))
        repeated, lost = counted.duplicates - self._duplicates, counted.lost - self._lost
        if repeated or lost:
            self._duplicates, self._lost = counted.duplicates, counted.lost
            detail = f"ECU status frames: {repeated} repeated, {lost} missing"
            late = counted.lateness >= LATE
            findings.append(Finding("ecu-late", detail, t_ns, counted.lateness, LATE, warns=not late))
        return findings

    def _load(self, counted: EcuCounters, t_ns: int) -> list[Finding]:
        elapsed_ns = t_ns - self._window_ns
        if elapsed_ns < BUS_WINDOW_NS:
            return []
        share = (counted.other_bits - self._bits) * 1e9 / elapsed_ns / self._bitrate
        self._bits, self._window_ns = counted.other_bits, t_ns
        if share <= FULL_BUS:
            return []
        detail = f"frames of others take {100 * share:.0f} % of the bus, allowed {100 * FULL_BUS:.0f} %"
        return [Finding("can-babble", detail, t_ns, share, FULL_BUS)]
