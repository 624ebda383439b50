"""Fit of the models with internal states that do not split: all parameters at once, sensitivities by differences.

Started from what the model proposes, which may be the solution of a simpler model that it contains as a limit. Starts
compete on one cycle of at most `SCREENED` tests, the best goes on with one cycle of each test, and is finished on all
samples.

The search is bounded by evaluations, on one cycle of each test of at most `SEARCHED` samples, and no state may be
faster than the integration can follow; so its work is bounded whatever the data are, and the same on any machine.
Beside a rival that fits twice as well it is given up after the starts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rig.dampers.algebraic import ColumnModel
from rig.dampers.arrays import FloatArray
from rig.dampers.catalogue import model as damper_model
from rig.dampers.kernel import Compiled, force_series
from rig.dampers.model import DamperModel
from rig.dampers.separation import MotionScale, Search, Unknowns
from rig.identification.models.measurement import Measurement, first_cycle, spaced, spanning
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import (
    SCREENED,
    SEARCHED,
    SearchAbandoned,
    SearchState,
    Solution,
    motion_scale,
    solve_loop,
    solve_separable,
)
from rig.identification.models.undetermined import examine
from rig.optimisers.least_squares import Descent, Squares, descend, normal_equations

DIFFERENCE = 1e-4
ITERATIONS, FIRST_ITERATIONS, LAST_ITERATIONS = 40, 15, 15
TOLERANCE, ROUGH = 1e-7, 1e-5  # share of the objective that a step must promise: on all samples, while searching
MOST_EVALUATIONS = 700  # of the search, on its few samples
NEARLY = 1e-3  # the same from a fit to nearly the same tests, where the model misses far more than the noise
FAR_OFF = 25.0  # times the sum of squares of the best start, beyond which a start is not followed
LONGEST_LOGARITHM = 1.0
DESCRIBED = 4.0  # misfit over noise, in squares, beyond which more cycles of the same misfit say nothing more
FLOOR = 1e-12  # of the largest curvature, below which an unknown counts as without effect


class StateSquares(Squares):
    """The weighted sum of squares over some tests; `noise_power` is what the tests' scatter leaves."""

    def __init__(
        self,
        search: Search,
        unknowns: Unknowns,
        measurements: Sequence[Measurement],
        weighting: Weighting,
        evaluations: int = 0,
    ) -> None:
        self._search, self._unknowns = search, unknowns
        self._data = [(test, weighting.of(test, index)) for index, test in enumerate(measurements)]
        self._scale = motion_scale(measurements)
        noise_N = [0.0 if np.isnan(test.sample_noise_N) else test.sample_noise_N for test in measurements]
        self.noise_power = sum(n**2 * float(w @ w) for n, (_, w) in zip(noise_N, self._data, strict=True)) or np.inf
        self.evaluations = evaluations
        self.budget = MOST_EVALUATIONS
        self.counting = sum(int(np.count_nonzero(w)) for _, w in self._data)
        self.weight = sum(float(np.sum(w**2)) for _, w in self._data)

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        self.evaluations += 1
        vector, total = self._unknowns.vector(theta), 0.0
        for test, weight in self._data:
            residual = (test.force_N - self._force(vector, test)) * weight
            total += float(residual @ residual)
        return total if np.isfinite(total) else np.inf

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`; by forward differences."""
        compiled = self._unknowns.model.slopes_along()
        if compiled is not None:
            return self._exact_slopes(theta, compiled)
        self.evaluations += theta.size + 1
        vectors = [self._unknowns.vector(theta + DIFFERENCE * row) for row in np.eye(theta.size)]
        centre = self._unknowns.vector(theta)

        def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
            for test, weight in self._data:
                force = self._force(centre, test)
                moved = [(self._force(vector, test) - force) * (weight / DIFFERENCE) for vector in vectors]
                yield np.column_stack(moved), (test.force_N - force) * weight

        return normal_equations(rows(), theta.size)

    def _exact_slopes(self, theta: FloatArray, compiled: Compiled) -> tuple[FloatArray, FloatArray]:
        """The same where the model gives its slopes: one pass for all unknowns."""
        centre = self._unknowns.vector(theta)
        self.evaluations += 1
        chain = np.array([
            (self._unknowns.vector(theta + DIFFERENCE * row) - self._unknowns.vector(theta - DIFFERENCE * row))
            / (2.0 * DIFFERENCE)
            for row in np.eye(theta.size)
        ])  # fmt: skip

        def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
            for test, weight in self._data:
                motion = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A)
                state = self._unknowns.model.initial_state(float(test.u_m[0]))
                force, columns = compiled(centre, state, *motion, test.dt_s, test.samples_per_cycle)
                yield (columns @ chain.T) * weight[:, None], (test.force_N - force) * weight

        return normal_equations(rows(), theta.size)

    def admissible(self, theta: FloatArray) -> bool:
        """See `Squares.admissible`."""
        return self._search.admissible(self._unknowns.values(theta), self._scale)

    @property
    def spent(self) -> bool:
        """See `Squares.spent`."""
        return self.evaluations >= self.budget

    def _force(self, vector: FloatArray, test: Measurement) -> FloatArray:
        model, motion = self._unknowns.model, (test.u_m, test.v_m_s, test.a_m_s2, test.current_A)
        state = model.initial_state(float(test.u_m[0]))
        return force_series(model, vector, state, *motion, test.dt_s, test.samples_per_cycle)

    def minimise(
        self, theta: FloatArray, iterations: int, tolerance: float = TOLERANCE, budget: int = MOST_EVALUATIONS
    ) -> tuple[FloatArray, float]:
        """Descend from `theta`; the best unknowns and their objective.

        Args:
            theta: where to start, shape (k,).
            iterations: at most so many.
            tolerance: it ends when a step promises less than this share of the objective,
            budget: or when so many evaluations were made, those before included.
        """
        self.budget = budget
        longest = np.where(self._unknowns.logarithmic, LONGEST_LOGARITHM, np.inf)
        return descend(self, theta, Descent(tolerance, iterations=iterations, floor=FLOOR, longest=longest))


def solve_states(
    measurements: Sequence[Measurement],
    model: DamperModel,
    weighting: Weighting,
    held: frozenset[str],
    start: Mapping[str, float] | None = None,
    rival_N: float = math.inf,
    *,
    exact: bool = False,
) -> Solution:
    """Fit a model with internal states that does not split.

    Args:
        measurements: the tests.
        model: the damper model.
        weighting: which samples count, and how much.
        held: parameters left out, held at zero.
        start: values to start from instead of those the model proposes.
        rival_N: root mean square error of another model on the tests of `spanning` (N).
        exact: finish on all samples also from a start.

    Raises:
        SearchAbandoned: the rival is so much better that nothing more is tried.
    """
    search = model.search()
    single = [first_cycle(test) for test in measurements]
    screened = spanning(single, SCREENED) if start is None and weighting.extra is None else single
    if start is None:
        starts = search.starts(_simpler_values(search, screened, weighting, held), motion_scale(measurements))
    else:
        starts = [search.named(start)]
    unknowns = search.unknowns(starts[0], held)
    few = [spaced(test, SEARCHED) for test in screened]
    short = StateSquares(search, unknowns, few, weighting)
    full = StateSquares(search, unknowns, measurements, weighting)
    families = [starts[k : k + search.family] for k in range(0, len(starts), search.family)]
    seen = [[(short.value(theta), theta) for theta in map(unknowns.theta, family)] for family in families]
    best_of = [min(family, key=lambda pair: pair[0]) for family in seen]
    nearest = min(value for value, _ in best_of)
    thetas = [theta for value, theta in best_of if value <= FAR_OFF * nearest]
    part = MOST_EVALUATIONS // (2 * len(thetas))
    first = FIRST_ITERATIONS if len(thetas) > 1 else ITERATIONS
    rough = NEARLY if start is not None and nearest > DESCRIBED * short.noise_power else ROUGH
    tried = [short.minimise(theta, first, rough, short.evaluations + part) for theta in thetas]
    best = min(tried, key=lambda minimum: minimum[1])
    widened = len(screened) < len(single)
    reached = SearchState(math.sqrt(best[1] / max(short.weight, 1e-300)), short.evaluations, widened)
    if (reason := reached.abandon_reason(model.name, rival_N)) is not None:
        raise SearchAbandoned(reason, reached)
    if widened:
        few, seen_share = [spaced(test, SEARCHED) for test in single], short.evaluations * short.counting
        short = StateSquares(search, unknowns, few, weighting)
        short.evaluations = math.ceil(seen_share / max(1, short.counting))
    share = short.counting / max(1, full.counting)
    theta, _ = best if len(thetas) == 1 and not widened else short.minimise(best[0], ITERATIONS, ROUGH)
    natural = unknowns.values(theta)
    bound = tuple(name for name in model.non_negative if natural[name] < 0.0)
    if bound:
        natural |= _held_at_zero(model, natural, bound, held, motion_scale(measurements))
        unknowns = search.unknowns(natural, held | frozenset(bound))
        short = StateSquares(search, unknowns, few, weighting, short.evaluations)
        full = StateSquares(search, unknowns, measurements, weighting)
        theta, _ = short.minimise(unknowns.theta(search.named(natural)), ITERATIONS, ROUGH)
    finished = start is None or exact
    theta, objective = full.minimise(theta, LAST_ITERATIONS) if finished else (theta, full.value(theta))
    evaluations = full.evaluations + int(np.ceil(short.evaluations * share))
    known = {name: value for name, value in unknowns.values(theta).items() if name != "eta"}
    return Solution(known, objective, evaluations, bound, search.at_limit(unknowns, theta), reached=reached)


def _held_at_zero(
    model: DamperModel, values: Mapping[str, float], bound: Sequence[str], held: frozenset[str], scale: MotionScale
) -> dict[str, float]:
    """Parameters at 0 that were found below, and what they gain per ampere so that the strongest current's force stays.

    Below 0 at most currents a parameter does nothing, and its two numbers may have run off together.
    """
    strongest_A = max(scale.low_current_A, scale.high_current_A, key=abs)
    kept = {
        parameter.name: values[parameter.name] + values[parameter.at_zero] / strongest_A
        for parameter in model.parameters
        if parameter.power == 1 and parameter.at_zero in bound and parameter.name not in held
    }
    return kept | dict.fromkeys(bound, 0.0)


def _simpler_values(
    search: Search, single: Sequence[Measurement], weighting: Weighting, held: frozenset[str]
) -> dict[str, float]:
    """The fitted values of the simpler model that gives the starts; none without one.

    It is fitted without what these tests cannot tell of it, its own powers of the current among them: those would run
    off, and take along the lower ones, which start the search.

    Raises:
        TypeError: the simpler model does not split.
    """
    if not search.simpler:
        return {}
    simpler = damper_model(search.simpler)
    without = frozenset(search.simpler_names[name] for name in held if name in search.simpler_names)
    without |= examine(simpler, single).held
    if isinstance(simpler, ColumnModel):
        return solve_separable(single, simpler, weighting, held=without).values
    form = simpler.separation(motion_scale(single))
    if form is None:
        raise TypeError(f"{simpler.name}, the starting model of {search.model.name}, is not separable")
    return solve_loop(single, form, weighting, without).values
