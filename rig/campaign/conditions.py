"""Under what conditions a point is measured: amplitude tolerance, temperature window, magnetic history. Pure values.

Made once from matrix, bench and plan (`conditions_of`); the sequencer asks it, nothing here knows a device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from rig.bench.model import Bench
from rig.campaign.adaptation import Ceiling
from rig.matrix.feasibility import command_limit, command_room
from rig.matrix.forecast import forecaster
from rig.matrix.model import Matrix
from rig.matrix.point import TestPoint
from rig.matrix.schedule import Load, Thermal, load_of, thermal_of, warm_up_point

DEMAGNETISING_RATIO = 0.7
DEMAGNETISED_A = 0.05
LONGEST_WARM_UP_PROGRAM_S = 60.0
FEWEST_WARM_UP_CYCLES = 3
UNKNOWN_WARM_UP_S = 10.0
LONGEST_GROWTH = 2.0
"""Of a warm-up program over the one before: a temperature read to 0.1 K says little of the pace."""
WARM_UP_MARGIN_K = 0.3
"""Warmed a little beyond the window's lower end, so that the rod's return does not cost another program."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """What every point of a campaign must find. Made once and the same object ever after.

    Attributes:
        tolerance: allowed deviation of the amplitude, relative; None: the command is not compensated.
        ceilings: by point id, what may be commanded.
        thermal: temperature window and heat model; None without a window.
        loads: by point id, its heat.
        warm_up: the motion that warms; None without a window.
        longest_s: longest warming up or cooling down before a point or a restart (s, rig's clock).
        demagnetise: the coil's core is demagnetised before another current.
    """

    tolerance: float | None = None
    ceilings: tuple[tuple[str, Ceiling], ...] = ()
    thermal: Thermal | None = None
    loads: tuple[tuple[str, Load], ...] = ()
    warm_up: TestPoint | None = None
    longest_s: float = 3600.0
    demagnetise: bool = False

    def ceiling(self, point: TestPoint) -> Ceiling:
        """What may be commanded for a point."""
        return dict(self.ceilings).get(point.id, Ceiling())

    def highest_start(self, point: TestPoint) -> float:
        """Largest temperature (degC) at which the point may begin; inf without a window."""
        if self.thermal is None:
            return math.inf
        return self.thermal.highest_start(dict(self.loads).get(point.id, Load(point.motion_s, 0.0)))

    def warm_up_program(
        self, now_degC: float, before: tuple[float, float] | None = None
    ) -> tuple[TestPoint, float] | None:
        """The next warm-up program from a temperature (degC), and its motion (s); None without a window.

        The forecast is corrected by doing: where `before`, the last program's motion (s) and the temperature it began
        at (degC), warmed less than forecast, the next one is longer, up to twice as long. A damper near the temperature
        that the motion can hold would never arrive by programs that shorten as it comes closer.
        """
        if self.thermal is None or self.warm_up is None:
            return None
        thermal, period_s = self.thermal, 1.0 / self.warm_up.frequency_Hz
        goal_degC = min(thermal.low_degC + WARM_UP_MARGIN_K, 0.5 * (thermal.low_degC + thermal.high_degC))
        needed_s = thermal.heat.time_to(goal_degC, now_degC, thermal.warm_up_W)
        needed_s = UNKNOWN_WARM_UP_S if math.isinf(needed_s) else needed_s
        if before is not None:
            needed_s = max(needed_s, _at_the_pace_of(before, now_degC, goal_degC))
        needed_s = min(needed_s, LONGEST_WARM_UP_PROGRAM_S)
        program = replace(self.warm_up, cycles=max(FEWEST_WARM_UP_CYCLES, math.ceil(needed_s / period_s)))
        return program, program.motion_s


def _at_the_pace_of(before: tuple[float, float], now_degC: float, goal_degC: float) -> float:
    """How long the motion takes to a goal if it warms as it last did (s); at most twice what it last took."""
    lasted_s, from_degC = before
    longest_s = LONGEST_GROWTH * lasted_s
    gained_K = now_degC - from_degC
    return longest_s if gained_K <= 0.0 else min(longest_s, lasted_s * (goal_degC - now_degC) / gained_K)


NO_CONDITIONS = Conditions()


def conditions_of(matrix: Matrix, bench: Bench) -> Conditions:
    """The conditions a matrix asks for on a bench."""
    points, temperature = matrix.points(), matrix.temperature
    found = Conditions(
        tolerance=matrix.sweep.amplitude_tolerance if matrix.sweep.adapt_amplitude else None,
        ceilings=tuple((point.id, _ceiling(point, matrix, bench)) for point in points if point.kind == "loop"),
        demagnetise=matrix.campaign.demagnetise,
    )
    if temperature is None:
        return found
    forecast = forecaster(matrix.specimen)
    return replace(
        found,
        thermal=thermal_of(points, forecast, temperature),
        loads=tuple((point.id, load_of(point, forecast)) for point in points),
        warm_up=warm_up_point(points, forecast, temperature),
        longest_s=temperature.longest_s,
    )


def _ceiling(point: TestPoint, matrix: Matrix, bench: Bench) -> Ceiling:
    amplitude_m, what = command_limit(point, bench)
    low_m, high_m, where = command_room(matrix, bench)
    return Ceiling(amplitude_m, what, low_m, high_m, where)


def demagnetising_currents(largest_A: float) -> tuple[float, ...]:
    """Currents (A) of alternating sign and falling size that take a core's remanence away, 0 last."""
    steps = max(0, math.ceil(math.log(DEMAGNETISED_A / largest_A) / math.log(DEMAGNETISING_RATIO)))
    sizes = [largest_A * DEMAGNETISING_RATIO**number for number in range(1, steps + 1)]
    return (*(size if number % 2 else -size for number, size in enumerate(sizes)), 0.0)
