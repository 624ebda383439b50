"""Rows of the controller's link: what the host does when Modbus TCP answers late, wrongly or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from end_states import assert_stopped

if TYPE_CHECKING:
    from conftest import Ending, Run

BRISK = {"speed": 1.0, "period_s": 0.25}


def assert_warned_only(ending: Ending, slug: str) -> None:
    """The campaign is not disturbed; the flag is in its journal."""
    assert ending.exit_code == 0, ending.said
    assert ending.answer["stopped_by"] is None
    assert slug in ending.warned()
    assert not ending.trips()
    assert set(ending.verdicts().values()) == {"valid"}


def test_a_controller_that_stays_busy_is_stopped_by_its_own_watchdog_and_by_the_current(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("modbus-busy@3.2"), "modbus-busy", first="TRIP", **BRISK)


def test_passing_troubles_of_the_link_are_overcome_and_flagged(run_brisk: Run) -> None:
    ending = run_brisk("modbus-busy@1+0.02", "modbus-wrong-tid@3.2")
    assert_warned_only(ending, "modbus-busy")
    assert_warned_only(ending, "modbus-wrong-tid")
    assert len(ending.truth.all("FAULT")) == 2


def test_a_controller_that_refuses_writes_is_read_on_and_stopped_by_its_own_watchdog(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("modbus-reject@3.2"), "modbus-reject", first="TRIP", **BRISK)


def test_a_reset_connection_stops_the_rig_over_a_new_one(run_brisk: Run) -> None:
    ending = run_brisk("modbus-reset@3.2")
    assert_stopped(ending, "modbus-reset", **BRISK)
    assert len(ending.truth.all("START")) == 2, "no command was executed twice"


def test_a_half_open_connection_is_given_up_and_the_rig_stopped_over_a_new_one(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("modbus-halfopen@3.2"), "modbus-halfopen", **BRISK)


def test_answers_to_another_function_stop_the_rig(run_brisk: Run) -> None:
    assert_stopped(run_brisk("modbus-mismatch@3.2"), "modbus-mismatch", **BRISK)


def test_lost_writes_are_seen_by_their_missing_effect(run_brisk: Run) -> None:
    assert_stopped(run_brisk("modbus-write-lost@3.2"), "modbus-write-lost", first="TRIP", **BRISK)


def test_stale_answers_on_a_serial_line_are_never_believed_and_spoil_the_point(run_brisk: Run) -> None:
    ending = run_brisk("rtu-stale@3.2+0.5")
    assert ending.exit_code == 5, ending.said
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}
    assert ending.point("p002").reasons[0].startswith("rtu-stale")
    assert not ending.trips()
    assert "rtu-stale" in ending.warned()


def test_damaged_answers_on_a_serial_line_are_read_again_and_then_stop_the_rig(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("rtu-crc@3.2"), "rtu-crc", **BRISK)
