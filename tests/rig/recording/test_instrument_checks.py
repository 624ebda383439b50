"""Load cell and LVDT against the controller's own inputs: what is said, of which points, and when nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig.recording.quality.instrument_checks import SLUGS, Checked, judge
from rig.recording.quality.point_quality import Agreement, Tolerances
from rig.recording.quality.verdict import Reason
from rig.signals.estimate import Estimate

CHANGES = {"zero-drift", "crosstalk"}


def campaign(
    seed: int = 0, points: int = 12, *, gain: float = 1.0, zero_N: float = 0.0, lag_s: float = 0.0,
    lvdt_gain: float = 1.0, lvdt_zero_m: float = 0.0, lvdt_lag_s: float = 0.0, drift_N_s: float = 0.0,
    crosstalk_N_A: float = 0.0, order: str = "random", currents_A: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0),
    weak: float = 1.0,
) -> list[Checked]:
    """Points whose estimates scatter by what they say; a weak campaign's say little."""
    random = np.random.default_rng(seed)
    chosen_A = [currents_A[i * len(currents_A) // points] for i in range(points)]
    if order == "random":
        random.shuffle(chosen_A)
    made = []
    for number, current_A in enumerate(chosen_A):
        begun_s = 9.0 * number + random.uniform(0.0, 1.0)
        offset_N = zero_N + drift_N_s * begun_s + crosstalk_N_A * current_A

        def seen(value: float, std: float) -> Estimate:
            return Estimate(value + std * random.standard_normal(), std)

        made.append(Checked(
            f"p{number:03d}", begun_s, current_A,
            Agreement(seen(gain, 0.002 * weak), seen(offset_N, 0.5 * weak), seen(lag_s, 1e-4 * weak), 2.25e-4),
            Agreement(
                seen(lvdt_gain, 2e-4 * weak), seen(lvdt_zero_m, 2e-6 * weak), seen(lvdt_lag_s, 5e-5 * weak), 4.5e-4,
            ),
        ))
    return made


def slugs(found: dict[str, tuple[Reason, ...]]) -> set[str]:
    return {reason.slug for reasons in found.values() for reason in reasons}


@pytest.mark.parametrize(("wrong", "slug", "number"), [
    ({"gain": 1.05}, "load-cell-gain", 0.05),
    ({"gain": 0.96}, "load-cell-gain", -0.04),
    ({"lvdt_gain": 1.03}, "lvdt-gain", 0.03),
    ({"zero_N": 150.0}, "load-cell-zero", 150.0),
    ({"lvdt_zero_m": 2e-3}, "lvdt-zero", 2e-3),
    ({"lag_s": -2e-3}, "force-input-lag", -2e-3),
    ({"lvdt_lag_s": -2e-3}, "position-input-lag", -2e-3),
    ({"drift_N_s": 2.0}, "zero-drift", 2.0),
    ({"crosstalk_N_A": 30.0}, "crosstalk", 30.0),
])
def test_each_error_is_named_at_every_point_with_its_number_both_instruments_and_the_bench(
    wrong: dict[str, float], slug: str, number: float
) -> None:
    for seed in range(20):
        for reasons in judge(campaign(seed, **wrong)).values():
            found = [reason for reason in reasons if reason.slug == slug]
            assert len(found) == 1
            assert found[0].blamed == "bench"
            shown = 1.0 + number if slug.endswith("gain") else number
            assert any(value == pytest.approx(shown, rel=0.1 if slug in CHANGES else 0.03)
                       for value in found[0].numbers.values())
            assert "+-" in found[0].text
            assert ("LVDT" if "lvdt" in slug or "position" in slug else "load cell") in found[0].text
            assert "controller's" in found[0].text
            assert found[0].slug in SLUGS


def test_a_clean_campaign_is_not_doubted_whatever_its_size_and_strength() -> None:
    alarms = []
    for seed in range(600):
        points, weak = 1 + seed % 25, (1.0, 4.0, 30.0)[seed % 3]
        kept = judge(campaign(seed, points, weak=weak, order=("random", "as written")[seed % 2]))
        alarms += [(seed, reason) for reasons in kept.values() for reason in reasons]
    assert alarms == []


def test_what_no_single_point_proves_is_proved_by_all_together_and_reported_of_each() -> None:
    points = campaign(3, 20, gain=1.05, weak=10.0)
    alone = [slugs(judge([point])) for point in points]
    assert sum("load-cell-gain" in reported for reported in alone) <= 4
    found = judge(points)
    assert all({reason.slug for reason in reasons} == {"load-cell-gain"} for reasons in found.values())
    assert all("20 points combined" in reason.text for reasons in found.values() for reason in reasons)


def test_one_point_whose_zero_jumped_is_doubted_alone() -> None:
    points = campaign(4)
    jumped = replace(points[5].force, offset=Estimate(90.0, 0.5))
    points[5] = replace(points[5], force=jumped)
    found = judge(points)
    doubted = {name for name, reasons in found.items() if "load-cell-zero" in {reason.slug for reason in reasons}}
    assert doubted == {"p005"}


def test_zeros_of_loops_with_few_polls_are_not_as_certain_as_they_say() -> None:
    """Estimates of a clean campaign at 10 Hz on Modbus RTU, three polls in a cycle: the true offset is 0."""
    allowed = Tolerances(force_zero_N=18.4)
    first, second = (
        replace(point, force=Agreement(offset=offset), tolerances=allowed)
        for point, offset in zip(campaign(13, 2), (Estimate(77.1, 19.8), Estimate(108.4, 35.9)), strict=True)
    )
    assert not slugs(judge([first, second])) - CHANGES
    many = [replace(point, force=Agreement(offset=Estimate(150.0, 20.0))) for point in campaign(14)]
    assert "load-cell-zero" in slugs(judge(many))


def test_a_comparison_that_failed_at_one_point_says_nothing_of_the_instruments() -> None:
    points = campaign(12)
    wrong = Agreement(Estimate(0.98, 0.004), Estimate(-161.0, 3.0), Estimate(0.0108, 0.0004), 2.25e-4)
    points[2] = replace(points[2], force=wrong)
    assert slugs(judge(points)) == set()
    assert slugs(judge([*points[:2], points[2]])) == set()


def test_a_loop_too_weak_to_show_its_lag_does_not_disprove_an_input() -> None:
    points = campaign(14, 3)
    weak = [replace(point, force=replace(point.force, lag=Estimate(lag_s, std_s))) for point, lag_s, std_s in zip(
        points, (-17.1e-3, -20.8e-3, 6.5e-3), (1.2e-3, 22e-3, 3.6e-3), strict=True,
    )]
    assert slugs(judge(weak)) == set()
    assert slugs(judge(weak[:1])) == set()


def test_a_gain_that_one_weak_loop_shows_is_not_certain() -> None:
    """-3.8 +- 0.8 % of a true 0, from 33 polls of a coarse input; -8 % is certain."""
    for gain, reported in ((0.9618, set()), (0.92, {"load-cell-gain"})):
        assert slugs(judge([Checked("p001", 0.0, 0.0, Agreement(Estimate(gain, 0.008)))])) == reported


def test_gain_and_lag_of_one_point_alone_are_evaluated_until_there_are_others() -> None:
    points = campaign(13, 6)
    odd = replace(points[1], force=Agreement(Estimate(1.1, 0.002), None, Estimate(-2e-3, 1e-4), 2.25e-4))
    assert slugs(judge([odd])) == {"load-cell-gain", "force-input-lag"}
    assert slugs(judge([*points[:1], odd, *points[2:]])) == set()


def test_a_point_that_could_not_be_compared_shares_the_campaigns_doubt() -> None:
    points = [*campaign(5, 8, gain=1.05), Checked("step", 100.0, 1.0)]
    assert [reason.slug for reason in judge(points)["step"]] == ["load-cell-gain"]


def test_drift_and_crosstalk_that_the_order_cannot_distinguish_are_both_named() -> None:
    for wrong in ({"drift_N_s": 2.0}, {"crosstalk_N_A": 30.0}):
        found = judge(campaign(6, 2, currents_A=(0.5, 1.5), order="as written", **wrong))
        assert slugs(found) <= {"zero-change", "load-cell-zero"}
        text = next(reason.text for reason in found["p000"] if reason.slug == "zero-change")
        assert "drift" in text
        assert "crosstalk" in text


def test_drift_at_one_current_can_only_be_drift() -> None:
    assert slugs(judge(campaign(7, 6, currents_A=(0.0,), drift_N_s=2.0))) == {"zero-drift", "load-cell-zero"}


def test_a_sensor_that_is_later_than_the_input_is_corrected_and_not_doubted() -> None:
    assert slugs(judge(campaign(8, lag_s=2e-3, lvdt_lag_s=3e-3))) == set()


def test_a_gross_error_makes_points_invalid_and_a_small_one_suspect() -> None:
    gross, small = judge(campaign(9, gain=1.2)), judge(campaign(9, gain=1.05))
    assert {reason.kind.word for reasons in gross.values() for reason in reasons} == {"invalid"}
    assert {reason.kind.word for reasons in small.values() for reason in reasons} == {"suspect"}


def test_the_bench_file_says_what_is_allowed() -> None:
    points = [replace(point, tolerances=Tolerances(force_gain=0.06)) for point in campaign(10, gain=1.05)]
    assert slugs(judge(points)) == set()


def test_tolerances_survive_the_file() -> None:
    found = Tolerances(force_gain=0.03, force_zero_N=11.0, time_s=1e-3)
    assert Tolerances.read(found.attributes) == found
    assert Tolerances.read({}) == Tolerances()


def test_the_ecus_standing_offset_and_a_coil_colder_than_the_ecu_are_named() -> None:
    points = [replace(point, current_zero=Estimate(0.1, 0.001), colder_K=12.0) for point in campaign(11)]
    found = judge(points)
    assert slugs(found) == {"current-zero", "coil-temperature"}
    assert "+100" in found["p000"][0].text
    warm = [replace(point, current_zero=Estimate(0.002, 0.001), colder_K=-20.0) for point in points]
    assert slugs(judge(warm)) == set()
