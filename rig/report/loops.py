"""The report's loops: every point measured and fitted, and all currents of one motion in one figure."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

from rig.document.blocks import Block, Blocks, Card, Cards, Figures, Heading, Keys, Paragraph
from rig.document.figure import Axis, Figure, Range, Style, Trace, span
from rig.document.numbers import number
from rig.document.style import FITTED, MEASURED, OVERLAID, RESIDUAL, current_colour
from rig.document.words import Key, Label, Span, Strong, verdict
from rig.report.fit import validation_words
from rig.report.views import Loop, PointView, motion_of
from rig.signals.arrays import FloatArray
from rig.test_point import HYBRID, SIGNAL

K = TypeVar("K", bound=Hashable)
FORCE, DISPLACEMENT, VELOCITY = Axis("Force", "N"), Axis("Displacement about mid-stroke", "mm"), Axis("Velocity", "m/s")


def overview(views: Sequence[PointView]) -> Blocks:
    """Force over velocity for each motion, one colour for each current, the fit dashed over it."""
    drawn = [view.loop for view in views if view.loop is not None]
    currents = sorted({view.level_A for view in views if view.loop is not None})
    if len(currents) < 2:
        return []
    keys = [Key(f"{number(current)} A", current_colour(place, len(currents))) for place, current in enumerate(currents)]
    if any(loop.fitted_N is not None for loop in drawn):
        keys.append(Key("fitted", OVERLAID, dashed=True))
    cards = tuple(Card(Strong(motion), (Figures((figure,)),)) for motion, figure in overview_figures(views).items())
    return [
        Heading("Force vs. velocity, all currents"), Keys(tuple(keys), "One measured cycle: "), Cards(cards),
    ]  # fmt: skip


def overview_figures(views: Sequence[PointView]) -> dict[str, Figure]:
    """Force over velocity by the motion's name, all currents in one figure."""
    drawn = [view for view in views if view.loop is not None]
    currents = sorted({view.level_A for view in drawn})
    made = {}
    for motion, group in _grouped(drawn, lambda view: view.group):
        traces = [
            Trace(view.loop.velocity_m_s, view.loop.force_N, name=f"{view.level_A:g} A, {view.point.id}",
                  colour=current_colour(currents.index(view.level_A), len(currents)))
            for view in sorted(group, key=lambda view: view.level_A) if view.loop is not None
        ]
        traces += [
            Trace(view.loop.velocity_m_s, view.loop.fitted_N, Style.OVERLAID, f"fitted, {view.level_A:g} A")
            for view in group if view.loop is not None and view.loop.fitted_N is not None
        ]
        made[motion] = Figure(VELOCITY, FORCE, traces, 400, 270, title=f"Force vs. velocity, {motion}")
    return made


def details(views: Sequence[PointView], *, fitted: bool) -> Blocks:
    """For each current one row of cards: both loops of every point but hybrid tests, and the residual of the fit."""
    shown = [view for view in views if view.point.kind != HYBRID]
    if not shown:
        return []
    keys = [Key("measured", MEASURED)]
    if fitted:
        keys += [Key("fitted", FITTED, dashed=True), Key("residual", RESIDUAL)]
    note = "One cycle from the middle of the test, or the whole test if the motion is not cyclic. "
    parts: Blocks = [Heading("Loops for all points"), Keys(tuple(keys), note)]
    ordered = sorted(shown, key=lambda view: (view.level_A, view.point.waveform, view.point.frequency_Hz))
    for current, group in _grouped(ordered, lambda view: view.level_A):
        loops = [view.loop for view in group if view.loop is not None]
        force = span([loop.force_N for loop in loops] + [loop.fitted_N for loop in loops if loop.fitted_N is not None])
        residual = span([_residual(loop) for loop in loops if loop.fitted_N is not None])
        cards = tuple(_card(view, force, residual) for view in group)
        parts += [Heading(f"{number(current)} A", 3), Cards(cards, large=True)]
    return parts


def _card(view: PointView, force: Range, residual: Range) -> Card:
    error = view.error_percent
    stated = motion_of(view) + (" " if error is None else f", error {number(error, 3)} % of peak ")
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

    `force` and `residual` are the axes' limits (N); by default each figure's own.
    """
    loop = view.loop
    if loop is None:
        return {}
    made, axis = {}, Axis("Force", "N", force)
    for name, label, along in (
        ("displacement", DISPLACEMENT, loop.displacement_mm), ("velocity", VELOCITY, loop.velocity_m_s),
    ):  # fmt: skip
        traces = [Trace(along, loop.force_N, name="measured")]
        if loop.fitted_N is not None:
            traces.append(Trace(along, loop.fitted_N, Style.FITTED, "fitted"))
        made[name] = Figure(label, axis, traces)
    if loop.fitted_N is not None:
        phase = Axis("Record" if view.point.kind == SIGNAL else "Cycle phase", limits=(0.0, 1.0))
        rest = Trace(loop.phase, _residual(loop), Style.RESIDUAL, "measured minus fitted")
        made["residual"] = Figure(phase, Axis("Residual", "N", residual), [rest], 610, 130)
    return made


def _residual(loop: Loop) -> FloatArray:
    return loop.force_N if loop.fitted_N is None else loop.force_N - loop.fitted_N


def _grouped(views: Sequence[PointView], by: Callable[[PointView], K]) -> list[tuple[K, list[PointView]]]:
    order = list(dict.fromkeys(by(view) for view in views))
    return [(one, [view for view in views if by(view) == one]) for one in order]
