"""The report's drawings: what is shown of a point, its loops, measured over fitted, all currents over each other."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from rig.characteristics.loop import LoopCharacteristics
from rig.dampers import DamperModel
from rig.dampers.temperature_law import COMMON, VISCOUS, YIELD, TemperatureLaw
from rig.errors import RigError, evaluating
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.softening import force_change_N
from rig.identification.points.preparation import prepare
from rig.recording.layout import HYBRID, SIGNAL
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint
from rig.report.chart import Chart, Range, Trace, span, thinned
from rig.report.fragment import block, card, charts, chip, heading, held_out, key, key_line, number, paragraph, text
from rig.report.style import FITTED, MEASURED, OVERLAID, RESIDUAL, current_colour
from rig.signals.arrays import FloatArray

K = TypeVar("K", bound=Hashable)
FORCE, DISPLACEMENT, VELOCITY = "Force N", "Displacement about mid-stroke mm", "Velocity m/s"

DRAWN_OF_CYCLE, DRAWN_OF_RECORD = 300, 1500
"""Samples at most: a record has many reversals, which fewer would cut off."""


def overview(views: Sequence[PointView]) -> str:
    """Force over velocity for each motion, one colour a current, the fit dashed over it."""
    drawn = [view for view in views if view.loop is not None]
    currents = sorted({view.level_A for view in drawn})
    if len(currents) < 2:
        return ""
    colours = {current: current_colour(index, len(currents)) for index, current in enumerate(currents)}
    keys = "".join(key(f"{number(current)} A", colours[current]) for current in currents)
    fitted = key("fitted", OVERLAID, dashed=True) if any(
        view.loop is not None and view.loop.fitted_N is not None for view in drawn
    ) else ""
    cards = [card(f"<b>{text(motion)}</b>", chart.svg()) for motion, chart in overview_charts(views).items()]
    return (
        heading("Force over velocity, all currents")
        + key_line("One cycle. Measured:", keys + fitted) + charts(cards)
    )


def overview_charts(views: Sequence[PointView]) -> dict[str, Chart]:
    """Force over velocity by the motion's words, all currents over each other."""
    drawn = [view for view in views if view.loop is not None]
    currents = sorted({view.level_A for view in drawn})
    made = {}
    for motion, group in _grouped(drawn, lambda view: view.group):
        traces = [
            Trace(view.loop.velocity_m_s, view.loop.force_N, "m", f"{view.level_A:g} A, {view.point.id}",
                  current_colour(currents.index(view.level_A), len(currents)))
            for view in sorted(group, key=lambda view: view.level_A) if view.loop is not None
        ]
        traces += [
            Trace(view.loop.velocity_m_s, view.loop.fitted_N, "q", f"fitted, {view.level_A:g} A")
            for view in group if view.loop is not None and view.loop.fitted_N is not None
        ]
        made[motion] = Chart(VELOCITY, FORCE, traces, 400, 270, title=f"Force over velocity, {motion}")
    return made


def details(views: Sequence[PointView], *, fitted: bool) -> str:
    """For each current one row of cards: both loops of every point but hybrid tests, and what the fit leaves over."""
    keys = key("measured", MEASURED)
    if fitted:
        keys += key("fitted", FITTED, dashed=True) + key("residual", RESIDUAL)
    note = "One cycle from the middle of the test; of a motion without cycles all of it."
    shown = [view for view in views if view.point.kind != HYBRID]
    if not shown:
        return ""
    parts = [heading("Loops of every point") + key_line(note, keys)]
    ordered = sorted(shown, key=lambda view: (view.level_A, view.point.waveform, view.point.frequency_Hz))
    for current, group in _grouped(ordered, lambda view: view.level_A):
        loops = [view.loop for view in group if view.loop is not None]
        force = span([loop.force_N for loop in loops] + [loop.fitted_N for loop in loops if loop.fitted_N is not None])
        residual = span([_residual(loop) for loop in loops if loop.fitted_N is not None])
        parts.append(heading(f"{number(current)} A", level=3))
        cards = "".join(_card(view, force, residual) for view in group)
        parts.append(block("cards", cards))
    return "".join(parts)


def _card(view: PointView, force: Range, residual: Range) -> str:
    point = view.point
    error = view.error.get("nrmse_percent_of_peak")
    title = [
        f"<b>{text(point.id)}</b>", chip(point.verdict, point.verdict), f"<span>{text(motion_of(view))}</span>",
    ]
    if isinstance(error, (int, float)):
        title.append(f"<span>error {number(error, 3)} % of peak</span>")
    if view.held_out:
        title.append(chip(held_out(view.error), "plain"))
    header = "".join(title)
    if view.loop is None:
        return card(header, paragraph(f"Not drawn: {text(view.why)}"))
    made = loop_charts(view, force, residual)
    strip = made["residual"].svg() if "residual" in made else ""
    return card(header, block("pair", made["displacement"].svg() + made["velocity"].svg()), strip)


def loop_charts(view: PointView, force: Range | None = None, residual: Range | None = None) -> dict[str, Chart]:
    """A point's loops: force over `displacement` and `velocity`, and with a fit the `residual` over the cycle.

    `force` and `residual` are the axes' ranges (N); by default each chart's own.
    """
    loop = view.loop
    if loop is None:
        return {}
    over_u = [Trace(loop.displacement_mm, loop.force_N, "m", "measured")]
    over_v = [Trace(loop.velocity_m_s, loop.force_N, "m", "measured")]
    made = {"displacement": Chart(DISPLACEMENT, FORCE, over_u, y_range=force),
            "velocity": Chart(VELOCITY, FORCE, over_v, y_range=force)}  # fmt: skip
    if loop.fitted_N is not None:
        over_u.append(Trace(loop.displacement_mm, loop.fitted_N, "p", "fitted"))
        over_v.append(Trace(loop.velocity_m_s, loop.fitted_N, "p", "fitted"))
        rest = Trace(loop.phase, _residual(loop), "e", "measured minus fitted")
        axis = f"Share of the {'record' if view.point.kind == SIGNAL else 'cycle'}"
        made["residual"] = Chart(axis, "Residual N", [rest], 610, 130, (0.0, 1.0), residual)
    return made


def _residual(loop: Loop) -> FloatArray:
    return loop.force_N if loop.fitted_N is None else loop.force_N - loop.fitted_N


def motion_of(view: PointView) -> str:
    """A point's motion as people say it: "sine, 50 mm, 1 Hz"; of what has no frequency, "road iso8608-c, 10 mm"."""
    point = view.point
    if not has_frequency(point):
        return f"{named(point)}, {1e3 * point.amplitude_m:.3g} mm"
    return motion_words(point.waveform, point.amplitude_m, point.frequency_Hz)


def motion_words(waveform: str, amplitude_m: float, frequency_Hz: float) -> str:
    """A motion as people say it: "sine, 50 mm, 1 Hz"."""
    return f"{waveform}, {1e3 * amplitude_m:.4g} mm, {frequency_Hz:.4g} Hz"


def has_frequency(point: RecordedPoint) -> bool:
    """Whether it is known by its frequency; a signal's counts how often it crosses its mean."""
    return point.kind not in {SIGNAL, HYBRID}


def named(point: RecordedPoint) -> str:
    """What moved, by name: "sine", "road iso8608-c", "hybrid test"."""
    record = str(point.test.get("record", ""))
    name = "hybrid test" if point.kind == HYBRID else point.waveform
    return name if record in {"", name} else f"{name} {record}"


def _grouped(views: Sequence[PointView], by: Callable[[PointView], K]) -> list[tuple[K, list[PointView]]]:
    order = list(dict.fromkeys(by(view) for view in views))
    return [(wanted, [view for view in views if by(view) == wanted]) for wanted in order]


REFERENCE_degC = "reference_degC"
"""Key of a fit's values: the temperature at which they hold, where a law says what another one does."""


@dataclass(frozen=True)
class Loop:
    """One cycle, thinned for drawing (k,): mm about mid-stroke, m/s, N; `fitted_N` None where there is no fit.

    `phase` runs from 0 to 1 over the cycle.
    """

    phase: FloatArray
    displacement_mm: FloatArray
    velocity_m_s: FloatArray
    force_N: FloatArray
    fitted_N: FloatArray | None


@dataclass(frozen=True)
class PointView:
    """A point, its loop (None when it cannot be drawn, and `why`), and its errors in the fit by `fit.json`'s keys.

    `placed` is the level of current (A) and the motion (amplitude in m, frequency in Hz) to which a loop belongs.
    """

    point: RecordedPoint
    loop: Loop | None
    why: str = ""
    error: Mapping[str, Any] = field(default_factory=dict)
    held_out: bool = False
    measured: Measurement | None = field(default=None, repr=False)
    placed: tuple[float, tuple[float, float]] | None = None

    @property
    def level_A(self) -> float:
        """The level of current to which the point belongs (A)."""
        return self.point.current_A if self.placed is None else self.placed[0]

    @property
    def group(self) -> str:
        """The motion to which the point belongs, in words."""
        return motion_of(self) if self.placed is None else motion_words(self.point.waveform, *self.placed[1])


def placed_views(views: Sequence[PointView], loops: Sequence[LoopCharacteristics]) -> list[PointView]:
    """The points with the level of current and the motion to which the standard tests say that they belong."""
    known = {loop.id: (loop.level_A, loop.group) for loop in loops}
    return [replace(view, placed=known.get(view.point.id)) for view in views]


def view_of(
    point: RecordedPoint, model: DamperModel | None, values: Mapping[str, float], error: Mapping[str, Any] | None,
    *, held_out: bool = False, skew: PointSkew | None = None,
) -> PointView:
    """Prepare a point for drawing; what keeps it from being drawn is said, never hidden.

    `skew` is what the campaign as a whole knows of the sensors' delays, as for the fit. `values` are those of the fit's
    parameters, and where it has a temperature law `REFERENCE_degC`.
    """
    if point.kind == "current_step":
        return PointView(point, None, "the rod stood still; the current was stepped", error or {}, held_out)
    if point.kind == "hybrid":
        return PointView(point, None, "a hybrid test: its motion has no cycles", error or {}, held_out)
    try:
        with evaluating("it"):
            measured = prepare(point, skew)
            if "eta" in values:
                measured = with_lag(measured, values["eta"])
            fitted = None if model is None else _curve_N(model, values, measured)
            loop = _middle_cycle(measured, fitted)
    except RigError as problem:
        return PointView(point, None, str(problem), error or {}, held_out)
    return PointView(point, loop, "", error or {}, held_out, measured)


def _curve_N(model: DamperModel, values: Mapping[str, float], measured: Measurement) -> FloatArray:
    """The fitted force (N), (n,), at the recorded temperatures where the fit follows them."""
    own = {name: value for name, value in values.items() if name in model.names}
    force_N = modelled_force(model, own, measured)
    if REFERENCE_degC not in values:
        return force_N
    rates = {name: values[name] for name in (VISCOUS, YIELD, COMMON) if name in values}
    return force_N + force_change_N(model, own, TemperatureLaw(values[REFERENCE_degC], rates), measured)


def _middle_cycle(measured: Measurement, fitted_N: FloatArray | None) -> Loop:
    count = len(measured.u_m)
    per_cycle = min(measured.samples_per_cycle or count, count)
    start = (count // per_cycle // 2) * per_cycle
    start = min(start, count - per_cycle)
    cyclic = measured.samples_per_cycle > 0
    chosen = start + thinned(min(per_cycle + 1, count - start), DRAWN_OF_CYCLE if cyclic else DRAWN_OF_RECORD)
    force = np.where(measured.scored, measured.force_N, np.nan)
    if fitted_N is not None and not cyclic:  # a record's ends are driven, and not judged
        fitted_N = np.where(measured.scored, fitted_N, np.nan)
    return Loop(
        phase=(chosen - start) / per_cycle, displacement_mm=1e3 * measured.u_m[chosen],
        velocity_m_s=measured.v_m_s[chosen], force_N=force[chosen],
        fitted_N=None if fitted_N is None else fitted_N[chosen],
    )
