"""Points whose motion has no cycles, such as random motion: the whole record is a measurement, and may be cut in time.

No cycle is dropped and none is run before the first sample: models with internal states start at rest there. So many
samples are kept that a crossing of the mean to the next has about `SAMPLES_A_CROSSING`; more tell a fit nothing.

What is held out is the end of the time. A model is run freely from the first sample of the record on through what was
fitted (only motion and current go in, never a measured force), and scored on the end.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement
from rig.identification.points.channels import FEWEST_SAMPLES, force_on_grid, measured
from rig.identification.remarks import say
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint
from rig.signals.fourier import quantisation_step
from rig.signals.free_motion import free_motion, mean_rate_Hz
from rig.signals.loop_shape import noise_of
from rig.signals.waveform import WAVEFORMS

SAMPLES_A_CROSSING = 80
HIGHEST_SHARE = 0.5
"""Of a signal's highest frequency, whose crossings keep so many samples too."""
LAST = re.compile(r"\s*last\s+(\d+(?:\.\d+)?)\s*%\s*")
LEAST_PERCENT, MOST_PERCENT = 1.0, 90.0


def has_cycles(point: RecordedPoint) -> bool:
    """Whether a point's motion repeats: that of a waveform of the matrix; not of a sweep, a road or a file's record."""
    return point.waveform in WAVEFORMS


def prepare_whole(point: RecordedPoint, skew: PointSkew | None = None) -> Measurement:
    """A recorded point without cycles as a measurement.

    Args:
        point: the point.
        skew: what the campaign as a whole knows of the sensors' delays; None: what the point's file says.

    Raises:
        IdentificationFailed: too little of the point can be used.
        NotDifferentiable: too few samples for a velocity.
    """
    known_s = point.time_s[np.isfinite(point.displacement_m)]
    if known_s.size == 0:
        raise IdentificationFailed("no displacement was measured")
    shift_s = 0.0 if skew is None else skew.shift_s
    first_s, last_s, evaluated_s = _stretch(point, float(known_s[0]), float(known_s[-1]))
    grid_s, force_N, usable = force_on_grid(point, shift_s, first_s, last_s)
    usable &= (grid_s >= evaluated_s[0]) & (grid_s <= evaluated_s[1])
    rate_Hz = max(mean_rate_Hz(point.time_s, point.displacement_m), HIGHEST_SHARE * _highest_Hz(point))
    dt_s = float(grid_s[-1] - grid_s[0]) / (grid_s.size - 1)
    every = max(1, int(1.0 / (SAMPLES_A_CROSSING * rate_Hz * dt_s))) if rate_Hz > 0.0 else 1
    rows = slice(0, grid_s.size, every)
    if np.count_nonzero(usable) < FEWEST_SAMPLES:
        count = np.count_nonzero(usable)
        raise IdentificationFailed(f"got {count} force samples between the ramps, expected {FEWEST_SAMPLES} or more")
    noise_N, step_N = noise_of(force_N[usable]), quantisation_step(force_N[usable])
    grid_s, force_N, usable = grid_s[rows], force_N[rows], usable[rows]
    motion = free_motion(point.time_s, point.displacement_m, grid_s)
    test = measured(point, skew, motion, float(np.mean(motion.u_m)), force_N, usable)
    warnings = (say("whole-record", used="every sample" if every == 1 else f"one in {every} samples"), *test.warnings)
    return replace(test, dt_s=dt_s * every, force_step_N=step_N, noise_N=noise_N, warnings=warnings)


def _stretch(point: RecordedPoint, first_s: float, last_s: float) -> tuple[float, float, tuple[float, float]]:
    """Where a model begins and ends (s), and between which times (s) it is scored.

    A signal is run from its beginning, where the damper stood, and scored between its ramps; any other motion is scored
    over all of the record.
    """
    signal = point.quality.signal
    if signal is None or signal.start_s is None or signal.end_s is None:
        return first_s, last_s, (first_s, last_s)
    begin_s, end_s = max(first_s, signal.start_s), min(last_s, signal.end_s)
    return begin_s, end_s, (signal.judged_start_s or begin_s, signal.judged_end_s or end_s)


def _highest_Hz(point: RecordedPoint) -> float:
    """The highest frequency of a signal; 0 if it is not stated."""
    return 0.0 if point.record is None else point.record.highest_Hz


def last_share(holdout: str) -> float | None:
    """The share of the time that `last 30 %` holds out (0.3); None where the text says something else.

    Raises:
        IdentificationFailed: it says so, and the share leaves too little on one side.
    """
    match = LAST.fullmatch(holdout)
    if match is None:
        return None
    percent = float(match[1])
    if not LEAST_PERCENT <= percent <= MOST_PERCENT:
        raise IdentificationFailed(
            f"holdout: got {holdout!r}, expected the last {LEAST_PERCENT:g} to {MOST_PERCENT:g} % of the record"
        )
    return percent / 100.0


def cut_in_time(tests: Sequence[Measurement], share: float) -> tuple[list[Measurement], list[Measurement]]:
    """The beginning of each test, to be fitted, and the test with only its end scored.

    Args:
        tests: without cycles.
        share: of the time that is held out, at the end.

    Raises:
        IdentificationFailed: a test has cycles, whose end repeats its beginning.
    """
    cyclic = [test.id for test in tests if test.waveform in WAVEFORMS]
    if cyclic:
        raise IdentificationFailed(
            f"the end of {', '.join(cyclic[:3])} repeats its beginning and cannot validate the fit: the last part of a "
            "record can be held out only if the motion has no cycles. Fix: hold out whole tests, such as frequency_Hz=2"
        )
    beginnings, ends = [], []
    for test in tests:
        cut = round((1.0 - share) * test.u_m.size)
        beginnings.append(test.rows(slice(0, cut)))
        later = test.scored.copy()
        later[:cut] = False
        ends.append(replace(test, usable=later))
    return beginnings, ends
