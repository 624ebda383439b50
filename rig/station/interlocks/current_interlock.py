"""Interlocks on the coil current, on the ECU's status, and on its bus; pure, no clock, no I/O."""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers.current_source import SourceCounters, SourceFault, SourceStatus, SourceTemperature, SourceTiming
from rig.station.interlocks.finding import CONSECUTIVE, Finding

SETTLED_S = 0.150
"""Time (of the ECU's clock, counted in its status frames) that a new set-point is given before it is compared."""
FEWEST_STATUSES = 3
ZERO_A = 0.05
TRACKING_A = 0.05
TRACKING_SHARE = 0.05
LATE = 4
"""Three repeated status frames, each followed by a fresh one."""
FULL_BUS = 0.7
BUS_WINDOW_NS = 50_000_000
CONSEQUENCE_NS = 50_000_000
CONSEQUENCES = int(SourceFault.UNDERVOLTAGE | SourceFault.COMMAND_TIMEOUT)
"""What the ECU reports when the fault is elsewhere."""
UNREPORTED_PERIODS = 5
"""So many of the temperature's periods without one, counted in status frames."""

_ECU_SLUGS = (
    (int(SourceFault.OPEN | SourceFault.SHORT), "coil-open-short"),
    (int(SourceFault.OVER_TEMPERATURE | SourceFault.UNDERVOLTAGE), "ecu-overtemp"),
    (int(SourceFault.RESTARTED), "ecu-restart"),
    (int(SourceFault.COMMAND_TIMEOUT | SourceFault.COMMAND_CHECK), "ecu-command"),
)


class CurrentInterlock:
    """Compares the measured current with the commanded one, once a new set-point has had its time.

    Args (construction):
        patience_ns: wall time which a command and its effect may take on the wires.
        timing: how often the source tells its current.
        settling_s: the time that a new set-point is given (s of its clock).
    """

    def __init__(
        self,
        patience_ns: int,
        timing: SourceTiming = SourceTiming(),  # noqa: B008 - immutable
        settling_s: float = SETTLED_S,
    ) -> None:
        self._patience_ns = patience_ns
        self._settled = max(FEWEST_STATUSES, round(settling_s / timing.status_s))
        self._set_point = (math.nan, 0)
        self._since_ns = 0
        self._statuses = 0
        self._off = 0

    def check(self, status: SourceStatus, commanded_A: float, t_ns: int, set_points: int = 0) -> list[Finding]:
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
        if self._statuses <= self._settled or t_ns - self._since_ns < self._patience_ns:
            return []
        allowed_A = ZERO_A if commanded_A == 0.0 else TRACKING_A + TRACKING_SHARE * abs(commanded_A)
        error_A = abs(status.current_A - commanded_A)
        self._off = self._off + 1 if error_A > allowed_A else 0
        if self._off != CONSECUTIVE:
            return []
        slug = "current-stuck" if commanded_A == 0.0 else "current-tracking"
        detail = (
            f"measured {status.current_A:.3f} A, commanded {commanded_A:.3f} A, allowed difference {allowed_A:.3f} A"
        )
        return [Finding(slug, detail, t_ns, status.current_A, commanded_A)]


WRONG = {
    "can-malformed": "consecutive ECU status frames with a wrong length or type",
    "ecu-crc": "consecutive ECU status frames with a wrong counter, CRC or length",
    "current-unmeasured": "consecutive answers of the current source without a measured number",
}
"""What was discarded, by fault."""


def thrown_away(counted: SourceCounters) -> str:
    """The fault for which status frames have been thrown away since the last good one; empty where none has."""
    if not counted.bad_in_a_row:
        return ""
    if counted.unmeasured_in_a_row == counted.bad_in_a_row:
        return "current-unmeasured"
    return "can-malformed" if counted.malformed_in_a_row == counted.bad_in_a_row else "ecu-crc"


class BusInterlock:
    """Follows what the ECU's driver counts: frames dropped, repeated, left out, and what others send.

    Args (construction):
        bitrate: of the bus, bit/s.
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._bad = 0
        self._duplicates = 0
        self._lost = 0
        self._other_commands = 0
        self._bits = 0
        self._window_ns = 0

    def forget_others(self, counted: SourceCounters) -> None:
        """Other senders on our command id count from now on."""
        self._other_commands = counted.foreign_commands

    def check(self, counted: SourceCounters, t_ns: int) -> list[Finding]:
        """Take the counters as they stand after a read that ended at `t_ns` (host monotonic)."""
        findings = [*self._frames(counted, t_ns), *self._load(counted, t_ns)]
        if counted.foreign_commands > self._other_commands:
            detail = (
                "frames with this host's command identifier received from another sender: "
                f"{counted.foreign_commands - self._other_commands}"
            )
            findings.append(Finding("can-foreign", detail, t_ns))
        return findings

    def _frames(self, counted: SourceCounters, t_ns: int) -> list[Finding]:
        findings = []
        bad = counted.bad_checks + counted.malformed
        if counted.bad_in_a_row > 0 and (bad > self._bad or counted.bad_in_a_row >= CONSECUTIVE):
            slug = thrown_away(counted)
            detail = f"{counted.bad_in_a_row} {WRONG[slug]}, discarded"
            few = counted.bad_in_a_row < CONSECUTIVE
            findings.append(Finding(slug, detail, t_ns, counted.bad_in_a_row, CONSECUTIVE, warns=few))
        self._bad = bad
        if counted.gaps_in_a_row >= CONSECUTIVE:
            detail = f"{counted.gaps_in_a_row} consecutive ECU status frames with a gap in the counter"
            findings.append(Finding("ecu-crc", detail, t_ns, counted.gaps_in_a_row, CONSECUTIVE))
        repeated, lost = counted.duplicates - self._duplicates, counted.lost - self._lost
        if repeated or lost:
            self._duplicates, self._lost = counted.duplicates, counted.lost
            detail = f"ECU status frames: {repeated} repeated, {lost} missing"
            late = counted.lateness >= LATE
            findings.append(Finding("ecu-late", detail, t_ns, counted.lateness, LATE, warns=not late))
        return findings

    def _load(self, counted: SourceCounters, t_ns: int) -> list[Finding]:
        elapsed_ns = t_ns - self._window_ns
        if elapsed_ns < BUS_WINDOW_NS:
            return []
        share = (counted.other_bits - self._bits) * 1e9 / elapsed_ns / self._bitrate
        self._bits, self._window_ns = counted.other_bits, t_ns
        if share <= FULL_BUS:
            return []
        detail = f"frames from other nodes occupy {100 * share:.0f} % of the bus, allowed: {100 * FULL_BUS:.0f} %"
        return [Finding("can-babble", detail, t_ns, share, FULL_BUS)]


class EcuInterlock:
    """Follows the ECU's status and temperature frames.

    Args (construction):
        current_limit_A: measured current beyond which the rig stops (A).
        coil_temperature_limit_degC: likewise of the coil (degC).
        controller_polls: how often the controller was asked so far; its word on a shared cause comes first.
        timing: how often the source tells what.
    """

    def __init__(
        self,
        current_limit_A: float,
        coil_temperature_limit_degC: float,
        controller_polls: Callable[[], int],
        timing: SourceTiming = SourceTiming(),  # noqa: B008 - immutable
    ) -> None:
        self._timing = timing
        self._unreported_allowed = max(
            FEWEST_STATUSES, round(UNREPORTED_PERIODS * timing.temperature_s / timing.status_s)
        )
        self.current_limit_A = current_limit_A
        self.coil_temperature_limit_degC = coil_temperature_limit_degC
        self._controller_polls = controller_polls
        self._boot_count: int | None = None
        self._unreported = 0
        self._consequence: tuple[int, int] | None = None

    def check_status(self, status: SourceStatus, t_ns: int) -> list[Finding]:
        """Take one SourceStatus that arrived at `t_ns` (host monotonic)."""
        self._unreported += 1
        faults = status.faults
        if faults & CONSEQUENCES and self._controller_may_know(t_ns):
            faults &= ~CONSEQUENCES
        elif not faults & CONSEQUENCES:
            self._consequence = None
        findings = [
            Finding(slug, f"ECU fault {SourceFault(faults & bits).name}", t_ns, float(faults))
            for bits, slug in _ECU_SLUGS
            if faults & bits
        ]
        if abs(status.current_A) > self.current_limit_A:
            detail = f"coil current {status.current_A:.3f} A, allowed {self.current_limit_A:.3f} A"
            findings.append(Finding("overcurrent", detail, t_ns, status.current_A, self.current_limit_A))
        return findings

    def _controller_may_know(self, t_ns: int) -> bool:
        """The controller is heard first, for it names the cause: two more polls, or `CONSEQUENCE_NS`.

        An opened e-stop chain takes the ECU's supply too, and a silent host stops feeding both; the ECU is at 0 A by
        itself meanwhile.
        """
        polls = self._controller_polls()
        if self._consequence is None:
            self._consequence = polls, t_ns
        first_poll, since_ns = self._consequence
        return polls < first_poll + 2 and t_ns - since_ns < CONSEQUENCE_NS

    def check_temperature(self, temperature: SourceTemperature, t_ns: int) -> list[Finding]:
        """Take one SourceTemperature that arrived at `t_ns` (host monotonic)."""
        self._unreported = 0
        findings: list[Finding] = []
        limit = self.coil_temperature_limit_degC
        if temperature.coil_degC > limit:
            detail = f"the coil is at {temperature.coil_degC:.1f} degC, allowed {limit:.1f} degC"
            findings.append(Finding("coil-temperature", detail, t_ns, temperature.coil_degC, limit))
        if self._boot_count is not None and temperature.boot_count != self._boot_count:
            detail = f"the ECU's boot count changed from {self._boot_count} to {temperature.boot_count}"
            findings.append(Finding("ecu-restart", detail, t_ns, temperature.boot_count, self._boot_count))
        self._boot_count = temperature.boot_count
        return findings

    def check_temperature_age(self, t_ns: int) -> list[Finding]:
        """Temperatures that stay away, by the statuses that came meanwhile; call it once a read's frames are judged."""
        if not self._timing.temperature_s or self._unreported <= self._unreported_allowed:
            return []
        status_ms = 1e3 * self._timing.status_s
        age_ms, allowed_ms = round(status_ms * self._unreported), round(status_ms * self._unreported_allowed)
        detail = f"ecu: no coil temperature for {age_ms} ms (ECU clock), allowed: {allowed_ms} ms"
        return [Finding("ecu-silent", detail, t_ns, age_ms / 1e3, allowed_ms / 1e3)]
