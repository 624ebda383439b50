"""Whether imported tests have compression positive: by the gas force, which pushes the rod out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rig.display import Positive
from rig.recording.external_tests import ImportedTest
from rig.signals.arrays import FloatArray
from rig.signals.free_motion import RANDOM

ENDS = 0.01
"""Share of the travel next to each end: within it, the speed of a sine is below 20 % of its peak."""
LEAST_N = 50.0
"""Less can be a load cell's zero or the weight of a fixture: up to 40 N in published MR damper data."""
LEAST_SHARE = 0.1
"""Of the largest force: less can be an asymmetric damper whose force lags behind the motion."""


class SignedLoop(NamedTuple):
    """Displacement (m) and force (N) of a test, each (n,), with extension positive, and the test's name."""

    name: str
    displacement_m: FloatArray
    force_N: FloatArray


def signed_loops(tests: Sequence[ImportedTest], waveform: str) -> Iterator[SignedLoop]:
    """The tests whose signs can be checked: none of motion without cycles."""
    for test in tests if waveform != RANDOM else ():
        yield SignedLoop(" ".join(filter(None, (test.source.name, test.part))), test.displacement_m, test.force_N)


def convention(positive: Positive) -> str:
    """The sign convention of an import in one line."""
    if positive == "compression":
        return "positive: compression; the signs of displacement and force were inverted (recorded: extension positive)"
    return ("positive: extension and rebound (default); for dyno files in which compression is positive, use "
        "--positive compression")


def doubtful_signs(
    loops: Iterable[SignedLoop], positive: Positive, option: str = "--positive compression"
) -> list[str]:
    """One line if the force between rebound and compression is that of a gas spring that pulls the rod in.

    It must do so in the test with the smallest forces, in which the gas force counts most, and in at least half of the
    tests: the gas force is the same in all of them.

    Args:
        loops: the tests.
        positive: direction that was taken for positive in the files.
        option: with which the user states the other direction.
    """
    known = [(*forces_N, one.name) for one in loops if (forces_N := _middle(one)) is not None]
    if not known:
        return []
    size_N, middle_N, name = min(known)
    if not min(middle_N, float(np.median([one[1] for one in known]))) > max(LEAST_N, LEAST_SHARE * size_N):
        return []
    other = f"{'without' if positive == 'compression' else 'with'} {option}"
    return [
        f"{name}: the mean force at the ends of the stroke is {middle_N:.3g} N in rebound, as if the gas force pulled "
        "the rod in; a gas force pushes the rod out. Displacement and force are probably both positive in "
        f"{'extension' if positive == 'compression' else 'compression'} in the file. Fix: import again {other}; if "
        "the signs are correct, the zero of the load cell has shifted"
    ]


def _middle(one: SignedLoop) -> tuple[float, float] | None:
    """Largest force about the middle and force at both ends of the travel (N); None if neither sign can be checked."""
    known = np.isfinite(one.displacement_m) & np.isfinite(one.force_N)
    x, force = one.displacement_m[known], one.force_N[known]
    if x.size < 2 or not np.ptp(x) > 0.0:
        return None
    if np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x)) <= 0.0:
        return None  # `reversed-sign`: one of the signs is wrong, and which is not known
    margin = ENDS * np.ptp(x)
    extending = np.gradient(x) > 0.0
    # separately, because friction acts in each direction and a few samples need not be divided equally between them
    rows = [end & direction for end in (x >= np.max(x) - margin, x <= np.min(x) + margin)
            for direction in (extending, ~extending)]  # fmt: skip
    if not all(map(np.any, rows)):
        return None
    return 0.5 * float(np.ptp(force)), float(np.mean([np.mean(force[one]) for one in rows]))
