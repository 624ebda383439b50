"""Fits to all tests but one group from common sums are the fits to the remaining tests."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement, Method
from rig.identification.models.measurement import set_of
from rig.identification.models.projection import Projection, Weighting
from rig.identification.models.separable import motion_scale
from rig.identification.models.solving import solve, solve_folds
from rig.identification.models.undetermined import examine
from rig.identification.uncertainty.scoring import misfits, rmse_N

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


@pytest.fixture
def tests(make_synthetic: Make) -> list[Measurement]:
    made = make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), cycles=1)
    rng = np.random.default_rng(4)
    return [replace(test, force_N=test.force_N + rng.normal(0.0, 5.0, test.u_m.size)) for test in made]


@pytest.mark.parametrize("name", ["asymmetric", "lost_motion"])
def test_each_fold_is_the_fit_to_the_other_tests(name: str, tests: list[Measurement]) -> None:
    damper, groups = model(name), set_of(tests).groups
    whole = solve(damper, tests, Method(), examine(damper, tests))
    folds = solve_folds(damper, tests, groups, Method(), whole.values)
    assert len(folds) == len(groups) == 3
    for group, values in zip(groups, folds, strict=True):
        rest = [test for number, test in enumerate(tests) if number not in group]
        alone = solve(damper, rest, Method(), examine(damper, rest), whole.values).values
        assert rmse_N(misfits(damper, values, rest)) <= rmse_N(misfits(damper, alone, rest)) * (1.0 + 1e-7)


def test_sums_do_not_depend_on_whether_the_current_is_constant(tests: list[Measurement]) -> None:
    """The powers of a constant current are factors of a test's sums; those of any other weight its samples."""
    form = model("lost_motion").separation(motion_scale(tests))
    assert form is not None
    stepped = [replace(test, current_A=test.current_A + np.where(np.arange(test.u_m.size) < 1, 1e-13, 0.0))
               for test in tests]  # fmt: skip
    one, other = (Projection(form, each_of, Weighting()).solve(form.starts[5]) for each_of in (tests, stepped))
    assert one.objective == pytest.approx(other.objective, rel=1e-9)
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-6)
