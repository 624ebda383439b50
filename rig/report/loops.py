"""The report's loops: all currents of one motion in one figure, and every point measured and fitted."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from rig.display import Display
from rig.document.blocks import Block, Blocks, Card, Cards, Figures, Heading, Keys, Paragraph
from rig.document.figure import Axis, Figure, Range, Style, Trace, span, thinned
from rig.document.numbers import number
from rig.document.style import FITTED, MEASURED, OVERLAID, RESIDUAL, current_colour
from rig.document.words import Key, Label, Span, Strong, verdict
from rig.report.fit import validation_words
from rig.report.peak_forces import current_keys, levels_of
from rig.report.views import Loop, PointView, motion_of
from rig.signals.arrays import FloatArray
from rig.test_point import HYBRID, SIGNAL

K = TypeVar("K", bound=Hashable)
MOST_COMPARED = 8
"""Motions that are drawn in one figure."""
MOST_ON_PAGES = 5
"""Motions whose loops are on the first two printed pages."""


def force_axis(display: Display, limits: Range | None = None) -> Axis:
    """The axis of forces."""
    return Axis("Force", display.force.unit, limits)


def displacement_axis(display: Display) -> Axis:
    """The axis of displacements about mid-stroke."""
    return Axis("Displacement about mid-stroke", display.displacement.unit)


def velocity_axis(display: Display) -> Axis:
    """The axis of velocities."""
    return Axis("Velocity", display.speed.unit)


def displacement_of(loop: Loop, display: Display) -> FloatArray:
    """A loop's displacement as it is shown (k,)."""
    return display.displacement.signed(1e-3 * loop.displacement_mm)


def velocity_of(loop: Loop, display: Display) -> FloatArray:
    """A loop's velocity as it is shown (k,)."""
    return display.speed.signed(loop.velocity_m_s)


@dataclass(frozen=True)
class Overlays:
    """The measured loops of each motion, all currents in one figure: the cards of the first pages, and the rest.

    A single test of a motion is not among the rest: its own loops are in the appendix. `further` counts the motions
    that are not on the first pages.
    """

    first: tuple[Card, ...] = ()
    rest: tuple[Card, ...] = ()
    keys: Blocks = field(default_factory=list)
    further: int = 0


def overlays(views: Sequence[PointView]) -> Overlays:
    """Force over displacement and over velocity for each motion, one colour for each current.

    Of many motions, evenly many between the slowest and the fastest are on the first pages. Points during or after an
    endurance test are in its own section: they show wear, which no colour here distinguishes.
    """
    drawn = [view for view in views if view.loop is not None and view.point.endurance is None]
    if not drawn:
        return Overlays()
    currents = levels_of(drawn)
    motions = _grouped(sorted(drawn, key=_speed), lambda view: view.group)
    cards = [_both(motion, group, _by_current(currents)) for motion, group in motions]
    places = sorted({round(k * (len(cards) - 1) / max(MOST_ON_PAGES - 1, 1)) for k in range(MOST_ON_PAGES)})
    first = places if len(cards) > MOST_ON_PAGES else range(len(cards))
    keys: Blocks = [Keys(current_keys(currents), "One measured cycle at ")] if len(currents) > 1 else []
    return Overlays(
        tuple(cards[place] for place in first),
        tuple(card for place, card in enumerate(cards) if place not in first and len(motions[place][1]) > 1), keys,
        len(cards) - len(first),
    )  # fmt: skip


def all_motions(views: Sequence[PointView]) -> Blocks:
    """The loops of all motions at one current in one figure, a card for each current; empty for a single motion.

    Of many motions, evenly many between the slowest and the fastest are drawn.
    """
    drawn = [view for view in views if view.loop is not None and view.point.endurance is None and view.standard]
    names = [name for name, _ in _grouped(sorted(drawn, key=_speed), lambda view: view.group)]
    names = [names[place] for place in thinned(len(names), MOST_COMPARED)]
    levels = _grouped([view for view in drawn if view.group in names], lambda view: view.level_A)
    compared = [(level_A, group) for level_A, group in sorted(levels) if len({view.group for view in group}) > 1]
    if not compared:
        return []
    colours = {name: current_colour(place, len(names)) for place, name in enumerate(names)}
    cards = tuple(
        _both(f"{number(level_A)} A", sorted(group, key=_speed), lambda view: colours[view.group])
        for level_A, group in compared
    )
    keys = tuple(Key(name, colour) for name, colour in colours.items())
    return [Heading("Loops of all motions"), Keys(keys, "One measured cycle of "), Cards(cards, large=True)]


def _speed(view: PointView) -> float:
    return view.point.amplitude_m * view.point.frequency_Hz


def _by_current(currents: Sequence[float]) -> Callable[[PointView], str]:
    return lambda view: current_colour(list(currents).index(view.level_A), len(currents))


def _both(title: str, group: Sequence[PointView], colour: Callable[[PointView], str]) -> Card:
    """Loops over displacement and over velocity, beside each other."""
    display = group[0].display
    return Card(Strong(title), (Figures((
        _overlay(group, colour, displacement_axis(display), displacement_of, f"Force vs. displacement, {title}"),
        _overlay(group, colour, velocity_axis(display), velocity_of, f"Force vs. velocity, {title}"),
    ), across=2),))  # fmt: skip


def _overlay(
    group: Sequence[PointView], colour: Callable[[PointView], str], along: Axis,
    values: Callable[[Loop, Display], FloatArray], title: str, *, fitted: bool = False,
    size: tuple[int, int] = (360, 225),
) -> Figure:
    """Several loops in one figure; with the fit dashed over them where that is wanted."""
    traces = []
    for view in sorted(group, key=lambda view: view.level_A):
        if view.loop is not None:
            x, force = values(view.loop, view.display), view.display.force.signed(view.loop.force_N)
            traces.append(Trace(x, force, name=f"{view.level_A:g} A, {view.point.id}", colour=colour(view)))
    for view in group if fitted else ():
        if view.loop is not None and view.loop.fitted_N is not None:
            x, force = values(view.loop, view.display), view.display.force.signed(view.loop.fitted_N)
            traces.append(Trace(x, force, Style.OVERLAID, f"fitted, {view.level_A:g} A"))
    return Figure(along, force_axis(group[0].display), traces, *size, title=title)


def model_overview(views: Sequence[PointView]) -> Blocks:
    """Force over velocity for each motion with the fit dashed over the measured loops; empty without a drawn fit."""
    if not any(view.loop is not None and view.loop.fitted_N is not None for view in views):
        return []
    keys = (*current_keys(levels_of(view for view in views if view.loop is not None)),
            Key("fitted", OVERLAID, dashed=True))  # fmt: skip
    cards = tuple(Card(Strong(view.group), (Figures((figure,)),)) for view, figure in overview_figures(views))
    return [Heading("Measured and fitted loops", 3), Keys(keys, "One cycle at "), Cards(cards)]


def overview_figures(views: Sequence[PointView]) -> list[tuple[PointView, Figure]]:
    """Force over velocity of each motion, all currents in one figure, with a point of the motion."""
    drawn = [view for view in views if view.loop is not None]
    currents = levels_of(drawn)
    return [
        (group[0], _overlay(group, _by_current(currents), velocity_axis(group[0].display), velocity_of,
                            f"Force vs. velocity, {motion}", fitted=True, size=(400, 270)))
        for motion, group in _grouped(drawn, lambda view: view.group)
    ]  # fmt: skip


def details(views: Sequence[PointView], *, fitted: bool) -> Blocks:
    """For each current one row of cards: both loops of every point but hybrid tests, and the residual of the fit."""
    drawn = [view for view in views if view.point.kind != HYBRID]
    if not drawn:
        return []
    keys = [Key("measured", MEASURED)]
    if fitted:
        keys += [Key("fitted", FITTED, dashed=True), Key("residual", RESIDUAL)]
    note = "One cycle from the middle of the test, or the whole test if the motion is not cyclic. "
    parts: Blocks = [Heading("Loops for all points"), Keys(tuple(keys), note)]
    ordered = sorted(drawn, key=lambda view: (view.level_A, view.point.waveform, view.point.frequency_Hz))
    for current, group in _grouped(ordered, lambda view: view.level_A):
        loops = [view.loop for view in group if view.loop is not None]
        shown = group[0].display.force
        forces = [loop.force_N for loop in loops] + [loop.fitted_N for loop in loops if loop.fitted_N is not None]
        force = span([shown.signed(one) for one in forces])
        residual = span([shown.signed(_residual(loop)) for loop in loops if loop.fitted_N is not None])
        cards = tuple(_card(view, force, residual) for view in group)
        parts += [Heading(f"{number(current)} A", 3), Cards(cards, large=True)]
    return parts


def _card(view: PointView, force: Range, residual: Range) -> Card:
    error = view.error_percent
    stated = motion_of(view) + (" " if error is None else f", error {number(error, 3)} % of force amplitude ")
    title: list[str | Span] = [Strong(view.point.id), " ", verdict(view.point.verdict), " ", stated]
    if view.held_out:
        title.append(Label(validation_words(view.beyond)))
    made = loop_figures(view, force, residual)
    if not made:
        return Card(tuple(title), (Paragraph(f"Not drawn: {view.why}"),))
    blocks: list[Block] = [Figures((made["displacement"], made["velocity"]), across=2)]
    if "residual" in made:
        blocks.append(Figures((made["residual"],)))
    return Card(tuple(title), tuple(blocks))


def loop_figures(view: PointView, force: Range | None = None, residual: Range | None = None) -> dict[str, Figure]:
    """A point's loops: force over `displacement` and `velocity`, and with a fit the `residual` over the cycle.

    `force` and `residual` are the axes' limits, in the shown unit; by default each figure's own.
    """
    loop, display = view.loop, view.display
    if loop is None:
        return {}
    made, axis, shown = {}, force_axis(display, force), display.force
    for name, label, along in (
        ("displacement", displacement_axis(display), displacement_of(loop, display)),
        ("velocity", velocity_axis(display), velocity_of(loop, display)),
    ):
        traces = [Trace(along, shown.signed(loop.force_N), name="measured")]
        if loop.fitted_N is not None:
            traces.append(Trace(along, shown.signed(loop.fitted_N), Style.FITTED, "fitted"))
        made[name] = Figure(label, axis, traces)
    if loop.fitted_N is not None:
        phase = Axis("Record" if view.point.kind == SIGNAL else "Cycle phase", limits=(0.0, 1.0))
        rest = Trace(loop.phase, shown.signed(_residual(loop)), Style.RESIDUAL, "measured minus fitted")
        made["residual"] = Figure(phase, Axis("Residual", shown.unit, residual), [rest], 610, 130)
    return made


def _residual(loop: Loop) -> FloatArray:
    return loop.force_N if loop.fitted_N is None else loop.force_N - loop.fitted_N


def _grouped(views: Sequence[PointView], by: Callable[[PointView], K]) -> list[tuple[K, list[PointView]]]:
    order = list(dict.fromkeys(by(view) for view in views))
    return [(one, [view for view in views if by(view) == one]) for one in order]
