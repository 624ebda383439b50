"""A station that is kept from running for short times beside a rig that is well: flagged, and the campaign goes on."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import h5py
import numpy as np
import pytest
from matrices import BRISK_POINTS

from protocols.quality import Quality

if TYPE_CHECKING:
    from conftest import BeginScenario

HELD_S = 0.025
DEVICES = ("loadcell", "lvdt", "ecu", "can", "modbus", "actuator", "auxiliary", "serial", "usb", "controller")


@pytest.mark.nightly
def test_short_times_in_which_the_station_does_not_run_are_recorded_and_the_campaign_goes_on(
    begin_scenario: BeginScenario,
) -> None:
    campaign = begin_scenario(matrix=BRISK_POINTS, speed=1.0)
    chance, held_s = random.Random(7), []
    campaign.wait_for("START", count=2)
    for _ in range(8):
        campaign.run_on(chance.uniform(0.1, 0.2))
        campaign.hold("rig.station", HELD_S)
        held_s.append(HELD_S)
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.output
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
