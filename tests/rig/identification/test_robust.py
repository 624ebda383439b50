"""Huber's loss: outliers move neither the fit, nor its intervals, nor the verdict on the model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, identify

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
HUBER = Method(loss="huber")


def spiked(tests: list[Measurement], seed: int = 0) -> list[Measurement]:
    """The tests with one sample in fifty off by 400 N, up or down."""
    rng = np.random.default_rng(seed)
    spikes = [400.0 * rng.choice((-1.0, 0.0, 1.0), each.u_m.size, p=(0.01, 0.98, 0.01)) for each in tests]
    return [replace(each, force_N=each.force_N + spike) for each, spike in zip(tests, spikes, strict=True)]


@pytest.mark.nightly
def test_intervals_among_outliers_are_as_wide_as_without_and_cover_the_truth(make_synthetic: Make) -> None:
    inside, stated, ratios = 0, 0, []
    for seed in range(20):
        tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), seed=seed)
        clean, robust = identify(tests), identify(spiked(tests, seed), method=HUBER)
        for name in robust.identifiable:
            each, reference = robust.parameters[name], clean.parameters[name]
            inside += each.low <= DEMO[name] <= each.high  # type: ignore[operator] - identifiable
            stated += 1
            ratios.append(each.standard_error / reference.standard_error)  # type: ignore[operator] - as above
    assert stated == 20 * 12
    assert inside >= 0.91 * stated
    assert 1.0 < np.mean(ratios) < 1.15  # Huber's loss is 95 % efficient, and one sample in fifty is lost


def test_the_right_model_is_adequate_among_outliers_and_a_wrong_one_is_not(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0))
    held_out = make_synthetic(DEMO, (0.5,), (1.5,), seed=3)
    assert identify(spiked(tests), method=HUBER, holdout=spiked(held_out, 5)).adequate
    assert not identify(spiked(tests)).adequate
    true = dict(parameter_set("demo-normalized-bouc-wen").values)
    other = make_synthetic(true, (0.0, 2.0), (0.5, 2.0), name="normalized_bouc_wen", cycles=4)
    assert not identify(spiked(other), method=HUBER).adequate


def test_the_loss_is_recorded_and_refused_where_there_is_none(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), cycles=3)
    assert identify(tests, method=HUBER).to_json()["loss"] == "huber"
    assert identify(tests).to_json()["loss"] == "squares"
    with pytest.raises(IdentificationFailed, match="got 'huber' for asymmetric with method de, expected"):
        identify(tests, method=Method("de", loss="huber"))
    with pytest.raises(IdentificationFailed, match="loss: got 'huber' for viscoelastic_plastic with method separable"):
        identify(tests, model="viscoelastic_plastic", method=HUBER)
    with pytest.raises(IdentificationFailed, match="series spring: needs least squares"):
        identify(tests, method=HUBER, series_spring=True)


def test_outliers_do_not_move_a_model_with_states_either(make_synthetic: Make) -> None:
    true = dict(parameter_set("demo-normalized-bouc-wen").values)
    tests = make_synthetic(true, (0.0, 2.0), (0.5, 2.0), name="normalized_bouc_wen", cycles=4)
    clean = identify(tests, model="normalized_bouc_wen")
    far = [replace(test, force_N=test.force_N + 900.0 * (np.arange(test.u_m.size) % 25 == 3)) for test in tests]
    robust, squares = (identify(far, model="normalized_bouc_wen", method=method) for method in (HUBER, Method()))
    assert robust.loss == "huber"
    assert abs(squares.values["f0"] - clean.values["f0"]) > 20.0  # 900 N in one sample of 25 move the mean by 36 N
    assert abs(robust.values["f0"] - clean.values["f0"]) < 2.0
    assert abs(robust.values["rho"] / clean.values["rho"] - 1.0) < 0.02
