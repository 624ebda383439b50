"""What the command of an emulated map is about, in terms of the simulated controller, whatever names were written."""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.register_maps.controller_map import ControllerMap
from drivers.roles import Command, Waveform
from simulators.actuator import Actuator

USUAL_SPEED_M_S = 0.05
"""Of moves, where the map has no speed for them."""
SOFT_CYCLES = 1.0
"""A device that is not told of ramps starts and ends a program softly within its cycles."""
FEWEST_SOFT = 4.0

Values = dict[str, float | int | str]


def order_of(command: Command, given: Mapping[str, float], actuator: Actuator, emulated: ControllerMap) -> Values:
    """The further entries of a command.

    Args:
        command: which.
        given: what its recipe wrote, by the recipe's names (SI).
        actuator: whose.
        emulated: its map.
    """
    if command is Command.MOVE_TO:
        usual_m_s = min(USUAL_SPEED_M_S, actuator.limits.speed_max_m_s)
        return {"target_position": given["target"], "speed": given.get("speed", usual_m_s)}
    if command is not Command.START:
        return {}
    low_m, high_m = given.get("low", 0.0), given.get("high", 0.0)
    amplitude_m = given.get("amplitude", 0.5 * given.get("peak_to_peak", high_m - low_m))
    middle_m = 0.5 * (low_m + high_m) if "low" in given else actuator.seen_m
    frequency_Hz = _frequency_Hz(given, amplitude_m)
    waveform = int(Waveform.SINE if emulated.capabilities.sine else Waveform.TRIANGLE)
    if "waveform" in given:
        waveform = emulated.words.waveforms.meaning(whole(given["waveform"]))
    length, passes_Hz = whole(given.get("table_length", 0.0)), abs(frequency_Hz)
    return {
        "waveform": waveform, "amplitude": amplitude_m, "frequency": frequency_Hz,
        "centre": given.get("centre", middle_m), **_cycles(given, frequency_Hz), "table_length": length,
        "table_interval": given.get("table_interval", 1.0 / (passes_Hz * length) if passes_Hz and length else 0.0),
    }


def _frequency_Hz(given: Mapping[str, float], amplitude_m: float) -> float:
    if "frequency" in given:
        return given["frequency"]
    if "period" in given:
        return 1.0 / max(given["period"], 1e-6)
    return given["mean_speed"] / max(4.0 * amplitude_m, 1e-9)


def whole(value: float) -> int:
    """A whole number that a host has written into a register, which may be a float; -1 for what is none."""
    return int(value) if math.isfinite(value) else -1


def _cycles(given: Mapping[str, float], frequency_Hz: float) -> Values:
    """Cycles at full amplitude, and the ramps beside them."""
    if "cycles" in given and "ramp_in_cycles" in given:
        ramps = (given["ramp_in_cycles"], given.get("ramp_out_cycles", given["ramp_in_cycles"]))
        return {"cycles": given["cycles"], "ramp_in_cycles": ramps[0], "ramp_out_cycles": ramps[1]}
    every = given.get("all_cycles", given.get("cycles", given.get("duration", 0.0) * frequency_Hz))
    soft = SOFT_CYCLES if every >= FEWEST_SOFT else 0.0
    return {"cycles": every - 2.0 * soft, "ramp_in_cycles": soft, "ramp_out_cycles": soft}
