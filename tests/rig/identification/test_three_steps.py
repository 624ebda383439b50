"""Zhu's three steps over several currents."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, identify

Make = Callable[..., list[Measurement]]
TRUE = dict(parameter_set("demo-normalized-bouc-wen").values) | {"rho": 120.0}
METHOD = Method("zhu_three_step")


def test_parameters_against_the_current_are_lines(make_synthetic: Make) -> None:
    tests = make_synthetic(TRUE, (0.5, 1.0, 2.0), (1.0,), name="normalized_bouc_wen", noise_N=0.5, cycles=4)
    fit = identify(tests, model="normalized_bouc_wen", method=METHOD)
    for name in ("kw", "kw_b", "kv", "kv_b"):
        scale = max(abs(TRUE["kw"] + TRUE["kw_b"]), 1.0) if name.startswith("kw") else TRUE["kv"] + TRUE["kv_b"]
        assert fit.parameters[name].value == pytest.approx(TRUE[name], abs=0.05 * scale), name
    assert fit.parameters["rho"].value == pytest.approx(TRUE["rho"], rel=0.15)
    assert fit.error.nrmse_percent_of_peak < 4.0
    assert fit.method == "zhu_three_step"


def test_one_current_gives_the_sums_alone(make_synthetic: Make) -> None:
    tests = make_synthetic(TRUE, (1.0,), (1.0,), name="normalized_bouc_wen", noise_N=0.5, cycles=4)
    fit = identify(tests, model="normalized_bouc_wen", method=METHOD)
    assert fit.parameters["kw"].value == pytest.approx(TRUE["kw"] + TRUE["kw_b"], rel=0.05)
    assert not fit.parameters["kw_b"].identifiable


def test_steps_that_work_at_one_current_of_two_do_not_split_a_number_in_two(make_synthetic: Make) -> None:
    tests = make_synthetic(TRUE, (1.0, 2.0), (1.0,), name="normalized_bouc_wen", noise_N=0.5, cycles=4)
    turned = replace(tests[1], force_N=800.0 * tests[1].v_m_s - 100.0 * np.sign(tests[1].v_m_s))
    with pytest.raises(IdentificationFailed, match=r"succeeds only at 1\.00 A, .* \(p002: .* is not positive"):
        identify([tests[0], turned], model="normalized_bouc_wen", method=METHOD)


def test_another_model_or_a_loop_without_hysteresis_is_refused_by_name(make_synthetic: Make) -> None:
    tests = make_synthetic(TRUE, (1.0,), (1.0,), name="normalized_bouc_wen", cycles=4)
    with pytest.raises(IdentificationFailed, match="got model kwok, expected normalized_bouc_wen"):
        identify(tests, model="kwok", method=METHOD)
    viscous = dict.fromkeys(model("normalized_bouc_wen").names, 0.0) | {
        "kv": 800.0,
        "rho": 1.0,
        "sigma": 1.0,
        "n": 2.0,
    }
    flat = make_synthetic(viscous, (1.0,), (1.0,), name="normalized_bouc_wen", noise_N=0.0, cycles=4)
    stripped = [Measurement(**{**vars(each), "force_N": each.force_N - 100.0 * np.sign(each.v_m_s)}) for each in flat]
    with pytest.raises(IdentificationFailed, match="p001: zhu_three_step: kw = -100 N is not positive"):
        identify(stripped, model="normalized_bouc_wen", method=METHOD)
