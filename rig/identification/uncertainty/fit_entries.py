"""What a fit consists of: estimates, errors, scores, energy given back, causes of misfit, tests worth running next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Estimate:
    """One parameter.

    Attributes:
        value: estimate in `unit`; None where nothing can be said.
        unit: SI unit.
        low: lower end of the 95 % interval of this parameter by itself, the one that is shown; None when not
            identifiable.
        high: upper end; a parameter held at its lower limit has this end alone.
        simultaneous_low: lower end of the interval that holds for all identifiable parameters together with 95 %.
        simultaneous_high: upper end.
        standard_error: standard error in `unit`.
        identifiable: whether these tests determine it.
        reason: why not; empty when they do.
        variance_inflation: by how much the other parameters widen its variance (1: not at all).
    """

    value: float | None
    unit: str
    low: float | None = None
    high: float | None = None
    simultaneous_low: float | None = None
    simultaneous_high: float | None = None
    standard_error: float | None = None
    identifiable: bool = True
    reason: str = ""
    variance_inflation: float | None = None


@dataclass(frozen=True)
class TestError:
    """How well the model gives one test's force back.

    Attributes:
        id: the test's id.
        file: its file.
        rmse_N: root mean square error (N).
        mae_N: mean absolute error (N).
        nrmse_percent_of_peak: 100 rmse / max|F - mean F|.
        noise_N: scatter of the force from cycle to cycle (N); None when unknown.
        samples: number of samples.
        energy_J: energy dissipated in a mean cycle, measured (J); NaN where a stretch of every cycle has no force.
        modelled_energy_J: the same by the model (J).
        beyond: of a test that the fit has not seen, the quantities in which it lies beyond the fitted ones
            (`velocity_m_s`, `current_A` ...): its error is that of an extrapolation; empty: it lies within. None: a
            fitted test, or a file that does not tell.
    """

    __test__ = False  # pytest takes classes called Test for its own

    id: str
    file: str
    rmse_N: float
    mae_N: float
    nrmse_percent_of_peak: float
    noise_N: float | None
    samples: int
    energy_J: float
    modelled_energy_J: float
    beyond: tuple[str, ...] | None = None


@dataclass(frozen=True)
class ErrorSummary:
    """Errors over some tests: all samples together, and each test.

    Attributes:
        rmse_N: root mean square error over all samples (N).
        mae_N: mean absolute error over all samples (N).
        sd_N: standard deviation of the error (N).
        r_squared: share of the force's variance that the model explains.
        nrmse_percent_of_peak: mean over tests of their relative errors.
        per_test: one entry a test.
    """

    rmse_N: float
    mae_N: float
    sd_N: float
    r_squared: float
    nrmse_percent_of_peak: float
    per_test: tuple[TestError, ...]

    @property
    def within_nrmse_percent_of_peak(self) -> float | None:
        """The same mean over the unseen tests that lie within the fitted ones' data; None where none is known to."""
        return mean_within([(test.nrmse_percent_of_peak, test.beyond) for test in self.per_test])


def mean_within(errors: Sequence[tuple[float, tuple[str, ...] | None]]) -> float | None:
    """Mean of the errors of tests that lie within the data, each with that in which its test lies beyond."""
    known = [error for error, beyond in errors if beyond == ()]
    return sum(known) / len(known) if known else None


@dataclass(frozen=True)
class ModelScore:
    """One model in the comparison: error on unseen tests (None without any) and Bayesian information criterion.

    A model that was not fitted to the end has its reason, and neither of them.

    Attributes:
        model: its name.
        holdout_nrmse_percent_of_peak: mean relative error on unseen tests: held out, or each left out in turn.
        bic: Bayesian information criterion.
        rmse_N: root mean square error on the fitted tests (N).
        parameters: how many were fitted.
        method: by which.
        reason: why it was given up; empty otherwise.
        within_nrmse_percent_of_peak: the mean over those unseen tests that lie within the data of their fit; None where
            none does.
        beyond: unseen test -> the quantities in which it lies beyond them; only those that do.
    """

    model: str
    holdout_nrmse_percent_of_peak: float | None
    bic: float
    rmse_N: float
    parameters: int
    method: str
    reason: str = ""
    within_nrmse_percent_of_peak: float | None = None
    beyond: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Passivity:
    """Where the fitted model takes energy out, over the tested speeds (both ways) and currents.

    Attributes:
        share: share of the envelope with F v >= 0, gas force and springs left out.
        worst: what happens elsewhere, in words; empty when `share` is 1.
    """

    share: float
    worst: str


@dataclass(frozen=True)
class NextTest:
    """A test worth running next.

    Attributes:
        parameter: whose interval it shrinks most.
        text: which test, and what it is expected to do.
        toml: lines to append to a matrix file.
        standard_error: of the parameter now, in its unit; None where it is not known.
        expected_error: the same after that test; None where there is none to compare with.
    """

    parameter: str
    text: str
    toml: str
    standard_error: float | None
    expected_error: float | None


@dataclass(frozen=True)
class Cause:
    """What probably explains a misfit, or data that no damper gives.

    Attributes:
        slug: which cause; see docs/json.md.
        text: what was found, with its numbers.
        explains: share of the misfit beyond the noise that it explains (0 to 1); 1 for units and signs, 0 for what
            these tests cannot show.
        next: what to measure or mend.
    """

    slug: str
    text: str
    explains: float
    next: str


@dataclass(frozen=True)
class SeriesSpring:
    """A spring in series with the damper, and its 95 % interval (N/m); all None where none is seen."""

    stiffness_N_m: float | None
    low: float | None
    high: float | None

    def widened(self, variance: float, relative: float) -> SeriesSpring:
        """The same where the residual's correlation and misfit multiply the variance of its compliance.

        Args:
            variance: that factor.
            relative: half width (1), as a share of the compliance, that is added to it in squares.
        """
        if self.stiffness_N_m is None or self.low is None or self.high is None:
            return self
        compliance = 1.0 / self.stiffness_N_m
        half = math.hypot(0.5 * math.sqrt(variance) * (1.0 / self.low - 1.0 / self.high), relative * compliance)
        high = 1.0 / (compliance - half) if half < compliance else math.inf
        return SeriesSpring(self.stiffness_N_m, 1.0 / (compliance + half), high)
