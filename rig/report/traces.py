"""The report's section of tests over time: the whole test, and one cycle with the fit."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from rig.document.blocks import Blocks, Card, Cards, Figures, Keys, section
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import number
from rig.document.style import FITTED, MEASURED
from rig.document.words import Key, Strong
from rig.errors import RigError
from rig.report.views import PointView, motion_of
from rig.signals.arrays import FloatArray
from rig.test_point import SIGNAL

MOST_CURRENTS = 6
COLUMNS = 240
"""A whole test is drawn by the lowest and highest sample of so many stretches: no peak is lost."""
WIDTH, HEIGHT = 610, 96


def time_traces(views: Sequence[PointView]) -> Blocks:
    """The fastest test of each current (of at most six, spread evenly); nothing where none can be drawn."""
    cards = []
    for view in chosen(views):
        title = (Strong(view.point.id), f" {motion_of(view)}, {number(view.level_A, 3)} A")
        cards.append(Card(title, (Figures(tuple(trace_figures(view).values())),)))
    if not cards:
        return []
    fitted = any(view.loop is not None and view.loop.fitted_N is not None for view in chosen(views))
    keys = (Key("measured", MEASURED), *([Key("fitted", FITTED, dashed=True)] if fitted else []))
    note = (
        "The fastest test at each current, from its first to its last sample; below, one cycle from the middle of the "
        "test."
    )
    return [*section("Time traces", note), Keys(keys), Cards(tuple(cards), large=True)]


def chosen(views: Sequence[PointView]) -> list[PointView]:
    """The fastest drawn test of each current."""
    fastest: dict[float, PointView] = {}
    for view in views:
        if view.loop is None or view.point.verdict == "invalid":
            continue
        rival = fastest.get(view.level_A)
        if rival is None or _speed(view) > _speed(rival):
            fastest[view.level_A] = view
    currents = sorted(fastest)
    if len(currents) > MOST_CURRENTS:
        places = np.linspace(0, len(currents) - 1, MOST_CURRENTS).round().astype(int)
        currents = [currents[place] for place in places]
    return [fastest[current] for current in currents]


def _speed(view: PointView) -> float:
    return view.point.amplitude_m * view.point.frequency_Hz


def trace_figures(view: PointView) -> dict[str, Figure]:
    """A test's figures over time by name: `displacement`, `force`, `current`, `cycle`."""
    point, drawn = view.point, {}
    display = view.display
    try:
        time_s = point.time_s
        values = {
            "displacement": (display.displacement.unit, display.displacement.signed(point.displacement_m)),
            "force": (display.force.unit, display.force.signed(point.force_N)),
            "current": ("A", point.current_measured_A),
        }
    except RigError:
        return {}
    for name, (unit, shown) in values.items():
        at_s, drawn_values = envelope(time_s, shown)
        title, time = f"{name.capitalize()} vs. time, {point.id}", Axis(f"{name.capitalize()} ({unit}) vs. time", "s")
        drawn[name] = Figure(
            time, Axis(), [Trace(at_s - at_s[0], drawn_values, Style.THIN, name)], WIDTH, HEIGHT, title=title
        )
    loop = view.loop
    if loop is not None and point.frequency_Hz > 0.0 and point.kind != SIGNAL:
        at_ms = 1e3 * loop.phase / point.frequency_Hz
        traces = [Trace(at_ms, display.force.signed(loop.force_N), name="measured")]
        if loop.fitted_N is not None:
            traces.append(Trace(at_ms, display.force.signed(loop.fitted_N), Style.FITTED, "fitted"))
        time = Axis(f"Force ({display.force.unit}) vs. time in the cycle", "ms")
        drawn["cycle"] = Figure(time, Axis(), traces, WIDTH, 130, title=f"One cycle from {point.id}")
    return drawn


def envelope(time_s: FloatArray, values: FloatArray, columns: int = COLUMNS) -> tuple[FloatArray, FloatArray]:
    """A long trace as the lowest and highest sample of each of so many stretches, in their order; short ones as is."""
    if len(time_s) <= 2 * columns:
        return time_s, values
    edges = np.linspace(0, len(time_s), columns + 1).astype(int)
    places = []
    for start, stop in itertools.pairwise(edges.tolist()):
        part = values[start:stop]
        if np.all(np.isnan(part)):
            places.append(start)
            continue
        places += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    index = np.array(places)
    return time_s[index], values[index]
