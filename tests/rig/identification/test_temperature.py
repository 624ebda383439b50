"""A damper that warm oil weakens: rates that cover the truth, tests at other temperatures predicted, reasons without.

The plant falls along a straight line, as the simulated rig's does; the fit along an exponential.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.dampers.current_law import AFFINE
from rig.dampers.current_law_model import with_law
from rig.dampers.temperature_law import RATES, TemperatureLaw
from rig.errors import FileProblem, IdentificationFailed
from rig.fits.entries import Corrections
from rig.identification import Fit, Measurement, identify
from rig.matrix.methods import TEMPERATURE_LAWS

Values = dict[str, float]
DEMO = dict(parameter_set("demo").values)
PER_K, AT_degC = -0.006, 23.0
VISCOUS = {"Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus"}
SOFT = VISCOUS | {"Fya", "Fyb"}


def at(degC: float, viscous: float = PER_K, yielding: float = PER_K) -> Values:
    """The plant's values at a temperature, by hand."""
    change = {name: (viscous if name in VISCOUS else yielding) * (degC - AT_degC) for name in SOFT}
    return {name: value * (1.0 + change.get(name, 0.0)) for name, value in DEMO.items()}


def run_at(
    temperatures: Sequence[float], frequencies_Hz: Sequence[float] = (0.5, 2.0), seed: int = 0, **rates: float
) -> list[Measurement]:
    """Three cycles at each frequency and 0, 1, 2 A; the first half of each test 1 K colder than its second half."""
    rng = np.random.default_rng(seed)
    tests = []
    for degC in temperatures:
        for current in (0.0, 1.0, 2.0):
            for frequency in frequencies_Hz:
                t = np.arange(round(3 / frequency * 250)) / 250.0 + 0.0013
                omega, half = 2.0 * np.pi * frequency, t.size // 2
                u, v = 0.05 * np.sin(omega * t), 0.05 * omega * np.cos(omega * t)
                motion = np.array((u, v, -(omega**2) * u, np.full(t.size, current)))
                recorded = np.where(np.arange(t.size) < half, degC - 0.5, degC + 0.5)
                force = np.concatenate([
                    model("asymmetric").force(at(warm, **rates), u[rows], v[rows], motion[2, rows], current, 0.004)
                    for rows, warm in ((slice(0, half), degC - 0.5), (slice(half, None), degC + 0.5))
                ])  # fmt: skip
                tests.append(Measurement(
                    id=f"{degC:g} degC, {current:g} A, {frequency:g} Hz", u_m=u, v_m_s=v, a_m_s2=motion[2],
                    force_N=force + rng.normal(0.0, 5.0, t.size), current_A=motion[3], dt_s=0.004, amplitude_m=0.05,
                    frequency_Hz=frequency, nominal_current_A=current, samples_per_cycle=round(250 / frequency),
                    noise_N=5.0, temperature_degC=recorded,
                ))  # fmt: skip
    return tests


@pytest.fixture(scope="module")
def tests() -> list[Measurement]:
    return run_at((20.0, 30.0, 45.0))


@pytest.fixture(scope="module")
def unseen() -> list[Measurement]:
    return run_at((38.0,), (1.0,), seed=5)


@pytest.fixture(scope="module")
def fit(tests: list[Measurement], unseen: list[Measurement]) -> Fit:
    return identify(tests, holdout=unseen, temperature_law="both")


def test_without_a_law_the_temperature_is_named_and_with_one_it_is_not(
    tests: list[Measurement], unseen: list[Measurement], fit: Fit
) -> None:
    bare = identify(tests, holdout=unseen)
    assert bare.adequate is False
    assert bare.diagnosis[0].slug == "temperature"
    assert "--temperature-law" in bare.diagnosis[0].next
    assert fit.adequate
    assert not fit.diagnosis
    assert bare.holdout is not None
    assert fit.holdout is not None
    assert fit.holdout.nrmse_percent_of_peak < 0.5 * bare.holdout.nrmse_percent_of_peak
    assert fit.holdout.rmse_N == pytest.approx(5.0, rel=0.05)  # the noise


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_intervals_cover_a_damper_that_falls_along_a_straight_line(seed: int) -> None:
    fit = identify(run_at((20.0, 30.0, 45.0), seed=seed), temperature_law="both")
    assert fit.temperature is not None
    reference = fit.temperature.reference_degC
    truth = at(reference)
    for name in fit.identifiable:
        if name in truth:
            each = fit.parameters[name]
            assert each.simultaneous_low <= truth[name] <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable
    slope = -PER_K / (1.0 + PER_K * (reference - AT_degC))  # of the straight line's logarithm, there
    for name in ("k_viscous", "k_yield"):
        each = fit.parameters[name]
        assert each.simultaneous_low <= slope <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable
        assert each.standard_error < 0.05 * slope  # type: ignore[operator]  # identifiable


def test_viscosity_alone_is_distinguished_from_viscosity_and_yield_force() -> None:
    tests = run_at((20.0, 30.0, 45.0), viscous=-0.012, yielding=0.0)
    both = identify(tests, temperature_law="both")
    assert both.values["k_viscous"] > 0.012
    assert abs(both.values["k_yield"]) < 3.0 * (both.parameters["k_yield"].standard_error or 0.0)
    alone = identify(tests, temperature_law="viscous")
    assert alone.adequate
    assert "k_yield" not in alone.parameters
    common = identify(tests, temperature_law="common")
    assert not common.adequate


def test_the_force_is_forereported_at_any_temperature_and_reported_where_beyond(fit: Fit, tmp_path: Path) -> None:
    table = {"displacement_m": 0.0, "velocity_m_s": 0.3, "current_A": 1.0, "temperature_degC": [20.0, 45.0, 80.0]}
    predicted = fit.predict(table, band=True)
    for row, degC in ((0, 20.0), (1, 45.0)):
        sliding = model("asymmetric").force_at(at(degC), 0.3, 1.0)
        assert predicted["force_N"][row] == pytest.approx(float(sliding), rel=0.01)
    assert predicted["extrapolates"].tolist() == [False, False, True]
    assert predicted["beyond"][2] == "temperature_degC"
    width = (predicted["model_high_N"] - predicted["model_low_N"]).to_numpy()
    assert width[2] > width[1]
    bare = fit.predict({name: values for name, values in table.items() if name != "temperature_degC"} | {
        "displacement_m": [0.0, 0.0]})  # fmt: skip
    assert "no temperature given" in bare.attrs["assumed"]
    gap = fit.predict({"displacement_m": 0.0, "velocity_m_s": 0.3, "current_A": 1.0,
                       "temperature_degC": [30.0, np.nan, 90.0]})  # fmt: skip
    assert gap["beyond"].tolist() == ["", "temperature_degC", "temperature_degC"]  # bridged: 60 degC
    assert gap.attrs["assumed"] == "no temperature in 1 of 3 rows: interpolated linearly"
    cold, warm = (fit.at(degC).inverse(150.0, 0.1) for degC in (20.0, 45.0))
    assert warm["current_A"][0] > cold["current_A"][0] + 0.1
    again = fit.predict({"displacement_m": 0.0, "velocity_m_s": 0.1, "current_A": warm["current_A"],
                         "temperature_degC": 45.0})  # fmt: skip
    assert again["force_N"][0] == pytest.approx(150.0, abs=0.5)
    assert fit.at(80.0).inverse(150.0, 0.1)["beyond"][0] == "temperature_degC"
    assert "temperature_degC" in fit.at(80.0).control_range().attrs["extrapolation"]
    assert fit.at(80.0).controller(0.001).step(300.0, 0.0, 0.1).beyond == "temperature_degC"
    assert not fit.at(30.0).controller(0.001).step(300.0, 0.0, 0.1).extrapolates
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(fit.to_json()))
    loaded = Fit.load(file)
    assert loaded.temperature == fit.temperature
    assert loaded.predict(table)["force_N"].tolist() == predicted["force_N"].tolist()
    assert "k_viscous (T - " in loaded.equation


def test_a_fit_at_another_temperature_is_what_tests_there_would_give(fit: Fit) -> None:
    warm = fit.at(45.0)
    direct = identify(run_at((40.0, 45.0, 50.0), seed=9), temperature_law="both").at(45.0)
    for name in ("Fyb", "Ca_plus", "Ca_minus"):
        one, other = warm.parameters[name], direct.parameters[name]
        apart = np.hypot(one.standard_error or 0.0, other.standard_error or 0.0)
        assert abs(warm.values[name] - direct.values[name]) < 4.0 * apart, name
    assert (warm.parameters["Ca_plus"].standard_error or 0.0) > (fit.parameters["Ca_plus"].standard_error or 0.0)
    assert "(T - 45 degC)" in warm.equation
    table = {"displacement_m": 0.0, "velocity_m_s": 0.3, "current_A": 1.0}
    there = fit.predict(table | {"temperature_degC": 45.0})
    assert warm.predict(table)["force_N"][0] == pytest.approx(there["force_N"][0])
    assert warm.at(20.0).at(45.0).values == pytest.approx(warm.values)
    assert fit.at(80.0).predict(table)["beyond"][0] == "temperature_degC"
    with pytest.raises(IdentificationFailed, match="no temperature law"):
        replace(fit, corrections=Corrections()).at(45.0)


def test_kelvin_taken_for_degrees_are_refused_with_the_way_out(tests: list[Measurement]) -> None:
    kelvin = [replace(test, temperature_degC=np.full(test.u_m.size, 293.0 + index)) for index, test in enumerate(tests)]
    with pytest.raises(IdentificationFailed, match=r"18 of 18 tests have implausible temperatures .*:K"):
        identify(kelvin, model="asymmetric", temperature_law="common")


def test_what_the_recordings_do_not_determine_is_refused_with_the_way_out(tests: list[Measurement]) -> None:
    unrecorded = [replace(tests[0], temperature_degC=None), *tests[1:]]
    with pytest.raises(IdentificationFailed, match=r"1 of 18 tests have no recorded temperature \(20 degC, 0 A"):
        identify(unrecorded, temperature_law="both")
    with pytest.raises(IdentificationFailed, match=r"19\.5 to 21\.5 degC, expected a span of at least 3 K"):
        identify(run_at((20.0, 21.0)), temperature_law="both")
    with pytest.raises(IdentificationFailed, match="name one model"):
        identify(tests, model="few", temperature_law="both")
    with pytest.raises(IdentificationFailed, match="temperature law: cannot be combined with series_spring"):
        identify(tests, temperature_law="both", series_spring=True)
    with pytest.raises(IdentificationFailed, match="expected one of none, viscous, yield, common, both"):
        identify(tests, temperature_law="arrhenius")
    rng = np.random.default_rng(3)
    fluid = [replace(test, force_N=700.0 * test.v_m_s * (1.0 - 0.006 * (test.temperature_degC - 23.0))
                     + rng.normal(0.0, 5.0, test.u_m.size))
             for test in tests if test.temperature_degC is not None and test.nominal_current_A == 0.0]  # fmt: skip
    with pytest.raises(IdentificationFailed, match=r"not enough to identify k_.*'common'"):
        identify(fluid, temperature_law="both")  # no yield force: nothing to weaken


def test_a_column_that_holds_no_numbers_is_one_problem(fit: Fit) -> None:
    with pytest.raises(FileProblem) as refused:
        fit.predict({"displacement_m": 0.0, "velocity_m_s": ["fast"], "current_A": 1.0})
    assert len(refused.value.problems) == 1


def test_the_laws_of_a_matrix_file_are_those_of_the_models() -> None:
    assert tuple(RATES) == TEMPERATURE_LAWS


def test_parameters_fall_as_written_and_a_current_law_does_not(tests: list[Measurement]) -> None:
    bent = with_law(model("asymmetric"), "saturating")
    assert bent is not with_law(model("asymmetric"), AFFINE)
    values = {**DEMO, "k_sat": 0.4}
    warm = bent.values(TemperatureLaw(20.0, {"k_viscous": 0.02, "k_yield": 0.01}).vectors(
        bent, values, np.array([30.0]))[0])  # fmt: skip
    for name, value in values.items():
        factor = np.exp(-0.2) if name in VISCOUS else np.exp(-0.1) if name in SOFT else 1.0
        assert warm[name] == pytest.approx(value * factor), name
