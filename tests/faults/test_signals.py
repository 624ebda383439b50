"""Rows of signals: an application, a station or a rig that is interrupted, killed or stands still."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_stopped
from matrices import LONG_SECOND_POINT
from watched_campaign import assert_completed

from drivers.roles import State
from rig.recording.conversion.recovery import recover

if TYPE_CHECKING:
    from conftest import InMotion
    from watched_campaign import Ending


FADE_S = 0.5 + 0.2


def quiet_after(ending: Ending, stop_s: float, zero_s: float) -> None:
    """0 A within the coil's lag of its command and standstill within the fade-out of its command, and for good."""
    truth = ending.truth
    assert np.abs(truth.current_A[truth.since(zero_s + 0.25)]).max() < 0.05
    assert np.abs(truth.velocity_m_s[truth.since(stop_s + FADE_S)]).max() < 2e-3


@pytest.mark.nightly
def test_the_end_of_the_session_also_takes_the_pressure_away(moving: InMotion) -> None:
    assert_stopped(moving().end_by(signal.SIGHUP), "sigterm")


@pytest.mark.nightly
@pytest.mark.wire
def test_a_killed_application_leaves_a_rig_at_rest_and_a_campaign_that_resumes(
    in_motion: InMotion,
) -> None:
    ending = in_motion().end_by(signal.SIGKILL)
    assert ending.exit_code == -signal.SIGKILL
    truth = ending.truth
    stop = truth.first("FADE_STOP")
    assert (stop.host_ns - ending.stopped_from_ns) / 1e9 < 1.5, "the link's end itself, not the beat's time-out of 2 s"
    quiet_after(ending, stop.time_s, stop.time_s)
    assert truth.state[-1] == State.OFF
    recover(ending.folder)
    assert ending.point("p001").verdict == "valid"
    broken = ending.point("p002")
    assert (broken.verdict, broken.quality.recovered) == ("invalid", True)
    assert broken.reasons[0].startswith("INTERRUPTED")
    assert np.ptp(broken.displacement_m) > 0.035, "what was flushed before the kill is there"
    assert_completed(ending.folder)


@pytest.mark.few(1)
@pytest.mark.parametrize("where", ["moving", pytest.param("in_motion", marks=pytest.mark.wire)])
def test_a_killed_station_leaves_controller_and_ecu_to_stop_by_themselves(
    request: pytest.FixtureRequest, where: str
) -> None:
    campaign = request.getfixturevalue(where)()
    killed_ns = campaign.now_ns
    campaign.send(signal.SIGKILL, "rig.station")
    ending = campaign.finish(killed_ns)
    assert ending.exit_code == 7
    trip = next(each for each in ending.truth.all("TRIP", text="WATCHDOG") if each.host_ns > killed_ns)
    silent = ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")
    assert (trip.host_ns - killed_ns) / 1e9 < 5.0
    quiet_after(ending, trip.time_s, silent.time_s)
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")
    campaign.assert_completed()


@pytest.mark.nightly
@pytest.mark.wire
def test_a_killed_simulated_rig_is_a_rig_of_unknown_state_with_its_files_intact(
    in_motion: InMotion,
) -> None:
    campaign = in_motion()
    os.kill(campaign.child("simulators"), signal.SIGKILL)
    ending = campaign.finish()
    assert ending.exit_code == 7
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")
    assert_completed(ending.folder)
    assert (ending.folder / "truth-session1.h5.part").exists()


def test_a_station_that_stalls_leaves_controller_and_ecu_to_stop_by_themselves(
    moving: InMotion,
) -> None:
    campaign = moving(seconds=1.0, matrix=LONG_SECOND_POINT)
    stalled_ns = campaign.now_ns
    campaign.send(signal.SIGSTOP, "rig.station")
    campaign.wait_for("TRIP", "WATCHDOG", count=2)
    campaign.wait_for("ECU_FAULT", "COMMAND_TIMEOUT")
    campaign.send(signal.SIGCONT, "rig.station")
    ending = campaign.finish(stalled_ns)
    assert ending.exit_code in {4, 7}
    trip = next(each for each in ending.truth.all("TRIP", text="WATCHDOG") if each.host_ns > stalled_ns)
    silent = ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")
    quiet_after(ending, trip.time_s, silent.time_s)
    assert not ending.truth.all("START", "MOVE_TO", after=trip)
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")
