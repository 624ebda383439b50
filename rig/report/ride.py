"""A ride study as a document: plots and tables like the c-FOA paper's Figures 12 and 13 and Table 5."""

from __future__ import annotations

import numpy as np

from rig.display import SI, Display, Shown
from rig.document import html
from rig.document.blocks import (
    Block,
    Blocks,
    Card,
    Cards,
    Column,
    Contents,
    Cover,
    Document,
    Fact,
    Facts,
    Figures,
    Head,
    Heading,
    Keys,
    Note,
    Paragraph,
    Properties,
    section,
    table,
    with_contents,
)
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, number
from rig.document.style import current_colour
from rig.document.words import FAIR, Key, Strong, Words
from rig.fits.residual_weights import RESIDUAL
from rig.signals.arrays import FloatArray
from rig.vehicle.answer import extrapolations
from rig.vehicle.response import BANDS
from rig.vehicle.ride import RideStudy

RIDE_MARK = "SIMULATED: the ride of a simulated car with fitted damper models"
UNITS = {"heave": "dB of 1 (m/s^2)/m", "pitch": "dB of 1 (rad/s^2)/m", "roll": "dB of 1 (rad/s^2)/m"}
PRINTED_dB = {"4-8 Hz": 5.0, "0-18 Hz": 12.0}
"""Largest differences of the c-FOA paper's three fits, as printed there (section 4.2)."""
SPEEDS_M_S = np.linspace(-0.3, 0.3, 121)
PAPER_FITS = tuple(f"cfoa-table5-fit{count}" for count in (1, 2, 3))
FEWEST_SAMPLES = 8
"""Monte Carlo samples from which on a band is drawn."""


def ride_page(study: RideStudy, display: Display = SI) -> str:
    """The study as a self-contained HTML page in the units of a display."""
    return html.page(ride_document(study, display))


def ride_document(study: RideStudy, display: Display = SI) -> Document:
    """The study as a document in the units of a display."""
    dampers = tuple(variant.name for variant in study.variants)
    about = ("Simulated car, dampers ", Strong(", ".join(dampers)),
             f" \N{MIDDLE DOT} {display.speed.text(study.road.speed_m_s)}")
    return Document(f"Ride: {study.car.name}", with_contents([
        Cover(f"Ride: {study.car.name} on {study.road.name}", (about,)), Contents(paper=False), _facts(study),
        *warnings(study), *differences(study), *numbers(study, display), *_curves(study, display), *_responses(study),
        *_parameters(study), *_provenance(study, display),
    ]), RIDE_MARK)  # fmt: skip


def _colours(study: RideStudy) -> dict[str, str]:
    names = [variant.name for variant in study.variants]
    return {name: current_colour(index, len(names)) for index, name in enumerate(names)}


def _facts(study: RideStudy) -> Facts:
    facts = []
    for band in BANDS:
        known = [
            (apart[0], motion, pair)
            for motion in study.own.body for pair in study.pairs()
            if (apart := study.difference("chosen", motion, band, pair)) is not None
        ]  # fmt: skip
        if known:
            value, motion, pair = max(known)
            between = " / ".join(pair)
            facts.append(Fact(f"{number(value, 3)} dB", f"largest difference in {band}: {motion}, {between}"))
    return Facts(tuple(facts))


def warnings(study: RideStudy) -> list[Note]:
    """What a reader has to know of the numbers."""
    lines = [f"{variant.name}: {variant.fit.remark}" for variant in study.variants if variant.fit.remark]
    lines += extrapolations(study)
    if study.car.estimate:
        lines.append(f"The parameters of this car were not measured: {study.car.source}.")
    if not study.step_close:
        lines.append(
            f"Even at a time step of {1e3 * study.step_s:g} ms, the results have not converged to within 1 %, because "
            "the force of a damper is nearly discontinuous."
        )
    return [Note(FAIR, line) for line in lines]


def _keys(study: RideStudy) -> Keys:
    return Keys(tuple(Key(name, colour) for name, colour in _colours(study).items()))


def _curves(study: RideStudy, display: Display) -> Blocks:
    """Force over velocity at mid-stroke (Figure 12)."""
    colours = _colours(study)
    traces = [
        Trace(
            display.speed.signed(SPEEDS_M_S), display.force.signed(variant.fit.damper.model.force_at(
                variant.fit.damper.values, SPEEDS_M_S, variant.control.current_A
            )), name=variant.name, colour=colours[variant.name],
        )
        for variant in study.variants
    ]
    speed, force = display.speed, display.force
    axes = Axis(speed.title("Velocity"), speed.unit), Axis(force.title("Force"), force.unit)
    figure = Figure(*axes, traces, 480, 320, title="Force vs. velocity")
    return [Heading("Force vs. velocity at mid-stroke"), _keys(study), Cards((Card("", (Figures((figure,)),)),))]


def _responses(study: RideStudy) -> Blocks:
    """Responses of every phase (Figures 13a to c)."""
    colours = _colours(study)
    note = (
        "Acceleration relative to the road height under the front left wheel (H1). Gaps in the curves: frequencies "
        "at which the motion does not follow the road."
    )
    parts: Blocks = [*section("Body response", note), _keys(study)]
    for phase, by_name in study.driven.items():
        cards = []
        for motion in study.own.body:
            traces = []
            for name, driven in by_name.items():
                levels = [answer.level_dB[motion] for answer in driven.responses]
                frequency_Hz = driven.responses[0].frequency_Hz
                drawn = [level for level in levels if level is not None]
                if not drawn:
                    continue
                traces.append(Trace(frequency_Hz, drawn[0], name=name, colour=colours[name]))
                if len(drawn) > FEWEST_SAMPLES:
                    for edge in band(np.array(drawn[1:])):
                        traces.append(Trace(frequency_Hz, edge, Style.OVERLAID, f"{name}, 95 %", colours[name]))
            if traces:
                axis = Axis(motion.capitalize(), UNITS[motion])
                figure = Figure(Axis("Frequency", "Hz"), axis, traces, 420, 280, title=f"{motion}, {phase}")
                cards.append(Card(Strong(motion), (Figures((figure,)),)))
        parts += [Heading(phase, 3), Cards(tuple(cards))]
    return parts


def band(drawn: FloatArray) -> FloatArray:
    """The central 95 % of samples (members, n) at each frequency, (2, n); a gap where none of them has a value."""
    edges = np.full((2, drawn.shape[1]), np.nan)
    known = np.any(np.isfinite(drawn), axis=0)
    if np.any(known):
        edges[:, known] = np.nanpercentile(drawn[:, known], (2.5, 97.5), axis=0)
    return edges


def differences(study: RideStudy) -> Blocks:
    """The largest differences of any two dampers, by motion and band; empty for one damper."""
    if not study.pairs():
        return []
    rows: list[list[Words]] = []
    for motion in study.own.body:
        for name in BANDS:
            for pair in study.pairs():
                cells: list[Words] = [motion, name, *pair]
                for phase in study.driven:
                    apart = study.difference(phase, motion, name, pair)
                    cells.append(NOTHING if apart is None else _with_interval(apart))
                rows.append(cells)
    phases = (Column(phase, "", True) for phase in study.driven)
    head: list[Head] = ["Motion", "Band", "Damper", "Against", *phases]
    note = f"In brackets: 95 % interval due to the uncertainty of the fits. {NOTHING}: not excited by the road."
    if {variant.name for variant in study.variants} == set(PAPER_FITS):
        printed = ", ".join(f"up to {value:g} dB in {name}" for name, value in PRINTED_dB.items())
        note += f" The corresponding differences printed in the paper are {printed}."
    return [*section("Largest differences, dB", note), table(head, rows)]


def _with_interval(known: tuple[float, tuple[float, float] | None], shown: Shown | None = None) -> str:
    """A value with its interval; in the unit of `shown`, if there is one."""
    value, interval = known
    if shown is not None:
        value = shown.value(value)
        interval = None if interval is None else (shown.value(interval[0]), shown.value(interval[1]))
    within = "" if interval is None else f" ({number(interval[0], 3)} to {number(interval[1], 3)})"
    return number(value, 3) + within


def numbers(study: RideStudy, display: Display = SI) -> Blocks:
    """Comfort, grip, travel, power and heat of each damper; the travel in the unit of a display."""
    travel = display.displacement
    names = {
        f"weighted_rms {motion}": f"{motion} weighted RMS, {'m/s^2' if motion == 'heave' else 'rad/s^2'}"
        for motion in study.own.body
    } | {
        "tyre_load_variation": "tyre load variation", "travel_m": f"largest travel, {travel.unit}",
        "damper_power_W": "damper power, W", "damper_heat_J": "damper heat, J",
    }  # fmt: skip
    rows = [
        [title, *(
            _with_interval(study.number(variant.name, name), travel if name == "travel_m" else None)
            for variant in study.variants
        )]
        for name, title in names.items()
    ]
    note = "Weighting to ISO 2631-1:1997: Wk for heave, We for pitch and roll."
    return [*section("Comfort, road holding, heat", note), _by_variant(study, rows)]


def _by_variant(study: RideStudy, rows: list[list[str]]) -> Block:
    head = ["Quantity", *(variant.name for variant in study.variants)]
    return table(head, rows, range(1, len(head)))


def _parameters(study: RideStudy) -> Blocks:
    """Parameters side by side (Table 5), where all dampers are of one model."""
    models = {variant.fit.damper.model.name for variant in study.variants}
    if len(models) != 1:
        return []
    model = study.variants[0].fit.damper.model
    rows = [
        [f"{parameter.name}, {parameter.unit}", *(
            number(variant.fit.damper.values[parameter.name]) for variant in study.variants
        )]
        for parameter in model.parameters if parameter.name not in RESIDUAL
    ]  # fmt: skip
    return [Heading("Parameters"), Paragraph(model.equation, small=True), _by_variant(study, rows)]


def _provenance(study: RideStudy, display: Display) -> Blocks:
    return [Heading("Car and road"), Properties({
        "car": f"{study.car.name} ({study.car.kind})", "source": study.car.source, "road": study.road.name,
        "speed": display.speed.text(study.road.speed_m_s), "step": f"{1e3 * study.step_s:g} ms",
        "natural frequencies": ", ".join(f"{value:.2f} Hz" for value in study.own.modes_Hz()),
    })]  # fmt: skip
