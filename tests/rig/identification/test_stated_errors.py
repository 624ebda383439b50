"""What is known of the sensors' errors is in the intervals and in the verdict, and nothing is stated beyond it."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.identification import Measurement, identify
from rig.identification.points.preparation import prepare
from rig.recording.quality.point_quality import PointQuality, RestQuality
from rig.recording.recorded_point import ForceSamples, RecordedPoint

Make = Callable[..., list[Measurement]]
MakeCampaign = Callable[..., list[RecordedPoint]]
DEMO = dict(parameter_set("demo").values)


def with_force(
    point: RecordedPoint, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], **described: object
) -> RecordedPoint:
    """The point with other force samples (times, N)."""
    time_s, force_N = change(point.force_samples.time_s, point.force_samples.force_N)
    changed = replace(point, **described)
    changed.__dict__["force_samples"] = ForceSamples(time_s, force_N, point.force_samples.flags)
    return changed


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_m_is_never_stated_from_one_frequency(waveform: str, make_campaign: MakeCampaign) -> None:
    for seed in range(3):
        fit = identify(make_campaign("demo", (0.0, 1.0), (1.0,), seed=seed, waveform=waveform))
        m = fit.parameters["m"]
        assert not m.identifiable
        assert m.low is m.high is m.standard_error is None
        assert "not separable" in m.reason
        assert "one frequency" in m.reason


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_m_is_not_stated_from_one_frequency_of_which_a_single_cycle_is_left(
    waveform: str,
    make_campaign: MakeCampaign,
) -> None:
    points = []
    for point in make_campaign("demo", (0.0, 1.0), (0.5,), waveform=waveform):
        assert point.arrays is not None
        first = point.time_s < point.time_s[0] + 6.3  # three whole cycles of 2 s, of which the middle one is kept
        samples = point.force_samples
        kept = samples.time_s < point.time_s[first][-1]
        short = replace(point, arrays={name: values[first] for name, values in point.arrays.items()})
        short.__dict__["force_samples"] = ForceSamples(samples.time_s[kept], samples.force_N[kept], samples.flags[kept])
        points.append(short)
    m = identify(points).parameters["m"]
    assert not m.identifiable
    assert m.low is m.high is None
    assert "one frequency" in m.reason


def test_two_frequencies_state_m(make_campaign: MakeCampaign) -> None:
    assert identify(make_campaign("demo", (0.0, 1.0), (1.0, 2.0))).parameters["m"].identifiable


def test_the_uncertain_zero_of_the_force_is_in_the_interval_of_f0_and_in_no_other(make_campaign: MakeCampaign) -> None:
    points = make_campaign("demo", (0.0, 1.0), (1.0, 2.0))
    sure = identify(points)
    rest = PointQuality(rest=RestQuality(force_zero_std_N=3.0))
    unsure = identify([with_force(point, lambda t, f: (t, f), quality=rest) for point in points])
    errors = {name: (sure.parameters[name].standard_error, unsure.parameters[name].standard_error)
              for name in sure.identifiable}  # fmt: skip
    assert errors["F0"][1] == pytest.approx(np.hypot(errors["F0"][0], 3.0), rel=0.02)  # type: ignore[arg-type]  # identifiable
    for name in set(errors) - {"F0"}:
        assert errors[name][1] == pytest.approx(errors[name][0], rel=0.02), name


def test_a_skew_within_its_stated_uncertainty_is_no_misfit_and_the_truth_stays_inside(
    make_campaign: MakeCampaign,
) -> None:
    late = [
        with_force(point, lambda t, f: (t + 4e-4, f), skew_std_s=3e-4)
        for point in make_campaign("demo", (0.0, 1.0, 2.0), (0.5, 1.0, 2.0))
    ]
    fit = identify(late)
    assert fit.adequate is True
    for name in fit.identifiable:
        each = fit.parameters[name]
        assert each.simultaneous_low <= DEMO[name] <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable
    unstated = identify([replace_skew(point) for point in late])
    assert unstated.adequate is False


def replace_skew(point: RecordedPoint) -> RecordedPoint:
    """The same, its skew stated as certain."""
    return with_force(point, lambda t, f: (t, f), skew_std_s=1e-6)


@pytest.mark.parametrize("step_N", [5.0, 20.0])
def test_a_coarse_force_is_neither_saturated_nor_a_misfit(step_N: float, make_campaign: MakeCampaign) -> None:
    points = [
        with_force(point, lambda t, f: (t, np.round(f / step_N) * step_N))
        for point in make_campaign("demo", (0.5, 1.5), (1.0, 2.0))
    ]
    fit = identify(points)
    assert fit.adequate is True
    assert not any("saturated" in text for text in fit.warnings)
    outside = [
        name for name in fit.identifiable
        if not fit.parameters[name].simultaneous_low <= DEMO[name] <= fit.parameters[name].simultaneous_high  # type: ignore[operator]
    ]  # fmt: skip
    assert outside == []


def test_a_force_cut_off_at_its_range_is_still_seen(make_campaign: MakeCampaign) -> None:
    point = make_campaign("demo", (2.0,), (1.0,))[0]
    top_N = 0.95 * float(np.max(point.force_samples.force_N))
    cut = with_force(point, lambda t, f: (t, np.round(np.minimum(f, top_N) / 5.0) * 5.0))
    assert any("saturated" in text for text in prepare(cut).warnings)


def test_the_errors_of_the_motion_widen_what_they_spoil(make_campaign: MakeCampaign) -> None:
    tests = [prepare(point) for point in make_campaign("demo", (0.0, 1.0), (1.0, 2.0))]
    assert all(each.motion_error is not None for each in tests)
    exact = identify([replace(each, motion_error=None) for each in tests])
    coarse = identify([
        replace(each, motion_error=replace(each.motion_error, errors_m=100.0 * each.motion_error.errors_m))  # type: ignore[union-attr]
        for each in tests
    ])  # fmt: skip
    for name in exact.identifiable:
        assert coarse.parameters[name].standard_error >= exact.parameters[name].standard_error  # type: ignore[operator]
    assert coarse.parameters["beta"].standard_error > 2.0 * exact.parameters["beta"].standard_error  # type: ignore[operator]


@pytest.mark.nightly
def test_a_parameter_at_its_limit_is_not_identified_and_says_which_limit(make_synthetic: Make) -> None:
    tests = make_synthetic({**DEMO, "delta": 0.0})
    fit = identify(tests, model="thinning_bouc_wen")
    sigma = fit.parameters["sigma"]
    assert not sigma.identifiable
    assert sigma.low is sigma.high is None
    assert sigma.value in (0.02, 50.0)
    assert f"limit, {sigma.value:g};" in sigma.reason


def test_no_interval_goes_beyond_what_the_model_allows(make_synthetic: Make) -> None:
    for name in ("thinning_bouc_wen", "normalized_bouc_wen"):
        fit = identify(make_synthetic(DEMO, (0.0, 1.0), (0.5, 1.0), cycles=3, noise_N=60.0), model=name)
        n = fit.parameters["n"]
        assert not n.identifiable or n.low >= 1.0  # type: ignore[operator]  # identifiable


def test_a_mass_held_at_zero_has_one_end_of_an_interval(make_synthetic: Make) -> None:
    fit = identify(make_synthetic({**DEMO, "m": -2.0}, (0.0, 1.0), (1.0, 2.0)))
    m = fit.parameters["m"]
    assert not m.identifiable
    assert m.value == 0.0
    assert m.low is None
    assert m.high is not None
    assert "lower bound, 0" in m.reason


@pytest.mark.nightly
def test_a_hopeless_model_is_given_up_and_stands_in_the_ranking_with_its_reason(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 2.0), cycles=3), model="all")
    given_up = {each.model: each.reason for each in fit.selection if each.reason}
    assert fit.model == "asymmetric"
    assert "viscoelastic_plastic" in given_up
    assert "stopped after" in given_up["viscoelastic_plastic"]
    assert {each["model"] for each in fit.to_json()["selection"]} == {each.model for each in fit.selection}


def test_evaluating_a_long_recording_takes_little_memory_beside_it(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), cycles=600)
    size = 8 * sum(each.u_m.size for each in tests)
    identify(tests)
    tracemalloc.start()
    try:
        fit = identify(tests)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert fit.adequate is True
    assert peak < 6 * size + 30e6


def with_readings(point: RecordedPoint, readings_A: np.ndarray, every_s: float) -> RecordedPoint:
    """The point with a measured current: straight lines between readings, as a recording has it."""
    assert point.arrays is not None
    at_s = point.time_s[0] + every_s * np.arange(readings_A.size)
    copy = replace(point, arrays={**point.arrays, "current": np.interp(point.time_s, at_s, readings_A)})
    copy.__dict__["force_samples"] = point.force_samples
    return copy


def test_the_mean_of_noisy_readings_of_the_current_is_as_sure_as_their_number_says(make_campaign: MakeCampaign) -> None:
    point = make_campaign("demo", (1.0,), (1.0,))[0]
    random, every_s = np.random.default_rng(3), 0.1
    count = int((point.time_s[-1] - point.time_s[0]) / every_s) + 2
    stated_A, mean_A = [], []
    for _ in range(25):
        test = prepare(with_readings(point, 1.0 + 0.01 * random.standard_normal(count), every_s))
        stated_A.append(test.current_std_A)
        mean_A.append(test.current_A[0] - 1.0)
    seconds = test.dt_s * test.u_m.size  # of the kept cycles
    by_hand_A = 0.01 / np.sqrt(seconds / every_s)  # white readings, 10 a second
    assert np.median(stated_A) == pytest.approx(by_hand_A, rel=0.2)
    assert np.std(mean_A) == pytest.approx(by_hand_A, rel=0.5)


def test_a_current_that_is_given_has_no_error_of_its_own(make_campaign: MakeCampaign) -> None:
    point = make_campaign("demo", (1.0,), (1.0,))[0]
    assert prepare(with_readings(point, np.ones(2), 1.0)).current_std_A == 0.0


def test_what_a_current_is_uncertain_by_is_in_the_interval_of_what_changes_with_it(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (1.0,), noise_N=0.01)  # one test at either current
    sure = identify(tests, diagnose=False)
    unsure = identify([replace(test, current_std_A=0.01) for test in tests], diagnose=False)
    for name in ("Fyb", "Cb_plus", "Cb_minus"):  # 0.01 A too much is 0.01 of it too much at that current, over 2 A
        by_hand = 0.01 * DEMO[name] * np.sqrt(2.0) / 2.0
        before, after = (fit.parameters[name].standard_error for fit in (sure, unsure))
        assert before is not None
        assert before < 0.3 * by_hand
        assert after == pytest.approx(np.hypot(before, by_hand), rel=0.05), name
    before, after = (fit.parameters["F0"].standard_error for fit in (sure, unsure))
    assert after == pytest.approx(before, rel=0.05)  # no current is in it
