"""The order `by heat`: the order of points that keeps the damper inside its temperature window in the shortest time.

Every point must start warm enough and end cool enough; otherwise the damper is warmed by a motion or left to cool
first. The duration of an order is computed exactly from the heat model; good orders are improved by moving and swapping
single points until no change helps. Deterministic: the same file gives the same order.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rig.signals.waveform import SINE
from rig.test_point import LOOP, TestPoint

if TYPE_CHECKING:
    from rig.matrix.forecast import Forecast
    from rig.matrix.sections import Temperature

BETWEEN_POINTS_S = 0.5
SEARCH_STEPS = 400_000
"""Points evaluated in the search from one order: about half a second."""
MOST_GREEDY = 1000
"""Beyond so many points the greedy order, whose time grows with their square, is left out: it would take seconds."""
MIN_GAIN_S = 1e-6
UNREACHABLE_S = 1e7


@dataclass(frozen=True)
class HeatModel:
    """How a damper warms and cools: one heat capacity C, one loss h to ambient Ta (PHYSICS section 11), solved exactly.

    `C T' = P - h (T - Ta)`, so that T goes to `Ta + P/h` with the time constant `C/h`.
    """

    capacity_J_K: float = 1500.0
    loss_W_K: float = 5.0
    ambient_degC: float = 23.0

    def after(self, start_degC: float, power_W: float, duration_s: float) -> float:
        """Temperature (degC) after `duration_s` seconds under constant power (W)."""
        final_degC = self.ambient_degC + power_W / self.loss_W_K
        return final_degC + (start_degC - final_degC) * math.exp(-duration_s * self.loss_W_K / self.capacity_J_K)

    def time_to(self, target_degC: float, start_degC: float, power_W: float = 0.0) -> float:
        """Seconds under constant power until the target is reached from `start_degC`; inf when it never is."""
        final_degC = self.ambient_degC + power_W / self.loss_W_K
        share = (start_degC - final_degC) / (target_degC - final_degC) if target_degC != final_degC else math.inf
        if start_degC == target_degC:
            return 0.0
        if not 1.0 <= share < math.inf:
            return math.inf
        return math.log(share) * self.capacity_J_K / self.loss_W_K


@dataclass(frozen=True)
class Load:
    """One point as the heat model sees it: duration (s), power while it runs (W), rest after it (s)."""

    duration_s: float
    power_W: float
    rest_s: float = 0.0


@dataclass(frozen=True)
class Thermal:
    """What does not depend on the order.

    Attributes:
        heat: the damper.
        low_degC: no point begins below; `high_degC`: no point ends above.
        start_degC: where the campaign begins.
        warm_up_W: power of the warm-up motion at full amplitude.
    """

    heat: HeatModel
    low_degC: float
    high_degC: float
    start_degC: float
    warm_up_W: float

    def total_s(self, loads: Sequence[Load]) -> float:
        """Duration of a campaign in this order: motion, rests, warming up, cooling down (s)."""
        now_degC, total_s = self.start_degC, 0.0
        for load in loads:
            waited_s, now_degC = self.step(now_degC, load)
            total_s += waited_s + load.duration_s + load.rest_s + BETWEEN_POINTS_S
        return total_s

    def step(self, now_degC: float, load: Load) -> tuple[float, float]:
        """Seconds of warming or cooling before a point, and the temperature after its rest (degC)."""
        highest = self.highest_start(load)
        waited_s = 0.0
        if now_degC < self.low_degC:
            waited_s = min(UNREACHABLE_S, self.heat.time_to(self.low_degC, now_degC, self.warm_up_W))
            now_degC = self.low_degC
        elif now_degC > highest:
            waited_s = min(UNREACHABLE_S, self.heat.time_to(highest, now_degC))
            now_degC = highest
        hot = self.heat.after(now_degC, load.power_W, load.duration_s)
        return waited_s, self.heat.after(hot, 0.0, load.rest_s + BETWEEN_POINTS_S)

    def highest_start(self, load: Load) -> float:
        """Largest temperature (degC) from which the point still ends inside the window; never below its lower end."""
        final_degC = self.heat.ambient_degC + load.power_W / self.heat.loss_W_K
        kept = math.exp(-load.duration_s * self.heat.loss_W_K / self.heat.capacity_J_K)
        start_degC = final_degC + (self.high_degC - final_degC) / kept
        return max(self.low_degC, min(self.high_degC, start_degC))


def by_heat(points: tuple[TestPoint, ...], forecast: Forecast, temperature: Temperature) -> tuple[TestPoint, ...]:
    """The points in the fastest order found; the order as written where no other is faster.

    Args:
        points: as written.
        forecast: force (N) and heat (J) of a point.
        temperature: window and heat model of the matrix file.
    """
    loads = [load_of(point, forecast) for point in points]
    order = fastest_order(loads, thermal_of(points, forecast, temperature))
    return tuple(points[index] for index in order)


def load_of(point: TestPoint, forecast: Forecast) -> Load:
    """A point's load; unknown heat counts as none."""
    _, energy_J = forecast(point)
    return Load(point.motion_s, (energy_J or 0.0) / point.motion_s, point.rest_s)


def thermal_of(points: Sequence[TestPoint], forecast: Forecast, temperature: Temperature) -> Thermal:
    """The order-independent part, for a damper that begins at ambient temperature."""
    warm = replace(warm_up_point(points, forecast, temperature), ramp_in_cycles=0.0, ramp_out_cycles=0.0)
    return Thermal(
        heat=heat_model(temperature),
        low_degC=temperature.window_degC[0],
        high_degC=temperature.window_degC[1],
        start_degC=temperature.ambient_degC,
        warm_up_W=load_of(warm, forecast).power_W,
    )


def heat_model(temperature: Temperature) -> HeatModel:
    """The heat model a matrix file declares."""
    return HeatModel(temperature.heat_capacity_J_K, temperature.heat_loss_W_K, temperature.ambient_degC)


def warm_up_point(points: Sequence[TestPoint], forecast: Forecast, temperature: Temperature) -> TestPoint:
    """The motion that warms: as written, else the loop with the largest forecast power.

    Where heat is unknown, peak speed times (1 + current) stands for it.
    """
    warm_up = temperature.warm_up
    loops = [point for point in points if point.kind == LOOP] or list(points)
    if warm_up is not None:
        return TestPoint(
            "warm-up",
            SINE.name,
            *warm_up.motion,
            warm_up.current_A,
            centre_m=points[0].centre_m,
        )

    def power(point: TestPoint) -> tuple[float, float]:
        return load_of(point, forecast).power_W, point.peak_speed_m_s * (1.0 + point.current_A)

    best = max(loops, key=power)
    waveform, amplitude_m = best.waveform, best.amplitude_m
    if best.record is not None:  # a sine that is no faster and goes no further
        waveform = SINE.name
        amplitude_m = min(amplitude_m, best.peak_speed_m_s / (SINE.peak_velocity * best.frequency_Hz))
    return TestPoint("warm-up", waveform, amplitude_m, best.frequency_Hz, best.current_A, centre_m=best.centre_m)


def fastest_order(loads: Sequence[Load], thermal: Thermal) -> tuple[int, ...]:
    """Indices of the loads in the fastest order found."""
    written = tuple(range(len(loads)))

    def total_s(order: Sequence[int]) -> float:
        return thermal.total_s([loads[index] for index in order])

    rising = tuple(sorted(written, key=lambda index: loads[index].power_W))
    starts = [written, rising, rising[::-1], _folded(rising)]
    if len(loads) <= MOST_GREEDY:
        starts.append(_greedy(loads, thermal))
    starts += [_improved(order, total_s) for order in starts]
    best = min(starts, key=total_s)
    return written if total_s(written) <= total_s(best) + MIN_GAIN_S else best


def _folded(rising: tuple[int, ...]) -> tuple[int, ...]:
    """Hot and cold points in turn."""
    half = (len(rising) + 1) // 2
    pairs = itertools.zip_longest(rising[::-1][:half], rising[: len(rising) - half])
    return tuple(index for pair in pairs for index in pair if index is not None)


def _greedy(loads: Sequence[Load], thermal: Thermal) -> tuple[int, ...]:
    """Always the hottest point that needs no waiting; where all need some, the one that needs least."""
    now_degC, left, order = thermal.start_degC, set(range(len(loads))), []
    while left:
        waits = {index: thermal.step(now_degC, loads[index]) for index in sorted(left)}
        chosen = min(waits, key=lambda index: (waits[index][0], -loads[index].power_W, index))
        now_degC = waits[chosen][1]
        order.append(chosen)
        left.remove(chosen)
    return tuple(order)


def _improved(order: tuple[int, ...], total_s: Callable[[Sequence[int]], float]) -> tuple[int, ...]:
    """Exchange and move single points as long as that makes the order faster."""
    best, best_s = list(order), total_s(order)
    left = SEARCH_STEPS // max(1, len(order))
    improved = True
    while improved:
        improved = False
        for first, second in itertools.combinations(range(len(best)), 2):
            left -= 3
            if left < 0:
                return tuple(best)
            for trial in _neighbours(best, first, second):
                trial_s = total_s(trial)
                if trial_s < best_s - MIN_GAIN_S:
                    best, best_s, improved = trial, trial_s, True
    return tuple(best)


def _neighbours(order: list[int], first: int, second: int) -> list[list[int]]:
    """The order with two points exchanged, with the first moved behind the second, and the other way round."""
    exchanged = order.copy()
    exchanged[first], exchanged[second] = order[second], order[first]
    later = order[:first] + order[first + 1 : second + 1] + [order[first]] + order[second + 1 :]
    earlier = [*order[:first], order[second], *order[first:second], *order[second + 1 :]]
    return [exchanged, later, earlier]
