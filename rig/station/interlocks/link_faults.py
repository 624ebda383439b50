"""Errors of the controller's link, by name: which are a fault immediately, which only when consecutive. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.connection import LinkKind
from drivers.errors import (
    Busy,
    DriverError,
    LinkLost,
    NoAnswer,
    OtherAnswer,
    PortClosed,
    RequestRefused,
    WrongAnswer,
)
from drivers.roles import ActuatorStatus, CountingLink
from rig.station.interlocks.finding import CONSECUTIVE, Finding
from rig.station.safe_stop import StopAction

BUSY_POLLS = 4
"""Each of them was asked several times already."""


def link_slug(error: DriverError, kind: LinkKind) -> str:
    """The fault matrix's slug for what the controller's driver raised in operation.

    Args:
        error: what it raised.
        kind: what the link is made of.
    """
    if isinstance(error, RequestRefused):
        return "modbus-busy" if isinstance(error, Busy) else "modbus-reject"
    if isinstance(error, OtherAnswer):
        return "modbus-mismatch"
    if isinstance(error, WrongAnswer):
        return "rtu-crc" if kind is LinkKind.MODBUS_RTU else "modbus-mismatch"
    if isinstance(error, NoAnswer):
        return "modbus-halfopen"
    return "modbus-reset" if isinstance(error, (LinkLost, PortClosed)) else "actuator-reboot"


class LinkFaults:
    """Names what goes wrong between two good answers."""

    def __init__(self, link: CountingLink) -> None:
        self._link = link
        self._kind = link.link_kind
        self._busy = 0
        self._wrong = 0
        self._seen_stale = 0
        self._seen_busy = 0

    def answered(self, t_ns: int) -> list[Finding]:
        """A status was read; returns what was overcome on the way, as warnings.

        Args:
            t_ns: host time of the answer.
        """
        self._busy = self._wrong = 0
        findings = [*self._stale(t_ns)]
        if self._link.busy > self._seen_busy:
            count = self._link.busy - self._seen_busy
            detail = f"busy answers from the controller before it accepted the request: {count}"
            findings.append(Finding("modbus-busy", detail, t_ns, warns=True))
        self._seen_busy = self._link.busy
        return findings

    def failed(self, error: DriverError, t_ns: int) -> Finding:
        """A poll or command failed.

        Args:
            error: what the driver raised.
            t_ns: host time.
        """
        detail, slug = str(error), link_slug(error, self._kind)
        if slug == "modbus-busy":
            self._busy += 1
            return Finding(slug, detail, t_ns, warns=self._busy < BUSY_POLLS)
        if isinstance(error, WrongAnswer):
            self._wrong += 1
            return Finding(slug, detail, t_ns, warns=self._wrong < CONSECUTIVE)
        if isinstance(error, NoAnswer):
            return self._silence(detail, t_ns)
        return Finding(slug, detail, t_ns)

    def _silence(self, detail: str, t_ns: int) -> Finding:
        """One missing answer warns; the second in a row has closed the connection and is a fault.

        Unless something did answer, with numbers of other requests: then connecting again is tried first.
        """
        others = self._stale(t_ns)
        if others:
            return others[0]
        return Finding("modbus-halfopen", detail, t_ns, warns=self._link.is_open)

    def _stale(self, t_ns: int) -> list[Finding]:
        count, self._seen_stale = self._link.stale - self._seen_stale, self._link.stale
        if count == 0:
            return []
        slug = "rtu-stale" if self._kind is LinkKind.MODBUS_RTU else "modbus-wrong-tid"
        return [Finding(slug, f"number of answers to other requests discarded: {count}", t_ns, warns=True)]


@dataclass
class SentStop:
    """A stop command on its way, and how many statuses have been read since."""

    action: StopAction
    sequence: int
    statuses: int = 0


class EchoWatch:
    """Compares the watchdog's counter with its echo in the status that was read after it was written."""

    def __init__(self) -> None:
        self._missing = 0

    def check(self, counter: int, status: ActuatorStatus) -> list[Finding]:
        """The echo must be there; not once, for a slow device, but in a row it is a fault.

        Args:
            counter: as it was written.
            status: as it was read after that.
        """
        self._missing = self._missing + 1 if status.watchdog_echo != counter else 0
        if self._missing < CONSECUTIVE:
            return []
        detail = f"wrote watchdog counter {counter}, but the controller still returns {status.watchdog_echo}"
        return [Finding("modbus-write-lost", detail, status.received_ns, status.watchdog_echo, counter)]
