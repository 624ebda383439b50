"""Paper 1, section 4.2: a car with the fits of c-FOA, GA and PSO, printed and of this study: Figures 12 and 13."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rig.dampers import model
from rig.document.figure import Axis, Figure, Panels, Style, Trace
from rig.document.style import category_colour
from rig.report.ride import UNITS, PRINTED_dB
from rig.study.loop_figures import HALF, WHOLE
from rig.study.outputs import Cell, Table
from rig.study.recordings import TABLE1_AMPLITUDE_M
from rig.study.settings import TITLES, Lines, best_lines
from rig.study.study_file import StudyFile
from rig.vehicle.car import load_car
from rig.vehicle.fitted_damper import FittedDamper, fitted_damper
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper
from rig.vehicle.response import BANDS
from rig.vehicle.ride import NotComparable, RideStudy, ride_study
from rig.vehicle.road_file import load_road

PRINTED = {"c_foa": "cfoa-table5-fit1", "ga": "cfoa-table5-fit2", "pso": "cfoa-table5-fit3"}
CAR, ROAD = "compact-suv", "paper-sweep"
FREQUENCY_HZ, RATE_HZ = 0.5, 1000.0
"""Of the sine behind Figure 12: that of Figure 10."""
ETA_1_S = 25.0
"""Of the coil, as the paper prints it: tests at constant current do not determine it; the ride's is constant too."""


@dataclass(frozen=True)
class Rides:
    """The same ride with the printed fits and with this study's.

    Attributes:
        printed: With Table 5's parameters.
        ours: With each method's best of this study; None where `reason` says why.
        reason: Empty, or why there is no such ride.
    """

    printed: RideStudy
    ours: RideStudy | None
    reason: str = ""

    @property
    def named(self) -> list[tuple[str, RideStudy]]:
        """The rides by the names of their fits."""
        return [("printed fits", self.printed), *([("this study's fits", self.ours)] if self.ours else [])]


def rides(study: StudyFile, results: Lines) -> Rides | None:
    """Drive the shipped car over the paper's sweep with every fit; about 3 s of CPU.

    Args:
        study: The study.
        results: Result lines by key.

    Returns:
        The rides, None where the study does not ask.
    """
    if study.ride is None:
        return None
    printed = [fitted_damper(name, 0) for name in PRINTED.values()]
    titles = [f"{TITLES[method]}, printed" for method in PRINTED]
    named = [FittedDamper(title, fit.damper) for title, fit in zip(titles, printed, strict=True)]
    control = Control("passive", current_A=study.ride.current_A)
    car, road = load_car(CAR), load_road(ROAD)
    ours = _own_fits(study, results)
    first = ride_study(car, road, named, [control])
    if len(ours) < 2:
        return Rides(first, None, "fewer than two of c-FOA, GA and PSO were run with the asymmetric model")
    try:
        return Rides(first, ride_study(car, road, ours, [control]))
    except NotComparable as error:
        return Rides(first, None, str(error))


def _own_fits(study: StudyFile, results: Lines) -> list[FittedDamper]:
    if study.comparison.models[0] != "asymmetric":
        return []
    damper = model("asymmetric", study.comparison.hysteresis)
    return [
        FittedDamper(f"{TITLES[method]}, this study", CornerDamper(damper, {**line["parameters"], "eta": ETA_1_S}))
        for method, line in best_lines(study, results).items()
        if method in PRINTED
    ]


def ride_table(driven: Rides) -> Table:
    """The largest differences of any two fits (dB), by motion and band, beside what the paper says.

    Args:
        driven: The rides.
    """
    rows = []
    for motion in driven.printed.own.body:
        for band in BANDS:
            cells: list[Cell] = [motion, band]
            for _, ride in driven.named:
                cells += largest(ride, motion, band)
            rows.append((*cells, PRINTED_dB[band]))
    columns: tuple[str, ...] = ("motion", "band")
    for name, _ in driven.named:
        columns += (f"{name} / dB", "between")
    note = (
        f"Car: {driven.printed.car.name} (an estimate); road: {driven.printed.road.name}. The paper does not state the "
        "parameters of the car, the duration and phase of the sweep, or the current; the current here is "
        f"{driven.printed.variants[0].control.current_A:g} A. The 0-18 Hz band starts at 0.5 Hz; the paper states 12 "
        f"dB for \"higher frequencies\". `rig ride {' '.join(PRINTED.values())}` shows more. {driven.reason}"
    ).strip()
    title = "Largest difference in the car's response between any two of the c-FOA, GA and PSO fits"
    return Table("table-x-ride", "Section 4.2", title, (*columns, "paper, up to / dB"), tuple(rows), note)


def largest(ride: RideStudy, motion: str, band: str) -> tuple[float | None, str]:
    """Largest difference (dB) of any two fits, and their names.

    Args:
        ride: One of the rides.
        motion: `heave`, `pitch` or `roll`.
        band: One of `BANDS`.

    Returns:
        None and no name for a motion that does not follow the road.
    """
    apart = [
        (difference[0], " / ".join(name.partition(", ")[0] for name in pair))
        for pair in ride.pairs()
        if (difference := ride.difference("chosen", motion, band, pair)) is not None
    ]
    return max(apart) if apart else (None, "")


def _by_method(driven: Rides) -> Iterator[tuple[str, RideStudy, Style, str]]:
    """Every fit: its name, its ride, line style and colour; one colour for each method."""
    for (_, ride), style in zip(driven.named, (Style.MEASURED, Style.FITTED), strict=False):
        for variant in ride.variants:
            method = variant.name.partition(", ")[0]
            yield variant.name, ride, style, category_colour([TITLES[name] for name in PRINTED].index(method))


def ride_figures(driven: Rides) -> dict[str, Figure | Panels]:
    """Figure 12, force over velocity, and Figure 13, responses and road.

    Args:
        driven: The rides.
    """
    return {"figure-12": _force_figure(driven), "figure-13": _response_figure(driven)}


def _force_figure(driven: Rides) -> Figure:
    omega = 2.0 * np.pi * FREQUENCY_HZ
    phase = omega * np.arange(0.0, 1.0 / FREQUENCY_HZ, 1.0 / RATE_HZ)
    u_m, v_m_s = TABLE1_AMPLITUDE_M * np.sin(phase), omega * TABLE1_AMPLITUDE_M * np.cos(phase)
    traces, title = [], ""
    for name, ride, style, colour in _by_method(driven):
        variant = next(one for one in ride.variants if one.name == name)
        damper, current_A = variant.fit.damper, variant.control.current_A
        force_N = damper.model.force(damper.values, u_m, v_m_s, -(omega**2) * u_m, current_A, 1.0 / RATE_HZ)
        traces.append(Trace(v_m_s, force_N, style, name, colour))
        title = f"I = {current_A:g} A, {FREQUENCY_HZ:g} Hz, {1e3 * TABLE1_AMPLITUDE_M:g} mm"
    return Figure(Axis("Velocity", "m/s"), Axis("Force", "N"), traces, WHOLE, 340, title, legend=True)


def _response_figure(driven: Rides) -> Panels:
    made = list[Figure]()
    for motion in driven.printed.own.body:
        traces = []
        for name, ride, style, colour in _by_method(driven):
            response = ride.driven["chosen"][name].responses[0]
            level_dB = response.level_dB[motion]
            if level_dB is not None:
                traces.append(Trace(response.frequency_Hz, level_dB, style, name, colour))
        axis = Axis(motion.capitalize(), UNITS[motion])
        made.append(Figure(Axis("Frequency", "Hz"), axis, traces, HALF, 300, legend=not made))
    time_s, height_m, _ = driven.printed.road.under(driven.printed.car, driven.printed.step_s)
    height = Trace(time_s[::5], 1e3 * height_m[::5, 0], Style.THIN)
    made.append(Figure(Axis("Time", "s"), Axis("Road, front left wheel", "mm"), [height], HALF, 300))
    return Panels(tuple(made), title="Response of the car")
