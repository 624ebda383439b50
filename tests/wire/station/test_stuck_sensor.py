"""A load cell whose value stands in a motion so slow that the controller hardly shows a speed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.mark.few(1)
@pytest.mark.parametrize(("amplitude_m", "frequency_Hz"), [(0.0005, 0.5), (0.002, 0.2)])
def test_it_is_called_stuck_and_nothing_else(
    station_rig: Callable[..., Any], amplitude_m: float, frequency_Hz: float
) -> None:
    rig = station_rig("--fault", "sensor-stuck@4", speed=5.0)
    rig.prepare()
    rig.run(amplitude_m=amplitude_m, frequency_Hz=frequency_Hz, cycles=200)
    trip = rig.event("trip")
    assert (trip["slug"], trip["stop"]) == ("sensor-stuck", "S2")
    assert "load_cell" in trip["detail"]
    rig.event("safe")
