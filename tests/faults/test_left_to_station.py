"""A station that is stopped (SIGSTOP) and goes on after its campaign has given it up: its last words are heard."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from row_scenarios import ONCE

if TYPE_CHECKING:
    from conftest import BeginScenario

LATE_S = 35.0
"""The campaign waits for about 30 s, and for as long again for the station's end."""


@pytest.mark.nightly
@pytest.mark.apart
def test_a_station_that_goes_on_late_proves_its_stop_before_the_campaign_is_called_safe(
    begin_scenario: BeginScenario,
) -> None:
    """It was called safe by the station's exit code, and "coil current not confirmed" in the same sentence."""
    campaign = begin_scenario(ONCE)
    campaign.move()
    campaign.hold("rig.station", LATE_S)
    ending = campaign.finish()
    assert (ending.exit_code, ending.answer["rig_state"]) == (4, "safe"), ending.output
    stop = ending.answer["stop"]
    assert (stop["proved"], stop["current_zero"], stop["pressure_off"]) == (True, True, True)
    lines = [line for line in ending.log if line["event"] == "station"]
    assert next(line for line in reversed(lines) if line.get("what") in {"trip", "safe"})["what"] == "safe"
    (trip,) = [line["detail"] for line in lines if line.get("what") == "trip"]
    assert "too busy" not in trip
