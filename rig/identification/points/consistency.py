"""Do these tests belong together: signs, one damper in one condition, held-out tests that the fit has not seen."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem, IdentificationFailed, some
from rig.identification.models.measurement import Measurement, samples_a_cycle, set_of
from rig.identification.remarks import Remark, say
from rig.signals.test_set import CurrentLevels, same_current, same_motion
from rig.signals.waveform import WAVEFORMS

if TYPE_CHECKING:
    from rig.recording.recorded_point import RecordedPoint

REVERSED = -0.1  # share of the work done without regard to sign, below which a test puts energy in
CLEARLY_REVERSED = -0.3  # the same of a test whose others resist, where stiffness and a delay may make a little of it
REVERSED_SIGN = (
    "the measured force acts with the motion instead of against it: force or displacement has the wrong sign, or their "
    "columns are swapped (displacement increases with extension; a positive force resists extension)"
)
FORCE_DIGEST = "force-digest"
"""Name of the cache entry that holds the SHA-256 of a point's force."""
PHASES = 64
DIFFERENT_OF_PEAK = 0.1  # of two tests alike: more is more than a real damper changes from cycle to cycle
DIFFERENT_OF_NOISE = 2.0
APART_OF_TOGETHER = 0.5  # error of fits apart over that of one fit, below which the runs hold different dampers


def refuse_seen(fitted: Sequence[RecordedPoint | Measurement], held_out: Sequence[RecordedPoint | Measurement]) -> None:
    """Refuse held-out tests that are fitted too.

    Raises:
        IdentificationFailed: a recording is on both sides; the message names them.
    """
    seen = {_fingerprint(test) for test in fitted} - {None}
    twice = [test.id for test in held_out if _fingerprint(test) in seen]
    if twice:
        raise IdentificationFailed(
            f"tests used both for the fit and for validation: {len(twice)} ({some(twice)}); their errors do not "
            "validate the fit. Fix: hold out another run, or part of this run, with a filter such as frequency_Hz=2"
        )


def refuse_twice(fitted: Sequence[RecordedPoint | Measurement]) -> None:
    """Refuse recordings that are given twice: noise that comes twice would count as half of it.

    Raises:
        IdentificationFailed: two tests hold the same recorded force; the message names them.
    """
    first: dict[bytes, str] = {}
    twice = []
    for test in fitted:
        mark = _fingerprint(test)
        if mark is None:
            continue
        if mark in first:
            twice.append(f"{first[mark]} and {test.id}")
        first.setdefault(mark, test.id)
    if twice:
        raise IdentificationFailed(
            f"recordings given twice: {len(twice)} ({some(twice)} contain the same force, sample by sample); a second "
            "copy narrows every interval without adding information. Fix: name each run only once"
        )


def without_still(tests: Sequence[Measurement]) -> tuple[list[Measurement], list[Remark]]:
    """The tests in which force and displacement change, and a warning for each other one.

    Without a change of the force its errors are a share of nothing.

    Raises:
        IdentificationFailed: no test is left; the message names each with its channel and value.
    """
    kept, left_out = [], []
    for test in tests:
        constant = [(name, float(values[0]), unit) for name, values, unit in (
            ("force", test.force_N[test.scored], "N"), ("displacement", test.u_m, "m")
        ) if values.size and float(np.ptp(values)) == 0.0]  # fmt: skip
        if constant:
            left_out.append(say("constant-channel", test=_name(test), channel=constant[0]))
        else:
            kept.append(test)
    if left_out and not kept:
        raise IdentificationFailed(some(left_out, "; "))
    return kept, left_out


def _fingerprint(test: RecordedPoint | Measurement) -> bytes | None:
    """SHA-256 of a test's force; None if its file is damaged, which the preparation of the test reports."""
    if isinstance(test, Measurement):
        return _digest(test.force_N)
    from rig.recording.point_cache import Entry, PointCache  # reads recordings, which measurements do not need

    cache = PointCache(test, FORCE_DIGEST, "")
    entry = cache.read()
    if entry is not None:
        with contextlib.suppress(KeyError, TypeError, ValueError):  # an entry that this program did not write
            return bytes.fromhex(entry.values["sha256"])
    try:
        digest = _digest(test.force_samples.force_N)
    except FileProblem:
        return None
    cache.write(Entry({"sha256": digest.hex()}, {}))
    return digest


def _digest(force_N: FloatArray) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(force_N).data).digest()


def without_reversed_signs(measurements: Sequence[Measurement]) -> tuple[list[Measurement], list[Remark]]:
    """The tests without those whose measured force clearly drives the motion, and a warning for each of these.

    Raises:
        IdentificationFailed: most of the tests put energy in: that is the sign of all of them.
    """
    kept, reversed_tests, clear = [], [], []
    for test in measurements:
        scored = test.scored
        mean_N, done, size = float(np.mean(test.force_N, where=scored)), 0.0, 0.0
        for rows in test.pieces():
            work = np.where(scored[rows], (test.force_N[rows] - mean_N) * test.v_m_s[rows], 0.0)
            done += float(np.sum(work))
            size += float(np.sum(np.abs(work)))
        if done < REVERSED * size:
            reversed_tests.append(test.id)
        if done < CLEARLY_REVERSED * size:
            clear.append(say("left-out", test=_name(test), reason=REVERSED_SIGN))
        else:
            kept.append(test)
    if 2 * len(reversed_tests) > len(measurements) or not kept:
        raise IdentificationFailed(f"{some(reversed_tests)}: {REVERSED_SIGN}")
    return kept, clear


def contradictions(measurements: Sequence[Measurement]) -> list[Remark]:
    """A warning when tests of the same motion and current measured different forces; and what blurs their currents.

    Requested alike is not enough: a test whose motion or current was not reached has another force for that reason.
    """
    groups = set_of(measurements)
    causes = _of_currents(measurements, groups.currents)
    pairs = [
        (first, second)
        for group in groups.identical
        for first, second in itertools.combinations([measurements[number] for number in group], 2)
        if first.waveform in WAVEFORMS and _same_measurement(first, second)
    ]
    loops = {id(test): _loop(test) for pair in pairs for test in pair}
    differing = []
    for first, second in pairs:
        difference = float(np.sqrt(np.mean((loops[id(first)] - loops[id(second)]) ** 2)))
        noise = max((x for x in (first.noise_N, second.noise_N) if not np.isnan(x)), default=0.0)
        peak = max(first.peak_force_N, second.peak_force_N)
        if difference > max(DIFFERENT_OF_PEAK * peak, DIFFERENT_OF_NOISE * noise):
            differing.append(f"{_name(first)} and {_name(second)} by {100.0 * difference / peak:.0f} % of peak")
    return [*causes, say("contradiction", pairs=some(differing))] if differing else causes


def inconsistent_runs(
    measurements: Sequence[Measurement], together_N: float, error_of: Callable[[list[Measurement]], float]
) -> list[Remark]:
    """A warning when the runs, each fitted apart, are described much better than all of them by one fit.

    Args:
        measurements: the tests of all runs.
        together_N: root mean square error of one fit to all (N).
        error_of: the same of a fit to some of them (N).
    """
    runs: dict[Path, list[Measurement]] = {}
    for test in measurements:
        runs.setdefault(Path(test.file).parent, []).append(test)
    if len(runs) < 2:
        return []
    samples = {
        run: sum(np.count_nonzero(test.scored) * test.recorded_each for test in tests) for run, tests in runs.items()
    }
    total = sum(samples[run] * error_of(tests) ** 2 for run, tests in runs.items())
    apart_N = float(np.sqrt(total / sum(samples.values())))
    if apart_N > APART_OF_TOGETHER * together_N:
        return []
    return [say("runs-apart", count=len(runs), apart_N=apart_N, together_N=together_N)]


def _of_currents(measurements: Sequence[Measurement], levels: CurrentLevels) -> list[Remark]:
    """Tests whose measured current is not the requested one, and levels whose tests cannot all be one current."""
    warnings = []
    if levels.contradicting:
        tests = [
            f"{_name(measurements[k])} (requested {measurements[k].nominal_current_A:.4g} A, measured "
            f"{float(np.mean(measurements[k].current_A)):.4g} A)" for k in levels.contradicting
        ]  # fmt: skip
        warnings.append(say("current-contradicts", tests=some(tests)))
    if levels.merged:
        ranges = []
        for level in levels.merged:
            means_A = [float(np.mean(measurements[k].current_A)) for k in levels.members(level)]
            ranges.append(f"{min(means_A):.4g} to {max(means_A):.4g} A")
        resolution_mA = 1e3 * levels.resolution_A[1]
        warnings.append(say("currents-merged", levels=some(ranges), resolution_mA=resolution_mA))
    return warnings


def _same_measurement(first: Measurement, second: Measurement) -> bool:
    one, other = first.current, second.current
    if one is None or other is None or not same_current(one.as_measured, other.as_measured):
        return False
    return same_motion(first.motion.as_measured, second.motion.as_measured)


def _loop(test: Measurement) -> FloatArray:
    """Mean force (N) at `PHASES` equal steps of the cycle, shape (PHASES,)."""
    about_mean = test.u_m - float(np.mean(test.u_m))
    rising = np.flatnonzero((about_mean[:-1] < 0.0) & (about_mean[1:] >= 0.0))
    start = float(rising[0]) if rising.size else 0.0
    phase = ((np.arange(test.u_m.size) - start) / samples_a_cycle(test.u_m)) % 1.0
    scored = test.scored
    bins = (phase[scored] * PHASES).astype(np.int64) % PHASES
    count = np.bincount(bins, minlength=PHASES)
    total = np.bincount(bins, weights=test.force_N[scored], minlength=PHASES)
    there = count > 0
    mean = total[there] / count[there]
    return np.interp(np.arange(PHASES), np.flatnonzero(there), mean, period=PHASES)


def _name(test: Measurement) -> str:
    return f"{test.id} of {Path(test.file).parent.parent.name}" if test.file else test.id
