"""Views of recorded points: figures of loops and channels, data sets of xarray."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from rig.document.figure import Axis, Figure, Trace, thinned
from rig.document.style import current_colour
from rig.errors import FileProblem
from rig.extras import how_to_install
from rig.signals.arrays import FloatArray
from rig.signals.test_set import CurrentReading, current_levels

if TYPE_CHECKING:
    import xarray

CHANNELS = {
    "time_s": "time",
    "displacement_m": "displacement",
    "velocity_m_s": "velocity",
    "force_N": "force",
    "current_measured_A": "current",
    "coil_temperature_degC": "coil_temperature",
}
"""Attribute of `RecordedPoint` -> dataset under `/entry/data`."""
TABLE_UNITS = {
    "displacement": "m", "velocity": "m/s", "force": "N", "current": "A", "commanded_current": "A",
    "coil_temperature": "degC",
}  # fmt: skip
"""Units of the columns of `RecordedPoint.to_pandas`, which are in its attribute `units`."""
Over = Literal["velocity", "displacement"]
MOST_SAMPLES = 20_000
"""Of a point that a figure shows."""
OVER: dict[str, tuple[Axis, float]] = {
    "velocity": (Axis("Velocity", "m/s"), 1.0), "displacement": (Axis("Displacement", "mm"), 1e3),
}  # fmt: skip
"""Horizontal axis, and its units for one of SI."""
CHANNEL_AXES = {
    "displacement": (Axis("Displacement", "mm"), 1e3), "velocity": (Axis("Velocity", "m/s"), 1.0),
    "force": (Axis("Force", "N"), 1.0), "current": (Axis("Coil current", "A"), 1.0),
    "commanded_current": (Axis("Commanded coil current", "A"), 1.0),
    "coil_temperature": (Axis("Coil temperature", "degC"), 1.0),
}  # fmt: skip
DESCRIBED = ("waveform", "amplitude_m", "frequency_Hz", "current_A", "verdict")


class Recorded(Protocol):
    """What a view needs of a point; see `rig.recording.recorded_point.RecordedPoint`."""

    @property
    def id(self) -> str:
        """Its id."""

    @property
    def current_A(self) -> float:
        """Requested coil current (A)."""

    @property
    def current_requested(self) -> bool:
        """Whether the current was requested; else it was measured."""

    @property
    def samples(self) -> int:
        """Number of samples n."""

    @property
    def time_s(self) -> FloatArray:
        """Times (s), (n,)."""

    @property
    def force_N(self) -> FloatArray:
        """Force (N), (n,)."""

    def channel(self, name: str) -> FloatArray:
        """A channel by its name in the file, (n,)."""


def axis_over(over: str) -> tuple[Axis, float]:
    """The horizontal axis of a loop and its units for one of SI.

    Raises:
        FileProblem: neither velocity nor displacement.
    """
    if over not in OVER:
        raise FileProblem("plot", [f"over: got {over!r}, expected {' or '.join(OVER)}"])
    return OVER[over]


def current_name(current_A: float) -> str:
    """A current as a legend has it; NaN is one that changes."""
    return "changing current" if math.isnan(current_A) else f"{round(current_A, 2) + 0.0:.2f} A"


def loops_figure(points: Sequence[Recorded], over: str) -> Figure:
    """Force (N) of each point over velocity (m/s) or displacement (mm), coloured by the level of its current.

    Raises:
        FileProblem: there is no point, or `over` is not known.
    """
    axis, scale = axis_over(over)
    if not points:
        raise FileProblem("plot", ["the run has no points"])
    levels = current_levels([
        CurrentReading(one.current_A, requested_A=one.current_A if one.current_requested else math.nan)
        for one in points
    ])  # fmt: skip
    traces = []
    for number, point in enumerate(points):
        few, place = thinned(point.samples, MOST_SAMPLES), levels.of_test[number] or 0
        named = current_name(levels.name_A(number))
        name = f"{point.id}, {named}" if len(points) <= len(levels) else named
        along = scale * point.channel(over)[few]
        traces.append(Trace(along, point.force_N[few], name=name, colour=current_colour(place, len(levels))))
    title = points[0].id if len(points) == 1 else f"{len(points)} tests"
    return Figure(axis, CHANNEL_AXES["force"][0], traces, title=title, legend=True)


def time_figure(point: Recorded, channel: str) -> Figure:
    """A channel of a point over time (s).

    Raises:
        FileProblem: there is no such channel.
    """
    if channel not in CHANNEL_AXES or not np.isfinite(values := point.channel(channel)).any():
        recorded = [name for name in CHANNEL_AXES if np.isfinite(point.channel(name)).any()]
        raise FileProblem(point.id, [f"channel: got {channel!r}, expected one of {', '.join(recorded)}"])
    axis, scale = CHANNEL_AXES[channel]
    few = thinned(point.samples, MOST_SAMPLES)
    return Figure(Axis("Time", "s"), axis, [Trace(point.time_s[few], scale * values[few])], title=point.id)


def run_dataset(points: Sequence[Recorded]) -> xarray.Dataset:
    """Points as one data set over `point` and `sample`; see `rig.recording.run.Run.to_xarray`.

    Raises:
        FileProblem: xarray is not installed, or a file cannot be read.
    """
    library = _library()
    longest = max((point.samples for point in points), default=0)
    variables: dict[str, Any] = {}
    for name, channel in CHANNELS.items():
        padded = np.full((len(points), longest), np.nan)
        for row, point in enumerate(points):
            padded[row, : point.samples] = point.channel(channel) if channel != "time" else point.time_s
        if channel == "time" or np.isfinite(padded).any():
            variables[name] = (("point", "sample"), padded, {"units": TABLE_UNITS.get(channel, "s")})
    coordinates: dict[str, Any] = {"point": [point.id for point in points]}
    coordinates |= {name: ("point", [getattr(point, name) for point in points]) for name in DESCRIBED}
    return library.Dataset(variables, coordinates)


def point_dataset(point: Recorded) -> xarray.Dataset:
    """A point as a data set over `time_s`.

    Raises:
        FileProblem: xarray is not installed, or the file cannot be read.
    """
    variables = {
        name: ("time_s", values, {"units": TABLE_UNITS[channel]}) for name, channel in CHANNELS.items()
        if channel != "time" and np.isfinite(values := point.channel(channel)).any()
    }
    attributes = {"id": point.id, **{name: getattr(point, name) for name in DESCRIBED}}
    coordinates = {"time_s": ("time_s", point.time_s, {"units": "s"})}
    return _library().Dataset(variables, coordinates, attributes)


def _library() -> Any:  # noqa: ANN401 - an optional package
    try:
        import xarray
    except ImportError as error:
        raise FileProblem("to_xarray", [f"xarray is not installed. Fix: {how_to_install('notebook')}"]) from error
    return xarray
