"""Each amplitude and frequency predicted from the others: the error of a fit that has not seen them."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Fit, Measurement, identify
from rig.matrix.methods import FEW_MODELS

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
FREQUENCIES_HZ = (0.5, 1.0, 2.0)


@pytest.fixture(scope="module")
def tests(make_synthetic: Make) -> list[Measurement]:
    """Three pairs at three currents; the fastest one bends where the model does not: 30 N s^2/m^2 of v|v|."""
    made = make_synthetic(DEMO, (0.0, 1.0, 2.0), FREQUENCIES_HZ, cycles=3)
    return [replace(test, force_N=test.force_N + 30.0 * test.v_m_s * np.abs(test.v_m_s)) for test in made]


def test_each_pair_has_the_error_of_a_fit_to_the_other_pairs(tests: list[Measurement], tmp_path: Path) -> None:
    fit = identify(tests, unseen="pairs")
    assert fit.unseen is not None
    assert fit.unseen.split == "leave-one-pair-out"
    assert [pair.frequency_Hz for pair in fit.unseen.per_pair] == list(FREQUENCIES_HZ)
    assert {pair.tests for pair in fit.unseen.per_pair} == {3}
    for pair in fit.unseen.per_pair:
        rest = [test for test in tests if test.frequency_Hz != pair.frequency_Hz]
        own = identify(rest, diagnose=False)
        relative = []
        for test in (test for test in tests if test.frequency_Hz == pair.frequency_Hz):
            table = {"displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "acceleration_m_s2": test.a_m_s2,
                     "current_A": test.current_A}  # fmt: skip
            error = own.predict(table)["force_N"].to_numpy() - test.force_N
            peak = np.max(np.abs(test.force_N - test.force_N.mean()))
            relative.append(100.0 * np.sqrt(np.mean(error**2)) / peak)
        assert pair.nrmse_percent_of_peak == pytest.approx(np.mean(relative), rel=1e-3)
    assert fit.unseen.nrmse_percent_of_peak == pytest.approx(
        np.mean([test.nrmse_percent_of_peak for test in fit.unseen.per_test])
    )
    written = tmp_path / "fit.json"
    written.write_text(json.dumps(fit.to_json()))
    assert Fit.load(written).unseen == fit.unseen


def test_what_cannot_be_left_out_is_refused_with_what_can(tests: list[Measurement]) -> None:
    one = [test for test in tests if test.frequency_Hz == 1.0]
    with pytest.raises(IdentificationFailed, match=r"the same amplitude and frequency.*current_A=1"):
        identify(one, unseen="pairs")
    with pytest.raises(IdentificationFailed, match="expected 'pairs'"):
        identify(tests, unseen="tests")
    with pytest.raises(IdentificationFailed, match="cannot be combined with series_spring"):
        identify(tests, unseen="pairs", series_spring=True)
    free = [replace(tests[0], waveform="random"), *tests[1:]]
    with pytest.raises(IdentificationFailed, match="last 30 %"):
        identify(free, unseen="pairs")


def test_few_models_are_ranked_and_the_dampers_own_is_picked(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (0.0, 1.0), (0.5, 2.0), cycles=3), model="few")
    assert fit.model == "asymmetric"
    assert {score.model for score in fit.selection} == set(FEW_MODELS)
    assert [one.name for one in fit.references] == ["mean_cycle", "regression"]
