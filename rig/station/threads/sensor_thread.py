"""The thread of one serial sensor: reads, checks every sample, writes them into the ring."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from drivers.errors import DriverError
from drivers.ring import Channel, Record
from drivers.roles import Sensor
from protocols.quality import Quality
from rig.bench.sensor_settings import SensorConfig
from rig.clock import monotonic_ns, wait_for
from rig.station.interlocks.channel_interlock import ChannelInterlock
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.line_interlock import ClockWatch, LineInterlock, drift
from rig.station.interlocks.motion_interlock import MotionInterlock, Reference, StandingInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.device_thread import ReadingThread
from rig.station.watchdogs import Listener

READ_TIMEOUT_S = 0.05
LOOK_AGAIN_S = 0.01
STALE_FOR_SURE_S = 0.0002
COUNTED = 1000
STUCK_S = 0.08
STUCK_SAMPLES = 10
STANDING_FLOOR_SHARE = 0.01
"""Of the span: by how much the controller's own measure may change while a coarse sensor rightly repeats a value."""


@dataclass(frozen=True, slots=True)
class SensorRole:
    """What a channel is in this rig.

    Attributes:
        slug: what its silence is called.
        channel: its number in the ring.
        interlock: its limits.
        motion: speed and standstill, for the LVDT; None for other sensors.
        reference: what the controller says of the rod and of this quantity; None where it knows neither.
        reference_ppm: rate of the controller's clock against the host's (ppm); None where its drift is not judged.
    """

    slug: str
    channel: Channel
    interlock: ChannelInterlock
    motion: MotionInterlock | None
    reference: Callable[[], Reference] | None
    reference_ppm: Callable[[], float] | None


class SensorThread(ReadingThread):
    """Owns a sensor's port from the first read on.

    Silence is judged here, right after a read that brought no value, so that a station that was kept from running does
    not mistake data waiting in its port for silence. The supervisor's own check of the age is only a backstop. Samples
    that waited while the station did not run are judged one by one like any others, and flagged as stale.
    """

    def __init__(
        self,
        config: SensorConfig,
        driver: Sensor,
        role: SensorRole,
        supervisor: Supervisor,
        append: Callable[[list[Record]], None],
    ) -> None:
        super().__init__(config.label, role.slug, config.stale_after_s)
        device_rate = supervisor.config.device_rate
        self.config = config
        self.interlock = role.interlock
        self.motion = role.motion
        self.lost = 0
        self.samples = 0
        self._reference = role.reference
        self._repeats_at_rest = False
        self._stuck_samples = max(STUCK_SAMPLES, round(STUCK_S * config.rate_Hz))
        self._standing = StandingInterlock(self._stuck_samples, STANDING_FLOOR_SHARE * config.span)
        self.clock = ClockWatch(device_rate)
        self._reference_ppm = role.reference_ppm
        self._line = LineInterlock(config.label, config.rate_Hz)
        self._bad_frames = 0
        self._garbage = 0
        self._channel = int(role.channel)
        self._progress = threading.Condition()
        self._first: Record | None = None
        self._latest: Record | None = None
        self._recent_count = 0
        self._driver = driver
        self._supervisor = supervisor
        self._append = append
        self._timeout_s = min(READ_TIMEOUT_S, config.stale_after_s)
        self._listener = Listener(supervisor.host, self._last_ns)
        self._late_after_ns = int(1e9 * supervisor.config.late_after_s)
        self._waiting_rate_Hz = config.rate_Hz * device_rate
        self._waited = 0
        self.late_samples = 0

    def open(self) -> None:
        """Open the port; before the thread starts.

        Raises:
            DriverError: the port cannot be opened.
        """
        self._driver.open()

    def close(self) -> None:
        """Close the port; after the thread has ended."""
        self._driver.close()

    def revive(self) -> None:
        """Open a lost port again; the thread goes on with it. Only at standstill, as part of a reset.

        Raises:
            DriverError: the port cannot be opened.
        """
        if self.port_lost is not None:
            self._driver.close()
            self._driver.open()
            self._reopened()

    @property
    def garbled(self) -> bool:
        """Bytes arrive, but they make no valid frames."""
        return self._driver.bad_frames > 0 or self._driver.skipped_bytes > 0

    @property
    def refusal(self) -> tuple[str, str]:
        """Code and reason why the received data cannot come from this sensor; two empty strings if it may."""
        # Optional for plug-in drivers.
        refusal: tuple[str, str] = getattr(self._driver, "refusal", ("", ""))
        return refusal

    @property
    def speed_m_s(self) -> float:
        """Speed by the LVDT (m/s); NaN while unknown or for another sensor."""
        return math.nan if self.motion is None else self.motion.speed_m_s

    def wait_rate(self, samples: int, timeout_s: float) -> float | None:
        """Wait for `samples` samples and return their rate (Hz of the device's clock, else of the host's).

        Returns:
            None when they did not come within `timeout_s` wall seconds.
        """
        with self._progress:
            if not wait_for(self._progress, lambda: self._recent_count >= samples, timeout_s):
                return None
            first, last, count = self._first, self._latest, self._recent_count
        if first is None or last is None:
            return None
        elapsed_s = (last[1] - first[1]) / 1e6 if first[1] >= 0 else (last[0] - first[0]) / 1e9
        return (count - 1) / elapsed_s if elapsed_s > 0 else None

    def counters(self, now_ns: int) -> dict[str, object]:
        """Age of the last value and what was counted."""
        return {
            "age_s": (now_ns - self._last_ns) / 1e9,
            "samples": self.samples,
            "lost": self.lost,
            "late": self.late_samples,
            "bad_frames": self._driver.bad_frames,
            "port_lost": self.port_lost,
        }

    def _read(self) -> None:
        fresh = False
        while not self._ending.is_set():
            try:
                if not fresh:
                    # While it was not read, the port may have overflowed; that is no loss of a test.
                    self._driver.discard_input()
                    fresh = True
                    self._listener.restart(monotonic_ns())
                request_s = self._patience_s()
                batch = self._driver.read_batch(request_s)
            except DriverError as error:
                self.port_lost = str(error)
                # The bus or adapter was lost, not the sensor; plug-in drivers need not report this.
                lost: str = getattr(self._driver, "lost_slug", "") or self.slug
                slug = "usb-renumber" if self._driver.moved else lost
                self._supervisor.report([Finding(slug, self.port_lost, monotonic_ns())])
                return
            blind_ns = self._listener.returned(request_s, batch.arrival_ns, heard=bool(batch.records))
            if blind_ns > self._late_after_ns:
                self._waited = math.ceil(1e-9 * blind_ns * self._waiting_rate_Hz)
            samples = [record for record in batch.records if record[4] == self._channel]
            self._check_line(len(samples), batch.arrival_ns)
            if samples:
                self._take(samples)
            if any(math.isfinite(record[2]) for record in samples):
                self._last_ns = batch.arrival_ns
            else:
                # A sample without a value leaves the channel as old as it was.
                self._check_silence(batch.arrival_ns)
            if len(samples) != len(batch.records):
                self._append([record for record in batch.records if record[4] != self._channel])
            self.lost += batch.lost

    def _patience_s(self) -> float:
        """How long to wait for a sample: until the last value is stale, then for short looks."""
        left_s = (self._last_ns + self._stale_ns - monotonic_ns()) * 1e-9 + STALE_FOR_SURE_S
        return min(left_s, READ_TIMEOUT_S) if left_s > 0.0 else LOOK_AGAIN_S

    def _take(self, samples: list[Record]) -> None:
        records, findings = self.interlock.check(samples)
        if self._waited:
            records = self._flagged(records)
        if self.motion is not None:
            findings += self.motion.check(records)
        if self.interlock.repeats >= self._stuck_samples and not self._supervisor.armed:
            self._repeats_at_rest = True
        if self._is_stuck():
            findings.append(self._stuck(records[-1][0]))
        if findings:
            self._supervisor.report(findings)
        self._append(records)
        if self.clock.take(records[-1][0], records[-1][1]) and self._reference_ppm is not None:
            self._supervisor.report(drift(self.name, self.clock.ppm, self._reference_ppm(), records[-1][0]))
        self._garbage = self._driver.bad_frames + self._driver.skipped_bytes
        self.samples += len(records)
        if self._recent_count < COUNTED:
            self._count(records)

    def _flagged(self, records: list[Record]) -> list[Record]:
        """The samples that waited while the station did not run, flagged; the value is as good as any other."""
        late, self._waited = records[: self._waited], max(0, self._waited - len(records))
        self.late_samples += len(late)
        stale = int(Quality.STALE)
        return [(*record[:5], record[5] | stale) for record in late] + records[len(late) :]

    def _is_stuck(self) -> bool:
        """The value repeats while the controller's does not."""
        interlock = self.interlock
        if self._reference is None:
            return False
        if interlock.repeats == 0:
            self._standing.forget(self._reference())
            return False
        step = interlock.step if math.isfinite(interlock.step) else 0.0
        return self._standing.check(interlock.repeats, self._reference(), fine=interlock.fine, step=step)

    def _stuck(self, t_ns: int) -> Finding:
        """A value that repeats in motion: stuck, or at an amplifier's end if nothing greater (or less) was ever shown.

        Either way the force or the position is not seen, so either way the rig stops.
        """
        slug = "sensor-saturated" if self.interlock.at_extreme else "sensor-stuck"
        value = self.interlock.last_value
        detail = f"{self.name}: {self.interlock.repeats} identical samples ({value:g}) during motion"
        return Finding(slug, detail, t_ns, value)

    def _check_line(self, good: int, t_ns: int) -> None:
        damaged = self._driver.bad_frames - self._bad_frames
        self._bad_frames += damaged
        findings = self._line.check(good, damaged, t_ns) if good or damaged else []
        if findings:
            self._supervisor.report(findings)

    def _count(self, records: list[Record]) -> None:
        """Follow the first samples, for the rate measured at connect."""
        with self._progress:
            if self._first is None:
                self._first = records[0]
            self._latest = records[-1]
            self._recent_count += len(records)
            self._progress.notify_all()

    @property
    def begun(self) -> bool:
        """A first sample has come, or the rig is armed."""
        return self.samples > 0 or self._supervisor.armed

    def _check_silence(self, now_ns: int) -> None:
        if not self.begun:
            return
        garbage = self._driver.bad_frames + self._driver.skipped_bytes > self._garbage
        slug = "serial-baud" if garbage else self.slug
        finding = self._supervisor.host.missed(self.name, slug, self._last_ns, self._stale_ns, now_ns)
        if finding is not None:
            _, words = self.refusal
            detail = f"{finding.detail}; {words}" if words and finding.slug == slug else finding.detail
            self._supervisor.report([replace(finding, detail=detail)])

    def fresh(self, now_ns: int) -> bool:
        """The last value is younger than the channel's stale-after, or may be waiting in the port."""
        return self.port_lost is None and now_ns - self._last_ns <= self._stale_ns + int(self._timeout_s * 1e9)

    def value(self, now_ns: int) -> float | None:
        """Latest good value (SI), None when stale or before the first."""
        value = self.interlock.last_value
        return value if self.fresh(now_ns) and not math.isnan(value) else None

    def position_m(self, now_ns: int) -> float | None:
        """Latest position (m), None when stale."""
        return self.value(now_ns)

    def still_s(self, now_ns: int) -> float | None:
        """Device seconds of standstill; None when stale, when its values tell nothing, or when this not the LVDT.

        One that repeated its value before the rig was armed, at rest, is quiet: that it does so again says nothing
        against it.
        """
        motion, samples = self.motion, math.inf if self._repeats_at_rest else self._stuck_samples
        if motion is None or motion.blind or self.samples == 0 or self.interlock.says_nothing(samples):
            return None
        return motion.still_s if self.fresh(now_ns) else None

    @property
    def changed(self) -> bool:
        """The LVDT's value has changed since the proof of standstill began, and not stood for too long since.

        A quiet one that rests cannot be told from one that followed the rod for a while and is stuck.
        """
        return self.motion is not None and self.motion.changed and self.interlock.repeats < self._stuck_samples

    def restart_still(self) -> None:
        """Begin the proof of standstill anew."""
        if self.motion is not None:
            self.motion.restart_still()
            self.motion.place.hold(math.nan)

    def hold_place(self) -> None:
        """Standstill is proved: the rod has to stay where it is."""
        if self.motion is not None:
            self.motion.hold_place()

    def left_place(self, now_ns: int) -> bool:
        """An LVDT that shows where the rod is shows it away from where its standstill was proved."""
        return self.motion is not None and self.motion.place.left and self.still_s(now_ns) is not None
