"""Tests that do not belong together are named; held-out tests that were fitted are refused."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, identify
from rig.identification.models.law_search import law_over
from rig.identification.models.measurement import set_of
from rig.identification.models.undetermined import levels_of
from rig.identification.points.consistency import contradictions
from rig.identification.remarks import Remark
from rig.identification.selection import groups_of
from rig.recording.recorded_point import RecordedPoint

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
OTHER = {**DEMO, "Fyb": 130.0, "Ca_plus": 1800.0}


def of_run(name: str, tests: list[Measurement]) -> list[Measurement]:
    return [replace(test, file=f"/logs/{name}/points/{test.id}.h5") for test in tests]


def test_the_same_test_with_another_force_is_named(make_synthetic: Make) -> None:
    one = of_run("A", make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0)))
    other = of_run("B", make_synthetic(OTHER, (1.0,), (2.0,), seed=4))
    warnings = identify([*one, *other]).warnings
    assert any("p004 of A and p001 of B by" in text and "two specimens" in text for text in warnings)


def test_two_dampers_without_a_common_test_are_reported_by_fits_apart(make_synthetic: Make) -> None:
    one = of_run("A", make_synthetic(DEMO, (0.0, 1.0), (0.5, 1.0)))
    other = of_run("B", make_synthetic(OTHER, (0.5, 1.5), (1.5, 2.0), seed=4))
    fit = identify([*one, *other])
    assert not fit.adequate
    assert any(re.match(r"separate fits to the 2 runs leave an error of [45]\.\d+ N", text) for text in fit.warnings)


def test_two_runs_of_one_damper_are_not_accused(make_synthetic: Make) -> None:
    one = of_run("A", make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0)))
    other = of_run("B", make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), seed=4))
    assert identify([*one, *other]).warnings == ()


def test_held_out_tests_that_are_fitted_are_refused(make_synthetic: Make, demo_points: list[RecordedPoint]) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    with pytest.raises(IdentificationFailed, match=r"for validation: 2 \(p001, p002\)"):
        identify(tests, holdout=tests[:2])
    with pytest.raises(IdentificationFailed, match="for validation: 9 "):
        identify(demo_points, holdout=demo_points)


@pytest.mark.parametrize(("channel", "unit"), [("force_N", "force"), ("u_m", "displacement")])
def test_a_test_with_a_constant_channel_is_left_out_by_name(make_synthetic: Make, channel: str, unit: str) -> None:
    """Its error as a share of its force is a division by zero, which ended in a linear algebra error."""
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    dead = replace(tests[1], **{channel: np.full_like(tests[1].force_N, 120.0)})
    fit = identify([tests[0], dead, *tests[2:]])
    (warning,) = [text for text in fit.warnings if isinstance(text, Remark) and text.slug == "constant-channel"]
    assert (warning.numbers["test"], warning.numbers["channel"][0]) == ("p002", unit)  # type: ignore[index]
    assert [entry.id for entry in fit.error.per_test] == ["p001", "p003", "p004"]
    with pytest.raises(IdentificationFailed, match=f"p002 not used: its {unit}"):
        identify([tests[0], *tests[2:]], holdout=[dead])


def test_tests_beside_mid_stroke_that_start_elsewhere_in_their_cycle_are_not_accused(make_synthetic: Make) -> None:
    one = make_synthetic(DEMO, (1.0,), (1.0,), noise_N=1.0)[0]
    shifted = {name: np.roll(getattr(one, name), 60) for name in ("v_m_s", "a_m_s2", "force_N")}
    tests = [
        replace(one, u_m=one.u_m + 0.1),
        replace(one, id="p002", u_m=np.roll(one.u_m, 60) + 0.1, **shifted),
    ]  # the force of one damper, 0.1 m from its mid-stroke: no test crosses it
    assert contradictions(tests) == []


def test_currents_25_mA_apart_are_five_currents_in_every_room(make_synthetic: Make) -> None:
    """They were one motion and current with contradicting forces, or 12.5, 62.5 and 100 mA, without a word."""
    currents = (0.0, 0.025, 0.05, 0.075, 0.1)
    strong = {**DEMO, "Fyb": 3000.0}
    tests = [replace(test, nominal_current_A=np.nan) for test in make_synthetic(strong, currents, (1.0,), cycles=3)]
    assert contradictions(tests) == []
    assert set_of(tests).currents.names_A == currents
    assert law_over(tests, "per-current") == "per-current@0,0.025,0.05,0.075,0.1"
    assert levels_of(tests).values_A == pytest.approx(currents)
    assert len(groups_of(tests)) == 5
    fit = identify(tests, model="bingham", current="per-current-affine")
    assert fit.current is not None
    assert fit.current.currents_A == pytest.approx(currents)
    assert {"c0 at 0.025 A", "c0 at 0.075 A"} <= set(fit.parameters)
    stated = fit.to_json()["test_set"]["statement"]
    assert stated == "currents 0, 25, 50, 75, 100 mA distinguished; resolution 1 to 2 mA"


def test_a_current_that_was_not_reached_is_named_and_no_second_damper(make_synthetic: Make) -> None:
    one, other, low = make_synthetic(DEMO, (1.0, 1.0, 0.4), (1.0,), cycles=3)
    warnings = contradictions([one, replace(other, id="p2"), replace(low, nominal_current_A=1.0)])
    assert [text.slug for text in warnings] == ["current-contradicts"]
    assert "requested 1 A, measured 0.4 A" in warnings[0]


def test_a_requested_stroke_that_was_not_reached_is_no_second_damper(make_synthetic: Make) -> None:
    one, other = make_synthetic(DEMO, (1.0, 1.0), (1.0,), noise_N=1.0)
    short = other.moved(0.8 * other.u_m, 0.8 * other.v_m_s, 0.8 * other.a_m_s2)
    assert contradictions([one, replace(short, force_N=0.8 * other.force_N)]) == []


def test_levels_that_the_noise_merges_are_reported(make_synthetic: Make) -> None:
    made = make_synthetic(DEMO, tuple(0.01 * k for k in range(6)), (1.0,), cycles=3)
    tests = [replace(test, nominal_current_A=np.nan, current_scatter_A=0.01) for test in made]
    assert [text.slug for text in contradictions(tests)] == ["currents-merged"]
