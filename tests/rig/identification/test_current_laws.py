"""A saturating damper: straight models do not describe it, the same models behind a current law do, in every use."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.export import export
from rig.identification import Fit, Measurement, identify
from rig.identification.runs import write_fit

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
K_SAT = 0.7
TRUTH = {**DEMO, "k_sat": K_SAT}


def by_hand(u: np.ndarray, v: np.ndarray, current: np.ndarray) -> np.ndarray:
    """The demo damper without inertia, equations (3) to (11) with (1 - exp(-0.7 I)) / 0.7 for I."""
    x = (1.0 - np.exp(-0.7 * current)) / 0.7
    viscous = np.where(v >= 0.0, 900.0 + 46.0 * x, 500.0 + 178.0 * x)
    yielding = (5.56 + 238.0 * x) * np.tanh(50.0 * v + 1.0 * np.sign(u))
    return np.asarray(viscous * v + (300.0 + 50.0 * x) * u + yielding - 270.0)


@pytest.fixture(scope="module")
def saturating(make_synthetic: Make) -> list[Measurement]:
    return make_synthetic(TRUTH, (0.0, 0.5, 1.0, 2.0), (0.75, 1.5), name="asymmetric+saturating", cycles=4)


@pytest.fixture(scope="module")
def fit(saturating: list[Measurement]) -> Fit:
    return identify(saturating, model="asymmetric", current_law="saturating")


def test_a_law_is_fitted_with_its_interval_and_correlation(fit: Fit) -> None:
    assert fit.model == "asymmetric+saturating"
    assert fit.adequate
    for name in ("k_sat", "Fyb", "Cb_minus", "beta", "delta"):
        estimate = fit.parameters[name]
        assert estimate.low is not None
        assert estimate.high is not None
        half = 0.5 * (estimate.high - estimate.low)
        assert abs(TRUTH[name] - (estimate.value or 0.0)) < 2.0 * half, name  # twice the 95 % interval
    assert fit.parameters["k_sat"].unit == "1/A"
    assert fit.correlation["k_sat"]["Fyb"] > 0.5  # more current felt, less force per ampere of it
    assert "k_sat = 0.7" in fit.equation


def test_laws_are_chosen_by_what_they_have_not_seen(saturating: list[Measurement]) -> None:
    fit = identify(saturating, model="asymmetric", current_law="all")
    names = [score.model for score in fit.selection]
    assert set(names) == {
        "asymmetric", "asymmetric+saturating", "asymmetric+polynomial", "asymmetric+per-current@0,0.5,1,2",
    }  # fmt: skip
    assert names[-1] == "asymmetric"
    assert fit.model == "asymmetric+saturating"  # as good as the others with fewer parameters


def test_a_table_tells_what_each_tested_current_is_felt_as(saturating: list[Measurement]) -> None:
    fit = identify(saturating, model="asymmetric", current_law="per-current")
    # the table has x = I at both ends: x = 2 (1 - exp(-0.7 I)) / (1 - exp(-1.4))
    for current_A, name in ((0.5, "x at 0.5 A"), (1.0, "x at 1 A")):
        expected = 2.0 * (1.0 - np.exp(-K_SAT * current_A)) / (1.0 - np.exp(-2.0 * K_SAT))
        assert fit.values[name] == pytest.approx(expected, abs=0.005)


def test_a_loaded_fit_foretells_and_inverts_with_its_law(fit: Fit, tmp_path: Path) -> None:
    path, _ = write_fit(fit, tmp_path)
    assert json.loads(path.read_text())["current_law"] == "saturating"
    loaded = Fit.load(path)
    u, v, current = np.array([0.01, -0.02, 0.03]), np.array([0.2, -0.1, 0.3]), np.array([0.2, 1.3, 1.9])
    table = {"displacement_m": u, "velocity_m_s": v, "current_A": current}
    force_N = loaded.predict(table)["force_N"].to_numpy()
    assert force_N == pytest.approx(by_hand(u, v, current), abs=2.0)
    answer = loaded.inverse(force_N=by_hand(u, v, current), velocity_m_s=v, displacement_m=u)
    assert answer["current_A"].to_numpy() == pytest.approx(current, abs=0.02)
    assert answer["attainable"].all()


def test_source_code_of_a_fit_has_its_law(fit: Fit, tmp_path: Path) -> None:
    write_fit(fit, tmp_path)
    files = export(tmp_path / "fit.json", "python", tmp_path / "out")
    source = next(file for file in files if file.suffix == ".py")
    spec = importlib.util.spec_from_file_location("exported_damper", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    u, v, current = np.array([0.01, -0.02]), np.array([0.2, -0.1]), np.array([0.2, 1.3])
    predicted = module.force(u.tolist(), v.tolist(), [0.0, 0.0], current.tolist(), 1e-3)
    assert predicted == pytest.approx(by_hand(u, v, current).tolist(), abs=2.0)


def test_tests_at_too_few_currents_say_so(make_synthetic: Make) -> None:
    two = make_synthetic(DEMO, (0.0, 1.0), (0.75, 1.5), cycles=3)
    fit = identify(two, model="asymmetric", current_law="saturating")
    assert not fit.parameters["k_sat"].identifiable
    assert "3" in fit.parameters["k_sat"].reason
    assert fit.values["k_sat"] == 0.0
    assert fit.values["Fyb"] == pytest.approx(238.0, rel=0.02)
    with pytest.raises(IdentificationFailed, match="2 different currents"):
        identify(two, model="asymmetric", current_law="per-current")
    assert [score.model for score in identify(two, model="asymmetric", current_law="all").selection] == ["asymmetric"]
    with pytest.raises(IdentificationFailed, match="'per-current-affine' cannot be combined with a current law"):
        identify(two, model="asymmetric", current="per-current-affine", current_law="saturating")


@pytest.mark.few(1)
@pytest.mark.parametrize(("currents_A", "known"), [((0.5, 1.0, 2.0), set()), ((0.0, 1.0, 2.0), {"kt"})])
def test_what_the_currents_show_only_beside_a_power_left_out_is_not_identified(
    currents_A: tuple[float, ...], known: set[str], make_synthetic: Make, tmp_path: Path
) -> None:
    values = {**model("lost_motion").demonstration, "kt": 60.0, "kt_b": 300.0, "kt_c": -90.0, "kt_d": 12.0}
    fit = identify(make_synthetic(values, currents_A, (0.75, 1.5), name="lost_motion", cycles=3), model="lost_motion")
    law = {"kt", "kt_b", "kt_c", "kt_d"}
    assert fit.values["kt_d"] == 0.0
    assert abs(fit.values["kt_b"] / 300.0 - 1.0) > 0.02  # 12 I^3 is told as lower powers
    assert {name for name in law if fit.parameters[name].identifiable} == known
    for name in known:
        interval = fit.parameters[name]
        assert interval.low is not None
        assert interval.high is not None
        assert interval.low <= values[name] <= interval.high
    assert "kt_d" in fit.parameters["kt_b"].reason
    table = {"time_s": np.arange(4) * 0.01, "displacement_m": 0.0, "velocity_m_s": 0.1,
             "current_A": [1.02, 1.4, 2.0, 0.8]}  # fmt: skip
    predicted = fit.predict(table)
    assert list(predicted["beyond"]) == [
        "",
        "current_A",
        "",
        "current_A",
    ]  # 12 I^3 is not known between tested currents
    tested = ", ".join(f"{current_A:g}" for current_A in currents_A)
    assert f"only near the currents {tested} A" in predicted.attrs["extrapolation"]
    for between in (fit.inverse_table(), fit.control_range()):
        assert "outside the tested range: current_A between tested currents" in between.attrs["extrapolation"]
    path, _ = write_fit(fit, tmp_path)
    (exported,) = export(path, "inverse", tmp_path / "out")
    assert "# outside the tested range: current_A between tested currents" in exported.read_text()
    assert list(Fit.load(path).predict(table)["beyond"]) == list(predicted["beyond"])


def test_a_law_in_the_models_name_is_fitted_too(make_synthetic: Make) -> None:
    values = {**parameter_set("demo-bingham").values, "k_sat": K_SAT}
    tests = make_synthetic(values, (0.0, 0.5, 1.0, 2.0), (0.75, 1.5), name="bingham+saturating", cycles=3)
    named = identify(tests, model="bingham+saturating")
    assert named.values["k_sat"] == pytest.approx(K_SAT, abs=0.02)
