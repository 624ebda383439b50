"""Interlock on a motion that the host streams: were its set-points sent in time, did the device follow them? Pure.

Every poll is a step; its set-point is due at the poll's time. A step is late if its set-point was sent, or omitted
because the next one was already due, more than the bench's `setpoint_late` after that. Only steps of a motion are
checked. If the poll interval is shorter than `setpoint_late`, omitted steps give a warning, once per motion.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from drivers.roles import Program, Waveform
from drivers.setpoint_generator import Setpoint
from drivers.streamed_actuator import FEWEST_SETPOINTS
from rig.bench.settings import Limits
from rig.station.interlocks.finding import CONSECUTIVE, Finding

LATE = "setpoints-late"
LOST = "setpoints-lost"
WINDOW_STEPS = 100
MOST_LATE = 5
"""Late steps of the last `WINDOW_STEPS`: a motion that is late so often is not the one that was asked for."""
BIN_S = 1e-4
BINS = 5000
"""Of the histogram of lateness: up to 0.5 s; the last one holds what is later."""
TAKEN_M = 0.2e-3
"""How far a set-point that the device shows may be from the one sent, beside what it goes on by in two polls."""
FOLLOWED_M = 2e-3
"""How far the rod may be from all set-points of the last two polls and `SERVO_S`."""
SERVO_S = 0.03
"""A position loop follows its set-point so much later at most."""
REST_SHARE = 0.2
"""A rod that moves less than this share of what its set-points of the last `REMEMBERED_STEPS` do stands still."""
REMEMBERED_STEPS = 10
LIMIT_SLACK = 1e-6


def unfollowable(program: Program, limits: Limits, poll_s: float) -> list[str]:
    """Why a motion cannot be streamed, in words; nothing where it can.

    Args:
        program: the motion.
        limits: of the machine.
        poll_s: period of the set-points (s of the device's time).
    """
    frequency_Hz, sine = program.frequency_Hz, program.waveform is Waveform.SINE
    omega = 2.0 * math.pi * frequency_Hz
    speed_m_s = (omega if sine else 4.0 * frequency_Hz) * program.amplitude_m
    acceleration_m_s2 = omega**2 * program.amplitude_m if sine else 0.0
    most_Hz = 1.0 / (FEWEST_SETPOINTS * poll_s)
    problems = []
    if frequency_Hz > most_Hz * (1.0 + LIMIT_SLACK):
        problems.append(
            f"a motion at {frequency_Hz:g} Hz has fewer than {FEWEST_SETPOINTS} set-points per cycle. Fix: use at most "
            f"{most_Hz:g} Hz, or shorten the poll interval"
        )
    if speed_m_s > limits.speed_m_s * (1.0 + LIMIT_SLACK):
        problems.append(f"speed {speed_m_s:g} m/s, allowed {limits.speed_m_s:g} m/s")
    if acceleration_m_s2 > limits.acceleration_m_s2 * (1.0 + LIMIT_SLACK):
        problems.append(f"acceleration {acceleration_m_s2:g} m/s^2, allowed {limits.acceleration_m_s2:g} m/s^2")
    return problems


@dataclass
class StepCount:
    """How late set-points were sent.

    Attributes:
        steps: set-points that were due in motion.
        late: those sent or left out too late.
        skipped: those left out.
        worst_s: the latest.
    """

    steps: int = 0
    late: int = 0
    skipped: int = 0
    worst_s: float = 0.0
    _bins: list[int] = field(default_factory=lambda: [0] * BINS, repr=False)

    def sent(self, late_s: float) -> None:
        """One was sent so much after its time (s)."""
        self.steps += 1
        self.worst_s = max(self.worst_s, late_s)
        self._bins[min(BINS - 1, max(0, int(late_s / BIN_S)))] += 1

    def quantile_s(self, share: float) -> float:
        """So much after its time, or less, that share of the set-points was sent (s); to 0.1 ms, rounded up."""
        count_needed, seen = share * sum(self._bins), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= count_needed and seen:
                return min(self.worst_s, (place + 1) * BIN_S)
        return 0.0

    def numbers(self) -> dict[str, object]:
        """For the application: counts, and lateness in s."""
        return {
            "steps": self.steps, "late": self.late, "skipped": self.skipped, "p99_s": self.quantile_s(0.99),
            "worst_s": self.worst_s,
        }


class SetpointInterlock:
    """Follows the set-points of one actuator.

    Args (construction):
        period_s: of the polls (wall s).
        late_s: a step sent so much after its time is late (wall s).
        device_rate: seconds of the device's time in one of the host's.

    Attributes:
        counted: all steps so far.
        lost: set-points were lost since the last `restart`: the stream moves nothing any more.
    """

    def __init__(self, period_s: float, late_s: float, device_rate: float) -> None:
        self.counted = StepCount()
        self.lost = False
        self._period_s = period_s
        self._late_s = late_s
        self._polls_s = 2.0 * period_s * device_rate
        self._servo_steps = math.ceil(SERVO_S / (period_s * device_rate)) + 3
        self._recent: deque[bool] = deque(maxlen=WINDOW_STEPS)
        self._omitted: deque[bool] = deque(maxlen=WINDOW_STEPS)
        self._warned = False
        self._in_a_row = 0
        self._apart = 0
        steps = max(REMEMBERED_STEPS, self._servo_steps)
        self._sent_points: deque[Setpoint] = deque(maxlen=steps)
        self._gone_m: deque[float] = deque(maxlen=steps)

    def restart(self) -> None:
        """Forget what was found: a new motion, or a reset."""
        self.lost = self._warned = False
        self._recent.clear()
        self._omitted.clear()
        self._in_a_row = self._apart = 0
        self._sent_points.clear()
        self._gone_m.clear()

    def sent(self, late_s: float, t_ns: int) -> list[Finding]:
        """A step's set-point was sent in motion.

        Args:
            late_s: so much after its time (wall s); steps that were due meanwhile were left out.
            t_ns: host time.
        """
        skipped = int(late_s / self._period_s)
        self.counted.sent(late_s)
        self.counted.steps += skipped
        self.counted.skipped += skipped
        for step in range(skipped + 1):
            late = late_s - step * self._period_s > self._late_s
            self._recent.append(late)
            self._omitted.append(step < skipped)
            self.counted.late += late
            self._in_a_row = self._in_a_row + 1 if late else 0
            if self._in_a_row >= CONSECUTIVE or sum(self._recent) >= MOST_LATE:
                return [self._late(late_s, t_ns)]
        omitted = sum(self._omitted)
        if self._warned or omitted < MOST_LATE:
            return []
        self._warned = True
        detail = (
            f"{omitted} of the last {len(self._omitted)} set-points were omitted because this computer was too busy "
            f"(the last one sent {1e3 * late_s:.1f} ms late, period {1e3 * self._period_s:g} ms): the rod does not "
            "follow the motion. Fix: close other programs, or grant this program real-time priority"
        )
        return [Finding(LATE, detail, t_ns, omitted, MOST_LATE, warns=True)]

    def _late(self, late_s: float, t_ns: int) -> Finding:
        detail = (
            f"{CONSECUTIVE} set-points in a row, or {MOST_LATE} of the last {WINDOW_STEPS}, were sent more than "
            f"{1e3 * self._late_s:g} ms late; the last one was {1e3 * late_s:.1f} ms late"
        )
        return Finding(LATE, detail, t_ns, late_s, self._late_s)

    def silent(self, gap_s: float, allowed_s: float, t_ns: int) -> Finding:
        """No set-point was taken for so long that the motion is not continued.

        Args:
            gap_s: since the last one that was taken (wall s).
            allowed_s: the longest gap after which a motion goes on (wall s).
            t_ns: host time.
        """
        detail = (
            f"no set-point was accepted for {1e3 * gap_s:.0f} ms, allowed {1e3 * allowed_s:.0f} ms: the motion ends"
        )
        return Finding(LATE, detail, t_ns, gap_s, allowed_s)

    def answered(self, sent: Setpoint, taken_m: float, position_m: float, t_ns: int) -> list[Finding]:
        """The device's answer to a set-point.

        Args:
            sent: the set-point.
            taken_m: the set-point that the device shows (m); NaN where it shows none: then by where the rod is.
            position_m: the device's own position (m).
            t_ns: host time of the answer.
        """
        self._sent_points.append(sent)
        self._gone_m.append(position_m)
        shows = math.isfinite(taken_m)
        apart_m, allowed_m = self._by_setpoint(taken_m) if shows else self._by_rod(position_m)
        self._apart = self._apart + 1 if apart_m > allowed_m else 0
        if self._apart < CONSECUTIVE:
            return []
        self.lost = True
        what = "the device's set-point" if shows else "the rod"
        detail = (
            f"{what} is {1e3 * apart_m:.2f} mm from the commanded set-point, allowed {1e3 * allowed_m:.2f} mm: the "
            "device is not following the streamed set-points"
        )
        return [Finding(LOST, detail, t_ns, apart_m, allowed_m)]

    def _by_setpoint(self, taken_m: float) -> tuple[float, float]:
        """How far the set-point that the device shows is from the one sent (m), and how far it may be."""
        fastest_m_s = max(abs(sent.velocity_m_s) for sent in self._sent_points)
        return abs(self._sent_points[-1].position_m - taken_m), TAKEN_M + fastest_m_s * self._polls_s

    def _by_rod(self, position_m: float) -> tuple[float, float]:
        """How far the rod is from what was sent (m), and how far it may be; it follows some time later."""
        places_m = [sent.position_m for sent in self._sent_points]
        span_m, gone_m = max(places_m) - min(places_m), max(self._gone_m) - min(self._gone_m)
        if span_m > 2.0 * FOLLOWED_M and gone_m < REST_SHARE * span_m:
            return span_m - gone_m, (1.0 - REST_SHARE) * span_m
        recent_m = places_m[-self._servo_steps :]
        # A device that takes no speed is told where the rod is to be a period later, and may be there at once.
        recent_m += [sent.position_m + 0.5 * self._polls_s * sent.velocity_m_s for sent in self._sent_points][-3:]
        beyond_m = max(min(recent_m) - position_m, position_m - max(recent_m), 0.0)
        return beyond_m, FOLLOWED_M
