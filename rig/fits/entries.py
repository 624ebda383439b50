"""The parts of a fit: estimates, errors, scores, cross-validation, corrections, causes of misfit, next tests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.covered import Covered
from rig.fits.relation import CurrentRelations


@dataclass(frozen=True)
class Estimate:
    """One parameter.

    Attributes:
        value: estimate in `unit`; None where nothing can be said.
        unit: SI unit.
        low: lower end of the 95 % interval of this parameter alone, the one that is shown; None when not
            identifiable.
        high: upper end; a parameter held at its lower limit has this end alone.
        simultaneous_low: lower end of the interval that holds for all identifiable parameters together with 95 %.
        simultaneous_high: upper end.
        standard_error: standard error in `unit`.
        identifiable: whether these tests determine it.
        reason: why not; empty when they do.
        variance_inflation: by how much the other parameters widen its variance (1: not at all).
        quantity: what value, interval and standard error describe if not the parameter alone, such as "c + c_b I at
            I = 0.80 A"; empty for the parameter itself.
    """

    value: float | None
    unit: str = ""
    low: float | None = None
    high: float | None = None
    simultaneous_low: float | None = None
    simultaneous_high: float | None = None
    standard_error: float | None = None
    identifiable: bool = True
    reason: str = ""
    variance_inflation: float | None = None
    quantity: str = ""

    @property
    def determined(self) -> bool:
        """Whether the tests determine the value, of the parameter or of `quantity`."""
        return self.identifiable or bool(self.quantity)

    @property
    def has_interval(self) -> bool:
        """Whether the value is determined and has both ends of its interval."""
        return self.determined and self.low is not None and self.high is not None

    def __float__(self) -> float:
        """The value; NaN where nothing can be said."""
        return math.nan if self.value is None else self.value

    def __str__(self) -> str:
        """Value, standard error and unit."""
        error = "" if self.standard_error is None else f" +- {self.standard_error:.2g}"
        return f"{float(self):.6g}{error} {self.unit}".rstrip()

    def __format__(self, spec: str) -> str:
        """The value by a format of numbers (`f"{fit['beta']:.4g}"`); without one as text."""
        return format(float(self), spec) if spec else str(self)

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Ends of the 95 % interval that is shown, in `unit`."""
        return self.low, self.high

    def holds(self, true: float | None) -> bool | None:
        """Whether the shown interval holds a true value (in `unit`); None without an interval or a true value."""
        if true is None or self.low is None or self.high is None or not self.identifiable:
            return None
        return self.low <= true <= self.high


@dataclass(frozen=True)
class Residual:
    """What one test's residual consists of.

    Attributes:
        noise_N: standard deviation of what does not repeat (N).
        repeating_N: root mean square of what repeats every cycle (N); 0 where that is within chance.
        memory_s: time (s) after which the noise has forgotten itself; tests of whiteness use one sample in so many.
        portmanteau_p: probability of so much autocorrelation in white noise (Ljung-Box); NaN when unknown.
        runs_p: probability of so few or so many runs of one sign in white noise (Wald-Wolfowitz); NaN when unknown.
        widening: factor on the variance of the parameters, against white noise of the same size.
    """

    noise_N: float = math.nan
    repeating_N: float = math.nan
    memory_s: float = math.nan
    portmanteau_p: float = math.nan
    runs_p: float = math.nan
    widening: float = math.nan

    @property
    def known_p(self) -> tuple[float, ...]:
        """The probabilities of such a residual in white noise, those that are known."""
        return tuple(p for p in (self.portmanteau_p, self.runs_p) if not math.isnan(p))

    @property
    def least_p(self) -> float:
        """The smaller probability; 1 where neither is known."""
        return min(self.known_p, default=1.0)


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
        beyond: of a held-out test, the quantities in which it lies beyond the fitted ones (`velocity_m_s`, `current_A`
            ...): its error is that of an extrapolation; empty: it lies within. None: a fitted test, or unknown.
        residual: of a fitted test, what its residual consists of; None where that was not evaluated.
    """

    __test__ = False  # pytest takes classes called Test for its own

    id: str
    file: str = ""
    rmse_N: float = math.nan
    mae_N: float = math.nan
    nrmse_percent_of_peak: float = math.nan
    noise_N: float | None = None
    samples: int = 0
    energy_J: float = math.nan
    modelled_energy_J: float = math.nan
    beyond: tuple[str, ...] | None = None
    residual: Residual | None = None


@dataclass(frozen=True, repr=False)
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

    rmse_N: float = math.nan
    mae_N: float = math.nan
    sd_N: float = math.nan
    r_squared: float = math.nan
    nrmse_percent_of_peak: float = math.nan
    per_test: tuple[TestError, ...] = ()

    def __repr__(self) -> str:
        """The errors over all tests in one line; `Fit.tests_to_pandas` lists each test."""
        return (
            f"<RMSE {self.rmse_N:.4g} N, MAE {self.mae_N:.4g} N, R^2 {self.r_squared:.5g}, "
            f"{self.nrmse_percent_of_peak:.3g} % of force amplitude, {len(self.per_test)} tests>"
        )

    @property
    def within_nrmse_percent_of_peak(self) -> float | None:
        """The same mean over the held-out tests that lie within the fitted ones' data; None where none is known to."""
        return mean_within([(test.nrmse_percent_of_peak, test.beyond) for test in self.per_test])

    @property
    def residuals(self) -> tuple[Residual, ...]:
        """What the tests' residuals consist of, where that was evaluated."""
        return tuple(test.residual for test in self.per_test if test.residual is not None)

    def with_residuals(self, residuals: Sequence[Residual]) -> ErrorSummary:
        """The same with the residual of each test, in the order of `per_test`; as it is where there are none."""
        if not residuals:
            return self
        tests = (replace(test, residual=one) for test, one in zip(self.per_test, residuals, strict=True))
        return replace(self, per_test=tuple(tests))


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
    holdout_nrmse_percent_of_peak: float | None = None
    bic: float = math.nan
    rmse_N: float = math.nan
    parameters: int = 0
    method: str = ""
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
    standard_error: float | None = None
    expected_error: float | None = None


@dataclass(frozen=True, repr=False)
class Cause:
    """What probably explains a misfit, or data that no damper gives.

    Attributes:
        slug: which cause; see docs/json.md.
        text: what was found, with its numbers.
        explains: share of the misfit beyond the noise that it explains (0 to 1); 1 for units and signs, 0 for what
            these tests cannot show.
        next: what to measure or correct.
    """

    slug: str
    text: str
    explains: float
    next: str

    @property
    def of_misfit(self) -> bool:
        """Whether it explains a part of the misfit; otherwise people read it as an observation."""
        return self.explains > 0.0

    def __repr__(self) -> str:
        """One line: code, share of the misfit, statement, what to do."""
        share = f", explains {100.0 * self.explains:.0f} % of the misfit" if self.of_misfit else ""
        return f"<{self.slug}{share}: {self.text}. Next: {self.next}>"


@dataclass(frozen=True)
class SeriesSpring:
    """A spring in series with the damper, and its 95 % interval (N/m); all None where none is seen."""

    stiffness_N_m: float | None
    low: float | None = None
    high: float | None = None

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


@dataclass(frozen=True)
class TemperatureTerm:
    """A fit's temperature law; its rates are among the parameters.

    Attributes:
        law: which (`rig.dampers.temperature_law.RATES`).
        reference_degC: temperature (degC) at which the other parameters hold.
        lowest_degC: lowest recorded temperature of the fitted tests.
        highest_degC: highest.
    """

    law: str
    reference_degC: float
    lowest_degC: float
    highest_degC: float


@dataclass(frozen=True)
class Corrections:
    """What was found and taken into account besides the model.

    Attributes:
        series: spring in series with the damper, where it was looked for; the parameters are the damper's behind it.
        current: relations to the current of parameters fitted at each current separately; None for one fit of all.
        temperature: how the damper follows its temperature; None where not looked for.
        coil_eta_1_s: rate (1/s) at which the coil's current follows its command, found with the force model where the
            current was commanded and not measured; None otherwise.
        others: further corrections by name, each with its numbers; empty where none was requested.
    """

    series: SeriesSpring | None = None
    current: CurrentRelations | None = None
    temperature: TemperatureTerm | None = None
    coil_eta_1_s: float | None = None
    others: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Reference:
    """What is compared with the models and is none.

    Attributes:
        name: `mean_cycle` or `regression`.
        holdout_nrmse_percent_of_peak: its error on held-out tests, scored as the models' are; None if unknown.
        nrmse_percent_of_peak: its error on the fitted tests; None if unknown.
        reason: why something is unknown; empty otherwise.
        within_nrmse_percent_of_peak: of `holdout_nrmse_percent_of_peak` the mean over those tests that lie within the
            data; None if none does, or unknown.
    """

    name: str
    holdout_nrmse_percent_of_peak: float | None = None
    nrmse_percent_of_peak: float | None = None
    reason: str = ""
    within_nrmse_percent_of_peak: float | None = None


@dataclass(frozen=True)
class UnseenTest:
    """One test, predicted by a fit to the tests of the other motions.

    Attributes:
        id: the test's id.
        amplitude_m: of its motion (m).
        frequency_Hz: of its motion (Hz).
        current_A: the level of current to which it belongs (A).
        rmse_N: root mean square error (N).
        nrmse_percent_of_peak: 100 rmse / max|F - mean F|.
        beyond: the quantities in which it lies beyond the other motions' data (`velocity_m_s`, `current_A` ...);
            empty: it lies within. None: unknown.
    """

    id: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    rmse_N: float = math.nan
    nrmse_percent_of_peak: float = math.nan
    beyond: tuple[str, ...] | None = None


@dataclass(frozen=True)
class UnseenPair:
    """One amplitude and frequency at all currents, predicted from the other motions.

    Attributes:
        amplitude_m: amplitude (m).
        frequency_Hz: frequency (Hz).
        tests: number of its tests.
        nrmse_percent_of_peak: mean of their relative errors.
        r_squared: share of their force's variance that is explained.
    """

    amplitude_m: float
    frequency_Hz: float
    tests: int
    nrmse_percent_of_peak: float = math.nan
    r_squared: float = math.nan


@dataclass(frozen=True)
class Unseen:
    """Cross-validation: each test predicted by a fit of the same model to the other motions.

    Attributes:
        split: "leave-one-pair-out".
        nrmse_percent_of_peak: mean over all tests of their relative errors.
        per_pair: one entry for each amplitude and frequency.
        per_test: one entry for each test.
    """

    split: str
    nrmse_percent_of_peak: float = math.nan
    per_pair: tuple[UnseenPair, ...] = ()
    per_test: tuple[UnseenTest, ...] = ()

    @property
    def within_nrmse_percent_of_peak(self) -> float | None:
        """Mean over the tests that lie within the other motions' data; None where none is known to."""
        return mean_within([(test.nrmse_percent_of_peak, test.beyond) for test in self.per_test])


@dataclass(frozen=True)
class TestCycle:
    """One cycle of a fitted test that has no file, for figures of the fit that is read back; arrays of one length.

    Attributes:
        id: of the test.
        dt_s: sampling interval (s).
        displacement_m: about mid-stroke (m).
        velocity_m_s: velocity (m/s).
        acceleration_m_s2: acceleration (m/s^2).
        force_N: measured force (N); 0 where it was not measured.
        current_A: coil current (A).
        missing: places of the samples without a force, from 0.
        temperature_degC: recorded temperature (degC); empty where none was.
    """

    __test__ = False  # pytest takes classes called Test for its own

    id: str
    dt_s: float
    displacement_m: tuple[float, ...]
    velocity_m_s: tuple[float, ...]
    acceleration_m_s2: tuple[float, ...]
    force_N: tuple[float, ...]
    current_A: tuple[float, ...]
    missing: tuple[int, ...] = ()
    temperature_degC: tuple[float, ...] = ()


@dataclass(frozen=True)
class Evaluation:
    """How well the model describes and predicts the tests.

    Attributes:
        error: on the tests it was fitted to.
        holdout: on the held-out tests; None without any.
        adequate: whether the model describes the data down to their noise; None where no test has two cycles to tell.
        selection: the models compared, best first.
        references: the mean cycle and a regression, for comparison; none where one model was fitted.
        passivity: where the fitted model takes energy out; None when it was not looked at.
        unseen: cross-validation over the motions, where that was requested; None otherwise.
    """

    error: ErrorSummary = field(default_factory=ErrorSummary)
    holdout: ErrorSummary | None = None
    adequate: bool | None = None
    selection: tuple[ModelScore, ...] = ()
    references: tuple[Reference, ...] = ()
    passivity: Passivity | None = None
    unseen: Unseen | None = None


@dataclass(frozen=True)
class SolverReport:
    """How the model was fitted.

    Attributes:
        method: name of the fitting method.
        weight: "1" or "v" (equation 12), or "relative" (each test by its relative error).
        loss: "squares" or "huber".
        evaluations: evaluations of equation (12) that the solution took; comparing and evaluating are not counted.
        wall_s: wall time (s).
        objective: equation (12) at the solution, with the fit's weight and those of its loss.
    """

    method: str = ""
    weight: str = "1"
    loss: str = "squares"
    evaluations: int = 0
    wall_s: float = math.nan
    objective: float = math.nan


@dataclass(frozen=True, repr=False)
class Profile:
    """One parameter's profile likelihood.

    Attributes:
        values: values of the parameter (SI), rising, shape (k,).
        deviance: D at each of them, shape (k,); 0 at the estimate, 3.84 at the ends of the interval.
        low: lower end of the 95 % interval; None where the profile stays below the threshold as far as the model can be
            evaluated, or a nonlinear parameter goes.
        high: upper end.
    """

    values: tuple[float, ...]
    deviance: tuple[float, ...]
    low: float | None
    high: float | None

    def __repr__(self) -> str:
        """The interval in one line, without the curve."""
        low, high = ("open" if end is None else f"{end:.6g}" for end in (self.low, self.high))
        return f"<profile likelihood at {len(self.values)} values; 95 % interval: {low} to {high}>"


@dataclass(frozen=True)
class BootstrapInterval:
    """One parameter over the draws of a bootstrap, in its unit: 95 % interval and standard error."""

    low: float
    high: float
    standard_error: float


@dataclass(frozen=True)
class BootstrapResult:
    """A bootstrap: the tests drawn again, and what each draw gave.

    Attributes:
        count: how many draws.
        tests: how many tests were drawn from.
        widening: factor on the spread of the draws, for so few tests.
        parameters: fitted parameter to its interval.
        draws: fitted parameter to its values (SI) in the first draws.
    """

    count: int
    tests: int
    widening: float
    parameters: Mapping[str, BootstrapInterval]
    draws: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Uncertainty:
    """How sure the parameters are, besides the intervals of their estimates.

    Attributes:
        correlation: parameter names to names to correlation.
        condition: condition number of the scaled normal matrix.
        notes: how the intervals were made.
        profiles: profile likelihoods that were requested, by parameter.
        drawn: the bootstrap, where one was requested.
    """

    correlation: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    condition: float = math.nan
    notes: tuple[str, ...] = ()
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    drawn: BootstrapResult | None = None


FEW_MOTIONS = 2
"""So few predicted motions hardly tell how far off the next one is; a band says so."""


@dataclass(frozen=True)
class Band:
    """How far measured forces are from predicted ones: within the tested range, 95 % of the samples of a new motion.

    Attributes:
        current_A: currents (A), rising.
        half_width_N: half width at each (N); NaN where it is not known.
        source: which tests it comes from.
        left_out: number of tests that were predicted by a fit to others, within whose range they lie. 0, as in files of
            earlier versions: the half width describes the residuals of fitted tests and is no prediction error.
        motions: number of different motions among those.
    """

    current_A: tuple[float, ...]
    half_width_N: tuple[float, ...]
    source: str
    left_out: int = 0
    motions: int = 0

    @property
    def of_predictions(self) -> bool:
        """Whether the half width is a prediction error, and not only the size of the residuals."""
        return self.left_out > 0

    def describe(self) -> str:
        """What a prediction error means and where it comes from, in one sentence."""
        tests = f"{self.left_out} test{'s' * (self.left_out != 1)}"
        motions = f"{'only ' * (self.motions <= FEW_MOTIONS)}{self.motions} motion{'s' * (self.motions != 1)}"
        return (
            f"95 % prediction error within the tested range, from {tests} of {motions} predicted by fits to other "
            f"tests ({self.source})"
        )

    def at(self, current_A: FloatArray) -> FloatArray:
        """Half width (N) at currents (A), shape (n,); as at the nearest tested current beyond them."""
        return np.asarray(np.interp(current_A, self.current_A, self.half_width_N))


@dataclass(frozen=True, kw_only=True)
class TestedRange(Covered):
    """What the fitted tests covered, and how far measured forces were from modelled ones there.

    Attributes:
        band: the error of a prediction there.
    """

    __test__ = False  # pytest takes classes called Test for its own

    band: Band = field(default_factory=lambda: Band((0.0,), (math.nan,), ""))
