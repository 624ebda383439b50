"""A fit used: force, current for a force, controller, what lies beyond the tests, and files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rig.dampers import model, parameter_set
from rig.errors import FileProblem, IdentificationFailed
from rig.export import export
from rig.fits.entries import Corrections, Estimate, SeriesSpring
from rig.identification import Fit, Measurement, identify
from rig.identification.runs import write_fit

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
TIME_S = np.arange(0.0, 2.0, 0.002)


def by_hand(u: np.ndarray, v: np.ndarray, a: np.ndarray, current: np.ndarray) -> np.ndarray:
    """The demo damper's force, equations (3) to (11) written out with its numbers."""
    viscous = np.where(v >= 0.0, 900.0 + 46.0 * current, 500.0 + 178.0 * current)
    yielding = (5.56 + 238.0 * current) * np.tanh(50.0 * v + 1.0 * np.sign(u))
    return np.asarray(3.83 * a + viscous * v + (300.0 + 50.0 * current) * u + yielding - 270.0)


def motion(frequency_Hz: float = 1.5, amplitude_m: float = 0.03) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    omega = 2.0 * np.pi * frequency_Hz
    u, v = amplitude_m * np.sin(omega * TIME_S), amplitude_m * omega * np.cos(omega * TIME_S)
    return u, v, -(omega**2) * u


@pytest.fixture(scope="module")
def fit(make_synthetic: Make) -> Fit:
    return identify(make_synthetic(DEMO))


def test_the_force_of_a_table_is_the_dampers_within_its_band_where_it_was_tested(fit: Fit) -> None:
    u, v, a = motion()
    current = 1.0 + 0.9 * np.sin(3.0 * TIME_S)
    table = pd.DataFrame({"displacement_m": u + 0.004, "velocity_m_s": v, "current_A": current}, TIME_S)
    table.index.name = "time_s"
    predicted = fit.predict(table, mid_stroke_m=0.004)
    truth = by_hand(u, v, a, current)
    assert predicted.index.equals(table.index)
    inside = (predicted["low_N"] < truth) & (truth < predicted["high_N"])
    assert inside.mean() > 0.995
    assert (predicted["high_N"] - predicted["low_N"]).between(18.0, 21.0).all()  # 5 N of noise: 2 x 1.96 x 5
    assert not predicted["extrapolates"].any()
    assert predicted.attrs["extrapolation"] == ""


def test_a_quantity_that_stands_in_two_columns_is_refused_by_both_names(fit: Fit) -> None:
    row = {"displacement_m": [0.0, 0.01], "velocity_m_s": [0.1, 0.1], "current_A": [1.0, 1.0], "time_s": [0.0, 0.1]}
    with pytest.raises(FileProblem) as refused:
        fit.predict(row | {"displacement": [0.02, 0.0], "current": [1.0, 1.0]})
    assert list(refused.value.problems) == [
        "columns `displacement_m` and `displacement`: both contain the same quantity. Fix: remove one",
        "columns `current_A` and `current`: both contain the same quantity. Fix: remove one",
    ]
    table = pd.DataFrame(row)
    with pytest.raises(FileProblem, match="columns `velocity_m_s` and `velocity_m_s`: both contain"):
        fit.predict(pd.concat([table, table["velocity_m_s"]], axis=1))
    with pytest.raises(FileProblem, match="the index and the column have different values"):
        fit.predict(table.set_index(pd.Index([5.0, 6.0], name="time")))
    assert len(fit.predict(table.set_index("time_s", drop=False))) == 2  # one time, twice the same


def test_a_row_beyond_the_tests_says_so_and_in_what(fit: Fit) -> None:
    table = {"displacement_m": [0.0, 0.0, 0.08, 0.0], "velocity_m_s": [0.1, 0.9, 0.1, -0.1],
             "current_A": [1.0, 1.0, 2.5, 1.0], "temperature_degC": [np.nan, np.nan, np.nan, np.nan]}  # fmt: skip
    predicted = fit.predict(table)
    assert list(predicted["extrapolates"]) == [True] * 4  # no test recorded a temperature, and one is given
    cool = fit.predict({name: values for name, values in table.items() if name != "temperature_degC"})
    assert list(cool["beyond"]) == ["", "velocity_m_s", "displacement_m current_A", ""]
    assert "velocity_m_s in 1 of 4 rows" in cool.attrs["extrapolation"]
    assert fit.tested is not None
    warm = replace(fit, tested=replace(fit.tested, temperature_degC=(20.0, 40.0)))
    table["temperature_degC"] = [19.0, 30.0, 41.0, 60.0]
    assert list(warm.predict(table)["beyond"]) == [
        "", "velocity_m_s", "displacement_m current_A", "temperature_degC"]  # fmt: skip


def test_everything_wrong_with_a_table_is_reported_at_once(fit: Fit) -> None:
    with pytest.raises(FileProblem) as caught:
        fit.predict(pd.DataFrame({"velocity_m_s": [0.1, np.nan], "current": ["one", "two"]}))
    assert len(caught.value.problems) == 3
    with pytest.raises(FileProblem, match="even spacing"):
        fit.simulate([0.0, 0.1, 0.3], [0.0, 0.0, 0.0], 1.0)
    with pytest.raises(FileProblem, match=r"`displacement_m`: got shape \(2,\), expected \(3,\)"):
        fit.simulate([0.0, 0.1, 0.2], [0.0, 0.0], 1.0)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["bouc_wen", "modified_bouc_wen"])
def test_a_simulation_carries_the_states_on_as_a_much_finer_plant_does(name: str, make_synthetic: Make) -> None:
    damper = model(name)
    values = damper.demonstration
    known = identify(make_synthetic(DEMO, currents_A=(0.0, 2.0), frequencies_Hz=(0.5, 1.0)), model="kwok")
    estimates = {key: Estimate(value, "1") for key, value in values.items()}
    fitted = replace(known, model=name, parameters=estimates)
    fine_s = np.arange(0.0, 1.0, 1e-4)
    omega = 2.0 * np.pi
    u, v = 0.02 * np.sin(omega * fine_s), 0.02 * omega * np.cos(omega * fine_s)
    truth = damper.force(values, u, v, -(omega**2) * u, 1.0, 1e-4)
    rows = slice(0, None, 20)
    predicted = fitted.simulate(fine_s[rows], u[rows], 1.0, velocity_m_s=v[rows])
    assert np.max(np.abs(predicted["force_N"] - truth[rows])) < 2e-3 * np.max(np.abs(truth))
    assert [column for column in predicted if column.startswith("state_")] == [
        f"state_{k + 1}" for k in range(damper.states)
    ]
    state = predicted[[f"state_{k + 1}" for k in range(damper.states)]].to_numpy()
    answer = fitted.inverse(truth[rows], v[rows], u[rows], state=state, acceleration_m_s2=-(omega**2) * u[rows])
    sure = answer["attainable"].to_numpy() & answer["resolvable"].to_numpy()
    assert sure.mean() > 0.2
    assert np.max(np.abs(answer["current_A"] - 1.0)[sure]) < 0.05
    with pytest.raises(FileProblem, match="internal states"):
        fitted.inverse(truth[rows], v[rows], u[rows])


def test_the_inverse_gives_the_current_of_the_damper_and_its_band_holds_it(fit: Fit) -> None:
    rng = np.random.default_rng(5)
    u, v, a = motion()
    current = 1.0 + 0.9 * np.sin(7.0 * TIME_S)
    measured = by_hand(u, v, a, current) + rng.normal(0.0, 5.0, u.size)
    answer = fit.inverse(measured, v, u, acceleration_m_s2=a)
    predicted = (answer["attainable"] & answer["resolvable"]).to_numpy()
    assert predicted.mean() > 0.85
    error = (answer["current_A"].to_numpy() - current)[predicted]
    assert math.sqrt(np.mean(error**2)) < 0.03 * 2.0
    held = (answer["low_A"].to_numpy() <= current) & (current <= answer["high_A"].to_numpy())
    assert 0.92 < held[predicted].mean() < 0.99
    slow = np.abs(v) < 1e-3
    assert not answer["resolvable"].to_numpy()[slow & (np.abs(u) < 1e-3)].any()


def test_a_force_that_no_current_gives_is_reported_and_the_nearest_taken(fit: Fit) -> None:
    answer = fit.inverse([1e4, -1e4], 0.2)
    assert list(answer["attainable"]) == [False, False]
    assert answer["current_A"].tolist() == pytest.approx([2.0, 0.0], abs=1e-4)
    most, least = by_hand(np.zeros(2), np.full(2, 0.2), np.zeros(2), np.array([2.0, 0.0]))
    assert answer["most_N"].iloc[0] == pytest.approx(most, abs=5.0)
    assert answer["least_N"].iloc[0] == pytest.approx(least, abs=5.0)


def test_the_control_range_says_where_force_tells_current(fit: Fit) -> None:
    speeds = fit.control_range()
    assert speeds["passive"].all()
    assert speeds["monotone"].all()
    rows = speeds.loc[speeds.index > 0.3]
    gain = 238.0 + 46.0 * rows.index.to_numpy()  # dF/dI of the demo damper where tanh is 1
    assert np.allclose(rows["gain_N_A"], gain, rtol=0.02)
    assert 0.0 < speeds.attrs["invertible_from_m_s"] < 0.06


def test_the_exported_table_gives_the_dampers_current_for_a_force_and_says_what_it_is_of(
    fit: Fit, tmp_path: Path
) -> None:
    written, _ = write_fit(fit, tmp_path)
    (file,) = export(written, "inverse", tmp_path / "out")
    table = pd.read_csv(file, comment="#")
    assert list(table) == ["velocity_m_s", "force_N", "current_A", "low_A", "high_A", "resolvable"]
    fast = table[table["velocity_m_s"].abs() > 0.2]
    speed = fast["velocity_m_s"].to_numpy()
    truth = by_hand(np.zeros(speed.size), speed, np.zeros(speed.size), fast["current_A"].to_numpy())
    assert np.allclose(fast["force_N"], truth, atol=3.0)
    assert fast["resolvable"].all()
    assert ((fast["low_A"] <= fast["current_A"]) & (fast["current_A"] <= fast["high_A"])).all()
    head = file.read_text().splitlines()[:3]
    assert all(line.startswith("# ") for line in head)
    assert "Fyb = 238" in head[0]
    assert "current_A 0 to 2" in head[1]


def test_what_is_no_number_is_named_by_row_when_a_current_is_requested(fit: Fit, make_synthetic: Make) -> None:
    with pytest.raises(FileProblem) as raised:
        fit.inverse([100.0, math.nan], [math.inf, 0.1])
    assert [line.split(":")[0] for line in raised.value.problems] == [
        "column `velocity_m_s`, row 0", "column `force_N`, row 1"]  # fmt: skip
    values = dict(model("bouc_wen").demonstration)
    wound = identify(make_synthetic(values, (0.0, 1.0), (1.0,), name="bouc_wen", cycles=3), model="bouc_wen")
    with pytest.raises(FileProblem, match="row 0, state_1: got nan"):
        wound.inverse([100.0, 90.0], 0.1, state=[math.nan])
    with pytest.raises(FileProblem, match="`force_N`, row 1: got nan"):  # and not that there is no state
        wound.inverse([100.0, math.nan], 0.1)


def test_tests_at_one_current_have_no_inverse(make_synthetic: Make) -> None:
    one = identify(make_synthetic(DEMO, currents_A=(1.0,), frequencies_Hz=(0.5, 1.0)))
    with pytest.raises(IdentificationFailed, match=r"every test ran at 1\.00 A"):
        one.inverse(100.0, 0.1)
    assert one.predict({"displacement_m": 0.0, "velocity_m_s": 0.1, "current_A": 1.2})["extrapolates"].all()


def test_a_controller_tracks_a_force_through_the_coils_lag(fit: Fit) -> None:
    eta = Estimate(25.0, "1/s")
    lagging = replace(fit, parameters={**fit.parameters, "eta": eta})
    controller = lagging.controller(0.002, limits_A=(0.0, 4.0))
    u, v, a = motion()
    expected = by_hand(u, v, a, 1.0 + 0.6 * np.sin(4.0 * TIME_S))
    coil, given, predicted = 0.0, [], []
    command = 0.0
    for k in range(TIME_S.size):
        coil += (1.0 - math.exp(-25.0 * 0.002)) * (command - coil)  # equation (9), exact for a held command
        given.append(float(by_hand(u[k : k + 1], v[k : k + 1], a[k : k + 1], np.array([coil]))[0]))
        step = controller.step(float(expected[k]), float(u[k]), float(v[k]), float(a[k]))
        predicted.append(step.attainable and step.resolvable and step.follows)
        assert step.coil_A == pytest.approx(coil, abs=1e-9)
        command = step.command_A
    good = np.array(predicted[:-1])
    error = (np.array(given) - expected)[1:][good]
    assert good.mean() > 0.8
    assert math.sqrt(np.mean(error**2)) < 0.05 * np.max(np.abs(expected))


@pytest.mark.parametrize("given", ["force_N", "displacement_m", "velocity_m_s", "acceleration_m_s2"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_controller_refuses_what_is_no_number_and_goes_on_as_if_it_had_not_been_requested(
    fit: Fit, given: str, value: float
) -> None:
    at_rest = {"velocity_m_s": 0.1, "acceleration_m_s2": 0.0}
    steps = [{"force_N": 100.0 + k, "displacement_m": 1e-3 * k, **at_rest} for k in range(4)]
    disturbed, other = fit.controller(0.002), fit.controller(0.002)
    for step in steps[:2]:
        disturbed.step(**step)
        other.step(**step)
    with pytest.raises(ValueError, match=rf"controller: {given} = {value:g}, expected a number"):
        disturbed.step(**{**steps[2], given: value})
    assert [disturbed.step(**step) for step in steps[2:]] == [other.step(**step) for step in steps[2:]]


def test_a_controller_says_when_its_step_lies_beyond_the_tests(fit: Fit) -> None:
    def beyond(target_A: float, velocity_m_s: float = 0.2, only_at_A: tuple[float, ...] = ()) -> bool:
        assert fit.tested is not None
        tested = replace(fit.tested, current_A=(0.5, 2.0), only_at_A=only_at_A)
        u, v, a, current = (np.array([value]) for value in (0.01, velocity_m_s, 0.0, target_A))
        controller = replace(fit, tested=tested).controller(0.002)
        step = controller.step(float(by_hand(u, v, a, current)[0]), 0.01, velocity_m_s)
        assert step.target_A == pytest.approx(target_A, abs=0.02)
        return step.extrapolates

    assert not beyond(1.0), "that no test ran at 0 A says nothing of 1 A"
    assert beyond(1.0, velocity_m_s=3.0)
    assert [beyond(at_A, only_at_A=(0.5, 1.0, 2.0)) for at_A in (1.0, 1.5)] == [False, True]


def test_the_lag_of_a_coil_is_the_exact_answer_to_a_step_and_refused_where_unknown(fit: Fit) -> None:
    with pytest.raises(FileProblem, match="lag"):
        fit.simulate(TIME_S, 0.0 * TIME_S, 1.0, lag=True)
    lagging = replace(fit, parameters={**fit.parameters, "eta": Estimate(25.0, "1/s")})
    command = np.where(TIME_S < 0.5, 0.0, 2.0)
    coil = lagging.simulate(TIME_S, 0.0 * TIME_S, command, lag=True)["current_A"].to_numpy()
    late = TIME_S[TIME_S >= 0.5] - 0.5
    assert np.allclose(coil[TIME_S >= 0.5], 2.0 * (1.0 - np.exp(-25.0 * late)), atol=1e-9)


def test_a_fit_per_current_predicts_between_its_currents(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, currents_A=(0.0, 1.0, 2.0), frequencies_Hz=(0.5, 1.0, 2.0))
    related = identify(tests, current="per-current-affine")
    u, v, a = motion(1.0)
    predicted = related.predict({"time_s": TIME_S, "displacement_m": u, "velocity_m_s": v, "current_A": 1.5})
    truth = by_hand(u, v, a, np.full(u.size, 1.5))
    away = np.abs(u) > 1e-3
    assert np.max(np.abs(predicted["force_N"] - truth)[away]) < 10.0
    answer = related.inverse(truth, v, u, acceleration_m_s2=a)
    sure = answer["resolvable"].to_numpy() & away
    assert np.max(np.abs(answer["current_A"] - 1.5)[sure]) < 0.06
    assert "Fya = " in related.equation


@pytest.mark.parametrize("value", [math.nan, math.inf, "x", True])
def test_a_fit_whose_parameter_is_no_number_is_refused(fit: Fit, tmp_path: Path, value: object) -> None:
    written, _ = write_fit(fit, tmp_path)
    content = json.loads(written.read_text())
    content["parameters"]["Fya"]["value"] = value
    written.write_text(json.dumps(content))
    with pytest.raises(FileProblem, match=r"parameters\.Fya\.value"):
        Fit.load(written)


def test_a_written_fit_is_read_back_whole_and_says_the_same(fit: Fit, make_synthetic: Make, tmp_path: Path) -> None:
    tests = make_synthetic(DEMO, currents_A=(0.0, 1.0), frequencies_Hz=(0.5, 1.0))
    related = identify(tests[:3], model="kwok", holdout=tests[3:], profile=["beta"])
    curved = identify(tests, model="kwok", current="per-current-affine")
    spring = replace(fit, corrections=Corrections(series=SeriesSpring(1e6, 9e5, 1.1e6)))
    for number, one in enumerate((fit, related, curved, spring)):
        folder = tmp_path / str(number)
        folder.mkdir()
        written, _ = write_fit(one, folder)
        again = Fit.load(written)
        assert json.loads(json.dumps(again.to_json())) == json.loads(written.read_text())
        assert again.path == written
        for name in ("parameters", "residual_parts"):
            assert repr(getattr(again, name)) == repr(getattr(one, name))
    assert (
        Fit.load(tmp_path / "0")
        .predict({"displacement_m": 0.01, "velocity_m_s": 0.1, "current_A": 1.0})
        .equals(fit.predict({"displacement_m": 0.01, "velocity_m_s": 0.1, "current_A": 1.0}))
    )
    with pytest.raises(IdentificationFailed, match="series spring"):
        Fit.load(tmp_path / "3").predict({"displacement_m": 0.01, "velocity_m_s": 0.1, "current_A": 1.0})


def test_a_fit_of_an_earlier_version_knows_no_range_and_says_so(fit: Fit, tmp_path: Path) -> None:
    written, _ = write_fit(fit, tmp_path)
    content = json.loads(written.read_text())
    del content["tested"], content["formula"]
    written.write_text(json.dumps(content))
    old = Fit.load(written)
    predicted = old.predict({"displacement_m": 0.0, "velocity_m_s": 0.1, "current_A": 1.0})
    assert predicted["extrapolates"].all()
    assert predicted["low_N"].isna().all()
    with pytest.raises(IdentificationFailed, match="the tested currents"):
        old.inverse(100.0, 0.1)


def test_a_current_has_no_band_beyond_the_tests_and_that_of_the_residuals_in_older_fits(fit: Fit) -> None:
    assert fit.tested is not None
    speeds_m_s = [0.1, 5.0]
    force_N = fit.predict({"displacement_m": 0.0, "velocity_m_s": speeds_m_s, "current_A": 1.0})["force_N"]
    old = replace(fit, tested=replace(fit.tested, band=replace(fit.tested.band, left_out=0)))
    for one in (fit, old):  # a controller with an older fit goes on resolving currents
        answer = one.inverse(force_N.to_numpy(), speeds_m_s)
        assert answer["extrapolates"].tolist() == [False, True]
        assert answer[["low_A", "high_A"]].isna().all(axis=1).tolist() == [False, True]
        assert answer["resolvable"].iloc[0]


@pytest.mark.parametrize(
    "damage", ["[]", "{}", '{"model": "kwok", "parameters": {"a": 1}, "error": {}, "method": "x"}']
)
def test_what_is_no_fit_is_refused_by_its_name(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    path.write_text(damage)
    with pytest.raises(FileProblem, match=r"fit\.json"):
        Fit.load(path)


def test_the_equation_has_every_number_with_its_unit_and_names_what_is_not_known(fit: Fit) -> None:
    assert "m = 3.8" in fit.equation
    assert "N s/(m A)" in fit.equation
    assert fit.equation.endswith("unknown: eta")
    assert fit.to_json()["equation"] == model("asymmetric").equation


def test_the_loops_are_drawn_with_one_measured_and_one_modelled_line_a_test(fit: Fit, tmp_path: Path) -> None:
    figure = fit.plot.loops()
    assert [len(axis.traces) for axis in figure.figures] == [40, 40]
    figure.savefig(tmp_path / "loops.svg")
    assert (tmp_path / "loops.svg").stat().st_size > 10_000
    write_fit(fit, tmp_path)
    assert [len(axis.traces) for axis in Fit.load(tmp_path).plot.loops().figures] == [40, 40]
