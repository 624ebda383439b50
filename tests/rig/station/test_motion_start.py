"""What a start request is refused for before anything is sent."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace

import pytest
from station_bench import config_for

from drivers.roles import Program, Waveform
from rig.station.errors import StationRefused
from rig.station.motion_start import refuse_without_travel


@pytest.mark.parametrize("waveform", [Waveform.SINE, Waveform.TRIANGLE, Waveform.TABLE])
def test_the_station_refuses_at_the_start_what_the_plan_refuses(waveform: Waveform) -> None:
    table_m = [0.062 * math.sin(math.tau * k / 240) for k in range(240)] if waveform is Waveform.TABLE else []
    program = Program(waveform, 0.062, 2.0, 0.0, 3, 1.0, 1.0, len(table_m))
    config = config_for()
    for halt, refused in ((4.0, True), (20.0, False)):
        slower = replace(config, actuator=replace(config.actuator, halt_deceleration_m_s2=halt))
        with pytest.raises(StationRefused, match="including halts") if refused else nullcontext():
            refuse_without_travel(program, table_m, slower)
