"""A spring in series with the damper: found where there is one, not seen where there is none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, identify

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
SMOOTH = {**DEMO, "delta": 0.0}  # the force through a spring cannot jump
STIFFNESS_N_M = 5e5


def behind_a_spring(test: Measurement, seed: int) -> Measurement:
    """The rod's motion is the damper's and the spring's stretch, both exact; 5 N of noise on the force."""
    force = model("asymmetric").force(SMOOTH, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s)
    rate = np.fft.irfft(np.fft.rfft(force) * 2j * np.pi * np.fft.rfftfreq(force.size, test.dt_s), force.size)
    return replace(
        test,
        force_N=force + np.random.default_rng(seed).normal(0.0, 5.0, force.size),
        u_m=test.u_m + force / STIFFNESS_N_M,
        v_m_s=test.v_m_s + rate / STIFFNESS_N_M,
    )


def test_a_spring_in_series_is_found_and_the_damper_behind_it(make_synthetic: Make) -> None:
    rigid = make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0))
    soft = [behind_a_spring(test, seed) for seed, test in enumerate(rigid)]
    without, found = identify(soft), identify(soft, series_spring=True)
    assert found.series is not None
    assert found.series.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.03)
    assert found.error.rmse_N < 0.5 * without.error.rmse_N
    assert found.values["beta"] == pytest.approx(SMOOTH["beta"], rel=0.05)
    assert found.to_json()["series_spring"]["low"] < STIFFNESS_N_M < found.to_json()["series_spring"]["high"]


def test_a_rigid_mounting_shows_no_spring_and_changes_nothing(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (0.5, 2.0))
    found = identify(tests, series_spring=True)
    assert found.series is not None
    assert found.series.stiffness_N_m is None
    assert found.values == identify(tests).values


def test_a_spring_with_all_models_or_without_cycles_is_refused(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (1.0,))
    with pytest.raises(IdentificationFailed, match="needs one model"):
        identify(tests, model="all", series_spring=True)
    with pytest.raises(IdentificationFailed, match="p001: its cycles are unknown"):
        identify([replace(tests[0], samples_per_cycle=0), tests[1]], series_spring=True)
