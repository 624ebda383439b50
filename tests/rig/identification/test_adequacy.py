"""Whether a model describes the data is told by their own scatter, and said to be unknown where there is none."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from rig.dampers import parameter_set
from rig.identification import Measurement, identify

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
OTHER = dict(parameter_set("demo-normalized-bouc-wen").values)


def unscattered(tests: list[Measurement]) -> list[Measurement]:
    """The tests as somebody makes them who does not know their scatter from cycle to cycle."""
    return [replace(each, noise_N=math.nan) for each in tests]


@pytest.mark.parametrize("current", ["affine", "per-current-affine"])
def test_without_a_measured_scatter_the_residuals_own_decides(current: str, make_synthetic: Make) -> None:
    right = identify(unscattered(make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0))), current=current)
    wrong = identify(
        unscattered(make_synthetic(OTHER, (0.0, 2.0), (0.5, 2.0), name="normalized_bouc_wen", cycles=4)),
        current=current,
    )
    assert right.adequate is True
    assert wrong.adequate is False
    assert not any("two whole cycles" in text for text in (*right.warnings, *wrong.warnings))


@pytest.mark.parametrize("cycles", [2, 8])
def test_two_cycles_are_enough_to_evaluate_and_are_not_reported_to_be_missing(
    cycles: int, make_synthetic: Make
) -> None:
    fit = identify(unscattered(make_synthetic(DEMO, cycles=cycles)))
    assert fit.adequate is True
    assert fit.warnings == ()


def test_what_one_cycle_cannot_determine_is_null(make_synthetic: Make) -> None:
    fit = identify(unscattered(make_synthetic(DEMO, cycles=1)))
    assert fit.adequate is None
    assert fit.to_json()["adequate"] is None
    assert any("no test has two whole cycles" in text for text in fit.warnings)
