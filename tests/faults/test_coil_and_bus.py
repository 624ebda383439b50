"""Rows of the CAN bus, the current ECU and the coil: what a stop owes to each, on the simulated physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_stopped

if TYPE_CHECKING:
    from conftest import Run



def test_bus_off_is_told_from_a_silent_ecu(run: Run) -> None:
    assert_stopped(run("can-busoff@6.3"), "can-busoff")


def test_an_adapter_that_is_gone_is_named_and_the_ecu_goes_to_zero_by_itself(
    run: Run
) -> None:
    ending = run("can-busoff:lost@6.3")
    assert_stopped(ending, "can-busoff", slug_of_station="can-lost")
    assert ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")


def test_a_silent_ecu_stops_the_rig(run: Run) -> None:
    assert_stopped(run("ecu-silent@6.3"), "ecu-silent")


def test_status_frames_that_come_twice_warn_and_stop_when_they_keep_coming(run: Run) -> None:
    ending = run("ecu-late@6.3")
    assert_stopped(ending, "ecu-late")
    assert "ecu-late" in ending.warned()


def test_status_frames_with_a_wrong_crc_stop_the_rig(run: Run) -> None:
    assert_stopped(run("ecu-crc@6.3"), "ecu-crc")


def test_short_remote_and_extended_frames_are_never_decoded(run: Run) -> None:
    assert_stopped(run("can-malformed@6.3"), "can-malformed")


def test_a_babbling_node_stops_the_rig(run: Run) -> None:
    assert_stopped(run("can-babble@6.3"), "can-babble")


def test_another_sender_on_our_command_id_stops_the_rig(run: Run) -> None:
    assert_stopped(run("can-foreign@6.3"), "can-foreign")


@pytest.mark.parametrize("fault", ["ecu-overtemp", "ecu-overtemp:undervoltage"])
def test_a_hot_ecu_and_one_without_supply_stop_the_rig(run: Run, fault: str) -> None:
    assert_stopped(run(f"{fault}@6.3"), "ecu-overtemp")


@pytest.mark.parametrize(("fault", "bit"), [("coil-open-short", "OPEN"), ("coil-open-short:short", "SHORT")])
def test_a_broken_coil_stops_the_rig(run: Run, fault: str, bit: str) -> None:
    ending = run(f"{fault}@6.3")
    assert_stopped(ending, "coil-open-short")
    (trip,) = [line for line in ending.log if line.get("what") == "trip"]
    assert bit in trip["detail"]


def test_an_ecu_that_starts_anew_stops_the_rig(run: Run) -> None:
    assert_stopped(run("ecu-restart@6.3"), "ecu-restart")


def test_a_current_off_its_setpoint_is_flagged_at_once_and_spoils_the_point(run: Run) -> None:
    ending = run("current-tracking@6.3")
    assert ending.exit_code == 5, ending.said
    assert "current-tracking" in ending.warned()
    assert ending.trips() == []
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}
    assert any(reason.startswith("current-tracking") for reason in ending.point("p002").reasons)


def test_more_current_than_the_bench_allows_stops_the_rig(run: Run) -> None:
    ending = run("current-tracking:over@6.3")
    assert_stopped(ending, "current-tracking", stop="S2", slug_of_station="overcurrent")
    assert np.max(ending.truth.current_A) > 3.0, "the fault: it really flowed"


def test_a_current_that_stays_after_zero_takes_the_hydraulics_away(run: Run) -> None:
    ending = run("current-stuck@6.3")
    truth = ending.truth
    assert ending.exit_code == 4, ending.said
    assert ending.trips() == [("current-stuck", "S1")]
    fault = truth.first("FAULT", text="current-stuck")
    zero = truth.first("SET_CURRENT", text="0.000", after=fault)
    stop = truth.first("FADE_STOP", after=zero)
    assert (stop.host_ns - zero.host_ns) / 1e9 < 1.5, "the detector, not the deadline of the phase"
    off = truth.first("HYDRAULICS_OFF", after=stop)
    assert truth.current_A[truth.since(off.time_s)].min() > 1.0, "the fault: current flows on, whatever is commanded"
    assert np.abs(truth.velocity_m_s[truth.since(off.time_s + 0.3)]).max() < 2e-3
    assert truth.state[-1] == 0
    assert ending.verdicts()["p001"] == "valid"
