"""Current against its set-point, and what the driver's counters say of the bus."""

import pytest

from drivers.current_source import SourceCounters, SourceStatus
from rig.station.interlocks.current_interlock import BusInterlock, CurrentInterlock

SETTLED = 15
"""Status frames of 10 ms: 0.15 s."""

MS = 1_000_000


def status(current_A: float) -> SourceStatus:
    return SourceStatus(2, current_A, 0)


def found(interlock: CurrentInterlock, current_A: float, commanded_A: float, count: int, begin: int = 0) -> list[str]:
    return [
        f"{finding.slug}@{n}"
        for n in range(begin, begin + count)
        for finding in interlock.check(status(current_A), commanded_A, 10 * n * MS)
    ]


def test_a_current_off_its_setpoint_is_reported_once_the_coil_has_had_its_time() -> None:
    interlock = CurrentInterlock(30 * MS)
    assert found(interlock, 0.7, 1.0, 100) == [f"current-tracking@{SETTLED + 2}"]


def test_a_new_setpoint_begins_the_time_anew() -> None:
    interlock = CurrentInterlock(30 * MS)
    assert found(interlock, 0.0, 0.0, 30) == []
    assert found(interlock, 0.0, 1.0, SETTLED, 30) == []
    assert found(interlock, 1.0, 1.0, 50, 60) == []


def test_statuses_that_come_in_a_burst_do_not_use_up_the_commands_way_to_the_ecu() -> None:
    interlock = CurrentInterlock(250 * MS)
    assert [interlock.check(status(0.0), 1.0, n * MS) for n in range(100)] == [[]] * 100


@pytest.mark.parametrize(("current_A", "tells"), [(1.099, False), (0.901, False), (1.101, True), (0.899, True)])
def test_the_tolerance_is_50_mA_and_5_percent(current_A: float, tells: bool) -> None:
    assert bool(found(CurrentInterlock(0), current_A, 1.0, 40)) is tells


def test_a_current_that_stays_after_zero_is_stuck() -> None:
    interlock = CurrentInterlock(30 * MS)
    found(interlock, 1.0, 1.0, 30)
    assert found(interlock, 1.0, 0.0, 30, 30) == [f"current-stuck@{30 + SETTLED + 2}"]


def test_a_setpoint_that_came_and_went_between_two_statuses_begins_the_time_anew() -> None:
    interlock = CurrentInterlock(30 * MS)
    assert found(interlock, 0.0, 0.0, 30) == []
    falling = [interlock.check(status(0.3 * 0.6**n), 0.0, 10 * (30 + n) * MS, 2) for n in range(30)]
    assert falling == [[]] * 30


def slugs(interlock: BusInterlock, counted: SourceCounters, t_ns: int = 0) -> list[tuple[str, bool]]:
    return [(finding.slug, finding.warns) for finding in interlock.check(counted, t_ns)]


@pytest.mark.parametrize(
    ("bad", "malformed", "expected"),
    [(2, 2, []), (3, 3, [("can-malformed", False)]), (3, 1, [("ecu-crc", False)]), (3, 0, [("ecu-crc", False)])],
)
def test_the_third_bad_frame_in_a_row_is_named_by_what_is_wrong(
    bad: int, malformed: int, expected: list[tuple[str, bool]]
) -> None:
    assert slugs(BusInterlock(500_000), SourceCounters(bad_in_a_row=bad, malformed_in_a_row=malformed)) == expected


@pytest.mark.parametrize(("malformed", "slug"), [(1, "can-malformed"), (0, "ecu-crc")])
def test_the_first_bad_frame_is_flagged_once(malformed: int, slug: str) -> None:
    interlock = BusInterlock(500_000)
    counted = SourceCounters(
        bad_checks=1 - malformed, malformed=malformed, bad_in_a_row=1, malformed_in_a_row=malformed
    )
    assert [slugs(interlock, counted), slugs(interlock, counted)] == [[(slug, True)], []]


def test_answers_without_a_measured_number_are_no_crc_errors() -> None:
    counted = SourceCounters(bad_checks=3, bad_in_a_row=3, unmeasured_in_a_row=3)
    assert slugs(BusInterlock(500_000), counted) == [("current-unmeasured", False)]


def test_counters_that_leave_frames_out_three_times_in_a_row_are_wrong() -> None:
    assert slugs(
        BusInterlock(500_000), SourceCounters(gaps_in_a_row=3, lost=3)
    ) == [("ecu-crc", False), ("ecu-late", True)]


def test_one_repeated_frame_warns_and_repetition_stops() -> None:
    interlock = BusInterlock(500_000)
    assert slugs(interlock, SourceCounters(duplicates=1, lateness=2)) == [("ecu-late", True)]
    assert slugs(interlock, SourceCounters(duplicates=1, lateness=1)) == []
    assert slugs(interlock, SourceCounters(duplicates=3, lateness=4)) == [("ecu-late", False)]


def test_only_a_bus_that_others_fill_is_babble() -> None:
    interlock = BusInterlock(500_000)
    interlock.check(SourceCounters(), 0)
    assert slugs(interlock, SourceCounters(other_bits=17_400), 50 * MS) == []
    assert slugs(interlock, SourceCounters(other_bits=60_000), 60 * MS) == [], "a window is not over"
    assert slugs(interlock, SourceCounters(other_bits=17_400 + 17_600), 100 * MS) == [("can-babble", False)]


def test_other_senders_count_from_arming_on() -> None:
    interlock = BusInterlock(500_000)
    interlock.forget_others(SourceCounters(foreign_commands=5))
    assert slugs(interlock, SourceCounters(foreign_commands=5)) == []
    assert slugs(interlock, SourceCounters(foreign_commands=6)) == [("can-foreign", False)]
