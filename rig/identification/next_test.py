"""Which test to run next: the one that is expected to shrink the widest interval most.

The information of a test that was not run yet is J'J / s^2, with the fitted model's slopes J on its motion and the
noise s of the tests that were run. Added to the information of all tests so far it gives the intervals to expect
(D-optimal designs look at all of them together; here the worst one counts). Candidates are sines inside what the bench,
or without one what the tests so far, allow; a slow one is not credited with being longer than the tests so far. A model
that does not fit proposes nothing: its slopes are not the damper's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from rig.campaign_folder import CampaignFolder
from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import physical
from rig.dampers.model import DamperModel
from rig.fits.entries import NextTest
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.model_slope import modelled_force, parameter_slopes
from rig.identification.options import Allowance
from rig.identification.uncertainty.fit import Fit
from rig.test_point import TestPoint

AMPLITUDES, FREQUENCIES, CURRENTS = 5, 6, 5
ENOUGH = 4096  # samples of a test that tell what it says of the parameters
SAMPLES = 120  # of one candidate cycle
KEPT_CYCLES = 8
PRIOR_DEVIATION = 10.0  # of every parameter, in its scale, so that what was never tested stays finite
SMALLEST_CONTRIBUTION = 0.01  # of the peak force: a smaller contribution's interval is judged by this, not by its value
WORTHWHILE = 0.9  # ratio of the intervals after and before, above which a test is not worth proposing
FORCE_SHARE = 0.95  # of the greatest force allowed that a candidate may be expected to need
ROUNDING = 1.02  # on what was tested, so that the nominal values of these tests are inside
MEANT_TO_BE_NEXT = 0.05  # of the last digit: 49.98 mm were meant to be 50
MOST_CHECKS = 25
STEP_HOLD = "500 ms"


def envelope_of(measurements: Sequence[Measurement]) -> Allowance:
    """What the tests so far have shown to be possible."""

    def largest(of: Callable[[Measurement], FloatArray]) -> float:
        return ROUNDING * max(float(np.max(np.abs(of(test)))) for test in measurements)

    return Allowance(
        amplitude_m=max(float(np.ptp(test.u_m)) for test in measurements) / 2.0,
        speed_m_s=largest(lambda test: test.v_m_s),
        acceleration_m_s2=largest(lambda test: test.a_m_s2),
        force_N=largest(lambda test: test.force_N) / FORCE_SHARE,
        current_A=largest(lambda test: test.current_A) / ROUNDING,
        source="within the range tested so far",
    )


def bench_of(folder: Path) -> Allowance | None:
    """What the bench and the specimen of a recorded campaign allow; None for tests from elsewhere.

    Raises:
        FileProblem: the campaign's own bench or matrix file cannot be read.
    """
    campaign = CampaignFolder(folder)
    if not campaign.bench.is_file() or not campaign.matrix.is_file():
        return None
    from rig.bench.model import Bench  # loads pydantic
    from rig.matrix.feasibility import HEADROOM_M  # loads pydantic
    from rig.matrix.model import Matrix, load_matrix  # loads pydantic
    from rig.matrix.plan import plan  # loads pydantic
    from rig.matrix.sections import ExtraPoint  # loads pydantic

    bench, matrix = Bench.load(campaign.bench), load_matrix(campaign.matrix)

    def feasible(point: TestPoint) -> bool:
        settings = {
            "amplitude": f"{point.amplitude_m!r} m",
            "frequency": f"{point.frequency_Hz!r} Hz",
            "current": f"{point.current_A!r} A",
        }
        extra = ExtraPoint.model_validate(settings)
        alone = Matrix(format=1, specimen=matrix.specimen, temperature=matrix.temperature, point=(extra,))
        return all(item.feasible for item in plan(alone, bench).points)

    own_A = matrix.specimen.max_current_A
    return Allowance(
        amplitude_m=min(matrix.specimen.stroke_m, float(np.ptp(bench.limits.position_m))) / 2.0 - HEADROOM_M,
        speed_m_s=bench.limits.speed_m_s,
        acceleration_m_s2=bench.limits.acceleration_m_s2,
        force_N=bench.limits.force_N,
        current_A=bench.limits.current_A if own_A is None else min(own_A, bench.limits.current_A),
        source=f"within the limits of the bench: {bench.name}",
        feasible=feasible,
    )


def next_tests(
    model: DamperModel, fit: Fit, measurements: Sequence[Measurement], allowance: Allowance | None = None
) -> tuple[NextTest, ...]:
    """The loop that shrinks the worst interval most, and current steps where eta is unknown and a bench can make them.

    Args:
        model: the fitted model.
        fit: the fit; parameters that were held count with an interval as wide as the prior.
        measurements: the tests of the fit.
        allowance: what may be tested; by default what was tested.
    """
    model = physical(model)  # a residual has no parameters to narrow
    allowance = allowance or envelope_of(measurements)
    proposals = list(_loop(model, fit, measurements, allowance)) if fit.adequate is not False else []
    if "eta" in fit.parameters and not fit.parameters["eta"].identifiable and allowance.feasible is not None:
        proposals.append(_steps(allowance))
    return tuple(proposals)


def _loop(
    model: DamperModel, fit: Fit, measurements: Sequence[Measurement], allowance: Allowance
) -> Iterator[NextTest]:
    values = {name: value for name, value in fit.values.items() if name != "eta" and name in model.names}
    names = tuple(values)
    if not names or len(fit.residual_parts) != len(measurements):
        return
    spacing = [1 if model.states else max(1, test.u_m.size // ENOUGH) for test in measurements]
    some = [test.rows(slice(0, test.u_m.size, by)) for test, by in zip(measurements, spacing, strict=True)]
    slopes = [parameter_slopes(model, values, names, test) for test in some]
    sizes = np.max([np.max(np.abs(jacobian), axis=0) for jacobian in slopes], axis=0)
    peak_N = max(test.peak_force_N for test in measurements)
    least = SMALLEST_CONTRIBUTION * peak_N / np.where(sizes > 0.0, sizes, np.inf)
    scale = np.maximum(np.abs([values[name] for name in names]), least)
    scale = np.where(scale > 0.0, scale, 1.0)
    before = np.eye(len(names)) / PRIOR_DEVIATION**2
    spread = []
    tested = zip(some, spacing, slopes, fit.residual_parts, fit.error.per_test, strict=True)
    for test, by, jacobian, residual, error in tested:
        spread.append(max(error.rmse_N, 1e-9) ** 2 * residual.widening)
        scaled = jacobian[test.scored] * scale
        before += by * test.recorded_each * (scaled.T @ scaled) / spread[-1]
    if not np.all(np.isfinite(before)):
        return
    widths = _widths(before)
    longest = float(np.median([test.u_m.size * test.recorded_each for test in measurements]))
    dt_s = float(np.median([test.dt_s / test.recorded_each for test in measurements]))
    noise = float(np.median(spread))
    candidates, expected = [], []
    for point, motion in _candidates(model, values, measurements, allowance):
        scaled = parameter_slopes(model, values, names, motion) * scale
        weight = min(KEPT_CYCLES / (point.frequency_Hz * dt_s), longest) / SAMPLES / noise
        after = before + weight * scaled.T @ scaled
        if np.all(np.isfinite(after)):
            candidates.append(point)
            expected.append(_widths(after))
    for worst in np.argsort(-widths) if candidates else ():
        ranked = np.argsort([widths[worst] for widths in expected])[:MOST_CHECKS]
        for k in ranked:
            ratio = float(expected[k][worst] / widths[worst])
            if not ratio <= WORTHWHILE:
                break
            if allowance.feasible is None or allowance.feasible(candidates[k]):
                yield _proposal(candidates[k], names[worst], fit, ratio, allowance)
                return


def _widths(information: FloatArray) -> FloatArray:
    """Standard deviations (p,) for an information matrix (p, p) that holds at least that of the prior."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(np.sqrt(vectors**2 @ (1.0 / np.maximum(values, 1.0 / PRIOR_DEVIATION**2))))


def _candidates(
    model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement], allowance: Allowance
) -> Iterator[tuple[TestPoint, Measurement]]:
    """Sines on a grid, what is too fast, too violent or too strong left out; numbers as people write them."""
    tested_Hz = [1.0 / (samples_a_cycle(test.u_m) * test.dt_s) for test in measurements]
    smallest_m = min(float(np.ptp(test.u_m)) for test in measurements) / 2.0
    amplitudes = np.geomspace(0.3 * min(smallest_m, allowance.amplitude_m), allowance.amplitude_m, AMPLITUDES)
    frequencies = np.geomspace(0.5 * min(tested_Hz), 3.0 * max(tested_Hz), FREQUENCIES)
    currents = np.linspace(0.0, allowance.current_A, CURRENTS if allowance.current_A > 0.0 else 1)
    phase = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    for amplitude, frequency, current_A in product(amplitudes, frequencies, currents):
        amplitude_m, frequency_Hz = _down(float(amplitude)), _down(float(frequency))
        omega = 2.0 * math.pi * frequency_Hz
        if not (omega * amplitude_m <= allowance.speed_m_s and omega**2 * amplitude_m <= allowance.acceleration_m_s2):
            continue
        motion = Measurement(
            id="candidate",
            u_m=amplitude_m * np.sin(phase),
            v_m_s=amplitude_m * omega * np.cos(phase),
            a_m_s2=-amplitude_m * omega**2 * np.sin(phase),
            force_N=np.zeros(SAMPLES),
            current_A=np.full(SAMPLES, round(float(current_A), 2)),
            dt_s=1.0 / (frequency_Hz * SAMPLES),
            samples_per_cycle=SAMPLES,
        )
        # A force that is no number is not a force that is allowed.
        if not float(np.max(np.abs(modelled_force(model, values, motion)))) <= FORCE_SHARE * allowance.force_N:
            continue
        yield (
            TestPoint(
                id="next",
                waveform="sine",
                amplitude_m=amplitude_m,
                frequency_Hz=frequency_Hz,
                current_A=round(float(current_A), 2),
                cycles=KEPT_CYCLES + 2,
            ),
            motion,
        )


def _down(value: float) -> float:
    """Two significant digits, rounded down but for what is nearly the next."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / unit + MEANT_TO_BE_NEXT) * unit, 12)


def _proposal(point: TestPoint, name: str, fit: Fit, ratio: float, allowance: Allowance) -> NextTest:
    mm, estimate = 1e3 * point.amplitude_m, fit.parameters[name]
    test = f"a sine of {mm:g} mm at {point.frequency_Hz:g} Hz and {point.current_A:g} A"
    if not estimate.identifiable or estimate.standard_error is None:
        after = None
        gain = f"would make {name} identifiable"
    else:
        after = ratio * estimate.standard_error
        gain = (
            f"would narrow the widest interval, that of {name}, to {100.0 * ratio:.0f} % of its present width"
        )
    toml = (
        f'[[point]]\nwaveform = "sine"\namplitude = "{mm:g} mm"\nfrequency = "{point.frequency_Hz:g} Hz"\n'
        f'current = "{point.current_A:g} A"\n'
    )
    return NextTest(name, f"{test} {gain} ({allowance.source})", toml, estimate.standard_error, after)


def _steps(allowance: Allowance) -> NextTest:
    high_A = round(allowance.current_A / 2.0, 2)
    toml = f'[[current_step]]\ncurrent = ["0 A", "{high_A:g} A", "0 A"]\nhold = "{STEP_HOLD}"\n'
    return NextTest("eta", "current steps at rest would make eta identifiable", toml, None, None)
