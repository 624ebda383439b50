"""The quality flags, as bits that recorded files and the ring already carry."""

from __future__ import annotations

from protocols.quality import Quality


def test_flags_keep_the_bits_of_the_documented_layout() -> None:
    documented = {"OVERLOAD": 1, "SENSOR_FAULT": 2, "GAP_BEFORE": 4, "NOT_A_NUMBER": 8, "SPIKE": 16, "STALE": 32}
    documented["CLOCK_BACK"] = 64
    assert {flag.name: flag.value for flag in Quality} == documented


def test_a_sample_carries_several_troubles_at_once() -> None:
    troubled = Quality.GAP_BEFORE | Quality.OVERLOAD
    assert troubled == 5
    assert Quality.OVERLOAD in troubled
    assert Quality.STALE not in troubled
    assert not Quality.GOOD
