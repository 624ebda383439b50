"""Peak and valley compensation of the commanded motion, as pure values: what was reached decides what is asked next.

A machine that reaches 46 mm when told 50 mm is told 54.3 mm the next time. What is learned for a motion (waveform,
amplitude, frequency) at a current serves every later point with both: a damper at another current pushes the rod with
another force, and no servo is infinitely stiff. A current not yet seen begins with what the motion's known currents
predict, a motion not yet seen with the nearest known one's correction. Where nothing has had to be corrected, points
run without a trial: on a good machine this costs nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from rig.campaign.words import say
from rig.matrix.point import TestPoint

MOST_STEPS = 3
MIN_ANSWER = 0.25
"""A larger command that brings less than this share of itself is not answered."""
LARGEST_SHIFT_M = 5e-3
MIN_SHARE = 0.5
"""Share of the wanted amplitude that a shift of the centre always leaves room for."""
MIN_CHANGE = 0.1
"""A correction that a limit makes smaller than this share of the tolerance is none."""
TRIAL_CYCLES = 3
TRIAL_RAMP_CYCLES = 1.0


@dataclass(frozen=True)
class MeasuredMotion:
    """What the sensors saw of a program that has ended.

    Attributes:
        amplitude_m: mean over the full cycles of half of peak to valley, m.
        mean_m: mean position, m.
        valve_saturated: the controller reported full flow.
        following_error_m: largest reported difference of set-point and position, m.
    """

    amplitude_m: float
    mean_m: float
    valve_saturated: bool = False
    following_error_m: float = 0.0


@dataclass(frozen=True)
class Ceiling:
    """What may be commanded.

    Attributes:
        amplitude_m: the largest amplitude that speed and acceleration allow, m; `what` limits it, in words.
        low_m: lowest position that may be commanded, m; `high_m` the highest; `where` they come from, in words.
    """

    amplitude_m: float = math.inf
    what: str = ""
    low_m: float = -math.inf
    high_m: float = math.inf
    where: str = ""

    def allowed(self, point: TestPoint, amplitude_m: float, shift_m: float) -> tuple[float, float, str]:
        """Amplitude and shift of the centre (m) nearest to the wanted ones, and what keeps them from being commanded.

        The shift comes first: it is what keeps the measured motion in the middle of the limits.
        """
        least_m = MIN_SHARE * point.amplitude_m
        lowest_m = max(-LARGEST_SHIFT_M, self.low_m + least_m - point.centre_m)
        highest_m = min(LARGEST_SHIFT_M, self.high_m - least_m - point.centre_m)
        moved_m = max(lowest_m, min(highest_m, shift_m))
        centre_m = point.centre_m + moved_m
        room_m = min(self.high_m - centre_m, centre_m - self.low_m)
        why = ""
        if amplitude_m > min(room_m, self.amplitude_m):
            limit = self.where if room_m < self.amplitude_m else self.what
            why = say("beyond-room", command_mm=1e3 * amplitude_m, centre_mm=1e3 * centre_m, limit=limit)
        elif moved_m != shift_m:
            why = say("beyond-shift", wanted_mm=1e3 * shift_m, allowed_mm=1e3 * moved_m)
        return min(amplitude_m, room_m, self.amplitude_m), moved_m, why


@dataclass(frozen=True)
class Drive:
    """How a motion is commanded.

    Attributes:
        waveform, amplitude_m, frequency_Hz: the motion wanted.
        current_A: the coil's current during it.
        command_m: the amplitude to command, m.
        shift_m: added to the centre, m.
        steps: corrections so far.
        settled: nothing more is to be tried: it is within tolerance, or the machine cannot.
        cannot: why the machine cannot; empty while it may.
        tried: commanded and reached amplitude (m) of the program before, None before the first.
    """

    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    command_m: float
    shift_m: float = 0.0
    steps: int = 0
    settled: bool = False
    cannot: str = ""
    tried: tuple[float, float] | None = None

    def moves_as(self, point: TestPoint) -> bool:
        """Whether this is the point's motion, at whatever current."""
        return (self.waveform, self.amplitude_m, self.frequency_Hz) == (
            point.waveform,
            point.amplitude_m,
            point.frequency_Hz,
        )

    def is_for(self, point: TestPoint) -> bool:
        """Whether this is the point's motion at its current."""
        return self.moves_as(point) and self.current_A == point.current_A

    @property
    def key(self) -> tuple[str, float, float, float]:
        """Motion and current."""
        return self.waveform, self.amplitude_m, self.frequency_Hz, self.current_A

    @property
    def gain(self) -> float:
        """Commanded over wanted amplitude."""
        return self.command_m / self.amplitude_m


Drives = tuple[Drive, ...]


def drive_for(point: TestPoint, known: Drives, ceiling: Ceiling) -> Drive:
    """The drive known for a point's motion at its current, else one predicted from other currents or motions."""
    for drive in known:
        if drive.is_for(point):
            return drive
    alike = [drive for drive in known if drive.waveform == point.waveform and not drive.cannot]
    same = [drive for drive in alike if drive.moves_as(point)]
    nearest = min(same or alike, key=lambda drive: _apart(drive, point), default=None)
    shift_m = 0.0 if nearest is None else nearest.shift_m
    gain = _gain_at(same, point.current_A) if same else _predicted_gain(alike, point.frequency_Hz)
    command_m, shift_m, _ = ceiling.allowed(point, point.amplitude_m * gain, shift_m)
    return Drive(point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A, command_m, shift_m)


def remembered(known: Drives, drive: Drive) -> Drives:
    """What is known, with this drive in place of an earlier one for the same motion and current."""
    kept = tuple(earlier for earlier in known if earlier.key != drive.key)
    return (*kept, drive)


def wants_trial(point: TestPoint, known: Drives, tolerance: float) -> bool:
    """Whether a short program is worth its time before the point: its drive is being corrected, or likely to be.

    A current between known ones needs none, nor does the first other current of a motion; beyond the known ones it does
    where the current is known to matter.
    """
    if any(drive.is_for(point) for drive in known):
        return any(drive.is_for(point) and not drive.settled for drive in known)
    same = [drive for drive in known if drive.moves_as(point)]
    if same:
        currents_A, gains = [drive.current_A for drive in same], [drive.gain for drive in same]
        inside = min(currents_A) <= point.current_A <= max(currents_A)
        return not inside and max(gains) - min(gains) > 0.5 * tolerance
    return any(abs(drive.gain - 1.0) > 0.5 * tolerance for drive in known)


def commanded(point: TestPoint, drive: Drive) -> TestPoint:
    """The program that makes the point's motion."""
    return replace(point, amplitude_m=drive.command_m, centre_m=point.centre_m + drive.shift_m)


def trial(point: TestPoint, drive: Drive) -> TestPoint:
    """A short program of the point's motion."""
    return replace(
        commanded(point, drive),
        cycles=min(point.cycles, TRIAL_CYCLES),
        ramp_in_cycles=TRIAL_RAMP_CYCLES,
        ramp_out_cycles=TRIAL_RAMP_CYCLES,
    )


def within(point: TestPoint, seen: MeasuredMotion, tolerance: float) -> bool:
    """Whether amplitude and mean are within `tolerance` of the wanted amplitude."""
    room_m = tolerance * point.amplitude_m
    return abs(seen.amplitude_m - point.amplitude_m) <= room_m and abs(seen.mean_m - point.centre_m) <= room_m


def learned(drive: Drive, point: TestPoint, seen: MeasuredMotion, tolerance: float, ceiling: Ceiling) -> Drive:
    """The drive after one more program: settled, corrected, or given up with the reason."""
    if within(point, seen, tolerance):
        return replace(drive, settled=True, cannot="")
    if seen.amplitude_m <= 0.0:
        return _given_up(drive, point, seen, say("no-motion"))
    if drive.steps >= MOST_STEPS:
        return _given_up(drive, point, seen, say("not-within", percent=100 * tolerance, steps=MOST_STEPS))
    if _unanswered(drive, point, seen, tolerance):
        return _given_up(drive, point, seen, _machine(seen))
    wanted_m = drive.command_m * point.amplitude_m / seen.amplitude_m
    wanted_shift_m = drive.shift_m - (seen.mean_m - point.centre_m)
    command_m, shift_m, why = ceiling.allowed(point, wanted_m, wanted_shift_m)
    change_m = max(abs(command_m - drive.command_m), abs(shift_m - drive.shift_m))
    if why and change_m <= MIN_CHANGE * tolerance * point.amplitude_m:
        return _given_up(drive, point, seen, f"{why}; {_machine(seen)}" if seen.valve_saturated else why)
    tried = (drive.command_m, seen.amplitude_m)
    return replace(drive, command_m=command_m, shift_m=shift_m, steps=drive.steps + 1, tried=tried)


def _unanswered(drive: Drive, point: TestPoint, seen: MeasuredMotion, tolerance: float) -> bool:
    """Whether a clearly larger command than before brought next to nothing."""
    if drive.tried is None or seen.amplitude_m >= point.amplitude_m:
        return False
    before_m, reached_m = drive.tried
    more_m = drive.command_m - before_m
    return more_m > 0.5 * tolerance * point.amplitude_m and seen.amplitude_m - reached_m < MIN_ANSWER * more_m


def _machine(seen: MeasuredMotion) -> str:
    if seen.valve_saturated:
        return say("valve-saturated")
    return say("no-answer", error_mm=1e3 * seen.following_error_m)


def _given_up(drive: Drive, point: TestPoint, seen: MeasuredMotion, why: str) -> Drive:
    text = say(
        "cannot-reach", reached_mm=1e3 * seen.amplitude_m, wanted_mm=1e3 * point.amplitude_m,
        off=100.0 * (seen.amplitude_m / point.amplitude_m - 1.0), command_mm=1e3 * drive.command_m, why=why,
    )
    return replace(drive, settled=True, cannot=text)


def _gain_at(same: list[Drive], current_A: float) -> float:
    """Gain of a motion at a current from its known currents: straight between two, beyond them as the last two say."""
    known = sorted((drive.current_A, drive.gain) for drive in same)
    if len(known) == 1:
        return known[0][1]
    upper = next((index for index, (at_A, _) in enumerate(known) if index and at_A >= current_A), len(known) - 1)
    (low_A, low), (high_A, high) = known[upper - 1], known[upper]
    straight = low + (high - low) * (current_A - low_A) / (high_A - low_A)
    room = max(gain for _, gain in known) - min(gain for _, gain in known)
    return max(min(low, high) - room, min(max(low, high) + room, straight))


def _predicted_gain(known: list[Drive], frequency_Hz: float) -> float:
    """Gain for a frequency from the known ones: `1 + b f^2`, a servo's droop well below its bandwidth.

    With two frequencies or more `a + b f^2` by least squares. Never extrapolated beyond twice the largest correction.
    """
    if not known:
        return 1.0
    squares = [drive.frequency_Hz**2 for drive in known]
    excess = [drive.gain - 1.0 for drive in known]
    mean_square, mean_excess = sum(squares) / len(squares), sum(excess) / len(excess)
    spread = sum((square - mean_square) ** 2 for square in squares)
    if spread > 0.0:
        slope = sum((s - mean_square) * e for s, e in zip(squares, excess, strict=True)) / spread
        predicted = mean_excess + slope * (frequency_Hz**2 - mean_square)
    else:
        predicted = mean_excess * frequency_Hz**2 / mean_square
    largest = 2.0 * max(map(abs, excess))
    return 1.0 + max(-largest, min(largest, predicted))


def _apart(drive: Drive, point: TestPoint) -> float:
    """How different two motions are: the servo answers to frequency first, then to speed, then to force."""
    motion = abs(math.log(drive.frequency_Hz / point.frequency_Hz)) + 0.3 * abs(
        math.log(drive.amplitude_m / point.amplitude_m)
    )
    return motion + 0.01 * abs(drive.current_A - point.current_A)
