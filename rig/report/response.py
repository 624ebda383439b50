"""The report's section on the response time: a table, each step over time, and the times over velocity and current.

The table is made of the same numbers as `characteristics.json`, so that the terminal shows it after a run, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rig.display import Display
from rig.document.blocks import Block, Blocks, Card, Cards, Column, Figures, Keys, Paragraph, section, table
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, number, with_uncertainty
from rig.document.style import FITTED, MEASURED, RESIDUAL, category_colour
from rig.document.words import Key, Strong, capitalised
from rig.errors import some
from rig.identification.points.response_steps import COMMAND, Curve, ResponseTest
from rig.signals.arrays import FloatArray
from rig.signals.step_response.result import LEVEL_NAMES, LEVELS, State, TimeResult

PLUS_MINUS_IS = "\N{PLUS-MINUS SIGN}: standard uncertainty (k = 1)."
NOTE = (
    "The current is stepped while the rod moves at constant velocity. Dead time, and times to 63, 90 and 95 % of "
    "the force step, from the current command; coil: the same times for the measured current. The times are read from "
    "the records without a model; where this is not possible, they are those of a fit with one or two lags and dead "
    "time, marked with a dagger. "
    f"{PLUS_MINUS_IS}"
)
FROM_CURRENT = (
    "The simulated rig ran faster than real time, so the times count from the start of the measured coil current."
)
WIDTH, HEIGHT = 440, 260
COMMON_S = 5e-4
"""Standard uncertainty of the origin of the times from which it is stated apart: the command alone is known to this."""
LEADS = 3.0
"""Standard uncertainties by which the force leads the current."""
APART = 0.012
"""Distance of the marks of two lines at one place, of the width of the figure."""
SHOWN = 3
"""Results that a remark names; it states the number of the others."""
ARROW, DAGGER = "\N{RIGHTWARDS ARROW}", "\N{DAGGER}"


def response_section(tests: Sequence[ResponseTest], left_out: Sequence[str], display: Display) -> Blocks:
    """Table and figures of the response tests; empty without any."""
    if not tests and not left_out:
        return []
    blocks: Blocks = [*section("Response time", NOTE)]
    if tests:
        blocks += response_blocks([test.to_json() for test in tests], display)
        keys = (Key("force", MEASURED), Key("fit", FITTED), Key("coil current", RESIDUAL))
        cards = tuple(_cards(tests, display))
        blocks += [Keys(keys), Cards(cards)] if cards else []
        blocks += _summary(tests, display)
    if left_out:
        blocks.append(Paragraph(f"Not used: {'; '.join(left_out)}.", small=True))
    return blocks


def response_blocks(tests: Sequence[Mapping[str, Any]], display: Display, *, narrow: bool = False) -> Blocks:
    """The table with its remarks.

    Args:
        tests: as `ResponseTest.to_json`.
        display: units and signs.
        narrow: for a terminal of 80 columns: without the point's name, the number of steps and the time to 90 %.
    """
    head = [
        Column("velocity", display.speed.unit, True), Column("current", "A"), Column("step", display.force.unit, True),
        Column("dead time", "ms", True), *(Column(name, "ms", True) for name in LEVEL_NAMES),
        Column("coil t63", "ms", True), Column("behind coil", "ms", True),
    ]
    rows = [_row(test, display) for test in tests]
    if narrow:
        kept = [place for place in range(len(head)) if place != 5]
        head, rows = [head[place] for place in kept], [[row[place] for place in kept] for row in rows]
    else:
        head = [Column("point"), *head, Column("steps", "", True)]
        rows = [[test["id"], *row, _steps(test)] for test, row in zip(tests, rows, strict=True)]
    remarks = [FROM_CURRENT] if any(test["origin"] != COMMAND for test in tests) else []
    remarks += [*_origin(tests), *_remarks(tests)]
    if narrow:
        remarks += [PLUS_MINUS_IS, *_discarded(tests)]
    return [table(head, rows, title="Response time" if narrow else ""),
            *(Paragraph(remark, small=True) for remark in remarks)]


def _row(test: Mapping[str, Any], display: Display) -> list[str]:
    force, current, behind = test["force"], test["current"] or {}, test["behind_current"]
    return [
        number(display.speed.signed(test["velocity_m_s"]), 3), f"{test['from_A']:.3g} {ARROW} {test['to_A']:.3g}",
        NOTHING if force["step_N"] is None else number(display.force.value(abs(force["step_N"])), 3),
        time_words(force["dead_time"]), *(_of_level(force, name) for name in LEVEL_NAMES),
        _of_level(current, "t63") if current else NOTHING,
        NOTHING if behind is None else _ms(behind["value_s"], behind["std_s"]),
    ]


def _of_level(response: Mapping[str, Any], name: str) -> str:
    """Without a model where that can be read, else by the fit, marked by a dagger."""
    stated = response["stated"][name]
    by_fit = stated["method"] == "fit" and stated["state"] == State.MEASURED
    return f"{time_words(stated)} {DAGGER}" if by_fit else time_words(stated)


def time_words(time: Mapping[str, Any]) -> str:
    """A time in ms with its standard uncertainty; `< limit` or `> limit` where only that is known; a dash."""
    if time["state"] == State.MEASURED:
        return _ms(time["value_s"], time["std_s"])
    sign = {State.FASTER: "<", State.SLOWER: ">"}.get(time["state"])
    return NOTHING if sign is None or time["limit_s"] is None else f"{sign} {number(1e3 * time['limit_s'], 3)}"


def _ms(value_s: float, std_s: float) -> str:
    return with_uncertainty(1e3 * value_s, 1e3 * std_s)


def _steps(test: Mapping[str, Any]) -> str:
    lost = f" ({test['discarded']} discarded)" if test["discarded"] else ""
    return f"{test['steps']}{lost}"


def _discarded(tests: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """States where the table has no column for them how many steps of each point are not in the results."""
    lost: dict[str, tuple[int, int]] = {}
    for test in tests:
        discarded, total = lost.get(test["id"], (0, 0))
        lost[test["id"]] = discarded + test["discarded"], total + test["steps"] + test["discarded"]
    named = [f"{discarded} of {total} in {name}" for name, (discarded, total) in lost.items() if discarded]
    if named:
        yield f"Discarded steps: {', '.join(named)}."


def _origin(tests: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """What of the uncertainties is common to all times of the force."""
    known = [test["origin_std_s"] for test in tests if test["origin_std_s"] is not None]
    if known and max(known) > COMMON_S:
        low, high = (number(1e3 * value, 2) for value in (min(known), max(known)))
        yield (
            f"{low if low == high else f'{low} to {high}'} ms of each uncertainty of the times of the force is "
            "common to all steps: the place of the steps on the time base (interval of the current samples, clocks)."
        )


def _remarks(tests: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """What a reader must know of single results, each once with the results that it is about."""
    about: dict[str, list[str]] = {}
    for test in tests:
        where = f"{test['id']} {test['direction']} {test['from_A']:.3g} {ARROW} {test['to_A']:.3g} A"
        for remark in _remarks_of(test):
            about.setdefault(remark, []).append(where)
    for remark, places in about.items():
        listed = "all results" if len(places) == len(tests) > 1 else some(places, most=SHOWN)
        yield f"{remark} ({listed})."


def _remarks_of(test: Mapping[str, Any]) -> Iterable[str]:
    """What a reader must know of one result."""
    force = test["force"]
    if force["why"]:
        yield capitalised(force["why"])
    if any(force["fit"][name]["state"] == State.SLOWER for name in LEVEL_NAMES):
        yield "The force did not settle within the window. Fix: use a longer window (lower speed or longer stroke)"
    fast = [name for name in LEVEL_NAMES if force["crossing"][name]["state"] == State.FASTER]
    if fast:
        yield f"Too few samples around {', '.join(fast)} to read the time without a model"
    if any(one["method"] == "fit" and one["state"] == State.MEASURED for one in force["stated"].values()):
        yield f"{DAGGER} by the fit: the window is too short to read the time without a model. Fix: use a longer window"
    if not force["fit_describes"]:
        known = force["dead_time"]["state"] != State.UNKNOWN
        lags = "one lag" if force["order"] == 1 else "two lags"
        yield f"A fit with {lags} does not describe the response{'' if known else ', so the dead time is not known'}"
    elif force["overshoots"]:
        yield "The response overshoots its final value"
    elif force["order"] == 2:
        yield "The response has two lags"
    if test["current"] is None:
        yield "The coil current is not measured, so the delay of the force behind it is not known"
    elif test["current"]["why"]:
        yield f"Coil current: {test['current']['why']}"
    behind = test["behind_current"]
    if behind is not None and behind["value_s"] < -LEADS * behind["std_s"]:
        yield (
            "The force leads the measured coil current: the measured current is filtered or delayed. Fix: state this "
            "as current_delay in [ecu] of the bench file"
        )
    if force["repeats_scatter"]:
        yield "The scatter between repeats exceeds the noise"


def _cards(tests: Sequence[ResponseTest], display: Display) -> Iterable[Card]:
    """Each motion and current in one figure, both steps over each other."""
    groups: dict[tuple[str, str], list[ResponseTest]] = {}
    for test in tests:
        groups.setdefault((test.id, test.direction), []).append(test)
    for (name, direction), group in groups.items():
        traces = [trace for test in group if test.curve is not None for trace in _traces(test.curve, test.rises)]
        if traces:
            high_A = max(abs(_high_A(test)) for test in group)
            title = f"{display.speed.text(abs(group[0].velocity_m_s), 3)} {direction}, {high_A:.3g} A"
            figure = Figure(Axis("Time", "ms"), Axis("Percentage of the step", "%"), traces, WIDTH, HEIGHT,
                            title=f"{name}: response at {title}")
            yield Card((Strong(name), f" {title}"), (Figures((figure,)),))


def _traces(curve: Curve, rises: bool) -> list[Trace]:
    """Force, fit and current of one step, rising or falling."""
    time_ms = 1e3 * curve.time_s

    def shown(share: FloatArray) -> FloatArray:
        return 100.0 * (share if rises else 1.0 - share)

    what = "on" if rises else "off"
    return [
        Trace(time_ms, shown(curve.current), Style.RESIDUAL, f"current, {what}", RESIDUAL),
        Trace(time_ms, shown(curve.force), Style.MEASURED, f"force, {what}", MEASURED),
        Trace(time_ms, shown(curve.fit), Style.FITTED, f"fit, {what}", FITTED),
    ]


def _summary(tests: Sequence[ResponseTest], display: Display) -> list[Block]:
    """Time to 95 % (63 % where that is not measured everywhere) over velocity and over current."""
    place = len(LEVELS) - 1 if all(test.best(len(LEVELS) - 1).measured for test in tests) else 0
    known = [test for test in tests if test.best(place).measured]
    if len(known) < 2:
        return []
    name = LEVEL_NAMES[place]
    over = (
        ("velocity", Axis("Velocity", display.speed.unit), lambda test: display.speed.signed(test.velocity_m_s),
         lambda test: f"{_high_A(test):.3g} A"),
        ("current", Axis("Current", "A"), _high_A,
         lambda test: f"{display.speed.text(abs(test.velocity_m_s), 2)} {test.direction}"),
    )
    figures = [
        _over(known, place, axis, f"{name} vs. {what}", at, group) for what, axis, at, group in over
        if len({round(at(test), 3) for test in known}) > 1
    ]
    if not figures:
        return []
    caption = f"{name} over velocity and over current. Vertical bars: 95 % intervals."
    return [Paragraph(caption, small=True), Figures(tuple(figures), across=2)]


def _high_A(test: ResponseTest) -> float:
    return max((test.from_A, test.to_A), key=abs)


def _over(
    tests: Sequence[ResponseTest], place: int, axis: Axis, title: str, at: Callable[[ResponseTest], float],
    group: Callable[[ResponseTest], str],
) -> Figure:
    """Times over one quantity: a line for each group and direction of the step, with marks and 95 % intervals.

    The marks of each line lie a little beside those of the others, so that intervals at one place stay apart.
    """
    lines: dict[str, list[ResponseTest]] = {}
    for test in tests:
        lines.setdefault(f"{group(test)}, {'on' if test.rises else 'off'}", []).append(test)
    traces = []
    places = [at(test) for test in tests]
    apart = APART * (max(places) - min(places)) if len(set(places)) > 1 else 0.0
    for index, (name, members) in enumerate(lines.items()):
        colour = category_colour(index)
        ordered = sorted(members, key=at)
        times = [test.best(place) for test in ordered]
        x = np.array([at(test) for test in ordered]) + apart * (index - 0.5 * (len(lines) - 1))
        y = np.array([1e3 * time.value_s for time in times])
        # A line over both directions of the motion would pass through standstill.
        breaks = [k + 1 for k, (one, other) in enumerate(pairwise(x)) if one < 0.0 < other]
        traces.append(Trace(np.insert(x, breaks, math.nan), np.insert(y, breaks, math.nan), Style.MEASURED, name,
                            colour))
        traces.append(Trace(x, y, Style.POINTS, colour=colour))
        for place_x, time in zip(x, times, strict=True):
            traces += _interval(place_x, time, 0.3 * apart, colour)
    return Figure(axis, Axis(title.split(" ")[0], "ms"), traces, WIDTH, HEIGHT + 40, title=title, legend=True)


def _interval(x: float, time: TimeResult, half_cap: float, colour: str) -> list[Trace]:
    """The 95 % interval of a time as a bar with caps (ms)."""
    low, high = 1e3 * time.low_s, 1e3 * time.high_s
    across = x + half_cap * np.array([-1.0, 1.0, 0.0, 0.0, -1.0, 1.0])
    up = np.repeat([low, high], 3)
    return [Trace(across, up, Style.THIN, "", colour)]
