"""The row of a station that is kept from running beside a rig that is well: flagged while short, named beyond."""

from __future__ import annotations

import os
import random
import signal
import threading
from typing import TYPE_CHECKING

import h5py
import numpy as np
import pytest
from end_states import assert_stopped
from matrices import BRISK_POINTS, PERIOD_S

from protocols.quality import Quality
from rig.bench.model import Bench
from rig.clock import monotonic_ns

if TYPE_CHECKING:
    from conftest import Start
    from watched_campaign import Campaign

DEVICES = ("loadcell", "lvdt", "ecu", "can", "modbus", "actuator", "auxiliary", "serial", "usb", "controller")


def hold(station: int, seconds: float) -> float:
    """Keep the station from running; how long it was (s)."""
    begin_ns = monotonic_ns()
    os.kill(station, signal.SIGSTOP)
    threading.Event().wait(seconds)
    os.kill(station, signal.SIGCONT)
    return (monotonic_ns() - begin_ns) / 1e9


def limit_s(campaign: Campaign) -> float:
    return Bench.load(campaign.folder / "bench.toml").station.late_limit_s


def test_a_station_that_is_held_up_for_too_long_stops_the_rig_and_blames_nobody_else(
    start: Start
) -> None:
    campaign = start(matrix=BRISK_POINTS, speed=1.0)
    campaign.wait_for("START", count=2)
    campaign.run_on(0.6)
    begin_ns = monotonic_ns()
    held_s = hold(campaign.station_pid(), 1.3 * limit_s(campaign))
    ending = campaign.finish(begin_ns)
    assert_stopped(ending, "host-late", speed=1.0, period_s=0.5 * PERIOD_S)
    (late,) = [line for line in ending.log if line.get("what") == "late" and line["late_s"] > line["limit_s"]]
    assert late["late_s"] == pytest.approx(held_s, abs=0.02)


def test_short_times_in_which_the_station_does_not_run_are_recorded_and_the_campaign_goes_on(start: Start) -> None:
    campaign = start(matrix=BRISK_POINTS, speed=1.0)
    chance, held_s = random.Random(7), []
    campaign.wait_for("START", count=2)
    station = campaign.station_pid()
    for _ in range(8):
        campaign.run_on(chance.uniform(0.1, 0.2))
        held_s.append(hold(station, 0.025))
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.said
    assert set(ending.verdicts().values()) == {"valid"}
    blamed = [slug for slug in ending.warned() if slug.startswith(DEVICES)]
    assert not blamed
    late_s = [line["late_s"] for line in ending.log if line.get("what") == "late"]
    assert len(late_s) >= len(held_s)
    assert sum(late_s) >= sum(held_s) - 0.001 * len(held_s)
    with h5py.File(ending.folder / "points" / "p002.h5") as file:
        flags = [file[f"entry/raw/{channel}/flags"][:] for channel in ("force", "displacement")]
        codes = {code.decode() for code in file["entry/events/code"][:]}
    for given in flags:
        assert np.count_nonzero(given & int(Quality.STALE)) >= len(held_s) * 5, "six samples wait in 25 ms"
    assert "host-late" in codes
