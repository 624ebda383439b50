"""What no rig records, although every check sum fits: named and refused before anything is computed with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rig.matrix.waveform import is_waveform
from rig.recording.column import Records
from rig.recording.context import PointContext
from rig.recording.journal import JournalProblem
from rig.recording.layout import parts

Range = tuple[float, float]

POINT: dict[str, Range] = {
    "amplitude_m": (0.0, 10.0), "frequency_Hz": (1e-6, 1e4), "current_A": (-1e3, 1e3), "cycles": (0.0, 1e6),
}
SENSOR: dict[str, Range] = {
    "rate_Hz": (1e-3, 1e7), "delay_s": (-10.0, 10.0), "range_SI": (0.0, 1e12), "sensitivity": (-1e12, 1e12),
    "offset": (-1e12, 1e12),
}
CONTEXT: dict[str, Range] = {
    "device_rate": (1e-4, 1e5), "controller_delay_s": (-10.0, 10.0), "mid_stroke_m": (-10.0, 10.0),
    "moving_mass_kg": (0.0, 1e6), "current_tolerance_A": (0.0, 1e3),
}
HOST_NS: Range = (0, 1 << 60)
"""Monotonic time of the host: 36 years."""
DEVICE_US: Range = (-1, 1 << 50)
"""A device's own clock, -1 where it has none: 35 years."""
LONGEST_NS = 30 * 24 * 3600 * 10**9
"""From a point's first record to its last."""


def checked_context(context: PointContext, name: str) -> PointContext:
    """The context of the point called `name`, with numbers that a rig can have.

    Raises:
        JournalProblem: one line with each number that cannot be.
    """
    point = context.point
    problems = _outside("point", point, POINT, needed=tuple(POINT))
    problems += _outside("header", vars(context), CONTEXT, needed=("device_rate",))
    if not is_waveform(point.get("waveform")):
        problems.append(f"point: waveform = {point.get('waveform')!r:.40}, expected its name")
    for channel in ("force", "displacement"):
        if channel not in context.sensors:
            problems.append(f"no sensor {channel}")
    for channel, sensor in context.sensors.items():
        problems += _outside(channel, vars(sensor), SENSOR, needed=("rate_Hz",))
        problems += [f"{channel}: {key} is no text" for key in ("sensor", "unit", "long_name")
                     if not isinstance(vars(sensor)[key], str)]
    if problems:
        raise JournalProblem("the header holds what no rig records: " + "; ".join(problems))
    return replace(context, point={**point, "id": name})


def _outside(
    place: str, values: Mapping[str, object], ranges: Mapping[str, Range], needed: tuple[str, ...],
) -> list[str]:
    problems = []
    for key, (low, high) in ranges.items():
        value = values.get(key)
        if value is None and key not in needed:
            continue
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (is_number and low <= value <= high):  # type: ignore[operator] # a number where the first half holds
            problems.append(f"{place}: {key} = {value!r:.40}, expected {low:g} to {high:g}")
    return problems


def check_records(channels: Mapping[str, Records]) -> None:
    """Refuse times that no clock shows.

    Raises:
        JournalProblem: naming the channel, the time and the range.
    """
    for name, records in channels.items():
        for key, (low, high) in (("host_ns", HOST_NS), ("device_us", DEVICE_US)):
            least, greatest = _extremes(records, key)
            if least < low or greatest > high:
                raise JournalProblem(f"{name}: {key} from {least} to {greatest}, expected {low} to {high}")
            if key == "host_ns" and greatest - least > LONGEST_NS:
                raise JournalProblem(f"{name}: records {1e-9 * (greatest - least):.0f} s apart; a point takes a month")


def _extremes(records: Records, key: str) -> tuple[int, int]:
    columns = [np.asarray(records[rows][key]) for rows in parts(len(records))]
    return min(int(each.min()) for each in columns if len(each)), max(int(each.max()) for each in columns if len(each))
