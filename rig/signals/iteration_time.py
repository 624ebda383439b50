"""Longest duration of the trials that precede the recorded points of iterated signals."""

from __future__ import annotations

from collections.abc import Iterable

from rig.signals.drive_iteration import IterationSettings, SignalDrive
from rig.signals.record import Record


def trials_s(
    signals: Iterable[tuple[Record, float]], settings: IterationSettings, known: Iterable[SignalDrive] = (),
    between_s: float = 0.0,
) -> float:
    """Duration of noise and trials before these signals if every allowed iteration is used (s).

    As in a campaign, noise is run only if no response is known up to the highest frequency of the signal; a signal at
    another current, or the same signal again, uses what is known of it. The real duration is shorter if an iteration
    converges earlier.

    Args:
        signals: each target with its current (A), in running order.
        settings: of the iteration.
        known: what is known already.
        between_s: allowed for each run in addition to its motion (s).
    """
    drives = {drive.key: drive for drive in known}
    moved = {(drive.mark, drive.amplitude_m) for drive in drives.values() if drive.response is not None}
    covered_Hz = {False: 0.0, True: 0.0}  # a response to displacement says nothing of force, nor the reverse
    for drive in drives.values():
        if drive.response is not None:
            covered_Hz[drive.of_force] = max(covered_Hz[drive.of_force], float(drive.response.frequency_Hz[-1]))
    begun, total_s = set[tuple[str, float, float]](), 0.0
    for target, current_A in signals:
        motion, key = (target.mark, target.amplitude_m), (target.mark, target.amplitude_m, current_A)
        if key in begun:
            continue
        begun.add(key)
        own = drives.get(key)
        if own is not None and own.settled:
            continue
        if motion not in moved and covered_Hz[target.of_force] < target.highest_Hz:
            total_s += settings.noise_s + between_s
            covered_Hz[target.of_force] = target.highest_Hz
        moved.add(motion)
        trials = settings.most + 1 - (0 if own is None else len(own.trials))
        total_s += max(0, trials) * (target.duration_s + between_s)
    return total_s
