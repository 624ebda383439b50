"""Cross-validation: each amplitude and frequency in turn is left out and predicted from a fit to the others.

A pair is one amplitude and frequency at all currents. The model is fitted to the other pairs and scored, in free run,
on all samples of the one left out: the split and the score of the benchmark on open recordings (`rig.study`).
`folds_of` are quick fits of the same kind, which rank models and give the size of prediction errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rig.dampers.covered import Covered
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.fits.entries import ErrorSummary, Unseen, UnseenPair, UnseenTest
from rig.identification.models.coverage import covered_by
from rig.identification.models.measurement import Measurement, all_but, first_cycle, set_of, spaced
from rig.identification.models.solving import Method, solve_folds
from rig.signals.test_set import MotionReading, motion_groups
from rig.signals.waveform import WAVEFORMS

PAIRS = "pairs"
LEFT_OUT = "leave-one-pair-out"
SAMPLES = 250  # of a cycle in quick fits to the other groups


@dataclass(frozen=True)
class Fold:
    """A fit to all tests but one group.

    Attributes:
        values: its parameters (SI).
        left_out: the tests of the group.
        covered: what the other tests covered.
    """

    values: Mapping[str, float]
    left_out: tuple[Measurement, ...]
    covered: Covered


def folds_of(
    model: DamperModel, tests: Sequence[Measurement], method: Method, near: Mapping[str, float] | None = None
) -> Iterator[Fold]:
    """Quick fits to all tests but those of one motion (of one current if all have one motion); none with one group.

    One cycle of each test is used, and each fit starts from `near`, the values fitted to all tests, where the method
    can make use of a start: for comparing models and for the size of prediction errors, nothing else.

    Raises:
        IdentificationFailed: the model cannot be fitted to the remaining tests.
    """
    some = [spaced(first_cycle(test), SAMPLES) for test in tests]
    groups = set_of(some).groups
    if len(groups) < 2:
        return
    for group, values in zip(groups, solve_folds(model, some, groups, method, near), strict=True):
        yield Fold(values, tuple(some[number] for number in group), covered_by(all_but(some, group)))


def pairs_of(tests: Sequence[Measurement]) -> list[tuple[MotionReading, list[int]]]:
    """Each pair of amplitude and frequency, with the indices of its tests (any current and waveform)."""
    groups = motion_groups([replace(test.motion, waveform="") for test in tests])
    return [(motion, list(groups.members(number))) for number, motion in enumerate(groups.motions)]


def refuse_one_pair(tests: Sequence[Measurement]) -> None:
    """Refuse tests of which no pair can be left out.

    Raises:
        IdentificationFailed: motion without cycles is among them, or they have one amplitude and frequency.
    """
    free = [
        test.id
        for test in tests
        if test.waveform not in WAVEFORMS or not math.isfinite(test.amplitude_m * test.frequency_Hz)
    ]
    if free:
        raise IdentificationFailed(
            f"unseen {PAIRS!r}: no amplitude and frequency for {', '.join(free[:3])}. Fix: hold out the end of the "
            "record instead, with holdout 'last 30 %'"
        )
    if len(pairs_of(tests)) < 2:
        raise IdentificationFailed(
            f"unseen {PAIRS!r}: all {len(tests)} tests have the same amplitude and frequency, so no test remains for "
            "the fit. Fix: hold out a current instead, for example with holdout 'current_A=1'"
        )


def cross_validated(
    tests: Sequence[Measurement], errors_of: Callable[[Sequence[Sequence[int]]], Sequence[ErrorSummary]]
) -> Unseen:
    """Leave-one-pair-out cross-validation: every amplitude and frequency predicted from the others.

    Args:
        tests: the tests.
        errors_of: returns the error of a fit to all other tests, for each group of test indices.

    Raises:
        IdentificationFailed: the model cannot be fitted to the remaining tests.
    """
    pairs, rows, levels = [], [], set_of(tests).currents
    current_of = {
        id(test): test.nominal_current_A if levels.of_test[number] is None else levels.name_A(number)
        for number, test in enumerate(tests)
    }
    motions = pairs_of(tests)
    errors = errors_of([numbers for _, numbers in motions])
    for (motion, numbers), error in zip(motions, errors, strict=True):
        group = [tests[number] for number in numbers]
        amplitude_m, frequency_Hz = motion.nominal
        relative = error.nrmse_percent_of_peak
        pairs.append(UnseenPair(amplitude_m, frequency_Hz, len(group), relative, error.r_squared))
        rows += [
            UnseenTest(
                test.id, amplitude_m, frequency_Hz, current_of[id(test)], one.rmse_N, one.nrmse_percent_of_peak,
                one.beyond,
            )
            for test, one in zip(group, error.per_test, strict=True)
        ]
    mean = sum(row.nrmse_percent_of_peak for row in rows) / len(rows)
    return Unseen(LEFT_OUT, mean, tuple(pairs), tuple(rows))
