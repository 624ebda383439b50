"""Dunn's test with Holm's correction, by hand; the papers' printed values; fits that mirror each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.dampers import model
from rig.identification.models.problem import unmirrored
from rig.study.post_hoc import dunn
from rig.study.printed_values import BEST, SETTINGS


def test_pairs_are_evaluated_by_their_mean_ranks_over_all_values() -> None:
    pairs = dunn({"a": [1.0, 2.0, 3.0], "b": [4.0, 5.0, 6.0], "c": [7.0, 8.0, 9.0]})
    # mean ranks 2, 5, 8; sqrt(9 * 10 / 12 * (1/3 + 1/3)) = sqrt(5); 6 / sqrt(5) = 2.683, 3 / sqrt(5) = 1.342
    assert [(pair.first, pair.second) for pair in pairs] == [("a", "c"), ("a", "b"), ("b", "c")]
    assert pairs[0].z == pytest.approx(6.0 / math.sqrt(5.0))
    alone = math.erfc(6.0 / math.sqrt(10.0))
    assert pairs[0].p == pytest.approx(alone)
    assert pairs[0].p_holm == pytest.approx(3.0 * alone)
    assert pairs[1].p_holm == pairs[2].p_holm == pytest.approx(2.0 * math.erfc(3.0 / math.sqrt(10.0)))


def test_ties_make_ranks_less_certain_and_probabilities_end_at_one() -> None:
    (pair,) = dunn({"a": [1.0, 2.0], "b": [2.0, 3.0]})
    # ranks 1, 2.5 | 2.5, 4: means 1.75, 3.25; variance 4 * 5 / 12 - 6 / (12 * 3) = 1.5
    assert pair.z == pytest.approx(1.5 / math.sqrt(1.5))
    identical = dunn({"a": [1.0, 4.0], "b": [2.0, 3.0], "c": [1.5, 3.5]})
    assert all(pair.p_holm == 1.0 for pair in identical)


def test_groups_without_a_difference_to_rank_are_refused() -> None:
    with pytest.raises(ValueError, match="equal"):
        dunn({"a": [1.0, 1.0], "b": [1.0]})
    with pytest.raises(ValueError, match="at least two"):
        dunn({"a": [1.0]})


def test_a_mirror_solution_gives_the_same_force_and_is_reported_with_a_positive_beta() -> None:
    damper = model("asymmetric")
    values = dict(damper.demonstration)
    mirror = {n: -x if n in {"beta", "delta", "Fya", "Fyb"} else x for n, x in values.items()}
    u, v = np.array([0.01, -0.01, 0.02]), np.array([0.1, -0.2, 0.05])
    forces = [damper.force(one, u, v, 0.0 * u, 1.0, 1e-3) for one in (values, mirror)]
    assert forces[0] == pytest.approx(forces[1])
    assert unmirrored(mirror) == unmirrored(values) == values


def test_printed_best_settings_are_rows_of_the_printed_tables() -> None:
    assert all(SETTINGS[method, N, budget] == row for method, (N, budget, row) in BEST.items())
    assert len(SETTINGS) == 5 * 9 + 1
