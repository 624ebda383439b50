"""How tests count where no model describes them to their noise: each by its relative error, not by its newtons.

Least squares with equal weights is right where what is left is noise. Where it is misfit, samples of one test say the
same again and again, and tests at high current have the largest misfit in newtons: the test with the most samples and
the greatest force would decide what all others get. Then each test counts alike, by its error in % of its peak, which
is also how models are ranked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rig.identification.models.measurement import Measurement
from rig.identification.models.solving import SEPARABLE, SQUARES, Candidate, Method, solve
from rig.identification.uncertainty.scoring import score

RELATIVE = "relative"
MISFIT = 3.0  # times the tests' scatter: what the best model leaves is then misfit for nine tenths of its power


def misfit_over_scatter(candidates: Sequence[Candidate], fitted: Sequence[Measurement]) -> float:
    """Root mean square error of the best candidate over the scatter of the tests (1); NaN where that is not known."""
    power = [test.noise_N**2 * test.u_m.size for test in fitted]
    scatter_N = math.sqrt(sum(power) / sum(test.u_m.size for test in fitted))
    least_N = min(score(candidate.model, candidate.solution.values, fitted).rmse_N for candidate in candidates)
    return least_N / scatter_N if scatter_N > 0.0 else math.nan


def weighted_by_misfit(
    candidates: Sequence[Candidate], fitted: Sequence[Measurement], method: Method
) -> tuple[list[Candidate], Method, float]:
    """The candidates fitted again with relative weights, where even the best one leaves misfit and not noise.

    Args:
        candidates: models with their solutions.
        fitted: the tests.
        method: how they were fitted; a weight that was asked for stays.

    Returns:
        The candidates and the method, as they were or with relative weights, and the misfit over the scatter.
    """
    asked = method.weight is not None or method.name != SEPARABLE or method.loss != SQUARES
    ratio = math.nan if asked or len(fitted) < 2 else misfit_over_scatter(candidates, fitted)
    if not MISFIT < ratio < math.inf:
        return list(candidates), method, ratio
    weighted, again = replace(method, weight=RELATIVE), []
    for candidate in candidates:
        solution = solve(candidate.model, fitted, weighted, candidate.findings, candidate.solution.values)
        evaluations = candidate.solution.evaluations + solution.evaluations
        again.append(replace(candidate, solution=replace(solution, evaluations=evaluations)))
    return again, weighted, ratio
