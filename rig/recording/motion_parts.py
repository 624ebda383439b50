"""Division of an imported file into tests: one for each steady motion, with the used share of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest
from rig.recording.quality.point_quality import RecordQuality
from rig.signals.arrays import FloatArray
from rig.signals.cycles import MeasuredMotion
from rig.signals.free_motion import RANDOM
from rig.signals.loop_shape import noise_of
from rig.signals.motions import Motions, SteadyMotion, motions_of
from rig.signals.test_set import STEADY_A

CURRENT_NOISES = 4.0


@dataclass(frozen=True)
class TestPart:
    """A test, or one of the motions in its record.

    Attributes:
        test: with the part's rows alone, its time from 0 on.
        number: of the part, from 1; 0 where the record is one test.
        count: parts of the record.
        start_s: where the part begins in the record (s).
        motions: the motions of the record.
        record_s: duration of the record (s).
        others: the record's other motions in words.
        whole: motion without cycles, all of which is used.
    """

    test: ImportedTest
    number: int
    count: int
    start_s: float
    motions: Motions
    record_s: float
    others: str = ""
    whole: bool = False

    def use(self, motion: MeasuredMotion | None) -> RecordQuality:
        """How much of the record the part's full cycles are; of motion without cycles all of it."""
        used_s = motion.end_s - motion.start_s if motion is not None else self.record_s if self.whole else 0.0
        rest_s = min(self.motions.rest_s, self.record_s - used_s)
        return RecordQuality(
            record_s=self.record_s, used_s=used_s, rest_s=rest_s, other_s=self.record_s - used_s - rest_s,
            motion=self.number or None, motions=self.count if self.number else None,
            start_s=self.start_s if self.number else None, other_motions=self.others or None,
        )


def parts_of(test: ImportedTest, waveform: str) -> list[TestPart]:
    """The tests in a record: one for each steady motion where there are several, else the record as it is.

    Args:
        test: the record.
        waveform: `random` for motion without cycles, which is never parted.
    """
    test, begin_s = _between_numbers(test)
    record_s = float(test.time_s[-1] - test.time_s[0])
    if waveform == RANDOM:
        return [TestPart(test, 0, 1, begin_s, Motions((), 0.0), record_s, whole=True)]
    current_A, tolerance_A = _current(test)
    motions = motions_of(test.time_s, test.displacement_m, current_A, current_tolerance_A=tolerance_A)
    steady = motions.steady
    if len(steady) < 2:
        return [TestPart(test, 0, 1, begin_s, motions, record_s)]
    parts = []
    for number, motion in enumerate(steady, 1):
        first, last = np.searchsorted(test.time_s, motion.stretch_s).tolist()
        others = "; ".join(_described(other) for other in steady if other is not motion)
        parts.append(TestPart(
            _rows(test, slice(first, last)), number, len(steady), begin_s + float(test.time_s[first]), motions,
            record_s, others,
        ))
    return parts


def between_numbers(displacement_m: FloatArray, force_N: FloatArray) -> slice:
    """The rows from the first to the last one with a displacement and a force.

    In recordings of this program the sensors begin and end at different times. A single row at either end may be a
    number that was cut off: it stays, as a missing value.
    """
    known = np.flatnonzero(np.isfinite(displacement_m) & np.isfinite(force_N))
    count = len(displacement_m)
    first, last = (int(known[0]), int(known[-1]) + 1) if len(known) else (0, count)
    return slice(0, count) if first <= 1 and last >= count - 1 else slice(first, last)


def _between_numbers(test: ImportedTest) -> tuple[ImportedTest, float]:
    """A test without rows before the first and after the last force, and where it begins in the record (s)."""
    rows = between_numbers(test.displacement_m, test.force_N)
    if rows == slice(0, len(test.time_s)):
        return test, 0.0
    return replace(_rows(test, rows), nominal_current_A=test.nominal_current_A), float(test.time_s[rows.start])


def check_one_motion(
    name: str, time_s: FloatArray, displacement_m: FloatArray, current_A: FloatArray | None, waveform: str
) -> None:
    """Refuse a record of several motions where one test is to be made of it.

    Args:
        name: of the record, for the message.
        time_s: time of the record (n,), s.
        displacement_m: displacement (n,), m.
        current_A: measured current (n,), A; None where there is none.
        waveform: `random` for motion without cycles, which is never parted.

    Raises:
        FileProblem: there are several; each with its rows.
    """
    if waveform == RANDOM:
        return
    known = current_A is not None and bool(np.any(np.isfinite(current_A)))
    tolerance_A = STEADY_A + CURRENT_NOISES * noise_of(current_A) if known and current_A is not None else float("inf")
    steady = motions_of(
        time_s, displacement_m, current_A if known else None, current_tolerance_A=tolerance_A
    ).steady
    if len(steady) < 2:
        return
    rows = [np.searchsorted(time_s, motion.stretch_s).tolist() for motion in steady]
    parts = [
        f"{_described(motion)} in rows {first} to {last}" for motion, (first, last) in zip(steady, rows, strict=True)
    ]
    raise FileProblem(name, [
        f"the table contains {len(steady)} motions: {'; '.join(parts)}. Fix: create a separate point for each "
        "motion with table.iloc[FIRST:LAST]"
    ])  # fmt: skip


def _described(motion: SteadyMotion) -> str:
    """A motion in words."""
    current = f" {motion.current_A:.3g} A" if motion.current_A else ""
    return (
        f"{1e3 * motion.amplitude_m:.3g} mm {motion.frequency_Hz:.3g} Hz{current} for "
        f"{motion.end_s - motion.start_s:.3g} s"
    )


def _current(test: ImportedTest) -> tuple[FloatArray | None, float]:
    """The current that tells motions apart (n,), A, and what is no difference of it (A)."""
    for current_A in (test.current_A if test.current_measured else None, test.commanded_A):
        if current_A is not None and np.any(np.isfinite(current_A)):
            return current_A, STEADY_A + CURRENT_NOISES * noise_of(current_A)
    return None, float("inf")


def _rows(test: ImportedTest, rows: slice) -> ImportedTest:
    """Some of a test's rows as a test."""
    def part(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[rows]

    time_s, current_A, commanded_A = test.time_s[rows], test.current_A[rows], part(test.commanded_A)
    known_A = current_A if test.current_measured else commanded_A
    nominal_A = test.nominal_current_A
    if known_A is not None and np.any(np.isfinite(known_A)):
        nominal_A = float(np.nanmedian(known_A))
    return replace(
        test, time_s=time_s - time_s[0], displacement_m=test.displacement_m[rows], force_N=test.force_N[rows],
        current_A=current_A, commanded_A=commanded_A, temperature_degC=part(test.temperature_degC),
        nominal_current_A=nominal_A,
    )


def every_part(tests: Sequence[ImportedTest], waveform: str) -> list[TestPart]:
    """The parts of all tests, in order."""
    return [part for test in tests for part in parts_of(test, waveform)]
