"""Response time of the damper: recorded steps of the current at constant velocity, from the samples to the times.

A step counts where it was made while the rod moved straight on: the constant part of its half stroke is read from the
measured motion, whatever the exact start of the motion was. Times count from the command where host and devices run at
the same rate; else, in simulated runs faster than real time, from the instant at which the measured current leaves its
level.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.errors import RigError, evaluating
from rig.fits.plain import plain
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.sensor_filter import DELAY_TIMES_BANDWIDTH
from rig.signals.step_response.analysis import step_response
from rig.signals.step_response.onset import onsets
from rig.signals.step_response.records import Record, Seen
from rig.signals.step_response.result import LEVEL_NAMES, StepResponse, TimeResult
from rig.signals.straight_steps import BASELINE_SHARE, StepsInMotion, StraightStep, steps_in_motion
from rig.test_point import RESPONSE

COMMAND, CURRENT = "command", "current"
"""What the times count from."""
HOST_STD_S = 0.0005
"""Standard uncertainty of a command's host time on the controller's clock: what the delays on both wires leave open."""
PLACES = 251
"""Of a curve in a figure."""


@dataclass(frozen=True)
class Curve:
    """A step for a figure, mean over its repeats.

    Attributes:
        time_s: (n,) s after the origin.
        force, current: (n,) shares of the step; NaN where nothing was recorded.
        fit: (n,) the fitted response of the force.
    """

    time_s: FloatArray
    force: FloatArray
    current: FloatArray
    fit: FloatArray


@dataclass(frozen=True)
class ResponseTest:
    """The steps from one current to another at one velocity.

    Attributes:
        id: of the point.
        velocity_m_s: mean velocity of the straight parts, positive in rebound.
        from_A, to_A: currents.
        steps: number of steps used; `discarded` of those that were not.
        origin: what the times count from: the `command`, or the start of the measured `current`.
        origin_std_s: standard uncertainty of that on the time base of the force (s).
        force: response of the force.
        current: response of the measured coil current; None where none is measured.
        behind_s: mean delay of the force behind the current, and its standard error (s); NaN where unknown.
        window_s: time over which the force was observed after a step (s).
        sample_s: sampling intervals of force and current (s).
        curve: for a figure.
    """

    id: str
    velocity_m_s: float
    from_A: float
    to_A: float
    steps: int
    discarded: int
    origin: str
    origin_std_s: float
    force: StepResponse
    current: StepResponse | None
    behind_s: tuple[float, float]
    window_s: float
    sample_s: tuple[float, float]
    curve: Curve | None = None

    @property
    def rises(self) -> bool:
        """Whether the current is switched on (away from 0)."""
        return abs(self.to_A) > abs(self.from_A)

    @property
    def direction(self) -> str:
        """Of the rod: `rebound` or `compression`."""
        return "rebound" if self.velocity_m_s > 0.0 else "compression"

    def best(self, place: int) -> TimeResult:
        """Time of the force to one of `LEVELS`: without a model where that is measured, else by the fit."""
        return self.force.best(place)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        shown: dict[str, Any] = plain({
            "id": self.id, "velocity_m_s": self.velocity_m_s, "direction": self.direction, "from_A": self.from_A,
            "to_A": self.to_A, "switched": "on" if self.rises else "off", "steps": self.steps,
            "discarded": self.discarded, "origin": self.origin, "origin_std_s": self.origin_std_s,
            "window_s": self.window_s, "force_sample_s": self.sample_s[0],
            "current_sample_s": self.sample_s[1], "force": _response_json(self.force, "N"),
            "current": None if self.current is None else _response_json(self.current, "A"),
            "behind_current": None if math.isnan(self.behind_s[0]) else {
                "value_s": self.behind_s[0], "std_s": self.behind_s[1],
            },
        })
        return shown


def _response_json(response: StepResponse, unit: str) -> dict[str, Any]:
    """A response for `plain`."""
    return {
        f"step_{unit}": response.size, f"step_std_{unit}": response.size_std,
        f"noise_{unit}": response.noise, "noise_correlation": response.correlation,
        "dead_time": _time_json(response.dead), "lag": _time_json(response.lag),
        "fit": {name: _time_json(time) for name, time in zip(LEVEL_NAMES, response.fit, strict=True)},
        "crossing": {name: _time_json(time) for name, time in zip(LEVEL_NAMES, response.crossing, strict=True)},
        "stated": {
            name: {**_time_json(response.best(place)), "method": response.method(place)}
            for place, name in enumerate(LEVEL_NAMES)
        },
        "order": response.order, "second_lag": _time_json(response.second_lag), "overshoots": response.overshoots,
        "first_order": response.fits and response.order == 1, "fit_describes": response.fits,
        "repeats_scatter": response.scatters, "why": response.why or None,
    }


def _time_json(time: TimeResult) -> dict[str, Any]:
    return {
        "state": str(time.state), "value_s": time.value_s if time.measured else None,
        "std_s": time.std_s if time.measured else None, "low_s": time.low_s, "high_s": time.high_s,
        "limit_s": time.limit_s,
    }


def response_tests(points: Sequence[RecordedPoint]) -> tuple[tuple[ResponseTest, ...], list[str]]:
    """The results of all response points, and one line for each that cannot be used or lost steps."""
    tests: list[ResponseTest] = []
    left_out: list[str] = []
    for point in points:
        if point.kind != RESPONSE:
            continue
        if point.verdict == "invalid":
            left_out.append(f"{point.id}: invalid")
            continue
        try:
            with evaluating("it"):
                of_point, lost = _of_point(point)
                tests += of_point
                left_out += [f"{point.id}: {line}" for line in lost]
        except RigError as error:
            left_out.append(f"{point.id}: {error}")
    return tuple(tests), left_out


def _of_point(point: RecordedPoint) -> tuple[list[ResponseTest], list[str]]:
    """Results of one point, and what was discarded."""
    seen = _steps_in_motion(point)
    if seen is None:
        return [], ["the commanded current is not recorded"]
    steps, lost = seen.steps, list(seen.lost())
    if not steps:
        return [], [*lost, "no step is in the constant-speed part of a stroke"]
    kinds = list(dict.fromkeys(step.kind for step in steps))
    force = point.force_samples
    good = np.isfinite(force.force_N)
    samples = (force.time_s[good], force.force_N[good])
    current = _current_samples(point)
    tests = []
    for kind in sorted(kinds, key=lambda one: (not one[0], -abs(one[2]))):
        chosen = [step for step in steps if step.kind == kind]
        tests.append(_result(point, chosen, samples, current, _discarded(point, kind, len(chosen))))
    return tests, lost


def _discarded(point: RecordedPoint, kind: tuple[bool, float, float], used: int) -> int:
    """How many steps of a kind the point has beyond those used; each is made once in each direction."""
    count = sum(
        (before, after) == kind[1:] for before, after in zip(point.steps_A, point.steps_A[1:], strict=False)
    )
    return max(0, count // 2 - used)


def _steps_in_motion(point: RecordedPoint) -> StepsInMotion | None:
    """The steps of the program in the recorded motion; None where the commanded current is not recorded."""
    raw = point.raw("commanded_current")
    if raw is None or "time" not in raw:
        return None
    return steps_in_motion(
        (point.steps_s, point.steps_A), (raw["time"], raw["value"]), (point.time_s, point.velocity_m_s),
        point.peak_speed_m_s,
    )


def _current_samples(point: RecordedPoint) -> tuple[FloatArray, FloatArray] | None:
    """Times (s) and values (A) of the measured current; None where none is measured."""
    raw = point.raw("coil_current")
    if raw is None or "time" not in raw or point.quality.current.mean_A is None:
        return None
    placed = np.isfinite(raw["time"]) & np.isfinite(raw["value"])
    time_s, value_A = raw["time"][placed].astype(np.float64), raw["value"][placed].astype(np.float64)
    order = np.argsort(time_s, kind="stable")
    return (time_s[order], value_A[order]) if len(time_s) > 2 else None


def _cut(samples: tuple[FloatArray, FloatArray], begin_s: float, end_s: float, at_s: float) -> Record:
    """The samples of an interval, on a time axis with the step at 0."""
    time_s, value = samples
    first, last = np.searchsorted(time_s, (begin_s, end_s))
    return Record(time_s[first:last] - at_s, value[first:last])


def _result(
    point: RecordedPoint, steps: Sequence[StraightStep], force: tuple[FloatArray, FloatArray],
    current: tuple[FloatArray, FloatArray] | None, discarded: int,
) -> ResponseTest:
    """The response to steps of one kind."""
    origin, force_std_s = COMMAND, _clock_std_s(point, "force")
    current_std_s = math.inf if current is None else _clock_std_s(point, "coil_current")
    origins_s, origin_std_s = np.array([step.at_s for step in steps]), math.hypot(force_std_s, HOST_STD_S)
    of_current_std_s = math.hypot(current_std_s, HOST_STD_S)
    if float(point.test.get("device_rate", 1.0)) != 1.0:
        origin, known, of_current_std_s = CURRENT, None, 0.0
        if current is not None:
            known = onsets([_cut(current, step.begin_s, step.end_s, step.at_s) for step in steps])
        if known is None:
            origin_std_s = math.inf
        else:
            origins_s = origins_s + known[0]
            origin_std_s = math.hypot(force_std_s, current_std_s, known[1] / math.sqrt(len(steps)))
    window_s = min(step.end_s - at_s for step, at_s in zip(steps, origins_s, strict=True))
    records, currents = [], []
    for step, at_s in zip(steps, origins_s, strict=True):
        baseline_s = BASELINE_SHARE * (at_s - step.begin_s)
        records.append(_cut(force, at_s - baseline_s, step.end_s, at_s))
        if current is not None:
            currents.append(_cut(current, at_s - baseline_s, step.end_s, at_s))
    response = _unknown_origin(len(steps)) if math.isinf(origin_std_s) else step_response(
        records, Seen(bandwidth_of(point), origin_std_s)
    )
    of_current = step_response(
        currents, Seen(current_bandwidth_of(point), of_current_std_s, drifts=False)
    ) if currents else None
    apart_std_s = math.hypot(force_std_s, current_std_s)
    return ResponseTest(
        point.id, float(np.mean([step.velocity_m_s for step in steps])), steps[0].from_A, steps[0].to_A, len(steps),
        discarded, origin, origin_std_s, response, of_current, _behind(response, of_current, apart_std_s), window_s,
        (_interval_s(records), _interval_s(currents)), _curve(records, currents, response, of_current, window_s),
    )


def _unknown_origin(count: int) -> StepResponse:
    return StepResponse(count, why="the instants of the steps are not known: the simulated rig ran faster than real "
        "time, and the measured current is too coarse to show when it changed")


def _behind(force: StepResponse, current: StepResponse | None, std_s: float) -> tuple[float, float]:
    """Mean delay of the force behind the current, and its standard error (s)."""
    if current is None or math.isnan(force.settling_s[0]) or math.isnan(current.settling_s[0]):
        return math.nan, math.nan
    apart_s = force.settling_s[0] - current.settling_s[0]
    return apart_s, math.hypot(force.settling_s[1], current.settling_s[1], std_s)


def _interval_s(records: Sequence[Record]) -> float:
    gaps = [np.diff(record.time_s) for record in records if len(record.time_s) > 1]
    return float(np.median(np.concatenate(gaps))) if gaps else math.nan


def _clock_std_s(point: RecordedPoint, channel: str) -> float:
    """Standard uncertainty of a channel's place on the time base (s); 0 where it is not stated."""
    return point.clock_std_s(channel) or 0.0


def bandwidth_of(point: RecordedPoint) -> float | None:
    """Cut-off frequency of the load cell's filter (Hz), declared or by its declared delay; None: no filter known."""
    sensor: Mapping[str, Any] = _context(point).get("sensors", {}).get("force", {})
    if sensor.get("bandwidth_Hz"):
        return float(sensor["bandwidth_Hz"])
    return _of_delay(sensor.get("delay_s"))


def current_bandwidth_of(point: RecordedPoint) -> float | None:
    """Cut-off frequency of the filter of the measured current (Hz), by its declared delay; None: no filter known."""
    return _of_delay(_context(point).get("current_delay_s"))


def _context(point: RecordedPoint) -> Mapping[str, Any]:
    """What the recording states of the bench; empty of an imported point."""
    context = point.provenance.get("context")
    stated: Mapping[str, Any] = json.loads(context) if isinstance(context, str) else {}
    return stated


def _of_delay(delay_s: float | None) -> float | None:
    return DELAY_TIMES_BANDWIDTH / float(delay_s) if delay_s else None


def _curve(
    records: Sequence[Record], currents: Sequence[Record], response: StepResponse, of_current: StepResponse | None,
    window_s: float,
) -> Curve | None:
    """The mean course over the repeats, for a figure."""
    if response.curve is None:
        return None
    time_s = np.linspace(-0.25 * window_s, window_s, PLACES)
    current = _mean_course(currents, time_s, of_current)
    return Curve(time_s, _mean_course(records, time_s, response), current, response.curve(time_s))


def _mean_course(records: Sequence[Record], time_s: FloatArray, response: StepResponse | None) -> FloatArray:
    """Mean share of the step at these times (n,), with the drift that the fit gives each record taken off."""
    if response is None or response.curve is None:
        return np.full(len(time_s), math.nan)
    courses = []
    for record in records:
        shape = response.curve(record.time_s)
        drift = np.column_stack((np.ones(len(shape)), record.time_s))
        solved = np.linalg.lstsq(np.column_stack((drift, drift * shape[:, None])), record.value, rcond=None)[0]
        share = (record.value - drift @ solved[:2]) / (drift @ solved[2:])
        courses.append(np.interp(time_s, record.time_s, share, math.nan, math.nan))
    known = np.sum(np.isfinite(courses), axis=0)
    return np.where(known > 0, np.nansum(courses, axis=0) / np.maximum(known, 1), math.nan)
