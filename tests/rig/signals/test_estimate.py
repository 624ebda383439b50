from __future__ import annotations

import numpy as np
import pytest

from rig.signals.estimate import Estimate, next_member


def test_one_estimate_says_no_more_of_another_member_than_members_are_identical() -> None:
    found = next_member([Estimate(1e-3, 1e-5)], 0.4e-3)
    assert found.value == pytest.approx(1e-3)
    assert 0.4e-3 < found.std < 1.2e-3


def test_many_members_that_are_identical_leave_their_common_value() -> None:
    rng = np.random.default_rng(1)
    found = next_member([Estimate(float(value), 1e-4) for value in 1e-3 + 1e-4 * rng.standard_normal(40)], 0.4e-3)
    assert found.value == pytest.approx(1e-3, abs=1e-4)
    assert found.std < 0.2e-3


@pytest.mark.parametrize("count", [2, 4, 12])
@pytest.mark.parametrize("effect", [0.1, 0.4, 1.0])
def test_the_next_member_lies_within_what_is_stated(count: int, effect: float) -> None:
    rng, inside = np.random.default_rng(2), []
    for _ in range(300):
        stds = np.exp(rng.uniform(np.log(0.05), np.log(2.0), count))
        values = 3.0 + effect * rng.standard_normal(count) + stds * rng.standard_normal(count)
        found = next_member([Estimate(*pair) for pair in zip(values.tolist(), stds.tolist(), strict=True)], 0.4)
        inside.append(abs(3.0 + effect * rng.standard_normal() - found.value) <= 1.96 * found.std)
    assert np.mean(inside) > (0.93 if effect <= 0.4 else 0.8)
