"""The plan: every point judged before anything moves (PHYSICS section 1; fault row `matrix-infeasible`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from rig.bench.model import Bench
from rig.matrix.forecast import Forecast, forecaster
from rig.matrix.model import Matrix
from rig.matrix.point import TestPoint
from rig.matrix.schedule import BETWEEN_POINTS_S, Thermal, load_of, thermal_of, warm_up_point
from rig.units import show

SETTLING_S = 0.5
"""Allowed for each point beside its motion: current settles, rod returns to centre, file closes."""

SAMPLES_A_CYCLE = 25
"""Fewer force samples in a cycle draw no loop."""

TOO_HOT = "its heat"

HEADROOM_M = 1e-3
"""Travel left to every position limit, for the servo's overshoot and the sensors' noise: the limits themselves trip."""

FORCE_HEADROOM = 0.05
"""Share of the force limit that a predicted force leaves, for the prediction's error and the load cell's noise."""

AMPLITUDE_STEP_M = 1e-5
"""Amplitudes that would fit are rounded down to this."""


@dataclass(frozen=True)
class PlannedPoint:
    """A point and its verdict.

    `predicted_force_N` and `energy_J` (dissipated over the whole program, coil included) are None when unknown;
    `would_fit_m` is the largest amplitude that mends an infeasible point, None when no amplitude does.
    """

    point: TestPoint
    predicted_force_N: float | None
    energy_J: float | None
    duration_s: float
    reasons: tuple[str, ...]
    would_fit_m: float | None

    @property
    def feasible(self) -> bool:
        """Whether the machine and the specimen can do it."""
        return not self.reasons

    def to_json(self) -> dict[str, Any]:
        """The keys of one entry of `points` in `rig plan --json`."""
        point = self.point
        return {
            "id": point.id,
            "waveform": point.waveform,
            "amplitude_m": point.amplitude_m,
            "frequency_Hz": point.frequency_Hz,
            "current_A": point.current_A,
            "peak_speed_m_s": point.peak_speed_m_s,
            "peak_acceleration_m_s2": point.peak_acceleration_m_s2,
            "predicted_force_N": self.predicted_force_N,
            "energy_J": self.energy_J,
            "duration_s": self.duration_s,
            "verdict": "feasible" if self.feasible else "infeasible",
            "reason": "; ".join(self.reasons) or None,
            "would_fit": None if self.would_fit_m is None else {"amplitude_m": self.would_fit_m},
        }


@dataclass(frozen=True)
class Plan:
    """All points in the order in which they run.

    `temperature_s` is forecast for warming up and cooling down from ambient temperature; 0 without a window, None where
    the heat that warms is unknown or does not suffice.
    """

    points: tuple[PlannedPoint, ...]
    bench_name: str
    specimen: str
    prediction: str
    temperature_s: float | None = 0.0
    warm_up: PlannedPoint | None = None

    @property
    def judged(self) -> tuple[PlannedPoint, ...]:
        """Everything that is to move: the points, and the warm-up motion where there is a temperature window."""
        return self.points if self.warm_up is None else (*self.points, self.warm_up)

    @property
    def feasible(self) -> bool:
        """Whether every motion is."""
        return all(item.feasible for item in self.judged)

    @property
    def duration_s(self) -> float | None:
        """Expected duration of the campaign at speed 1 (s): motion, ramps, settling, rest, warming up and cooling.

        None where the last two are unknown.
        """
        if self.temperature_s is None:
            return None
        return math.fsum(item.duration_s for item in self.points) + self.temperature_s

    @property
    def recorded_s(self) -> float:
        """How long the points are recorded at speed 1 (s): motion, ramps and settling; nobody records the rests."""
        return math.fsum(item.point.motion_s + SETTLING_S for item in self.points)

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig plan --json`."""
        return {
            "points": [item.to_json() for item in self.points],
            "feasible": self.feasible,
            "duration_s": self.duration_s,
            "temperature_s": self.temperature_s,
            "warm_up": None if self.warm_up is None else self.warm_up.to_json(),
            "bench": self.bench_name,
            "specimen": self.specimen,
            "prediction": self.prediction,
        }


def plan(matrix: Matrix, bench: Bench) -> Plan:
    """Judge every point of a matrix on a bench.

    Force is predicted from the specimen's `prior`, or bounded by its `max_force`; without either it is unknown, and
    the force interlock is what protects the rig.
    """
    specimen = matrix.specimen
    predict = forecaster(specimen)
    prediction = "unknown"
    if specimen.prior is not None:
        prediction = f"from the parameter set {specimen.prior}"
    elif specimen.max_force_N is not None:
        prediction = f"at most {show(specimen.max_force_N, 'N')}"
    points = tuple(_judge(point, matrix, bench, predict) for point in matrix.points())
    if matrix.temperature is None:
        return Plan(points, bench.name, specimen.serial_number, prediction)
    in_order = [item.point for item in points]
    thermal = thermal_of(in_order, predict, matrix.temperature)
    warm_up = _judged_warm_up(warm_up_point(in_order, predict, matrix.temperature), thermal, matrix, bench, predict)
    waits_s = None
    if warm_up.feasible and all(item.energy_J is not None for item in (*points, warm_up)):
        loads = [load_of(point, predict) for point in in_order]
        waits_s = thermal.total_s(loads) - sum(load.duration_s + load.rest_s + BETWEEN_POINTS_S for load in loads)
    return Plan(points, bench.name, specimen.serial_number, prediction, waits_s, warm_up)


def _judge(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> PlannedPoint:
    force_N, energy_J = predict(point)
    reasons = (*_reasons(point, force_N, matrix, bench), *_too_hot(point, energy_J, matrix))
    return PlannedPoint(
        point=point,
        predicted_force_N=force_N,
        energy_J=energy_J,
        duration_s=point.motion_s + SETTLING_S + point.rest_s,
        reasons=reasons,
        would_fit_m=_would_fit(point, matrix, bench, predict) if reasons else None,
    )


def _judged_warm_up(
    warm_up: TestPoint, thermal: Thermal, matrix: Matrix, bench: Bench, predict: Forecast
) -> PlannedPoint:
    """The warm-up motion: it may heat as much as it likes, and must heat enough."""
    judged = _judge(warm_up, matrix, bench, predict)
    reasons = [text for text in judged.reasons if not text.startswith(TOO_HOT)]
    fits_m = judged.would_fit_m if reasons else None
    ambient_degC = thermal.heat.ambient_degC
    reached_degC = ambient_degC + thermal.warm_up_W / thermal.heat.loss_W_K
    if judged.energy_J is not None and ambient_degC < thermal.low_degC and reached_degC <= thermal.low_degC:
        reasons.append(
            f"warm-up reaches only {reached_degC:.3g} degC, the temperature window begins at {thermal.low_degC:.3g} "
            "degC; a lower window or a stronger [temperature.warm_up] would do"
        )
    return replace(judged, reasons=tuple(reasons), would_fit_m=fits_m)


def _reasons(point: TestPoint, force_N: float | None, matrix: Matrix, bench: Bench) -> Iterator[str]:
    limits, specimen = bench.limits, matrix.specimen
    if _beyond(point.peak_speed_m_s, limits.speed_m_s):
        yield f"speed {point.peak_speed_m_s:.3g} m/s is above the bench's {limits.speed_m_s:.3g} m/s"
    if _beyond(point.peak_acceleration_m_s2, limits.acceleration_m_s2):
        reached, limit = point.peak_acceleration_m_s2, limits.acceleration_m_s2
        yield f"acceleration {reached:.3g} m/s^2 is above the bench's {limit:.3g} m/s^2"
    low, high = limits.position_m
    room = f"; {show(HEADROOM_M, 'mm')} must be left at each end"
    if _beyond(point.amplitude_m, _room_m(point, bench)):
        yield f"{_span(point)} leaves the bench's {show(low, 'mm')} to {show(high, 'mm')}{room}"
    if _beyond(point.amplitude_m, specimen.stroke_m / 2.0 - HEADROOM_M):
        travel_m, stroke_m = 2.0 * point.amplitude_m, specimen.stroke_m
        yield f"{show(travel_m, 'mm')} of travel exceed the specimen's stroke {show(stroke_m, 'mm')}{room}"
    if force_N is not None and _beyond(force_N, _allowed_force_N(bench)):
        yield (
            f"predicted force {force_N:.4g} N is above the bench's {limits.force_N:.4g} N less "
            f"{100 * FORCE_HEADROOM:g} % of headroom"
        )
    yield from _independent_of_amplitude(point, matrix, bench)


def command_limit(point: TestPoint, bench: Bench) -> tuple[float, str]:
    """The largest amplitude (m) that speed and acceleration let be commanded for a point's motion, and which of them.

    The same limits as the plan's. The force's is none of them: that follows the motion reached, not the one commanded.
    """
    limits, one_metre = bench.limits, replace(point, amplitude_m=1.0)
    allowed = {
        f"the bench's speed limit, {limits.speed_m_s:.3g} m/s": limits.speed_m_s / one_metre.peak_speed_m_s,
        f"the bench's acceleration limit, {limits.acceleration_m_s2:.3g} m/s^2": limits.acceleration_m_s2
        / one_metre.peak_acceleration_m_s2,
    }
    what = min(allowed, key=lambda name: allowed[name])
    return allowed[what], what


def command_room(matrix: Matrix, bench: Bench) -> tuple[float, float, str]:
    """Lowest and highest position (m) that may be commanded, headroom taken off, and what sets them, in words."""
    (low_m, high_m), specimen = bench.limits.position_m, matrix.specimen
    half_m = 0.5 * specimen.stroke_m
    low_m, high_m = max(low_m, specimen.mid_stroke_m - half_m), min(high_m, specimen.mid_stroke_m + half_m)
    where = f"the positions that bench and specimen allow, {show(low_m, 'mm')} to {show(high_m, 'mm')}"
    return low_m + HEADROOM_M, high_m - HEADROOM_M, where


def _too_hot(point: TestPoint, energy_J: float | None, matrix: Matrix) -> Iterator[str]:
    temperature = matrix.temperature
    if temperature is None or energy_J is None:
        return
    low_degC, high_degC = temperature.window_degC
    coldest_degC = max(low_degC, temperature.ambient_degC)
    rise_K, width_K = energy_J / temperature.heat_capacity_J_K, high_degC - coldest_degC
    if _beyond(rise_K, width_K):
        wide = "wide above ambient" if coldest_degC > low_degC else "wide"
        yield f"{TOO_HOT} would warm the damper by {rise_K:.3g} K; the temperature window is {width_K:.3g} K {wide}"


def _independent_of_amplitude(point: TestPoint, matrix: Matrix, bench: Bench) -> Iterator[str]:
    if _beyond(point.current_A, bench.limits.current_A):
        yield f"current {point.current_A:.3g} A is above the bench's {bench.limits.current_A:.3g} A"
    own = matrix.specimen.max_current_A
    if own is not None and _beyond(point.current_A, own):
        yield f"current {point.current_A:.3g} A is above the specimen's {own:.3g} A"
    if point.kind == "current_step":
        return
    rate_Hz = min(bench.load_cell.rate_Hz, bench.lvdt.rate_Hz)
    if _beyond(SAMPLES_A_CYCLE * point.frequency_Hz, rate_Hz):
        yield (
            f"{rate_Hz / point.frequency_Hz:.3g} samples a cycle at {rate_Hz:.4g} Hz; a loop needs {SAMPLES_A_CYCLE}"
        )


def _room_m(point: TestPoint, bench: Bench) -> float:
    """The largest amplitude the bench's position limits leave about the point's centre (m)."""
    low, high = bench.limits.position_m
    return min(high - point.centre_m, point.centre_m - low) - HEADROOM_M


def _allowed_force_N(bench: Bench) -> float:
    return bench.limits.force_N * (1.0 - FORCE_HEADROOM)


def _span(point: TestPoint) -> str:
    return f"{show(point.centre_m - point.amplitude_m, 'mm')} to {show(point.centre_m + point.amplitude_m, 'mm')}"


def _beyond(value: float, limit: float) -> bool:
    """Above the limit by more than rounding."""
    return value > limit + 1e-9 * max(1.0, abs(limit))


def _would_fit(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> float | None:
    """The largest amplitude, rounded down, with which the point becomes feasible; None when none does."""
    if any(True for _ in _independent_of_amplitude(point, matrix, bench)):
        return None
    one_metre = replace(point, amplitude_m=1.0)
    amplitude_m = min(
        point.amplitude_m,
        bench.limits.speed_m_s / one_metre.peak_speed_m_s,
        bench.limits.acceleration_m_s2 / one_metre.peak_acceleration_m_s2,
        _room_m(point, bench),
        matrix.specimen.stroke_m / 2.0 - HEADROOM_M,
    )
    steps = math.floor(amplitude_m / AMPLITUDE_STEP_M + 1e-6)
    steps = _largest_within_force(point, steps, matrix, bench, predict)
    return None if steps <= 0 else round(steps * AMPLITUDE_STEP_M, 6)


def _largest_within_force(point: TestPoint, steps: int, matrix: Matrix, bench: Bench, predict: Forecast) -> int:
    """Bisect for the largest number of amplitude steps whose predicted force and heat are allowed; 0 when none is."""

    def fits(count: int) -> bool:
        smaller = replace(point, amplitude_m=count * AMPLITUDE_STEP_M)
        force_N, energy_J = predict(smaller)
        cool = not any(True for _ in _too_hot(smaller, energy_J, matrix))
        return cool and (force_N is None or not _beyond(force_N, _allowed_force_N(bench)))

    if steps <= 0 or fits(steps):
        return steps
    low, high = 0, steps
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
