"""What nobody reports by itself: a silent device, a thread that ended, an application, machine or recorder that lags.

Looked at by the supervisor's tick; says what it found and decides nothing. Silence counts only while the station itself
watched (`host_watch`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rig.clock import SuspendWatch, monotonic_ns
from rig.station.host_watch import HostWatch
from rig.station.interlocks import Finding
from rig.station.roles import Watched

HIGH_WATER = 0.5


class Vigil:
    """Watches ages.

    Args (construction):
        heartbeat_timeout_s: how long the application may be silent (wall s).
        host: the station's watch over itself.

    Attributes:
        watched: the threads that read the devices.
        unread_share: how much of the ring the recorder has left unread, 0 to 1.
    """

    def __init__(self, heartbeat_timeout_s: float, host: HostWatch) -> None:
        self.watched: tuple[Watched, ...] = ()
        self.unread_share: Callable[[], float] = lambda: 0.0
        self._heartbeat_timeout_s = heartbeat_timeout_s
        self._host = host
        self._beat_ns = monotonic_ns()
        self._application_well = True
        self._suspend = SuspendWatch()

    def beat(self, healthy: bool) -> None:
        """The application lives; `healthy` carries its recorder's state."""
        self._beat_ns = monotonic_ns()
        self._application_well = healthy

    def restart_beat(self) -> None:
        """The application's silence counts from now."""
        self._beat_ns = monotonic_ns()

    def beat_age_s(self, now_ns: int) -> float:
        """Seconds since the application's last beat."""
        return (now_ns - self._beat_ns) / 1e9

    def devices(self, now_ns: int) -> Iterator[Finding]:
        """Threads that ended, devices not heard within their time."""
        for source in self.watched:
            if not source.alive:
                yield Finding("task-dies", f"the thread of {source.name} ended", now_ns)
                continue
            age_ns, stale_ns = source.silent_ns(now_ns)
            finding = self._host.missed(source.name, source.slug, now_ns - age_ns, stale_ns, now_ns)
            if finding is not None:
                yield finding

    def machine(self, now_ns: int) -> Iterator[Finding]:
        """A machine that slept."""
        slept_s = self._suspend.slept_s()
        if slept_s > 0.0:
            detail = f"the machine slept for {slept_s:.3f} s; what the rig did meanwhile is not known"
            yield Finding("host-suspend", detail, now_ns, slept_s)

    def application(self, now_ns: int) -> Iterator[Finding]:
        """An application that does not beat, or whose recorder is not well."""
        finding = self._host.missed(
            "application", "host-stalled", self._beat_ns, int(1e9 * self._heartbeat_timeout_s), now_ns
        )
        if finding is not None:
            yield finding
        elif not self._application_well:
            yield Finding("recorder-unwell", "the application says that its recorder is not well", now_ns)

    def consumer(self, now_ns: int) -> Iterator[Finding]:
        """What the recorder leaves unread; the limits never wait for it, they are judged before a record goes in."""
        unread = self.unread_share()
        if unread > HIGH_WATER:
            detail = f"the recorder has left {100 * unread:.0f} % of the ring unread, allowed {100 * HIGH_WATER:.0f} %"
            yield Finding("slow-consumer", detail, now_ns, unread, HIGH_WATER)
