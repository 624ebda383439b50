"""The plan: every point is checked before any motion (PHYSICS section 1; fault row `matrix-infeasible`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

from rig.bench.model import Bench
from rig.display import SI, Display
from rig.errors import clean_text
from rig.files.display_table import display_of
from rig.matrix.feasibility import (
    Reason,
    command_limit,
    current_hints,
    reasons_against,
    sampling_hints,
    speed_that_fits,
    too_hot,
    would_fit,
)
from rig.matrix.forecast import Forecast, forecaster
from rig.matrix.lost_answers import lost_answer_hints
from rig.matrix.model import Matrix
from rig.matrix.order_by_heat import BETWEEN_POINTS_S, Thermal, load_of, thermal_of, warm_up_point
from rig.matrix.sensor_timing import skew_hints
from rig.matrix.stopping import stopping_reach
from rig.matrix.storage import NO_STORAGE, SETTLING_S, Storage, storage_of
from rig.matrix.streaming import Peaks, amplitude_hints, gap_warnings, peaks, some_points
from rig.signals.iteration_time import trials_s
from rig.signals.stopping import Reach
from rig.test_point import SIGNAL, TestPoint

HYSTERESIS = 0.3
"""Error with the expected damper before the iteration, above which forces did not converge in simulations."""


@dataclass(frozen=True)
class PlannedPoint:
    """A point and its verdict.

    `predicted_force_N` and `energy_J` (dissipated over the whole program, coil included) are None when unknown;
    `stopping_reach_m` is where a halt at any instant comes to rest, lowest and highest, in the rig's coordinate;
    `peaks` are those of the rod at the point's own amplitude, the ripple of streamed set-points included.
    `highest_peaks` bound those of every command for the point: where the amplitude is adapted, a machine that does not
    reach it is commanded more, up to where the command's own peaks reach the limits (`command_limit`).
    `would_fit_m` is the largest amplitude that makes an infeasible point feasible, None when no amplitude does;
    `would_fit_m_s` the highest speed at the point's own amplitude, where the matrix states speeds at that amplitude.
    """

    point: TestPoint
    predicted_force_N: float | None
    energy_J: float | None
    duration_s: float
    causes: tuple[Reason, ...]
    would_fit_m: float | None
    stopping_reach_m: Reach
    peaks: Peaks
    highest_peaks: Peaks
    would_fit_m_s: float | None = None

    def fits(self, display: Display) -> tuple[str, str]:
        """What would fit, rounded down, and its unit: a speed where the matrix states it at a constant amplitude.

        The value is empty where nothing fits, or nothing is to fit.
        """
        shown, si = (
            (display.speed, self.would_fit_m_s) if self.point.by_speed else (display.displacement, self.would_fit_m)
        )
        if si is None or self.feasible:
            return "", shown.unit
        value = shown.value(si)
        step = 10.0 ** (math.floor(math.log10(value)) - 3)
        return f"{step * math.floor(value / step * (1.0 + 1e-9)):.4g}", shown.unit

    def fits_text(self, display: Display) -> str:
        """`fits` in words; empty where nothing fits."""
        value, unit = self.fits(display)
        what = "highest speed at this stroke" if self.point.by_speed else "largest amplitude"
        return value and f"{what} that fits: {value} {unit}"

    @property
    def reasons(self) -> tuple[str, ...]:
        """The causes in words."""
        return tuple(clean_text(cause.text) for cause in self.causes)

    @property
    def feasible(self) -> bool:
        """Whether the machine and the specimen can do it."""
        return not self.causes

    def to_json(self) -> dict[str, Any]:
        """The keys of one entry of `points` in `rig plan --json`."""
        point = self.point
        return {
            "id": point.id,
            "waveform": point.waveform,
            "record": None if point.record is None else point.record.name,
            "amplitude_m": point.amplitude_m,
            "frequency_Hz": point.frequency_Hz,
            "current_A": point.current_A,
            "peak_speed_m_s": self.peaks.speed_m_s,
            "peak_acceleration_m_s2": self.peaks.acceleration_m_s2,
            "highest_commanded": {
                "speed_m_s": self.highest_peaks.speed_m_s, "acceleration_m_s2": self.highest_peaks.acceleration_m_s2,
            },
            "predicted_force_N": self.predicted_force_N,
            "energy_J": self.energy_J,
            "stopping_reach_m": list(self.stopping_reach_m),
            "duration_s": self.duration_s,
            "verdict": "feasible" if self.feasible else "infeasible",
            "reason": "; ".join(self.reasons) or None,
            "causes": [cause.slug for cause in self.causes],
            "would_fit": self._would_fit_json(),
        }

    def _would_fit_json(self) -> dict[str, float | None] | None:
        speed = {} if self.would_fit_m_s is None else {"speed_m_s": self.would_fit_m_s}
        return None if self.would_fit_m is None and not speed else {"amplitude_m": self.would_fit_m, **speed}


@dataclass(frozen=True)
class Plan:
    """All points in the order in which they run.

    `warnings` are hints that refuse nothing.
    `temperature_s` is forecast for warming up and cooling down from ambient temperature; 0 without a window, None where
    the heat that warms is unknown or does not suffice.
    `storage` is the disk space that the points need.
    `trials_s` is the longest duration of the trials of iterated signals; 0 without iteration.
    `display` is how people read its numbers.
    """

    points: tuple[PlannedPoint, ...]
    bench_name: str
    specimen: str
    prediction: str
    temperature_s: float | None = 0.0
    warm_up: PlannedPoint | None = None
    warnings: tuple[str, ...] = ()
    display: Display = SI
    storage: Storage = NO_STORAGE
    trials_s: float = 0.0

    @property
    def planned_points(self) -> tuple[PlannedPoint, ...]:
        """Everything that is to move: the points, and the warm-up motion where there is a temperature window."""
        return self.points if self.warm_up is None else (*self.points, self.warm_up)

    @property
    def feasible(self) -> bool:
        """Whether every motion is."""
        return all(item.feasible for item in self.planned_points)

    @property
    def duration_s(self) -> float | None:
        """Expected duration of the campaign at speed 1 (s): motion, ramps, settling, rest, trials, warming up, cooling.

        Of iterated signals the longest duration. None where the last two are unknown.
        """
        if self.temperature_s is None:
            return None
        return math.fsum(item.duration_s for item in self.points) + self.trials_s + self.temperature_s

    @property
    def energy_J(self) -> float | None:
        """Energy that all points together turn to heat (J), the warm-up's apart; None where one is unknown."""
        energies = [item.energy_J for item in self.points if item.energy_J is not None]
        return math.fsum(energies) if len(energies) == len(self.points) else None

    @property
    def recorded_s(self) -> float:
        """How long the points are recorded at speed 1 (s): motion, ramps and settling; rests are not recorded."""
        return math.fsum(item.point.motion_s + SETTLING_S for item in self.points)

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig plan --json`."""
        return {
            "points": [item.to_json() for item in self.points],
            "feasible": self.feasible,
            "duration_s": self.duration_s,
            "energy_J": self.energy_J,
            "temperature_s": self.temperature_s,
            "trials_s": self.trials_s,
            "warm_up": None if self.warm_up is None else self.warm_up.to_json(),
            "bench": self.bench_name,
            "specimen": self.specimen,
            "prediction": self.prediction,
            "warnings": list(self.warnings),
            "storage_bytes": self.storage.total,
            "endurance": endurance_json(item.point for item in self.points),
        }


def plan(matrix: Matrix, bench: Bench) -> Plan:
    """Judge every point of a matrix on a bench.

    Force is predicted from the specimen's `prior`, or bounded by its `max_force`; without either it is unknown, and
    the force interlock is what protects the rig.
    """
    specimen, display = matrix.specimen, display_of(bench.display, matrix.display)
    predict = forecaster(specimen)
    prediction = "unknown"
    if specimen.assumed is not None:
        prediction = f"from {specimen.assumed.description}"
    elif specimen.max_force_N is not None:
        prediction = f"at most {display.force.text(specimen.max_force_N)}"
    # An endurance test has thousands of equal motions.
    check = cache(lambda motion: _check(motion, matrix, bench, predict))
    running = in_running_order(matrix, bench)
    points = tuple(replace(check(point.without_name), point=point) for point in running)
    in_order = [item.point for item in points]
    hints, longest_trials_s = _iterated(in_order, matrix)
    warnings = (
        *sampling_hints(in_order, bench), *current_hints(matrix, bench), *skew_hints(in_order, bench),
        *amplitude_hints(in_order, adapted=matrix.sweep.adapt_amplitude), *gap_warnings(in_order, bench),
        *lost_answer_hints(bench), *hints,
        *(hint for name, test in matrix.endurance_tests.items() for hint in test.hints(name)),
    )
    if specimen.assumed is not None:
        warnings += specimen.assumed.hints(item.point for item in points)
    if bench.ecu.by_hand:
        currents_A = [0.0, *(item.point.first_current_A for item in points), 0.0]
        changes = sum(before_A != after_A for before_A, after_A in pairwise(currents_A))
        warnings += (
            f"the current is set manually: the operator must change it {changes} times, after setting 0 A at "
            "the start",
        )
    planned = Plan(
        points, bench.name, specimen.serial_number, prediction, warnings=warnings, display=display,
        storage=storage_of(in_order, bench), trials_s=longest_trials_s,
    )  # fmt: skip
    if matrix.temperature is None:
        return planned
    thermal = thermal_of(in_order, predict, matrix.temperature)
    warm_up = _checked_warm_up(warm_up_point(in_order, predict, matrix.temperature), thermal, matrix, bench, predict)
    waits_s = None
    if warm_up.feasible and all(item.energy_J is not None for item in (*points, warm_up)):
        loads = [load_of(point, predict) for point in in_order]
        waits_s = thermal.total_s(loads) - sum(load.duration_s + load.rest_s + BETWEEN_POINTS_S for load in loads)
    return replace(planned, temperature_s=waits_s, warm_up=warm_up)


def endurance_json(points: Iterable[TestPoint]) -> list[dict[str, Any]]:
    """The endurance tests of a plan: cycles, blocks, most cycles of a block, performance points, motion (s)."""
    tests: dict[str, dict[str, Any]] = {}
    for point in points:
        step = point.endurance
        if step is None:
            continue
        test = tests.setdefault(step.test, {
            "id": step.test, "cycles": step.total, "blocks": 0, "cycles_per_block": 0, "performance_points": 0,
            "motion_s": 0.0,
        })  # fmt: skip
        if step.block:
            test["blocks"] += 1
            test["cycles_per_block"] = max(test["cycles_per_block"], step.block_cycles)
            test["motion_s"] += point.motion_s
        else:
            test["performance_points"] += 1
    return list(tests.values())


def _iterated(points: Sequence[TestPoint], matrix: Matrix) -> tuple[tuple[str, ...], float]:
    """What precedes points whose command is iterated, in words, and its longest duration (s); empty and 0 without."""
    signals = [point for point in points if point.kind == SIGNAL]
    settings = matrix.sweep.iteration
    if settings is None or not signals:
        return (), 0.0
    targets = [(point.record_samples, point.current_A) for point in signals]
    longest_s = trials_s(
        ((record, current_A) for record, current_A in targets if record is not None), settings, between_s=SETTLING_S
    )
    hint = (
        f"{some_points(signals)}: the command is iterated to an RMS error of {100 * settings.tolerance:g} %: the "
        f"machine is identified with {settings.noise_s:g} s of noise, and up to {settings.most + 1} trials at each "
        "current precede the recorded point"
    )
    return (hint, *_force_hints(signals)), longest_s


def _force_hints(signals: Sequence[TestPoint]) -> Iterator[str]:
    """What the expected damper says of forces as targets."""
    for point in signals:
        force = None if point.record_samples is None else point.record_samples.force
        if force is None:
            continue
        text = (
            f"{point.id}: the mean, {force.offset_N:.3g} N, is subtracted from the force in the file, because a motion "
            "that produces this mean would drift; the mean of the measured force is not evaluated. With the expected "
            f"damper, the RMS error before the iteration is {100.0 * force.forecast_error:.2g} %"
        )
        if force.forecast_error > HYSTERESIS:
            text += (
                "; most of this force is hysteresis and friction, which the first command cannot compensate, so the "
                "iteration is not expected to converge. Fix: use a force with higher speeds, or a lower current"
            )
        yield text


def in_running_order(matrix: Matrix, bench: Bench) -> tuple[TestPoint, ...]:
    """The points as they run: in the matrix's order; where a person sets the current, by rising current.

    `order = "random"` stays as it is drawn: it was asked for. Points of an endurance test stay between its blocks.
    """
    points = matrix.points()
    if not bench.ecu.by_hand or matrix.sweep.order == "random" or matrix.endurance:
        return points
    return tuple(sorted(points, key=lambda point: point.first_current_A))


def _check(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> PlannedPoint:
    force_N, energy_J = predict(point)
    causes = (*reasons_against(point, force_N, matrix, bench), *too_hot(energy_J, matrix))
    return PlannedPoint(
        point=point,
        predicted_force_N=force_N,
        energy_J=energy_J,
        duration_s=point.motion_s + SETTLING_S + point.rest_s,
        causes=causes,
        would_fit_m=would_fit(point, matrix, bench, predict) if causes else None,
        stopping_reach_m=stopping_reach(point, matrix, bench),
        peaks=peaks(point, bench),
        highest_peaks=_highest_peaks(point, matrix, bench),
        would_fit_m_s=speed_that_fits(point, matrix, bench, predict) if causes and point.by_speed else None,
    )


def _highest_peaks(point: TestPoint, matrix: Matrix, bench: Bench) -> Peaks:
    """Of the largest command that the adaption of the amplitude may give for a point; its own without adaption."""
    own = peaks(point, bench)
    if not matrix.sweep.adapt_amplitude or not point.adapts:
        return own
    largest_m = max(point.amplitude_m, command_limit(point, matrix, bench)[0])
    largest = peaks(replace(point, amplitude_m=largest_m), bench)
    return Peaks(*map(max, own, largest))


def _checked_warm_up(
    warm_up: TestPoint, thermal: Thermal, matrix: Matrix, bench: Bench, predict: Forecast
) -> PlannedPoint:
    """The warm-up motion: it may heat as much as it likes, and must heat enough."""
    planned = _check(warm_up, matrix, bench, predict)
    causes = [cause for cause in planned.causes if cause.slug != "heat"]
    fits_m = planned.would_fit_m if causes else None
    ambient_degC = thermal.heat.ambient_degC
    reached_degC = ambient_degC + thermal.warm_up_W / thermal.heat.loss_W_K
    if planned.energy_J is not None and ambient_degC < thermal.low_degC and reached_degC <= thermal.low_degC:
        text = (
            f"warm-up reaches only {reached_degC:.3g} degC, but the temperature window starts at "
            f"{thermal.low_degC:.3g} degC. Fix: lower the temperature window, or specify a [temperature.warm_up] "
            "with more power"
        )
        causes.append(Reason("warm-up", text))
    limit_degC = bench.limits.coil_temperature_degC
    if thermal.high_degC > limit_degC:
        text = (
            f"[temperature] window ends at {thermal.high_degC:.3g} degC, but the bench's [limits] coil_temperature "
            f"allows at most {limit_degC:.3g} degC. Fix: lower the temperature window"
        )
        causes.append(Reason("warm-up", text))
    return replace(planned, causes=tuple(causes), would_fit_m=fits_m)
