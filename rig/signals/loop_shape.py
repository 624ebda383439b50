"""What the force says about specimen and fixture, cycle against cycle: scatter, change, free play, standing values.

The force of every full cycle is laid on one grid of phases. Nothing is known of a damper model here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import FloatArray

PHASES = 400
FEWEST_CYCLES = 3
NOISE_OF_THIRD_DIFFERENCE = 1.0 / (0.6745 * np.sqrt(20.0))
QUIET_NOISES = 4.0
QUIET_SHARE = 0.01
OUTSIDE = 5.0
SLOPE_TO = 2.0
SLOWER = 3.0
"""Free play: the force rests at zero so many times longer than its way there and on (to `SLOPE_TO` times what counts as
zero, before a flank turns into a plateau) takes."""
MAYBE_SLOWER = 1.5
MAYBE_FLAT = 2.0
"""A rest may be hidden by noise: where it has to be excluded, so little is enough, and so many times as much noise."""
SMALLEST_PLAY_M = 0.1e-3
LARGEST_PLAY_SHARE = 0.2
"""Of the stroke: a force that rests at zero for longer is the specimen's own."""
FLAT_NOISES = 2.0
APART_SHARE = 0.25
"""Of a cycle, by which the sign changes of the two reversals lie apart."""
PLAY_CYCLES = 2
SPAN_PERCENT = 3.0
CERTAIN = 4.0
"""Standard deviations that noise alone does not make of a scatter, or of a change, in a campaign's points."""
APART_SAMPLES = 3
"""Neighbours so far apart share no noise, whatever interpolation has done to it."""
REPEATED_SHARE = 0.2
"""Where this share of all neighbours are equal, the resolution is coarse and a standing value says nothing."""
STANDING_SAMPLES = 5
STUCK_SHARE = 0.1
"""Of a cycle, during which a moving quantity cannot stand."""


@dataclass(frozen=True)
class LoopShape:
    """Findings about one point's force over its full cycles.

    Attributes:
        scatter_N: standard deviation of the force between cycles at equal phase, beyond the sensor's noise (N); 0 where
            noise alone would explain it.
        change_N: how much peak-to-peak force changed from the first to the last third of the cycles (N), signed.
        change_std_N: what noise alone makes of that (N, one standard deviation).
        span_N: mean peak-to-peak force (N).
        noise_N: the sensor's own noise, from neighbouring samples (N).
        free_play_m: travel during which the force rests at zero after it changes sign; 0 where there is none (m).
    """

    scatter_N: float
    change_N: float
    span_N: float
    noise_N: float
    free_play_m: float
    change_std_N: float = 0.0


def loop_shape(
    time_s: FloatArray, displacement_m: FloatArray, force_N: FloatArray, start_s: FloatArray
) -> LoopShape | None:
    """Compare the cycles of one point.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m.
        force_N: (n,) N; NaN where nothing was measured.
        start_s: beginnings of the full cycles and the end of the last (k + 1,), s.

    Returns:
        None with fewer than three cycles, or without enough samples in them.
    """
    if len(start_s) <= FEWEST_CYCLES:
        return None
    forces, moves = (by_phase(time_s, values, start_s) for values in (force_N, displacement_m))
    if forces is None or moves is None:
        return None
    noise_N = noise_of(force_N)
    a_cycle = np.count_nonzero(np.isfinite(force_N)) / len(forces)
    scatter_N, alone_N = _scatter_N(forces, min(a_cycle, PHASES))
    spans = np.ptp(np.percentile(forces, (SPAN_PERCENT, 100.0 - SPAN_PERCENT), axis=1), axis=0)
    third = max(1, len(spans) // 3)
    span_std_N = alone_N / np.sqrt(0.01 * SPAN_PERCENT * min(a_cycle, PHASES))
    return LoopShape(
        scatter_N=scatter_N,
        change_N=float(np.mean(spans[-third:]) - np.mean(spans[:third])), span_N=float(np.mean(spans)),
        noise_N=noise_N,
        free_play_m=_largest_play_m(forces, moves, noise_N), change_std_N=float(span_std_N * np.sqrt(2.0 / third)),
    )


def _scatter_N(forces: FloatArray, a_cycle: float) -> tuple[float, float]:
    """What cycles differ by beyond the noise (N), 0 where noise explains it, and the noise of a single value (N).

    What two cycles differ by changes slowly over the phase, noise from sample to sample: the noise is what the
    difference at one phase has changed by a few samples on. So it is that of these values, interpolated as they are.

    Args:
        forces: force at equal phases of each cycle, (k, n), N.
        a_cycle: how many of them in a cycle were measured, n at most.
    """
    phases, free = forces.shape[1], len(forces) - 1
    apart = max(1, round(APART_SAMPLES * phases / a_cycle))
    differences = forces - np.mean(forces, axis=0)
    between = np.sum(differences**2, axis=0) / free
    alone = 0.5 * np.sum((differences - np.roll(differences, apart, axis=1)) ** 2, axis=0) / free
    excess = float(np.median(between) - np.median(alone))
    certain = CERTAIN * 2.0 * float(np.median(alone)) * np.sqrt(2.0 / (free * a_cycle))
    return float(np.sqrt(excess)) if excess > certain else 0.0, float(np.sqrt(np.mean(alone)))


def resting_travel_m(
    forces_N: FloatArray, moves_m: FloatArray, noise_N: float, *, at_most: bool = False
) -> float | None:
    """Travel at rest of the force's sign changes in the mean of some cycles.

    Args:
        forces_N: force at equal phases of each cycle, (k, n), N.
        moves_m: displacement at the same phases, (k, n), m.
        noise_N: standard deviation of the force's noise, N.
        at_most: take for a rest what may be one, instead of what certainly is.

    Returns:
        0 where the force does not rest (m); None where it is too weak beside its noise, or changes no sign, to tell.
    """
    force_N = np.mean(forces_N, axis=0)
    quiet_N = max(QUIET_NOISES * noise_N, QUIET_SHARE * 0.5 * float(np.ptp(force_N)))
    if OUTSIDE * quiet_N > 0.5 * float(np.ptp(force_N)) or not np.min(force_N) < 0.0 < np.max(force_N):
        return None
    return _free_play_m(force_N, np.mean(moves_m, axis=0), noise_N, len(forces_N), at_most=at_most)


def noise_of(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal (n,), from its third differences."""
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    return float(np.median(np.abs(third)) * NOISE_OF_THIRD_DIFFERENCE) if len(third) else 0.0


def by_phase(time_s: FloatArray, values: FloatArray, start_s: FloatArray) -> FloatArray | None:
    """Values (n,) at `PHASES` phases of each of k cycles, (k, PHASES); None where too few were measured.

    Args:
        time_s: (n,) s, increasing.
        values: (n,), NaN where nothing was measured.
        start_s: beginnings of the cycles and the end of the last (k + 1,), s.
    """
    known = np.isfinite(values) & np.isfinite(time_s)
    if np.count_nonzero(known) < PHASES // 4:
        return None
    grid = np.arange(PHASES) / PHASES
    grid_s = start_s[:-1, None] + grid[None, :] * np.diff(start_s)[:, None]
    return np.asarray(np.interp(grid_s, time_s[known], values[known]))


def _largest_play_m(forces: FloatArray, moves: FloatArray, noise_N: float) -> float:
    """Free play in any stretch of `PLAY_CYCLES` cycles: a joint may slip in the middle of a point."""
    stretches = [slice(first, first + PLAY_CYCLES) for first in range(len(forces) - PLAY_CYCLES + 1)]
    return max(
        _free_play_m(np.mean(forces[rows], axis=0), np.mean(moves[rows], axis=0), noise_N, PLAY_CYCLES)
        for rows in stretches
    )


def _free_play_m(
    force_N: FloatArray, displacement_m: FloatArray, noise_N: float, cycles: int, *, at_most: bool = False
) -> float:
    """The smaller of the travels at rest of the force's sign changes up and down; both show a loose joint.

    They follow the two reversals, so they lie apart: noise on a slow change of sign makes both at one place.
    """
    quiet_N = max(QUIET_NOISES * noise_N, QUIET_SHARE * 0.5 * float(np.ptp(force_N)))
    if OUTSIDE * quiet_N > 0.5 * float(np.ptp(force_N)) or np.min(force_N) >= 0.0 or np.max(force_N) <= 0.0:
        return 0.0
    flat_N = (MAYBE_FLAT if at_most else 1.0) * FLAT_NOISES * noise_N / np.sqrt(cycles)
    slower = MAYBE_SLOWER if at_most else SLOWER
    changes: list[list[tuple[int, float]]] = []
    for rising in (force_N, -force_N):
        crossing = np.flatnonzero((rising < 0.0) & (np.roll(rising, -1) >= 0.0)).tolist()
        changes.append([(at, _rest_m(rising, displacement_m, at, quiet_N, flat_N, slower)) for at in crossing])
    size = len(force_N)
    return max(
        (min(up_m, down_m) for up, up_m in changes[0] for down, down_m in changes[1]
         if min((up - down) % size, (down - up) % size) >= APART_SHARE * size),
        default=0.0,
    )


def _rest_m(
    rising: FloatArray, displacement_m: FloatArray, at: int, quiet_N: float, flat_N: float, slower: float
) -> float:
    """Travel around one sign change while the force rests, if it is flat and rests longer than its slopes explain."""
    size = len(rising)
    ways = []
    for step in (-1, 1):
        quiet = outside = 0
        position = at if step < 0 else at + 1
        while quiet < size // 2 and abs(rising[(position + step * quiet) % size]) < quiet_N:
            quiet += 1
        while outside < size // 2 and abs(rising[(position + step * (quiet + outside)) % size]) < SLOPE_TO * quiet_N:
            outside += 1
        ways.append((quiet, outside))
    resting = ways[0][0] + ways[1][0]
    slope = max(1.0, (ways[0][1] + ways[1][1]) / (SLOPE_TO - 1.0))
    if resting <= slower * slope:
        return 0.0
    first, last = (at - ways[0][0]) % size, (at + 1 + ways[1][0]) % size
    inside = np.take(rising, np.arange(at - ways[0][0] + 2, at + ways[1][0]), mode="wrap")
    if len(inside) < 2 or float(np.std(inside)) > flat_N:
        return 0.0
    travel_m = abs(float(displacement_m[last] - displacement_m[first]))
    largest_m = LARGEST_PLAY_SHARE * float(np.ptp(displacement_m))
    return travel_m if SMALLEST_PLAY_M <= travel_m <= largest_m else 0.0


@dataclass(frozen=True)
class Standing:
    """Longest runs of exactly equal neighbours: anywhere, and at the greatest or least value (samples).

    `ends`: how many runs of about this length are at the extreme at which the longest one is, as at the end of a
    channel's range; 0 where it is at none, or where most samples are at an extreme: those show no moving quantity.
    `coarse`: besides the longest run and away from the extremes equal neighbours are usual: the resolution is coarse,
    and a run at the extreme says nothing. `step` is the smallest difference of two neighbours, `span` peak to peak.
    """

    longest: int
    at_extreme: int
    coarse: bool = False
    step: float = 0.0
    span: float = 0.0
    ends: int = 0


def standing(values: FloatArray) -> Standing:
    """Find values that stand still where a noisy moving quantity cannot.

    Args:
        values: samples (n,), NaN where nothing was measured.
    """
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return Standing(0, 0)
    differences = np.abs(np.diff(known))
    equal = differences == 0.0
    low, high = float(np.min(known)), float(np.max(known))
    step = float(np.min(differences[~equal])) if not np.all(equal) else 0.0
    bounds = np.flatnonzero(np.diff(np.concatenate(([0], equal.astype(np.int8), [0]))))
    starts, lengths = bounds[::2], np.diff(bounds)[::2] + 1
    if len(starts) == 0:
        return Standing(0, 0, step=step, span=high - low)
    extreme = (known[starts] == high) | (known[starts] == low)
    longest = int(np.argmax(lengths))
    elsewhere = (known[1:] != high) & (known[1:] != low)
    moves = bool(2 * np.count_nonzero(elsewhere) >= len(elsewhere))
    elsewhere[starts[longest] : starts[longest] + lengths[longest]] = False
    coarse = bool(np.any(elsewhere)) and float(np.mean(equal[elsewhere])) > REPEATED_SHARE
    at_extreme = 0 if coarse or not np.any(extreme) else int(np.max(lengths[extreme]))
    similar = np.count_nonzero((known[starts] == known[starts[longest]]) & (2 * lengths > lengths[longest]))
    ends = int(similar) if extreme[longest] and moves and not coarse else 0
    return Standing(int(lengths[longest]), at_extreme, coarse, step, high - low, ends)
