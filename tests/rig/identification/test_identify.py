"""The whole way from recorded points to a fit."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Fit, Measurement, identify
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

Make = Callable[..., list[RecordedPoint]]
DEMO = dict(parameter_set("demo").values)


@pytest.fixture(scope="module")
def demo_fit(demo_points: list[RecordedPoint], make_campaign: Make) -> Fit:
    triangles = make_campaign("demo", (0.0, 1.0), (1.0,), seed=9, waveform="triangle")
    return identify([*demo_points, *triangles], holdout="waveform=triangle")


def test_simultaneous_intervals_hold_the_simulated_truth(demo_fit: Fit) -> None:
    for name in demo_fit.identifiable:
        each = demo_fit.parameters[name]
        assert each.simultaneous_low < DEMO[name] < each.simultaneous_high, name  # type: ignore[operator] - identifiable
        assert each.simultaneous_low <= each.low <= each.high <= each.simultaneous_high  # type: ignore[operator] - as above
    assert set(demo_fit.identifiable) == set(DEMO) - {"eta"}


def test_the_fit_reaches_the_noise_and_predicts_unseen_triangles_as_well(demo_fit: Fit) -> None:
    assert demo_fit.adequate
    assert demo_fit.error.rmse_N == pytest.approx(5.0, rel=0.03)
    assert demo_fit.holdout is not None
    assert demo_fit.holdout.rmse_N < 6.0
    assert [test.id for test in demo_fit.holdout.per_test] == ["t001", "t002"]


def test_json_has_the_documented_keys_and_no_bare_infinities(demo_fit: Fit) -> None:
    text = json.dumps(demo_fit.to_json(), allow_nan=False)
    found = json.loads(text)
    assert {
        "model",
        "method",
        "parameters",
        "error",
        "selection",
        "adequate",
        "warnings",
        "evaluations",
        "wall_s",
    } <= set(found)
    assert {"value", "unit", "low", "high", "identifiable"} <= set(found["parameters"]["Ca_plus"])
    assert {"rmse_N", "mae_N", "nrmse_percent_of_peak", "per_test", "holdout"} <= set(found["error"])
    assert {"id", "file", "rmse_N", "nrmse_percent_of_peak"} <= set(found["error"]["per_test"][0])
    assert {"rmse_N", "nrmse_percent_of_peak", "per_test"} <= set(found["error"]["holdout"])
    assert {"model", "holdout_nrmse_percent_of_peak", "bic"} <= set(found["selection"][0])
    assert found["parameters"]["eta"]["value"] is None
    assert "add a current step" in found["parameters"]["eta"]["reason"]


def test_relative_error_is_the_mean_over_tests_of_rmse_over_peak(demo_fit: Fit) -> None:
    each = demo_fit.error.per_test
    assert demo_fit.error.nrmse_percent_of_peak == pytest.approx(np.mean([test.nrmse_percent_of_peak for test in each]))
    assert demo_fit.to_pandas().loc["Fyb", "unit"] == "N/A"


def test_a_damper_of_another_model_is_reported_not_to_fit(make_campaign: Make) -> None:
    points = make_campaign("demo-normalized-bouc-wen", (0.0, 2.0), (0.5, 2.0))
    fit = identify(points)
    assert not fit.adequate
    assert any(getattr(text, "slug", "") == "model-error" for text in fit.warnings)
    assert fit.error.rmse_N > 20.0


def test_all_models_compared_recommend_the_one_that_made_the_data(make_campaign: Make) -> None:
    points = make_campaign("demo-normalized-bouc-wen", (0.0, 2.0), (0.5, 2.0))
    fit = identify(points, model="all", holdout="current_A=2,frequency_Hz=2")
    assert fit.model in {"normalized_bouc_wen", "bouc_wen"}
    assert fit.adequate
    scores = {score.model: score.holdout_nrmse_percent_of_peak for score in fit.selection}
    assert scores["asymmetric"] > 3.0 * scores["normalized_bouc_wen"]  # type: ignore[operator] - held-out tests were given


@pytest.mark.nightly
def test_without_held_out_tests_models_are_compared_on_what_they_have_not_seen(
    demo_points: list[RecordedPoint],
) -> None:
    fit = identify(demo_points, model="all")
    assert fit.model == "asymmetric"
    assert fit.selection[0].holdout_nrmse_percent_of_peak is not None
    assert fit.selection[0].bic == min(score.bic for score in fit.selection)


def test_only_the_loops_of_a_held_out_run_are_scored(demo_points: list[RecordedPoint], make_campaign: Make) -> None:
    loop, friction, step = make_campaign("demo", (1.0,), (0.7, 0.8, 0.9), seed=11)
    special = [replace(friction, kind="friction"), replace(step, kind="current_step")]
    fit = identify(demo_points, holdout=[loop, *special])
    assert fit.holdout is not None
    assert [test.id for test in fit.holdout.per_test] == [loop.id]
    with pytest.raises(IdentificationFailed, match="none of the 2 points contains loops"):
        identify(demo_points, holdout=special)


def test_a_holdout_that_matches_nothing_or_everything_is_refused(demo_points: list[RecordedPoint]) -> None:
    with pytest.raises(IdentificationFailed, match="matches none of the 9 points; they have waveform=sine"):
        identify(demo_points, holdout="waveform=triangle")
    with pytest.raises(IdentificationFailed, match="no test remains for the fit"):
        identify(demo_points, holdout="waveform=sine")


def test_held_out_tests_that_are_none_are_refused_and_not_forgotten(demo_points: list[RecordedPoint]) -> None:
    with pytest.raises(IdentificationFailed, match="holdout: no test was specified"):
        identify(demo_points, holdout=[])
    empty = Run(path=Path("other"), points=(replace(demo_points[0], verdict="invalid"),))
    with pytest.raises(IdentificationFailed, match="holdout: the run other contains no valid point"):
        identify(demo_points, holdout=empty)


def test_a_recording_given_twice_is_refused(demo_points: list[RecordedPoint]) -> None:
    again = replace(demo_points[2], id="copy")
    again.__dict__["force_samples"] = demo_points[2].force_samples
    with pytest.raises(IdentificationFailed, match=r"twice: 1 \(s003 and copy contain the same"):
        identify([*demo_points, again])


def test_unusable_points_are_left_out_with_a_warning(demo_points: list[RecordedPoint]) -> None:
    broken = replace(demo_points[0], verdict="invalid", reasons=("tripped",))
    fit = identify([broken, *demo_points[1:]])
    assert fit.warnings == (f"{broken.id} not used: the recording is invalid (tripped)",)


def test_unknown_methods_are_refused(demo_points: list[RecordedPoint]) -> None:
    with pytest.raises(IdentificationFailed, match="method: got 'simplex'"):
        identify(demo_points, method="simplex")


def test_a_one_off_fit_loads_neither_numba_nor_scipy() -> None:
    program = (
        "import sys, numpy as np, rig.identification as r\n"
        "t = np.arange(2000) / 250.0\n"
        "u, v, a = 0.05 * np.sin(6.28 * t), 0.314 * np.cos(6.28 * t), -1.97 * np.sin(6.28 * t)\n"
        "m = [r.Measurement(id=str(i), u_m=u, v_m_s=v, a_m_s2=a, current_A=np.full(2000, float(i)), dt_s=0.004,\n"
        "     force_N=500.0 * v + 200.0 * (i + 1) * np.tanh(40.0 * v + np.sign(u))) for i in range(2)]\n"
        "r.identify(m)\n"
        "heavy = {'numba', 'scipy', 'pandas', 'h5py', 'matplotlib'}\n"
        "print(sorted({name.split('.')[0] for name in sys.modules} & heavy))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("share", "warned"), [(0.003, False), (0.04, True)])
def test_sharp_reversals_are_reported_where_their_velocity_matters(*, share: float, warned: bool) -> None:
    """0.003 of the RMS speed is what the rounding of a sine gives that repeats in every cycle."""
    t = np.arange(2000) / 250.0
    u, v, a = 0.05 * np.sin(6.28 * t), 0.314 * np.cos(6.28 * t), -1.97 * np.sin(6.28 * t)
    unseen = share * 0.222 * np.cos(630.0 * t)
    tests = [
        Measurement(
            id=str(current), u_m=u, v_m_s=v, a_m_s2=a, current_A=np.full(2000, current), dt_s=0.004,
            force_N=500.0 * v + 200.0 * (current + 1.0) * np.tanh(40.0 * v + np.sign(u)),
            unseen_v_m_s=unseen, unseen_a_m_s2=630.0 * unseen,
        )
        for current in (0.0, 1.0)
    ]
    fit = identify(tests)
    assert any("more sharply than its displacement samples resolve" in text for text in fit.warnings) == warned


@pytest.mark.nightly
def test_triangles_alone_give_intervals_that_cover_the_truth_and_a_warning(
    make_campaign: Callable[..., list[RecordedPoint]],
) -> None:
    truth = parameter_set("demo").values
    for seed in range(4):
        fit = identify(make_campaign("demo", (0.0, 1.0, 2.0), (0.5, 1.0), seed=seed, waveform="triangle"))
        assert any("more sharply than its displacement samples resolve" in text for text in fit.warnings)
        for name, found in fit.parameters.items():
            if found.identifiable:
                low, high = found.simultaneous_low, found.simultaneous_high
                assert low is not None
                assert high is not None
                assert low < truth[name] < high, (seed, name)
