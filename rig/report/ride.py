"""The report of a ride study: plots and tables like the c-FOA paper's Figures 12 and 13 and Table 5."""

from __future__ import annotations

import numpy as np

from rig.report.chart import Chart, Trace
from rig.report.fragment import (
    block,
    box,
    card,
    charts,
    data_list,
    fact,
    heading,
    key,
    key_line,
    number,
    page,
    table,
    text,
)
from rig.report.style import current_colour
from rig.signals.arrays import FloatArray
from rig.vehicle.answer import extrapolations
from rig.vehicle.response import BANDS
from rig.vehicle.ride import RideStudy

LEVELS = {
    "heave": "Heave, dB of 1 (m/s^2)/m", "pitch": "Pitch, dB of 1 (rad/s^2)/m", "roll": "Roll, dB of 1 (rad/s^2)/m",
}
PRINTED_dB = {"4-8 Hz": 5.0, "0-18 Hz": 12.0}
"""What the c-FOA paper prints as largest differences of its three fits (section 4.2)."""
SPEEDS_M_S = np.linspace(-0.3, 0.3, 121)
PAPER_FITS = tuple(f"cfoa-table5-fit{count}" for count in (1, 2, 3))


def ride_page(study: RideStudy) -> str:
    """One self-contained HTML page."""
    parts = [
        heading(f"Ride: {text(study.car.name)} on {text(study.road.name)}", level=1),
        _facts(study), _warnings(study), _curves(study), _responses(study), _differences(study), _numbers(study),
        _parameters(study), _provenance(study),
    ]
    return page(f"Ride: {study.car.name}", "".join(parts))


def _colours(study: RideStudy) -> dict[str, str]:
    names = [variant.name for variant in study.variants]
    return {name: current_colour(index, len(names)) for index, name in enumerate(names)}


def _facts(study: RideStudy) -> str:
    facts = []
    for band in BANDS:
        known = [
            (apart[0], motion, pair)
            for motion in study.own.body for pair in study.pairs()
            if (apart := study.difference("chosen", motion, band, pair)) is not None
        ]  # fmt: skip
        if known:
            value, motion, pair = max(known)
            between = text(" / ".join(pair))
            facts.append(fact(f"{number(value, 3)} dB", f"largest difference in {band}: {motion}, {between}"))
    return block("facts", "".join(facts))


def _warnings(study: RideStudy) -> str:
    lines = [f"{text(variant.name)}: {text(variant.fit.remark)}" for variant in study.variants if variant.fit.remark]
    lines += [text(line) for line in extrapolations(study)]
    if study.car.estimate:
        lines.append(f"The numbers of this car are an estimate: {text(study.car.source)}.")
    if not study.step_close:
        lines.append("The smallest step still changes the numbers by more than 1 %: a damper's force all but jumps.")
    return "".join(box("warn", line) for line in lines)


def _keys(study: RideStudy) -> str:
    return key_line("", "".join(key(text(name), colour) for name, colour in _colours(study).items()))


def _curves(study: RideStudy) -> str:
    """Force over velocity at mid-stroke (Figure 12)."""
    colours = _colours(study)
    traces = [
        Trace(
            SPEEDS_M_S, variant.fit.damper.model.force_at(
                variant.fit.damper.values, SPEEDS_M_S, variant.control.current_A
            ), "m", variant.name, colours[variant.name],
        )
        for variant in study.variants
    ]
    chart = Chart("Velocity m/s", "Force N", traces, 480, 320, title="Force over velocity")
    return heading("Force over velocity at mid-stroke") + _keys(study) + charts([card("", chart.svg())])


def _responses(study: RideStudy) -> str:
    """Responses of every phase (Figures 13a to c)."""
    colours = _colours(study)
    parts = [heading("Response of the body", "Acceleration for the road's height under the front left wheel (H1); gaps "
                     "where the motion does not follow the road.")]  # fmt: skip
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
                traces.append(Trace(frequency_Hz, drawn[0], "m", name, colours[name]))
                if len(drawn) > 8:
                    for edge in band(np.array(drawn[1:])):
                        traces.append(Trace(frequency_Hz, edge, "q", f"{name}, 95 %", colours[name]))
            if traces:
                chart = Chart("Frequency Hz", LEVELS[motion], traces, 420, 280, title=f"{motion}, {phase}")
                cards.append(card(f"<b>{motion}</b>", chart.svg()))
        parts.append(heading(phase, level=3) + charts(cards))
    return parts[0] + _keys(study) + "".join(parts[1:])


def band(drawn: FloatArray) -> FloatArray:
    """The 95 % of draws (members, n) at each place, (2, n); a gap where none of them has a value."""
    edges = np.full((2, drawn.shape[1]), np.nan)
    known = np.any(np.isfinite(drawn), axis=0)
    if np.any(known):
        edges[:, known] = np.nanpercentile(drawn[:, known], (2.5, 97.5), axis=0)
    return edges


def _differences(study: RideStudy) -> str:
    if not study.pairs():
        return ""
    paper = {variant.name for variant in study.variants} == set(PAPER_FITS)
    rows = []
    for motion in study.own.body:
        for band in BANDS:
            for pair in study.pairs():
                cells = [motion, band, text(" / ".join(pair))]
                for phase in study.driven:
                    apart = study.difference(phase, motion, band, pair)
                    cells.append("not excited" if apart is None else _with_interval(apart))
                rows.append(("", [*cells, f"up to {PRINTED_dB[band]:g}"] if paper else cells))
    head = ["motion", "band", "between", *study.driven, *(["printed in the paper"] if paper else [])]
    return heading("Largest differences, dB", "95 % interval from the fits' uncertainty in brackets.") + table(
        head, rows
    )


def _with_interval(known: tuple[float, tuple[float, float] | None]) -> str:
    value, interval = known
    within = "" if interval is None else f" ({number(interval[0], 3)} to {number(interval[1], 3)})"
    return number(value, 3) + within


def _numbers(study: RideStudy) -> str:
    names = {
        f"weighted_rms {motion}": f"{motion} weighted RMS, {'m/s^2' if motion == 'heave' else 'rad/s^2'}"
        for motion in study.own.body
    } | {
        "tyre_load_variation": "tyre load variation", "travel_m": "largest travel, m",
        "damper_power_W": "damper power, W", "damper_heat_J": "damper heat, J",
    }  # fmt: skip
    rows = [
        ("", [text(title), *(_with_interval(study.number(variant.name, name)) for variant in study.variants)])
        for name, title in names.items()
    ]
    return heading("Comfort, grip, heat", "Weighting of ISO 2631-1:1997: Wk for heave, We for pitch and roll.") + table(
        ["", *(text(variant.name) for variant in study.variants)], rows, range(1, len(study.variants) + 1)
    )


def _parameters(study: RideStudy) -> str:
    """Parameters side by side (Table 5), where all dampers are of one model."""
    models = {variant.fit.damper.model.name for variant in study.variants}
    if len(models) != 1:
        return ""
    model = study.variants[0].fit.damper.model
    rows = [
        ("", [text(f"{parameter.name}, {parameter.unit}"), *(
            number(variant.fit.damper.values[parameter.name]) for variant in study.variants
        )])
        for parameter in model.parameters
    ]  # fmt: skip
    return heading("Parameters", text(model.equation)) + table(
        ["", *(text(variant.name) for variant in study.variants)], rows, range(1, len(study.variants) + 1)
    )


def _provenance(study: RideStudy) -> str:
    return heading("What was driven") + data_list({
        "car": f"{study.car.name} ({study.car.kind})", "source": study.car.source, "road": study.road.name,
        "speed": f"{study.road.speed_m_s:g} m/s", "step": f"{1e3 * study.step_s:g} ms",
        "natural frequencies": ", ".join(f"{value:.2f} Hz" for value in study.own.modes_Hz()),
    })
