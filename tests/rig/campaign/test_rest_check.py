"""The zero check before arming: its limit is in proportion to the test, and noise is not taken for a zero."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rig.bench.model import Checks
from rig.campaign.preflight.rest_check import RestLimits, check_rest
from rig.signals.rest import AtRest

RANGE_N = 10_000.0
LIMITS = RestLimits(
    force_N=5000.0, position_min_m=-0.085, position_max_m=0.085, disagreement_m=0.005, range_N=RANGE_N, zero_N=25.0,
    current_zero_A=0.02, force_per_wire=1.0,
    displacement_per_wire=1e-3, force_offset_N=0.0, displacement_offset_m=0.0,
)


def rest(seed: int, zero_N: float = 0.0, current_A: float = 0.0, *, polls: int = 20, samples: int = 50) -> AtRest:
    """A rest window of 0.2 s as the simulated rig's sensors show it; of a fast rig there are few polls."""
    random = np.random.default_rng(seed)
    return AtRest(
        zero_N + 5.0 * random.standard_normal(samples), 5e-6 * random.standard_normal(samples),
        1e-5 * random.standard_normal(polls), 10.0 * random.standard_normal(polls),
        current_A=current_A + 0.002 * random.standard_normal(polls),
    )


@pytest.mark.parametrize("polls", [1, 2, 5, 20])
def test_no_clean_rest_is_refused(polls: int) -> None:
    for largest_N in (None, 100.0, 2000.0):
        limits = replace(LIMITS, zero_N=Checks().zero_N(RANGE_N, largest_N))
        refused = [cause for seed in range(500) if (cause := check_rest(rest(seed, polls=polls), limits)) is not None]
        assert refused == []


@pytest.mark.parametrize("polls", [1, 20])
@pytest.mark.parametrize("zero_N", [150.0, -150.0])
def test_a_zero_that_matters_to_the_test_is_refused_with_its_number_and_both_instruments(
    polls: int, zero_N: float
) -> None:
    for seed in range(50):
        cause = check_rest(rest(seed, zero_N, polls=polls), LIMITS)
        assert cause is not None
        assert cause.slug == "not-tared"
        assert cause.message == "force-zero"
        number = float(str(cause.values["difference"]).split()[0])
        assert number == pytest.approx(zero_N, abs=50.0 if polls == 1 else 15.0)


def test_the_limit_follows_the_test_and_the_bench_file() -> None:
    assert Checks().zero_N(RANGE_N, None) == pytest.approx(25.0)
    assert Checks().zero_N(RANGE_N, 600.0) == pytest.approx(12.0)
    assert Checks().zero_N(RANGE_N, 50.0) == pytest.approx(10.0)
    assert Checks().zero_N(RANGE_N, 4000.0) == pytest.approx(25.0)
    assert Checks.model_validate({"force_zero": "200 N"}).zero_N(RANGE_N, 600.0) == pytest.approx(200.0)
    weak, strong = (replace(LIMITS, zero_N=Checks().zero_N(RANGE_N, force_N)) for force_N in (500.0, 3000.0))
    shown = rest(1, 24.0)
    assert check_rest(shown, weak) is not None
    assert check_rest(shown, strong) is None


def test_a_current_that_stands_while_the_output_stage_is_off_is_refused() -> None:
    cause = check_rest(rest(2, current_A=0.1), LIMITS)
    assert cause is not None
    assert float(cause.detail.split("reports ")[1].split()[0]) == pytest.approx(100.0, abs=2.0)
    assert "ECU" in cause.detail
    assert check_rest(rest(3, current_A=0.01), LIMITS) is None


def test_the_zero_is_known_as_well_as_the_rest_window_allows() -> None:
    zeros = [rest(seed, 40.0).force_zero for seed in range(400)]
    errors = np.array([zero.value - 40.0 for zero in zeros])
    stated = np.array([zero.std for zero in zeros])
    assert np.std(errors / stated) == pytest.approx(1.0, abs=0.15)
    drifting = rest(5)
    drifting = replace(drifting, force_N=drifting.force_N + np.linspace(-20.0, 20.0, 50))
    assert drifting.force_zero.std > 4.0
    numbers = rest(6, 40.0).numbers(RANGE_N)
    assert numbers["force_zero_std_N"] == pytest.approx(5.0 / math.sqrt(50), rel=0.5)
    assert numbers["rest_force_difference_N"] == pytest.approx(40.0, abs=10.0)
