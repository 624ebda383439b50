from __future__ import annotations

from dataclasses import replace

import pytest

from rig.recording.quality.verdict import Verdict, blamed
from rig.recording.quality.verdict_rules import PointEvidence, SensorCounts, evaluate, with_skew

GOOD = PointEvidence(
    sensors={"force": SensorCounts(2500), "displacement": SensorCounts(2500)}, requested_cycles=10,
    requested_amplitude_m=0.05, requested_frequency_Hz=1.0, current_tolerance_A=0.02, measured_cycles=10,
    measured_amplitude_m=0.0499, measured_frequency_Hz=1.001, current_error_A=0.002,
)


def with_force(samples_a_cycle: float = float("inf"), **counts: float) -> PointEvidence:
    force = replace(SensorCounts(2500), **counts)
    return replace(GOOD, sensors={"force": force, "displacement": SensorCounts(2500)}, samples_a_cycle=samples_a_cycle)


def test_a_point_with_nothing_found_is_valid() -> None:
    assert evaluate(GOOD).verdict == "valid"
    assert evaluate(GOOD).reasons == ()


@pytest.mark.parametrize(("findings", "verdict", "slug"), [
    (with_force(lost=2), "valid", ""),
    (with_force(lost=3), "invalid", "sample-gap"),
    (with_force(not_a_number=3), "invalid", "sensor-nan"),
    (with_force(saturated=2), "valid", ""),
    (with_force(saturated=3), "invalid", "sensor-saturated"),
    (with_force(faulty=1), "invalid", "sensor-fault"),
    (with_force(spikes=1), "suspect", "sensor-spike"),
    (replace(GOOD, sensors={"force": SensorCounts(0)}), "invalid", "no-samples"),
    (replace(GOOD, stopped_by="estop"), "invalid", "estop"),
    (replace(GOOD, tripped=True), "invalid", "trip"),
    (replace(GOOD, interrupted=True), "invalid", "INTERRUPTED"),
    (replace(GOOD, overrun_records=1), "invalid", "slow-consumer"),
    (replace(GOOD, damaged_bytes=1), "invalid", "journal-damaged"),
    (replace(GOOD, measured_cycles=9), "valid", ""),
    (replace(GOOD, measured_cycles=8), "invalid", "too-few-cycles"),
    (replace(GOOD, measured_cycles=None), "invalid", "too-few-cycles"),
    (replace(GOOD, measured_amplitude_m=0.0470), "suspect", "amplitude"),
    (replace(GOOD, measured_amplitude_m=0.0440), "invalid", "amplitude"),
    (replace(GOOD, measured_amplitude_m=0.0560), "invalid", "amplitude"),
    (replace(GOOD, measured_frequency_Hz=1.05), "suspect", "frequency"),
    (replace(GOOD, current_error_A=0.021), "invalid", "current-tracking"),
    (replace(GOOD, current_error_A=None), "suspect", "no-current"),
    (replace(GOOD, skew_std_s=0.004), "suspect", "skew"),
    (with_force(flat=6), "invalid", "sensor-saturated"),
    (replace(with_force(standing=40, flat=2), samples_a_cycle=250.0), "invalid", "sensor-stuck"),
    (replace(GOOD, temperature_degC=(25.0, 29.0)), "valid", ""),
    (replace(GOOD, temperature_degC=(25.0, 32.0)), "suspect", "temperature-drift"),
    (replace(GOOD, temperature_degC=(25.0, 36.0)), "invalid", "temperature-drift"),
    (replace(GOOD, temperature_degC=(46.0, 47.0), temperature_window_degC=(25.0, 45.0)), "invalid",
     "temperature-window"),
    (replace(GOOD, temperature_window_degC=(25.0, 45.0)), "suspect", "no-temperature"),
    (replace(GOOD, temperature_degC=(30.0, 31.0), temperature_share=0.85, temperature_window_degC=(25.0, 45.0)),
     "suspect", "no-temperature"),
    (replace(GOOD, temperature_degC=(30.0, 31.0), temperature_share=0.95, temperature_window_degC=(25.0, 45.0)),
     "valid", ""),
    (replace(GOOD, temperature_degC=None, temperature_share=0.0), "valid", ""),
    (replace(GOOD, free_play_m=1e-3), "invalid", "free-play"),
    (replace(GOOD, span_N=1000.0, scatter_N=30.0, change_N=0.0), "suspect", "force-scatter"),
    (replace(GOOD, span_N=1000.0, scatter_N=60.0, change_N=0.0), "invalid", "force-scatter"),
    (replace(GOOD, span_N=1000.0, scatter_N=60.0, change_N=0.0, amplitude_std_m=1e-3), "invalid", "amplitude-scatter"),
    (replace(GOOD, span_N=1000.0, scatter_N=0.0, change_N=-100.0), "invalid", "force-change"),
    (replace(GOOD, span_N=1000.0, scatter_N=0.0, change_N=-100.0, change_std_N=30.0), "valid", ""),
    (replace(GOOD, skew_std_s=0.002), "valid", ""),
    (with_force(standing=60, coarse=True, step=20.0, span=600.0, samples_a_cycle=250.0), "valid", ""),
    (with_force(standing=200, coarse=True, step=20.0, span=600.0, samples_a_cycle=250.0), "invalid", "sensor-stuck"),
    (with_force(standing=60, coarse=True, step=20.0, span=300.0, samples_a_cycle=250.0), "suspect",
     "sensor-resolution"),
    (with_force(rate_Hz=24.0), "suspect", "bandwidth"),
    (with_force(rate_Hz=26.0), "valid", ""),
    (with_force(rate_Hz=250.0, bandwidth_Hz=9.0), "suspect", "bandwidth"),
    (with_force(rate_Hz=250.0, bandwidth_Hz=11.0), "valid", ""),
])
def test_each_finding_has_its_verdict_and_its_slug(findings: PointEvidence, verdict: str, slug: str) -> None:
    found = evaluate(findings)
    assert found.verdict == verdict
    assert [reason.split(":")[0] for reason in found.reasons] == ([slug] if slug else [])


def test_invalid_reasons_come_before_suspect_ones_and_all_are_kept() -> None:
    found = evaluate(replace(GOOD, stopped_by="estop", current_error_A=None, measured_amplitude_m=0.04))
    assert found.verdict == "invalid"
    assert [reason.split(":")[0] for reason in found.reasons] == ["estop", "amplitude", "no-current"]


@pytest.mark.parametrize(("reason", "who"), [
    ("free-play: a joint slips", "bench"), ("sample-gap: 4 lost", "bench"), ("force-scatter: 6 %", "specimen"),
    ("temperature-drift: 12 K", "test"), ("too-few-cycles: none", "test"), ("anything-else: said", "bench"),
])
def test_every_reason_says_who_is_to_blame(reason: str, who: str) -> None:
    assert blamed(reason) == who


@pytest.mark.parametrize(("findings", "std_s", "verdict", "slugs"), [
    (replace(GOOD, skew_std_s=0.004), 0.002, "valid", []),
    (replace(GOOD, skew_std_s=0.004, current_error_A=None), 0.002, "suspect", ["no-current"]),
    (replace(GOOD, skew_std_s=0.004, stopped_by="estop"), 0.002, "invalid", ["estop"]),
    (replace(GOOD, skew_std_s=0.002), 0.004, "suspect", ["skew"]),
    (replace(GOOD, skew_std_s=0.004), 0.005, "suspect", ["skew"]),
])
def test_skew_known_better_or_worse_changes_what_was_evaluated_by_it_and_nothing_else(
    findings: PointEvidence, std_s: float, verdict: str, slugs: list[str]
) -> None:
    found = with_skew(evaluate(findings), std_s, findings.requested_frequency_Hz)
    assert found.verdict == verdict
    assert [reason.split(":")[0] for reason in found.reasons] == slugs


def test_the_fewest_cycles_that_are_stated_are_those_that_are_accepted() -> None:
    three = replace(GOOD, requested_cycles=3)
    assert evaluate(replace(three, measured_cycles=1)).reasons == (
        "too-few-cycles: 1 full cycle measured, expected at least 2",
    )
    assert "too-few-cycles" not in str(evaluate(replace(three, measured_cycles=2)).reasons)


def test_a_verdict_survives_the_file_and_can_be_evaluated_on() -> None:
    verdict = evaluate(replace(GOOD, stopped_by="estop", skew_std_s=0.004, current_error_A=None))
    stored = Verdict.stored(verdict.attributes)
    assert stored == verdict
    left = stored.replaced({"estop"}, ())
    assert (left.verdict, [reason.slug for reason in left.entries]) == ("suspect", ["no-current", "skew"])


def test_a_file_without_kinds_keeps_the_verdict_it_has() -> None:
    stored = Verdict.stored({"verdict": "invalid", "reasons": ("estop: held", "skew: 4 ms")})
    assert stored.verdict == "invalid"
    assert stored.reasons == ("estop: held", "skew: 4 ms")
    assert Verdict.stored({"verdict": "suspect"}).verdict == "suspect"
    assert Verdict.stored({"verdict": "suspect", "reasons": ("a: b",), "reason_kinds": ("worse",)}).verdict == "suspect"


def test_the_words_of_a_reason_decide_nothing() -> None:
    """A file whose messages were all rewritten means the same."""
    verdict = evaluate(PointEvidence(
        sensors={"force": SensorCounts(1000, lost=100, spikes=2)}, requested_cycles=10.0, requested_amplitude_m=0.02,
        requested_frequency_Hz=1.0, current_tolerance_A=0.02, measured_cycles=10.0, measured_amplitude_m=0.015,
        current_error_A=0.5, tripped=True,
    ))
    lines = tuple(f"{reason.slug}: {reason.slug[::-1]}" for reason in verdict.entries)
    read = Verdict.stored({**verdict.attributes, "reasons": lines})
    assert [(reason.slug, reason.kind) for reason in read.entries] == [
        (reason.slug, reason.kind) for reason in verdict.entries
    ]
    assert (read.verdict, read.blamed) == (verdict.verdict, verdict.blamed)
