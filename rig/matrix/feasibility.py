"""Checks of one point against every limit of machine and specimen, the largest amplitude that fits, and hints.

A hint warns of a point within limits whose recording could be too coarse to identify a damper.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from drivers.streamed_actuator import FEWEST_SETPOINTS
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.bench.settings import Limits
from rig.files.display_table import display_of
from rig.matrix.forecast import Forecast
from rig.matrix.model import Matrix
from rig.matrix.stopping import stop_fits, stopping_reach, within
from rig.matrix.storage import LARGEST_BLOCK_BYTES, journal_bytes, most_in_a_block
from rig.matrix.streaming import peaks, some_points
from rig.signals.program_limits import MOST_STEPS, SHORTEST_HOLD_S
from rig.signals.record import Record
from rig.signals.sensor_filter import DELAY_TIMES_BANDWIDTH
from rig.signals.waveform import SINE_ON_SINE, waveform_named
from rig.test_point import ENDURANCE, HYBRID, RESPONSE, TestPoint
from rig.units import show

SAMPLES_A_CYCLE = 25
"""Fewer force samples in a cycle draw no loop."""

HEADROOM_M = 1e-3
"""Travel left to every position limit, for the servo's overshoot and the sensors' noise: the limits themselves trip."""

FORCE_HEADROOM = 0.05
"""Share of the force limit that a predicted force leaves, for the prediction's error and the load cell's noise."""

SETTLING_LAGS = 6.0
"""Shortest hold of a current step in time constants of the coil: with fewer the recorded current, with its noise, does
not determine to which level it settles (3 mA at 6, 16 mA at 5, 30 mA at 4 for 4 mA of noise)."""

SETTLED_SHARE = 0.95
"""Of a step, that the current must make before the next one."""

SETTLED_STEPS = 4.0
"""Of the measured current: the noise of a current controller is some steps (2 mA of 1 mA on the simulated rig)."""

AMPLITUDE_STEP_M, SPEED_STEP_M_S = 1e-5, 1e-4
"""Amplitudes and speeds that would fit are rounded down to these."""


@dataclass(frozen=True)
class Reason:
    """Why a point cannot be run.

    `slug` is one of `speed`, `acceleration`, `position`, `stroke`, `stopping-distance`, `force`, `heat`, `current`,
    `specimen-current`, `current-settling`, `sampling`, `warm-up`, `waveform`, `hybrid`, `hybrid-unstable`, `block`;
    `text` has the numbers; `excess` grows with how far it is beyond its limit, among points
    with the same slug; 0 where that cannot be ordered.
    """

    slug: str
    text: str
    excess: float = 0.0


def reasons_against(point: TestPoint, force_N: float | None, matrix: Matrix, bench: Bench) -> Iterator[Reason]:
    """Every limit of bench and specimen that the motion or its current would exceed; heat apart."""
    limits, shown = bench.limits, display_of(bench.display, matrix.display)
    reached_m_s, reached_m_s2 = peaks(point, bench)
    if _beyond(reached_m_s, limits.speed_m_s):
        own_m_s = point.peak_speed_m_s
        ripple = _ripple(shown.speed.text(own_m_s, 3)) if _beyond(reached_m_s, own_m_s) else ""
        text = (
            f"speed {shown.speed.text(reached_m_s, 3)}{_when(point, 0)} is above the bench's limit, "
            f"{shown.speed.text(limits.speed_m_s, 3)}{ripple}"
        )
        yield Reason("speed", text, reached_m_s / limits.speed_m_s)
    if _beyond(reached_m_s2, limits.acceleration_m_s2):
        own_m_s2, acceleration = point.peak_acceleration_m_s2, shown.acceleration
        ripple = _ripple(acceleration.text(own_m_s2, 3)) if _beyond(reached_m_s2, own_m_s2) else ""
        text = (
            f"acceleration {acceleration.text(reached_m_s2, 3)}{_when(point, 1)} is above the bench's limit, "
            f"{acceleration.text(limits.acceleration_m_s2, 3)}{ripple}"
        )
        yield Reason("acceleration", text, reached_m_s2 / limits.acceleration_m_s2)
    yield from _against_travel(point, matrix, bench)
    if force_N is not None and _beyond(force_N, _allowed_force_N(bench)):
        yield Reason(
            "force",
            f"predicted force {shown.force.text(force_N)} is above the bench's limit, "
            f"{shown.force.text(limits.force_N)} minus "
            f"{100 * FORCE_HEADROOM:g} % headroom", force_N / limits.force_N,
        )
    yield from _independent_of_amplitude(point, matrix, bench)
    yield from _of_block(point, bench)


def _of_block(point: TestPoint, bench: Bench) -> Iterator[Reason]:
    """Whether the journal of a block of an endurance test is too large."""
    most = most_in_a_block(point, bench)
    if most is not None:
        text = (
            f"a block of {point.cycles:g} cycles would record {journal_bytes(point.motion_s, bench) / 1e6:.0f} MB; "
            f"allowed: at most {LARGEST_BLOCK_BYTES / 1e6:.0f} MB. Fix: set block = {most}"
        )
        yield Reason("block", text, point.cycles / most)


def _against_travel(point: TestPoint, matrix: Matrix, bench: Bench) -> Iterator[Reason]:
    """Travel limits that the motion exceeds; if it keeps them, those that a halt at some instant would exceed."""
    limits, specimen, display = bench.limits, matrix.specimen, display_of(bench.display, matrix.display)
    shown = display.displacement
    travel_fits = True
    room = f"; a margin of {shown.text(HEADROOM_M)} is required at each end"
    if _beyond(point.amplitude_m, _room_m(point, limits)):
        travel_fits = False
        ends_m = point.centre_m - point.amplitude_m, point.centre_m + point.amplitude_m
        text = f"{shown.span(*ends_m)} exceeds the bench's range, {shown.span(*limits.position_m)}{room}"
        yield Reason("position", text, point.amplitude_m)
    if _beyond(point.amplitude_m, specimen.stroke_m / 2.0 - HEADROOM_M):
        travel_fits = False
        travel_m, stroke_m = 2.0 * point.amplitude_m, specimen.stroke_m
        text = f"travel of {shown.text(travel_m)} exceeds the specimen's stroke, {shown.text(stroke_m)}{room}"
        yield Reason("stroke", text, travel_m / stroke_m)
    room_m, reached = command_room(matrix, bench)[:2], stopping_reach(point, matrix, bench)
    if travel_fits and not within(reached, room_m):
        deceleration = display.acceleration.text(bench.actuator.halt_deceleration_m_s2)
        text = (
            f"stopping distance: with a deceleration of {deceleration}, the rod stops between "
            f"{shown.span(*reached, word='and')}; allowed: {shown.span(*room_m)}"
        )
        fits = stop_fits(point, matrix, bench, room_m).text(display)
        yield Reason("stopping-distance", f"{text}; {fits}" if fits else text)


def command_limit(point: TestPoint, matrix: Matrix, bench: Bench) -> tuple[float, str]:
    """The largest amplitude (m) that may be commanded for a point's motion, and what sets it.

    Speed, acceleration and the travel of a halt, as in the plan. The force's limit is none of them: force follows the
    motion that is reached, not the one that is commanded.
    """
    limits, one_metre = bench.limits, replace(point, amplitude_m=1.0)
    shown = display_of(bench.display, matrix.display)
    speed, acceleration = (
        shown.speed.text(limits.speed_m_s, 3), shown.acceleration.text(limits.acceleration_m_s2, 3)
    )
    allowed = {
        f"the bench's speed limit, {speed}": limits.speed_m_s / one_metre.peak_speed_m_s,
        f"the bench's acceleration limit, {acceleration}": limits.acceleration_m_s2 / one_metre.peak_acceleration_m_s2,
    }
    what = min(allowed, key=lambda name: allowed[name])
    steps = math.floor(allowed[what] / AMPLITUDE_STEP_M + 1e-6)
    slower = _largest(steps, lambda smaller: _within_peaks(smaller, bench), point)
    if slower < steps:
        allowed[what] = slower * AMPLITUDE_STEP_M
    halted = _largest(steps, lambda smaller: _can_be_halted(smaller, matrix, bench), point)
    if halted < min(steps, slower):
        allowed["the distance required to stop"] = halted * AMPLITUDE_STEP_M
    what = min(allowed, key=lambda name: allowed[name])
    return allowed[what], what


def command_room(matrix: Matrix, bench: Bench) -> tuple[float, float, str]:
    """Lowest and highest position (m) that may be commanded, headroom taken off, and what sets them, in words."""
    low_m, high_m = _travel(matrix, bench).position_m
    shown = display_of(bench.display, matrix.display).displacement
    where = f"the travel limits of bench and specimen, {shown.span(low_m, high_m)}"
    return low_m + HEADROOM_M, high_m - HEADROOM_M, where


def too_hot(energy_J: float | None, matrix: Matrix) -> Iterator[Reason]:
    """Whether a point's heat alone takes the damper through its temperature window."""
    temperature = matrix.temperature
    if temperature is None or energy_J is None:
        return
    low_degC, high_degC = temperature.window_degC
    coldest_degC = max(low_degC, temperature.ambient_degC)
    rise_K, width_K = energy_J / temperature.heat_capacity_J_K, high_degC - coldest_degC
    if _beyond(rise_K, width_K):
        wide = "wide above ambient" if coldest_degC > low_degC else "wide"
        text = f"the test would warm the damper by {rise_K:.3g} K; the temperature window is {width_K:.3g} K {wide}"
        yield Reason("heat", text, rise_K / width_K)


def _of_waveform(point: TestPoint, bench: Bench) -> Iterator[Reason]:
    """Reason why the controller's function generator cannot produce a waveform."""
    if point.waveform == "triangle" and not bench.actuator.makes_triangles:
        yield Reason("waveform", "triangle: the controller's function generator produces only sine waveforms")
    if point.waveform == "sine" and not bench.actuator.makes_sines:
        text = "sine: the controller moves between two points at constant speed, which produces a triangle"
        yield Reason("waveform", f'{text}. Fix: set waveform = "triangle"')


def _independent_of_amplitude(point: TestPoint, matrix: Matrix, bench: Bench) -> Iterator[Reason]:
    largest_A = max(map(abs, (point.current_A, *point.steps_A)))
    if _beyond(largest_A, bench.limits.current_A):
        text = f"current {largest_A:.3g} A is above the bench's limit, {bench.limits.current_A:.3g} A"
        yield Reason("current", text)
    yield from _settled_current(point, matrix, bench)
    own = matrix.specimen.max_current_A
    if own is not None and _beyond(largest_A, own):
        yield Reason("specimen-current", f"current {largest_A:.3g} A is above the specimen's limit, {own:.3g} A")
    if point.current_programmed:
        yield from _of_program(point, bench)
        yield from _of_supply(point, matrix, bench)
    assumed = matrix.specimen.assumed
    if point.kind == HYBRID and matrix.hybrid is not None and assumed is not None:
        yield from (Reason(*given) for given in matrix.hybrid.reasons(point, assumed, bench))
    if point.at_rest and assumed is not None and assumed.eta_1_s is not None:
        yield from _of_steps(point, assumed.eta_1_s)
    if point.record_samples is not None:
        yield from _of_record(point, point.record_samples, bench)
    if not point.cyclic:
        return
    rate_Hz = min(bench.load_cell.rate_Hz, bench.lvdt.rate_Hz)
    if _beyond(SAMPLES_A_CYCLE * point.frequency_Hz, rate_Hz):
        samples = rate_Hz / point.frequency_Hz
        text = f"{samples:.3g} samples per cycle at {rate_Hz:.4g} Hz; a loop requires at least {SAMPLES_A_CYCLE}"
        yield Reason("sampling", text)
    yield from _of_waveform(point, bench)
    streamed_s = bench.actuator.setpoints_s
    if streamed_s is None:
        return
    count = 1.0 / (point.frequency_Hz * streamed_s * bench.clock.device_rate)
    if _beyond(FEWEST_SETPOINTS, count):
        poll_ms = 1e3 * streamed_s
        text = (
            f"{count:.3g} set-points per cycle at a poll interval of {poll_ms:.3g} ms; at least {FEWEST_SETPOINTS} are "
            "required"
        )
        if bench.clock.device_rate > 1.0:
            text += f". Fix: --speed {count * bench.clock.device_rate / FEWEST_SETPOINTS:.3g} or less"
        yield Reason("sampling", text)


def _settled_current(point: TestPoint, matrix: Matrix, bench: Bench) -> Iterator[Reason]:
    """Whether the current source's resolution can show the current within [campaign] current_settled."""
    set_point_A, measured_A = bench.ecu.steps_A
    target_A, allowed_A = point.first_current_A, matrix.campaign.current_settled_A
    needed_A = max(_off_grid(target_A, measured_A), _off_grid(target_A, set_point_A) - 0.5 * measured_A)
    if _beyond(needed_A, allowed_A):
        text = (
            f"[campaign] current_settled = {show(allowed_A, 'mA', 3)} cannot be reached at {target_A:g} A: the current "
            f"source sets it in steps of {show(set_point_A, 'mA', 3)} and measures it in steps of "
            f"{show(measured_A, 'mA', 3)}; allowed: from {show(needed_A, 'mA', 3)}"
        )
        yield Reason("current-settling", text)


def _off_grid(value: float, step: float) -> float:
    """Distance to the nearest multiple of a step; 0 without steps."""
    return abs(math.remainder(value, step)) if step else 0.0


def current_hints(matrix: Matrix, bench: Bench) -> tuple[str, ...]:
    """A warning if the noise of a few steps of the measured current leaves [campaign] current_settled; else empty."""
    least_A, allowed_A = SETTLED_STEPS * bench.ecu.steps_A[1], matrix.campaign.current_settled_A
    if not _beyond(least_A, allowed_A):
        return ()
    return (
        f"[campaign] current_settled = {show(allowed_A, 'mA', 3)} is less than {SETTLED_STEPS:g} steps of the measured "
        f"current ({show(bench.ecu.steps_A[1], 'mA', 3)}): its noise can make points invalid (current-tracking). Fix: "
        f"{show(least_A, 'mA', 3)} or more",
    )


def _of_steps(point: TestPoint, eta_1_s: float) -> Iterator[Reason]:
    """Whether the coil's current can settle in each hold."""
    hold_s, needed_s = 1.0 / point.frequency_Hz, SETTLING_LAGS / eta_1_s
    if _beyond(needed_s, hold_s):
        text = (
            f"a hold of {show(hold_s, 'ms', 3)} is too short for the current to settle: the time constant of the coil "
            f"in the prior is {show(1.0 / eta_1_s, 'ms', 3)}; required: at least {show(needed_s, 'ms', 3)}. Fix: "
            f'hold = "{math.ceil(1e3 * needed_s - 1e-6)} ms"'
        )
        yield Reason("current-settling", text)


def _of_program(point: TestPoint, bench: Bench) -> Iterator[Reason]:
    """Whether the steps of a current program fit into the motion, and whether the current source can take them."""
    count, last_s = len(point.steps_s), point.steps_s[-1]
    if count > MOST_STEPS:
        text = f"the current program has {count} steps; allowed: at most {MOST_STEPS}"
        yield Reason("current", text, count)
    if last_s >= point.motion_s and point.kind != ENDURANCE:  # a block states the whole program
        text = (
            f"the last step of the current program is at {last_s:.4g} s, but the motion ends at {point.motion_s:.4g} s"
        )
        yield Reason("current", text, last_s)
    hold_s = _shortest_hold_s(point)
    needed_s = max(SHORTEST_HOLD_S, 0.0 if bench.ecu.described_supply is None else bench.ecu.poll_s)
    if _beyond(needed_s, hold_s):
        text = (
            f"the current program holds a current for only {show(hold_s, 'ms', 3)}; this current source requires at "
            f"least {show(needed_s, 'ms', 3)}"
        )
        yield Reason("current-settling", text, needed_s / max(hold_s, 1e-9))


def _shortest_hold_s(point: TestPoint) -> float:
    """Shortest time between two steps of a current program (s)."""
    return min((after - before for before, after in pairwise(point.steps_s)), default=math.inf)


def _settling_s(point: TestPoint) -> float:
    """Shortest time that a step of a current program has: until the next one, in a response test until the reversal."""
    if point.kind != RESPONSE:
        return _shortest_hold_s(point)
    half_s, first_s = 0.5 / point.frequency_Hz, (point.ramp_in_cycles + 0.25) / point.frequency_Hz
    return min((half_s - (at_s - first_s) % half_s for at_s in point.steps_s[1:]), default=math.inf)


def _of_supply(point: TestPoint, matrix: Matrix, bench: Bench) -> Iterator[Reason]:
    """Whether the current source can make the steps of a current program: voltage, inductance, rate of change."""
    specimen, ecu = matrix.specimen, bench.ecu
    largest_A, limit_V = max(map(abs, point.steps_A)), ecu.voltage_limit_V
    left_s = _settling_s(point)
    until = "the rod reverses" if point.kind == RESPONSE else "the next step begins"
    step_A = max((abs(after - before) for before, after in pairwise(point.steps_A)), default=0.0)
    if ecu.slew_limit_A_s is not None and _beyond(step_A / ecu.slew_limit_A_s, left_s):
        text = (
            f"the current source changes the current by at most {ecu.slew_limit_A_s:.3g} A/s ([ecu] slew_limit): a "
            f"step of {step_A:.3g} A takes {show(step_A / ecu.slew_limit_A_s, 'ms', 3)}, but {until} "
            f"after {show(left_s, 'ms', 3)}"
        )
        yield Reason("current-settling", text, step_A)
    ohm = specimen.coil_resistance_ohm
    if limit_V is None or ohm is None:
        return
    if _beyond(ohm * largest_A, limit_V):
        text = (
            f"{largest_A:.3g} A through the coil ({ohm:.3g} ohm) requires {ohm * largest_A:.3g} V; [ecu] voltage_limit "
            f"is {limit_V:.3g} V"
        )
        yield Reason("current", text, largest_A)
    elif specimen.coil_inductance_H is not None:
        # Up at the full voltage; down through the resistance alone, as of a supply that cannot reverse its voltage.
        lag_s = specimen.coil_inductance_H / ohm
        rise_s = lag_s * math.log(limit_V / max(limit_V - SETTLED_SHARE * ohm * largest_A, 1e-9 * limit_V))
        needed_s = max(rise_s, -lag_s * math.log1p(-SETTLED_SHARE))
        if _beyond(needed_s, left_s):
            text = (
                f"with a coil of {show(specimen.coil_inductance_H, 'mH', 3)} and {ohm:.3g} ohm at {limit_V:.3g} V, the "
                f"current takes {show(needed_s, 'ms', 3)} to complete 95 % of its step, but {until} after "
                f"{show(left_s, 'ms', 3)}"
            )
            yield Reason("current-settling", text, needed_s)


def _of_record(point: TestPoint, record: Record, bench: Bench) -> Iterator[Reason]:
    """Whether sensors and set-points carry a signal's highest frequency, and whether there are set-points at all."""
    highest_Hz, rate_Hz = record.highest_Hz, min(bench.load_cell.rate_Hz, bench.lvdt.rate_Hz)
    if _beyond(SAMPLES_A_CYCLE * highest_Hz, rate_Hz):
        text = (
            f"{rate_Hz / highest_Hz:.3g} samples per cycle at the signal's highest frequency, {highest_Hz:.3g} Hz "
            f"(sampling rate {rate_Hz:.4g} Hz); at least {SAMPLES_A_CYCLE} are required"
        )
        yield Reason("sampling", text)
    streamed_s = bench.actuator.setpoints_s
    if streamed_s is None:
        yield Reason(
            "waveform", f"{point.waveform}: requires an actuator with streamed set-points; this bench's controller "
                "generates the motion itself and has no generator for this waveform",
        )
        return
    count = 1.0 / (highest_Hz * streamed_s * bench.clock.device_rate)
    if _beyond(FEWEST_SETPOINTS, count):
        poll_ms = 1e3 * streamed_s
        text = (
            f"{count:.3g} set-points per cycle at the signal's highest frequency, {highest_Hz:.3g} Hz (poll interval "
            f"{poll_ms:.3g} ms); at least {FEWEST_SETPOINTS} are required"
        )
        if bench.clock.device_rate > 1.0 and count * bench.clock.device_rate >= FEWEST_SETPOINTS:
            text += f". Fix: --speed {count * bench.clock.device_rate / FEWEST_SETPOINTS:.3g} or less"
        elif point.waveform != "sweep":
            fits_Hz = 1.0 / (FEWEST_SETPOINTS * streamed_s * bench.clock.device_rate)
            key = "frequency" if point.waveform == SINE_ON_SINE else "highest_frequency"
            text += f'. Fix: {key} = "{fits_Hz:.3g} Hz"'
        yield Reason("sampling", text)


def _ripple(own: str) -> str:
    """How much of what is reached the motion itself asks for."""
    return f" ({own} for the motion itself; the rest is due to ramps, ramp-down, corners and streaming)"


def _when(point: TestPoint, which: int) -> str:
    """Where in a signal its speed (0) or acceleration (1) is largest; empty for cycles."""
    return "" if point.record_samples is None else f" at {point.record_samples.fastest_s[which]:.2f} s"


def _travel(matrix: Matrix, bench: Bench) -> Limits:
    """The bench's limits with the travel that machine and specimen both allow."""
    return bench.limits.within_stroke(matrix.specimen.stroke_m, matrix.specimen.mid_stroke_m)


def _room_m(point: TestPoint, limits: Limits) -> float:
    """The largest amplitude that position limits leave about the point's centre (m), headroom taken off."""
    low, high = limits.position_m
    return min(high - point.centre_m, point.centre_m - low) - HEADROOM_M


def _allowed_force_N(bench: Bench) -> float:
    return bench.limits.force_N * (1.0 - FORCE_HEADROOM)


def _beyond(value: float, limit: float) -> bool:
    """Above the limit by more than rounding."""
    return value > limit + 1e-9 * max(1.0, abs(limit))


def would_fit(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> float | None:
    """The largest amplitude, rounded down, with which the point becomes feasible; None when none does."""
    if point.forecast is not None or point.kind == RESPONSE:  # a smaller stroke has no room for its steps
        return None
    if any(True for _ in _independent_of_amplitude(point, matrix, bench)):
        return None
    one_metre = replace(point, amplitude_m=1.0)
    amplitude_m = min(
        point.amplitude_m,
        bench.limits.speed_m_s / one_metre.peak_speed_m_s,
        bench.limits.acceleration_m_s2 / one_metre.peak_acceleration_m_s2,
        _room_m(point, _travel(matrix, bench)),
    )
    steps = math.floor(amplitude_m / AMPLITUDE_STEP_M + 1e-6)
    steps = _largest(steps, lambda smaller: _within_peaks(smaller, bench), point)
    steps = _largest(steps, lambda smaller: _can_be_halted(smaller, matrix, bench), point)
    steps = _largest(steps, lambda smaller: _force_and_heat_fit(smaller, matrix, bench, predict), point)
    return None if steps <= 0 else round(steps * AMPLITUDE_STEP_M, 6)


def speed_that_fits(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> float | None:
    """The highest speed (m/s), rounded down, with which a point of the same amplitude is feasible; None if none is."""
    if point.current_programmed and point.kind != RESPONSE:  # its steps would no longer be in step with the motion
        return None
    one_Hz_m_s = replace(point, frequency_Hz=1.0).peak_speed_m_s

    def allowed(steps: int) -> bool:
        slower = replace(point, frequency_Hz=steps * SPEED_STEP_M_S / one_Hz_m_s)
        force_N, energy_J = predict(slower)
        causes = (*reasons_against(slower, force_N, matrix, bench), *too_hot(energy_J, matrix))
        return not causes

    steps = _most(math.floor(point.peak_speed_m_s / SPEED_STEP_M_S + 1e-6), allowed)
    return None if steps <= 0 else round(steps * SPEED_STEP_M_S, 6)


def _within_peaks(point: TestPoint, bench: Bench) -> bool:
    speed_m_s, acceleration_m_s2 = peaks(point, bench)
    limits = bench.limits
    return not _beyond(speed_m_s, limits.speed_m_s) and not _beyond(acceleration_m_s2, limits.acceleration_m_s2)


def _can_be_halted(point: TestPoint, matrix: Matrix, bench: Bench) -> bool:
    return within(stopping_reach(point, matrix, bench), command_room(matrix, bench)[:2])


def _force_and_heat_fit(point: TestPoint, matrix: Matrix, bench: Bench, predict: Forecast) -> bool:
    force_N, energy_J = predict(point)
    cool = not any(True for _ in too_hot(energy_J, matrix))
    return cool and (force_N is None or not _beyond(force_N, _allowed_force_N(bench)))


def _largest(steps: int, allowed: Callable[[TestPoint], bool], point: TestPoint) -> int:
    """Bisect for the largest number of amplitude steps with which a point is allowed; 0 when none is."""
    return _most(steps, lambda count: allowed(replace(point, amplitude_m=count * AMPLITUDE_STEP_M)))


def _most(steps: int, fits: Callable[[int], bool]) -> int:
    """Bisect for the largest number of steps that fits; 0 when none does."""
    if steps <= 0 or fits(steps):
        return steps
    low, high = 0, steps
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


HARMONICS = 20
"""The sensor passes so many: a first-order filter at 20 f takes 0.1 % of the fundamental, and 11 % of the tenth."""


def sampling_hints(points: Sequence[TestPoint], bench: Bench) -> tuple[str, ...]:
    """One line for each sensor and each way in which it is too slow, with the points concerned and the limit.

    Args:
        points: all points of a plan.
        bench: rates, declared bandwidths and delays of its sensors.
    """
    moving = [point for point in points if point.cyclic]
    hints: list[str] = []
    for name, sensor in (("load cell", bench.load_cell), ("LVDT", bench.lvdt)):
        hints += _rate(name, sensor, moving)
        hints += _bandwidth(name, sensor, moving)
    return tuple(hints)


def _rate(name: str, sensor: SensorConfig, points: Sequence[TestPoint]) -> Iterator[str]:
    for waveform in sorted({point.waveform for point in points}):
        needed = waveform_named(waveform).samples_needed
        coarse = [
            point for point in points if point.waveform == waveform and sensor.rate_Hz < needed * point.frequency_Hz
        ]
        if coarse:
            fewest = sensor.rate_Hz / max(point.frequency_Hz for point in coarse)
            need_Hz = needed * max(point.frequency_Hz for point in coarse)
            yield (
                f"{some_points(coarse)}: only {fewest:.3g} samples per cycle from the {name} at "
                f"{sensor.rate_Hz:.4g} Hz; identification from a {waveform} requires {needed:g} "
                f"(here: a rate of {show(need_Hz, 'Hz')}), "
                "because the force reverses within a few samples"
            )


def _bandwidth(name: str, sensor: SensorConfig, points: Sequence[TestPoint]) -> Iterator[str]:
    if sensor.bandwidth_Hz is not None and sensor.bandwidth_Hz > 0.5 * sensor.rate_Hz:
        yield (
            f"{name}: the declared bandwidth, {show(sensor.bandwidth_Hz, 'Hz')}, is above the Nyquist frequency, "
            f"{show(0.5 * sensor.rate_Hz, 'Hz')}: noise and hum above the Nyquist frequency are aliased to lower "
            "frequencies"
        )
    band_Hz, source = sensor.bandwidth_Hz, "declared bandwidth"
    if band_Hz is None and sensor.delay_s:
        band_Hz, source = DELAY_TIMES_BANDWIDTH / sensor.delay_s, f"declared delay {show(sensor.delay_s, 'ms')}, about"
    if band_Hz is None:
        return
    slow = [point for point in points if band_Hz < HARMONICS * point.frequency_Hz]
    if slow:
        fastest_Hz = max(point.frequency_Hz for point in slow)
        yield (
            f"{some_points(slow)}: the {name} ({source} {show(band_Hz, 'Hz', 3)}) passes only "
            f"{math.floor(band_Hz / fastest_Hz)} harmonics of {show(fastest_Hz, 'Hz')}; the shape of a loop requires "
            f"{HARMONICS} (here: a bandwidth of {show(HARMONICS * fastest_Hz, 'Hz')})"
        )
