"""The station's own latency, distinguished from the silence of its devices. No I/O, no clock of its own.

Every thread reports when it ran (`awake`) and when a device was heard (`heard`). Two conditions make a blind time:

- no thread ran for `SHORTEST_NS`: the process was stopped, or its computer suspended;
- no device at all was heard for `quiet_ns`, although each has its own line: the host's ports or the computer.

A thread whose own wait took longer than requested adds that time (`blind`). A device counts as silent only by time in
which the station was not blind, after it has been read again; so data that wait in a port are read first. A
disconnected cable is therefore reported later than its stale-after, by `limit_ns` at most.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rig.clock import SuspendWatch, monotonic_ns
from rig.station.interfaces import Watched
from rig.station.interlocks.finding import Finding

SHORTEST_NS = 10_000_000
"""A thread may be kept waiting for so long by the others."""
LOOK_AGAIN_NS = 20_000_000
"""A device that is well is heard again within this time after a blind one ..."""
GRACE_NS = 5_000_000
"""... and what waited in its port is read within this time."""
TOO_BUSY = "this computer was too busy: monitoring paused"
STOPPED = "monitoring paused: this process was stopped"
FIX = "Fix: close other programs, or grant real-time priority"
LET_RUN = "Fix: do not stop this process (SIGSTOP, debugger, frozen container); otherwise close other programs"
LATE = "host-late"
SILENT_HOST = "host-silent"
WINDOW_NS = 1_000_000_000
BLIND_SHARE = 0.5
"""Of the last second; a host that is blind for longer in all does not watch the rig, however short each time is."""
MATTERS_SHARE = 0.25
"""Of the limit: shorter times do not count towards that sum."""
MOST_KEPT = 256


@dataclass(frozen=True)
class BlindTime:
    """From `begin_ns` to `end_ns` (host monotonic) nothing was watched; `stopped`: no thread ran all the time."""

    begin_ns: int
    end_ns: int
    stopped: bool = False

    @property
    def length_ns(self) -> int:
        """How long it lasted."""
        return self.end_ns - self.begin_ns


class HostWatch:
    """Adds up blind times; any thread may call anything.

    Args (construction):
        limit_s: a blind time longer than this stops the rig.
        watchdog_s: after so long the controller's watchdog has stopped the rig already.
        quiet_s: so long no device at all may be unheard while all of them are well.

    Attributes:
        watching: the station's loop ticks, so that no thread running means something.
        listening: devices are being read, so that hearing none of them means something.
        count, worst_ns, total_ns: blind times so far.
        woke_ns: end of the last blind time; 0 before the first.
    """

    def __init__(self, limit_s: float, watchdog_s: float, quiet_s: float, now_ns: int) -> None:
        self.limit_ns = int(1e9 * min(limit_s, watchdog_s))
        self.listening = False
        self.watching = False
        self.count = 0
        self.worst_ns = 0
        self.total_ns = 0
        self.woke_ns = 0
        self._watchdog_ns = int(0.9e9 * watchdog_s)
        self._quiet_ns = max(SHORTEST_NS, int(1e9 * quiet_s))
        self._awake_ns = now_ns
        self._heard_ns = now_ns
        self._kept: deque[BlindTime] = deque(maxlen=MOST_KEPT)
        self._unreported: deque[BlindTime] = deque(maxlen=MOST_KEPT)
        self._lock = threading.Lock()

    def watch(self, now_ns: int) -> None:
        """The station's loop begins to tick."""
        with self._lock:
            self._awake_ns = now_ns
            self.watching = True

    def listen(self, now_ns: int, *, listening: bool) -> None:
        """Say whether hearing no device means something from now on; it does while the loop ticks."""
        with self._lock:
            self._heard_ns = now_ns
            self.listening = listening and self.watching

    def awake(self, now_ns: int) -> None:
        """A thread runs."""
        with self._lock:
            self._look(now_ns, now_ns)

    def heard(self, now_ns: int) -> None:
        """A device's data have just been read; its thread runs."""
        with self._lock:
            quiet = self.listening and now_ns - self._heard_ns > self._quiet_ns
            self._look(self._heard_ns if quiet else now_ns, now_ns)
            self._heard_ns = max(self._heard_ns, now_ns)

    def blind(self, begin_ns: int, now_ns: int) -> None:
        """A thread was kept from running since `begin_ns`, by what it asked for and what it got."""
        with self._lock:
            self._look(begin_ns, now_ns)

    def blind_ns(self, since_ns: int, now_ns: int) -> int:
        """Blind time between two instants."""
        if self.woke_ns <= since_ns:
            return 0
        with self._lock:
            return sum(max(0, min(blind.end_ns, now_ns) - max(blind.begin_ns, since_ns)) for blind in self._kept)

    def missed(self, name: str, slug: str, last_ns: int, stale_ns: int, now_ns: int) -> Finding | None:
        """Judge a silence.

        Args:
            name: of the device.
            slug: what its silence is called.
            last_ns: when it was last heard.
            stale_ns: how long it may be silent.
            now_ns: host time just after looking what waits.

        Returns:
            None while the device may be well.
        """
        age_ns = now_ns - last_ns
        if age_ns <= stale_ns:
            return None
        overdue = age_ns > stale_ns + self.limit_ns
        unheard_ns = now_ns - self._heard_ns
        if self.listening and unheard_ns > max(self._quiet_ns, stale_ns // 2):
            if not overdue:
                return None
            detail = (
                f"no device sent anything for {unheard_ns / 1e6:.0f} ms ({name}: {age_ns / 1e6:.0f} ms, limit "
                f"{(stale_ns + self.limit_ns) / 1e6:.0f} ms): this computer was too busy, or all devices lost "
                "power"
            )
            return Finding(LATE, detail, now_ns, unheard_ns / 1e9, self.limit_ns / 1e9)
        blind_ns = self.blind_ns(last_ns, now_ns)
        since_woken_ns = now_ns - max(last_ns, self.woke_ns)
        # It was looked at again after the blind time; where blind times follow each other closely, at least briefly.
        again_ns = GRACE_NS if overdue else min(stale_ns, LOOK_AGAIN_NS)
        if age_ns - blind_ns <= stale_ns or since_woken_ns <= again_ns:
            return None
        meanwhile = f"; the station itself was not running for {blind_ns / 1e6:.0f} ms of this time" if blind_ns else ""
        detail = f"{name}: no value for {age_ns / 1e6:.0f} ms, allowed {stale_ns / 1e6:.0f} ms{meanwhile}"
        return Finding(slug, detail, now_ns, age_ns / 1e9, stale_ns / 1e9)

    def take(self) -> BlindTime | None:
        """A blind time that was not taken yet, the oldest first."""
        try:
            return self._unreported.popleft()
        except IndexError:
            return None

    @property
    def has_unreported(self) -> bool:
        """There are blind times to take."""
        return bool(self._unreported)

    def finding(self, blind: BlindTime) -> Finding | None:
        """What stops the rig: a blind time, or the last second's together, beyond what is allowed."""
        limit_s = self.limit_ns / 1e9
        if blind.length_ns > self.limit_ns:
            slug = SILENT_HOST if blind.length_ns > self._watchdog_ns else LATE
            # A busy computer lets some thread run within that time; a process that was stopped runs none.
            what, way_out = (STOPPED, LET_RUN) if slug == SILENT_HOST and blind.stopped else (TOO_BUSY, FIX)
            detail = f"{what} for {blind.length_ns / 1e6:.0f} ms (limit {1e3 * limit_s:.0f} ms). {way_out}"
            return Finding(slug, detail, blind.end_ns, blind.length_ns / 1e9, limit_s)
        recent_ns = self._recent_ns(blind.end_ns)
        if recent_ns > BLIND_SHARE * WINDOW_NS:
            limit_ms = BLIND_SHARE * WINDOW_NS / 1e6
            detail = f"{TOO_BUSY} for {recent_ns / 1e6:.0f} ms of the last second (limit {limit_ms:.0f} ms). {FIX}"
            return Finding(LATE, detail, blind.end_ns, recent_ns / 1e9, BLIND_SHARE * WINDOW_NS / 1e9)
        return None

    def _recent_ns(self, end_ns: int) -> int:
        """Sum of the times that matter in the second before `end_ns`."""
        with self._lock:
            matter = [blind for blind in self._kept if blind.length_ns > MATTERS_SHARE * self.limit_ns]
        return sum(max(0, blind.end_ns - max(blind.begin_ns, end_ns - WINDOW_NS)) for blind in matter)

    def _look(self, begin_ns: int, end_ns: int) -> None:
        """Keep a blind time that begins at `begin_ns`, or earlier where no thread ran; called with the lock held."""
        idle_ns = end_ns - self._awake_ns
        if idle_ns > SHORTEST_NS:
            begin_ns = min(begin_ns, self._awake_ns)
        self._awake_ns = max(self._awake_ns, end_ns)
        if self._kept:
            begin_ns = max(begin_ns, self._kept[-1].end_ns)
        length_ns = end_ns - begin_ns
        if length_ns <= SHORTEST_NS or not self.watching:
            return
        self.woke_ns = end_ns
        self.count += 1
        self.total_ns += length_ns
        self.worst_ns = max(self.worst_ns, length_ns)
        blind = BlindTime(begin_ns, end_ns, idle_ns >= length_ns)
        self._kept.append(blind)
        self._unreported.append(blind)


class Listener:
    """One reading thread's share in the watch: how late each of its reads came back.

    Args (construction):
        host: the station's watch.
        now_ns: host time.
    """

    def __init__(self, host: HostWatch, now_ns: int) -> None:
        self._host = host
        self._before_ns = now_ns

    def restart(self, now_ns: int) -> None:
        """Nothing was read until now, and nothing was meant to be."""
        self._before_ns = now_ns

    def returned(self, request_s: float, now_ns: int, *, heard: bool) -> int:
        """A read came back.

        Args:
            request_s: the longest it was to take (s).
            now_ns: when it came back.
            heard: with data.

        Returns:
            Blind time since the read before (ns): what has come now may have waited for so long.
        """
        host, before_ns, self._before_ns = self._host, self._before_ns, now_ns
        over_ns = now_ns - before_ns - int(1e9 * request_s)
        if over_ns > SHORTEST_NS:
            host.blind(now_ns - over_ns, now_ns)
        if heard:
            host.heard(now_ns)
        else:
            host.awake(now_ns)
        return host.blind_ns(before_ns, now_ns)


def quiet_s(periods_s: list[float]) -> float:
    """So long no device may be unheard while all send or answer at these periods (wall s)."""
    return 1.5 * min(periods_s, default=math.inf) + 0.005


HIGH_WATER = 0.5


class Watchdogs:
    """Watches ages.

    Args (construction):
        heartbeat_timeout_s: how long the application may be silent (wall s).
        host: the station's watch over itself.
        unread_share: says how much of the ring the recorder has left unread, 0 to 1.

    Attributes:
        watched: the threads that read the devices.
    """

    def __init__(self, heartbeat_timeout_s: float, host: HostWatch, unread_share: Callable[[], float]) -> None:
        self.watched: tuple[Watched, ...] = ()
        self._unread_share = unread_share
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
                yield Finding("task-dies", f"the station's thread for {source.name} ended", now_ns)
                continue
            age_ns, stale_ns = source.silent_ns(now_ns)
            finding = self._host.missed(source.name, source.slug, now_ns - age_ns, stale_ns, now_ns)
            if finding is not None:
                yield finding

    def machine(self, now_ns: int) -> Iterator[Finding]:
        """A machine that slept."""
        slept_s = self._suspend.slept_s()
        if slept_s > 0.0:
            detail = f"the computer was suspended for {slept_s:.3f} s; the rig was not monitored during this time"
            yield Finding("host-suspend", detail, now_ns, slept_s)

    def application(self, now_ns: int) -> Iterator[Finding]:
        """An application that does not beat, or whose recorder is not well."""
        finding = self._host.missed(
            "application", "host-stalled", self._beat_ns, int(1e9 * self._heartbeat_timeout_s), now_ns
        )
        if finding is not None:
            yield finding
        elif not self._application_well:
            yield Finding("recorder-unwell", "the application reports a recorder failure", now_ns)

    def consumer(self, now_ns: int) -> Iterator[Finding]:
        """What the recorder leaves unread; the limits never wait for it, they are judged before a record goes in."""
        unread = self._unread_share()
        if unread > HIGH_WATER:
            detail = f"the recorder has left {100 * unread:.0f} % of the ring unread, allowed: {100 * HIGH_WATER:.0f} %"
            yield Finding("slow-consumer", detail, now_ns, unread, HIGH_WATER)
