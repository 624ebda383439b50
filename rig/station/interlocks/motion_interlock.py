"""Is the rod moving, how fast, and does a sensor show it? Pure, no clock, no I/O.

`MotionInterlock` evaluates the LVDT. `StandingInterlock` compares a sensor that repeats one value with the controller's
own transducers. A sensor whose resolution is finer than its noise is stuck if the rod has moved meanwhile; if it has
not yet followed a motion, some polls after the motion was seen, because values sent at rest may still be in transit.
One with a coarse resolution may repeat a value along a whole stroke; it is stuck if the controller's own measurement
has changed by several of its steps.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from drivers.ring import Record
from protocols.quality import DOUBTFUL, NO_VALUE
from rig.station.interlocks.finding import CONSECUTIVE, Finding

SPEED_WINDOW_S = 0.010
STILL_TOLERANCE_M = 0.0003
LEFT_M = 0.002
"""A rod that is held under pressure yields by some tenths of a millimetre when the load on it changes."""
TRAVEL_M = 0.2e-3
STEPS = 4.0
SETTLED_POLLS = 5
UNSEEN_PERIODS, UNSEEN_S = 5, 0.025
"""What moved and came back between two samples farther apart than both is not seen: no standstill in between."""
"""Polls of the controller, before and after, by which its status and the sensor may differ in age."""


class Place:
    """Where the rod is held after its standstill was proved, as one transducer measures it."""

    def __init__(self) -> None:
        self._held_m = math.nan
        self._beyond = 0

    @property
    def left(self) -> bool:
        """`CONSECUTIVE` measurements in a row are more than `LEFT_M` away from it."""
        return self._beyond >= CONSECUTIVE

    def hold(self, position_m: float) -> None:
        """Compare what follows with this position (m); with none if it is NaN."""
        self._held_m = position_m
        self._beyond = 0

    def check(self, position_m: float) -> None:
        """Take one measurement (m)."""
        self._beyond = self._beyond + 1 if abs(position_m - self._held_m) > LEFT_M else 0


class MotionInterlock:
    """Speed and standstill from LVDT samples, on the sensor's own clock.

    The speed is the slew over `SPEED_WINDOW_S` of device time (at least 3 samples), which divides the sensor's noise by
    the window; it trips when `CONSECUTIVE` windows in a row exceed the limit, so that one spike (which spoils two
    windows that are not neighbours) does not.
    """

    def __init__(self, speed_limit_m_s: float, rate_Hz: float) -> None:
        self.speed_limit_m_s = speed_limit_m_s
        self._period_s = 1.0 / rate_Hz
        self._span = max(CONSECUTIVE, round(SPEED_WINDOW_S * rate_Hz))
        self._unseen_s = max(UNSEEN_S, UNSEEN_PERIODS / rate_Hz)
        self._recent: deque[tuple[float, float]] = deque(maxlen=self._span)
        self._over = 0
        self._unusable = 0
        self._anchor_m = math.nan
        self._anchor_s = math.nan
        self._latest_s = math.nan
        self._shown: set[float] = set()
        self.place = Place()
        self.speed_m_s = math.nan

    @property
    def changed(self) -> bool:
        """More than one value has been shown since the proof of standstill began."""
        return len(self._shown) > 1

    @property
    def blind(self) -> bool:
        """The sensor sends, but nothing that says where the rod is: its last samples are no measurements."""
        return self._unusable >= CONSECUTIVE

    @property
    def still_s(self) -> float:
        """For how many seconds of the sensor's clock the rod has stayed within `STILL_TOLERANCE_M` (0: it moves)."""
        elapsed_s = self._latest_s - self._anchor_s
        return 0.0 if math.isnan(elapsed_s) else max(0.0, elapsed_s)

    def restart_still(self) -> None:
        """Begin the proof of standstill anew, from the next sample on."""
        # In this order: a sample judged between the two (the supervisor calls from its own thread) sets neither.
        self._anchor_s = math.nan
        self._anchor_m = math.nan
        self._shown = set()

    def hold_place(self) -> None:
        """Compare what follows with the position at which the rod rests now; with none while that is not known."""
        self.place.hold(self._anchor_m)

    def check(self, records: list[Record]) -> list[Finding]:
        """Follow one batch of LVDT samples (m); findings when the speed limit is exceeded."""
        findings: list[Finding] = []
        for host_ns, device_us, value, sequence, _, flags in records:
            if flags:
                if flags & NO_VALUE:
                    self._miss()
                if flags & DOUBTFUL:
                    continue
            self._unusable = 0
            t_s = device_us * 1e-6 if device_us >= 0 else sequence * self._period_s
            if self._recent and t_s <= self._recent[-1][0]:
                self._recent.clear()
                self.restart_still()
            elif t_s - self._latest_s > self._unseen_s:
                self.restart_still()
            if len(self._recent) == self._span:
                before_s, before_m = self._recent[0]
                self.speed_m_s = (value - before_m) / (t_s - before_s)
                self._check_speed(host_ns, findings)
            self._recent.append((t_s, value))
            self._latest_s = t_s
            self.place.check(value)
            if len(self._shown) < 2:
                self._shown.add(value)
            if not abs(value - self._anchor_m) <= STILL_TOLERANCE_M:
                self._anchor_m, self._anchor_s = value, t_s
        return findings

    def _miss(self) -> None:
        """A sample that is no measurement; after a few in a row speed and standstill are unknown."""
        self._unusable += 1
        if self.blind:
            self._recent.clear()
            self.speed_m_s = math.nan
            self.restart_still()

    def _check_speed(self, host_ns: int, findings: list[Finding]) -> None:
        speed_m_s = abs(self.speed_m_s)
        self._over = self._over + 1 if speed_m_s > self.speed_limit_m_s else 0
        if self._over >= CONSECUTIVE:
            detail = f"LVDT speed {speed_m_s:.4g} m/s, allowed {self.speed_limit_m_s:.4g} m/s"
            findings.append(Finding("speed-limit", detail, host_ns, speed_m_s, self.speed_limit_m_s))


class Reference(NamedTuple):
    """What the controller says: polls and the rod's way so far (m), its own measure of the sensor's quantity (SI)."""

    polls: int
    path_m: float
    value: float


class StandingInterlock:
    """Follows one sensor's repeated values.

    Args (construction):
        samples: so many equal ones before anything is judged.
        floor: what the controller's measure of the quantity may change by itself (SI), beside the sensor's steps.
    """

    def __init__(self, samples: int, floor: float) -> None:
        self._samples = samples
        self._floor = floor
        self._repeats = 0
        self._began = Reference(0, 0.0, math.nan)
        self._low = self._high = math.nan
        self._from: Reference | None = None
        self._beyond_since: int | None = None
        self._seen = Reference(0, 0.0, math.nan)
        self._moving = 0
        self._followed = False

    def forget(self, reference: Reference) -> None:
        """The last sample has another value than the one before; the controller's last status."""
        self._repeats = 0
        self._follow(reference)

    def check(self, repeats: int, reference: Reference, *, fine: bool, step: float) -> bool:
        """Take one read.

        Args:
            repeats: how many samples in a row have had the last value.
            reference: the controller's last status.
            fine: the sensor's values usually differ from one sample to the next.
            step: the smallest difference between two of its values that was seen (SI); 0 where none was.

        Returns:
            True while it stands and the rod does not.
        """
        self._follow(reference)
        if repeats < self._repeats or self._repeats == 0:
            self._began, self._from, self._beyond_since = reference, None, None
            self._followed = self._moving >= SETTLED_POLLS
            self._low, self._high = math.inf, -math.inf
        self._repeats = repeats
        if fine:
            return self._gone_a_way(reference) and repeats >= self._samples
        if repeats < self._samples:
            return False
        if reference.polls - self._began.polls < SETTLED_POLLS or not math.isfinite(reference.value):
            return False
        self._low, self._high = min(self._low, reference.value), max(self._high, reference.value)
        if not self._high - self._low > STEPS * step + self._floor:
            return False
        self._beyond_since = reference.polls if self._beyond_since is None else self._beyond_since
        return reference.polls - self._beyond_since >= SETTLED_POLLS

    def _gone_a_way(self, reference: Reference) -> bool:
        """Since the first poll after the value began to stand; where it followed no motion before, some polls ago."""
        if self._from is None:
            self._from = reference if reference.polls > self._began.polls else None
            return False
        if reference.path_m - self._from.path_m <= TRAVEL_M:
            return False
        if self._beyond_since is None:
            self._beyond_since = reference.polls
        return self._followed or reference.polls - self._beyond_since >= SETTLED_POLLS

    def _follow(self, reference: Reference) -> None:
        """Count the polls in a row in each of which the rod had moved on."""
        if reference.polls != self._seen.polls:
            self._moving = self._moving + 1 if reference.path_m > self._seen.path_m else 0
            self._seen = reference
