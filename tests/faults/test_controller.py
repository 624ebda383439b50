"""Rows of the actuator controller: what it says, what it forgets, what it refuses to do."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import numpy as np
from end_states import assert_refused, assert_stopped

from rig.clock import monotonic_ns
from simulators.controller_firmware import State

if TYPE_CHECKING:
    from conftest import Run, Start

BRISK = {"speed": 1.0, "period_s": 0.25}


def test_a_frozen_position_register_is_not_trusted_and_the_halt_ramp_is_used(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("actuator-frozen@3.2"), "actuator-frozen", **BRISK)


def test_a_rebooted_controller_is_never_taken_for_the_one_that_was_prepared(
    run_brisk: Run
) -> None:
    assert_stopped(run_brisk("actuator-reboot@3.2"), "actuator-reboot", **BRISK)


def test_a_watchdog_that_does_not_trip_is_refused(run_brisk: Run) -> None:
    assert_refused(run_brisk("watchdog-absent"), "watchdog-absent")


def test_another_word_order_is_refused_at_connect(run_brisk: Run) -> None:
    ending = run_brisk("register-layout")
    assert_refused(ending, "register-layout")
    assert [each.code for each in ending.truth.log] == ["FAULT"], "nothing was written to it"


def test_a_second_master_is_noticed_and_the_motion_stopped(run_brisk: Run) -> None:
    assert_stopped(run_brisk("second-master@3.2"), "second-master", **BRISK)


def test_a_program_that_does_not_end_is_stopped_by_taking_the_pressure_away(run_brisk: Run) -> None:
    ending = run_brisk("stop-ignored@3.2")
    assert ending.exit_code == 4, ending.said
    assert ending.trips() == [("stop-ignored", "S1")]
    truth = ending.truth
    end_s = truth.all("START")[1].time_s + 2.0
    fade, off = truth.first("FADE_STOP"), truth.first("HYDRAULICS_OFF")
    assert end_s + 0.05 <= fade.time_s <= end_s + 1.0
    assert fade.time_s + 0.25 <= off.time_s
    assert np.abs(truth.velocity_m_s[truth.since(off.time_s + 0.3)]).max() < 2e-3
    assert np.abs(truth.current_A[truth.since(fade.time_s + 0.25)]).max() < 0.05
    assert truth.state[-1] == State.OFF
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}


def test_a_joint_that_works_loose_stops_the_rig_within_a_cycle(run_brisk: Run) -> None:
    ending = run_brisk("load-train@3.2")
    assert_stopped(ending, "load-train", **BRISK)
    loose, fade = ending.truth.first("FAULT"), ending.truth.first("FADE_STOP")
    assert fade.time_s - loose.time_s <= 2 * 0.25 + 0.2, "the rest of the cycle it happened in, and one more"


def test_a_station_that_falls_silent_is_stopped_by_the_controllers_watchdog(
    start_brisk: Start
) -> None:
    campaign = start_brisk()
    campaign.wait_for("START", count=2)
    station = campaign.station_pid()
    os.kill(station, signal.SIGSTOP)
    silent_ns = monotonic_ns()
    campaign.wait_for("TRIP", "WATCHDOG", count=2)
    os.kill(station, signal.SIGCONT)
    assert_stopped(campaign.finish(silent_ns), "host-silent", first="TRIP", **BRISK)


def test_an_opened_e_stop_chain_is_mirrored_and_latched(run_brisk: Run) -> None:
    ending = run_brisk("estop@3.2")
    assert_stopped(ending, "estop", settling_s=0.3, **BRISK)
    opened = ending.truth.first("FAULT", text="estop")
    assert np.abs(ending.truth.velocity_m_s[ending.truth.since(opened.time_s + 0.3)]).max() < 2e-3
