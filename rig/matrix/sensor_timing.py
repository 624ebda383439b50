"""Forecast of how well force and displacement can be aligned in time, and a warning where this is not enough.

The recording ties each sensor's clock to the controller's (`rig.recording.alignment.sensor_clock`): by cycle pulses, by
the controller's input of the same quantity if its delay is stated, else by arrival times, with an unknown latency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.catalogue import clocked_format_names
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.matrix.streaming import some_points
from rig.signals.clock_model import UNKNOWN_LATENCY_S
from rig.signals.delay_estimation.delay_model import weighed_alone_s
from rig.test_point import LARGEST_SKEW_PERIODS, TestPoint
from rig.units import show


def skew_hints(points: Sequence[TestPoint], bench: Bench) -> tuple[str, ...]:
    """A warning if arrival times alone align a sensor, and points are too fast for that; empty otherwise.

    Args:
        points: all points of a plan.
        bench: its controller, the formats of its sensors, and the delays that it states.
    """
    able, stated = bench.actuator.capabilities, bench.actuator.input_delay_s is not None
    sensors = {"load cell": (bench.load_cell, able.force_input), "LVDT": (bench.lvdt, True)}
    late = {
        name: _arrival_std_s(sensor, bench.clock.device_rate) for name, (sensor, has_input) in sensors.items()
        if not (able.cycle_pulse and sensor.format in clocked_format_names()) and not (stated and has_input)
    }
    std_s = math.hypot(*late.values())
    fast = [point for point in points if std_s * point.highest_Hz > LARGEST_SKEW_PERIODS]
    if not fast:
        return ()
    fixes = [f"plan up to {LARGEST_SKEW_PERIODS / std_s:.3g} Hz"]
    if not able.force_input and "load cell" in late:
        fixes.insert(0, "add the controller's force input to the register map")
    if not stated:
        fixes.insert(0, "state [actuator] input_delay")
    return (
        f"{some_points(fast)}: {' and '.join(late)} without cycle pulses and without a controller input of known "
        f"delay: the delay between force and displacement is uncertain by about {show(std_s, 'ms', 3)}, and points "
        f"above {LARGEST_SKEW_PERIODS / std_s:.3g} Hz become suspect (skew). Fix: {_either(fixes)}",
    )


def _arrival_std_s(sensor: SensorConfig, device_rate: float) -> float:
    """Standard deviation (s of device clock) of a sensor's time by its arrivals alone."""
    return math.hypot(UNKNOWN_LATENCY_S * device_rate, weighed_alone_s(sensor.delay_s))


def _either(fixes: Sequence[str]) -> str:
    *first, last = fixes
    return f"{' and '.join(first)}, or {last}" if first else last
