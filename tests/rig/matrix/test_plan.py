"""The plan refuses what the machine cannot do, and says what it could."""

from __future__ import annotations

import json
import math
import random
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.catalogue import make_actuator
from drivers.connection import ActuatorConnection
from drivers.roles import Actuator, Program, Waveform
from drivers.setpoint_generator import SetpointGenerator
from rig.bench.model import Bench
from rig.campaign.sequencer.state import conditions_of
from rig.cli.tables import PlanText
from rig.dampers import model, parameter_set
from rig.display import SI
from rig.files.display_table import DisplayTable
from rig.matrix.lost_answers import lost_answer_hints
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import Plan, PlannedPoint, plan
from rig.matrix.stopping import stopping_reach
from rig.matrix.streaming import JITTER_S, amplitude_hints, peaks
from rig.signals.stopping import CYCLE_STEPS, Cycles
from rig.test_point import TestPoint

EXAMPLES = Path(__file__).parents[3] / "examples"
DEMO = Bench.load(EXAMPLES / "demo-bench.toml")
PAPER = Bench.load(EXAMPLES / "paper-bench.toml")
STREAMED = Bench.load(EXAMPLES / "streamed-bench.toml")


def matrix(point: str, specimen: str = "", tail: str = "") -> Matrix:
    import tomllib

    from rig.files.toml_source import frozen

    text = f'format = 1\n[specimen]\nserial_number = "A"\nstroke = "170 mm"\n{specimen}\n[[point]]\n{point}\n{tail}'
    return Matrix.model_validate(frozen(tomllib.loads(text)))


def one(amplitude: str, frequency: str, *, waveform: str = "sine", current: str = "0 A", specimen: str = "") -> Matrix:
    motion = f'waveform = "{waveform}"\namplitude = "{amplitude}"\nfrequency = "{frequency}"'
    return matrix(f'{motion}\ncurrent = "{current}"', specimen)


def only(result: Plan) -> tuple[bool, str, float | None]:
    (item,) = result.points
    return item.feasible, "; ".join(item.reasons), item.would_fit_m


def test_table_1_needs_the_speeds_of_the_paper() -> None:
    speeds = [item.point.peak_speed_m_s for item in plan(load_matrix(EXAMPLES / "table1.toml"), DEMO).points[:4]]
    assert speeds == pytest.approx([0.157, 0.314, 0.471, 0.628], abs=5e-4)


def test_table_1_is_refused_on_the_papers_machine_with_the_amplitudes_that_fit() -> None:
    result = plan(load_matrix(EXAMPLES / "table1.toml"), PAPER)
    assert not result.feasible
    fits_mm = [1e3 * (item.would_fit_m or 0.0) for item in result.points[:4]]
    assert fits_mm == pytest.approx([47.15, 23.57, 15.71, 11.78], abs=1e-9)
    for item in result.points:
        assert not item.feasible
        again = replace(item.point, amplitude_m=item.would_fit_m or 0.0)
        assert again.peak_speed_m_s <= 0.15


def test_table_1_is_feasible_on_the_demo_bench() -> None:
    result = plan(load_matrix(EXAMPLES / "table1.toml"), DEMO)
    assert result.feasible
    motion_s = 5 * 12 * (1 / 0.5 + 1 + 1 / 1.5 + 1 / 2)
    assert motion_s < result.duration_s < 1.1 * motion_s


@pytest.mark.parametrize(
    ("given", "reason", "fits_m"),
    [
        (one("100 mm", "0.1 Hz"), "-100 mm to 100 mm exceeds the bench's range, -85 mm to 85 mm", 0.084),
        (one("20 mm", "9.9 Hz"), "acceleration 81.2 m/s^2 is above the bench's limit, 60 m/s^2", 0.0127),
        (one("50 mm", "3 Hz", waveform="triangle"), "acceleration 72 m/s^2 is above the bench's limit, 60", 0.04166),
        (one("30 mm", "1 Hz", current="5 A"), "current 5 A is above the bench's limit, 3 A", None),
        (one("30 mm", "1 Hz", current="2.5 A", specimen='max_current = "2 A"'), "the specimen's limit, 2 A", None),
        (one("30 mm", "1 Hz", specimen='max_force = "6 kN"'), "force 6000 N is above the bench's limit, 5000 N", None),
        (one("30 mm", "1 Hz", specimen='max_force = "4.8 kN"'), "5000 N minus 5 % headroom", None),
        (one("84.5 mm", "0.1 Hz"), "a margin of 1 mm is required at each end", 0.084),
        (one("1 mm", "12 Hz"), "20.8 samples per cycle at 250 Hz; a loop requires at least 25", None),
        (one("60 mm", "0.1 Hz", specimen='mid_stroke = "40 mm"'), "-20 mm to 100 mm exceeds", 0.044),
    ],
)
def test_each_limit_refuses_with_its_reason_and_what_would_fit(
    given: Matrix, reason: str, fits_m: float | None
) -> None:
    feasible, reasons, would_fit_m = only(plan(given, DEMO))
    assert not feasible
    assert reason in reasons
    assert would_fit_m == (None if fits_m is None else pytest.approx(fits_m, abs=1e-9))


def test_the_specimens_stroke_limits_the_travel() -> None:
    short = matrix('amplitude = "50 mm"\nfrequency = "0.2 Hz"\ncurrent = "0 A"', "")
    short = short.model_copy(update={"specimen": short.specimen.model_copy(update={"stroke_m": 0.08})})
    assert only(plan(short, DEMO)) == (
        False, "travel of 100 mm exceeds the specimen's stroke, 80 mm; a margin of 1 mm is required at each end", 0.039,
    )


def test_a_predicted_force_beyond_the_limit_names_an_amplitude_whose_force_fits() -> None:
    weak = DEMO.model_copy(update={"limits": replace(DEMO.limits, force_N=600.0)})
    given = one("50 mm", "2 Hz", current="0.5 A", specimen='prior = "demo"')
    feasible, reasons, would_fit_m = only(plan(given, weak))
    assert not feasible
    assert "predicted force" in reasons
    assert would_fit_m is not None
    fitted = one(f"{would_fit_m * 1e3} mm", "2 Hz", current="0.5 A", specimen='prior = "demo"')
    assert only(plan(fitted, weak))[0]
    beyond = one(f"{would_fit_m * 1e3 + 0.1} mm", "2 Hz", current="0.5 A", specimen='prior = "demo"')
    assert not only(plan(beyond, weak))[0]


def test_force_and_heat_from_a_prior_agree_with_its_model_integrated_here() -> None:
    (item,) = plan(one("40 mm", "1.5 Hz", current="1 A", specimen='prior = "demo"'), DEMO).points
    prior = parameter_set("demo")
    time_s = np.linspace(0.0, 1 / 1.5, 20_001)
    omega = 2 * math.pi * 1.5
    u, v = 0.04 * np.sin(omega * time_s), 0.04 * omega * np.cos(omega * time_s)
    force_N = model(prior.model).force(prior.values, u, v, -(omega**2) * u, 1.0, time_s[1])
    assert item.predicted_force_N == pytest.approx(np.max(np.abs(force_N)), rel=1e-3)
    cycle_J = np.trapezoid(force_N * v, time_s)
    ramps = 2 * sum((phase / 2000) ** 2 for phase in range(2000)) / 2000
    assert item.energy_J == pytest.approx(cycle_J * (10 + ramps), rel=5e-3)


def test_without_prior_or_bound_force_and_heat_are_unknown_and_the_plan_says_so() -> None:
    result = plan(one("30 mm", "1 Hz"), DEMO)
    (entry,) = result.to_json()["points"]
    assert entry["predicted_force_N"] is None
    assert entry["energy_J"] is None
    assert result.prediction == "unknown"


def test_a_force_bound_bounds_the_heat_and_the_coil_adds_its_own() -> None:
    (item,) = plan(one("30 mm", "1 Hz", specimen='max_force = "2 kN"'), DEMO).points
    assert item.predicted_force_N == 2000.0
    assert item.energy_J == pytest.approx(4 * 0.03 * 2000 * (10 + 2 / 3))
    coil = one("30 mm", "1 Hz", current="2 A", specimen='max_force = "2 kN"\ncoil_resistance = "1.5 ohm"')
    (warm,) = plan(coil, DEMO).points
    assert warm.energy_J == pytest.approx((item.energy_J or 0.0) + 2.0**2 * 1.5 * 12.0)


def halting(deceleration_m_s2: float) -> Bench:
    return DEMO.model_copy(update={
        "actuator": replace(DEMO.actuator, halt_deceleration_m_s2=deceleration_m_s2),
    })


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_a_motion_that_a_halt_would_take_out_of_its_travel_is_refused_with_all_that_would_do(waveform: str) -> None:
    """Highest end of a halt: A s + V^2 (1 - s^2) / 2 d at s = A d / V^2 of a sine, A + V^2 / 2 d of a triangle."""
    amplitude_m, frequency_Hz, mid_m, halt = 0.058, 2.0, 0.02, 4.0
    bench = halting(halt)

    def planned(amplitude_m: float, mid_m: float, bench: Bench) -> PlannedPoint:
        text = one(f"{amplitude_m} m", f"{frequency_Hz} Hz", waveform=waveform, specimen=f"mid_stroke_m = {mid_m}")
        return plan(text, bench).points[0]

    item = planned(amplitude_m, mid_m, bench)
    assert [cause.slug for cause in item.causes] == ["stopping-distance"]
    speed_m_s = item.point.peak_speed_m_s
    share = amplitude_m * halt / speed_m_s**2 if waveform == "sine" else 1.0
    beyond_m = speed_m_s**2 * ((1.0 - share**2) if waveform == "sine" else 1.0) / (2.0 * halt)
    assert item.stopping_reach_m[1] == pytest.approx(mid_m + share * amplitude_m + beyond_m, abs=5e-5)
    would_do = re.search(r'halt_deceleration = "([\d.]+) m/s', item.reasons[0])
    assert would_do is not None
    least = float(would_do[1])
    assert planned(amplitude_m, mid_m, halting(least)).feasible
    assert not planned(amplitude_m, mid_m, halting(0.95 * least)).feasible
    assert item.would_fit_m is not None
    assert planned(item.would_fit_m, mid_m, bench).feasible
    assert not planned(item.would_fit_m + 5e-5, mid_m, bench).feasible


def test_the_deceleration_that_would_do_is_in_the_units_of_the_display_and_not_rounded_down() -> None:
    """The same motion needs at least as much as in m/s^2, which is known to 0.1 m/s^2, and a little less is refused."""
    def reasons(bench: Bench) -> tuple[str, ...]:
        return plan(one("58 mm", "2 Hz", specimen='mid_stroke = "20 mm"'), bench).points[0].reasons

    shown = halting(4.0).model_copy(update={"display": DisplayTable(speed="in/s")})
    least_in = re.search(r'halt_deceleration = "([\d.]+) in/s\^2"', reasons(shown)[0])
    least = re.search(r'halt_deceleration = "([\d.]+) m/s\^2"', reasons(halting(4.0))[0])
    assert least_in is not None
    assert least is not None
    assert 0.0 <= float(least_in[1]) * 0.0254 - float(least[1]) < 0.001 * float(least[1])
    assert not reasons(halting(float(least_in[1]) * 0.0254))


def test_a_centre_that_leaves_a_halt_its_travel_is_named() -> None:
    bench = halting(4.0)
    (item,) = plan(one("40 mm", "2 Hz", specimen='mid_stroke = "42 mm"'), bench).points
    centre = re.search(r"a centre \(mid_stroke\) of ([-\d.]+) mm is sufficient", item.reasons[0])
    assert centre is not None
    assert plan(one("40 mm", "2 Hz", specimen=f'mid_stroke = "{centre[1]} mm"'), bench).feasible


@given(
    waveform=st.sampled_from([Waveform.SINE, Waveform.TRIANGLE]),
    frequency_Hz=st.floats(0.2, 9.0), speed_m_s=st.floats(0.05, 0.75), halt=st.floats(2.0, 40.0),
    ramp=st.sampled_from([0.5, 1.0, 1.3, 3.0]), fade=st.sampled_from([1.0, 2.5]), begins=st.floats(0.0, 8.0),
    length=st.floats(0.0, 1.0), fades=st.booleans(),
)  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_wherever_a_motion_or_its_fade_is_halted_the_rod_rests_within_what_the_plan_states(
    waveform: Waveform, frequency_Hz: float, speed_m_s: float, halt: float, ramp: float, fade: float, begins: float,
    length: float, fades: bool,
) -> None:
    """The set-points' own generator against the plan's reach."""
    per_cycle = math.tau if waveform is Waveform.SINE else 4.0
    amplitude_m = speed_m_s / (per_cycle * frequency_Hz)
    bench = halting(halt).model_copy(update={
        "actuator": replace(DEMO.actuator, halt_deceleration_m_s2=halt, fade_out_cycles=fade),
    })
    text = one(f"{amplitude_m} m", f"{frequency_Hz} Hz", waveform=waveform.name.lower())
    point = replace(plan(text, bench).points[0].point, ramp_in_cycles=ramp, ramp_out_cycles=ramp, cycles=3)
    low_m, high_m = stopping_reach(point, text, bench)
    generator = SetpointGenerator(0.0, halt_deceleration_m_s2=halt, fade_out_cycles=fade)
    generator.start(Program(waveform, amplitude_m, frequency_Hz, 0.0, 3, ramp, ramp), 0.0)
    now_s = begins / frequency_Hz
    position_m, velocity_m_s = generator.at(now_s)
    if fades:
        generator.fade(now_s)
        position_m, velocity_m_s = generator.at(now_s + length * fade / frequency_Hz)
    end_m = position_m + velocity_m_s * abs(velocity_m_s) / (2.0 * halt)
    slack_m = 1e-5 + 2e-3 * (high_m - low_m)
    assert low_m - slack_m <= end_m <= high_m + slack_m


def follow(frequency_Hz: float, period_s: float, jitter_s: float, seed: int) -> tuple[float, float]:
    """Largest speed and acceleration of a position loop (30 Hz, 0.7) that follows set-points of a sine of 10 mm."""
    chance, step_s, corner, damping = random.Random(seed), 5e-5, math.tau * 30.0, 0.7
    omega, at_s, from_m, speed_m_s, from_s = math.tau * frequency_Hz, 0.0, 0.0, 0.0, 0.0
    x, v, fastest, hardest, due_s = 0.0, 0.01 * math.tau * frequency_Hz, 0.0, 0.0, 0.0
    for step in range(round(4.0 / frequency_Hz / step_s)):
        t_s = step * step_s
        if t_s >= due_s:
            from_m, from_s = 0.01 * math.sin(omega * at_s), t_s
            speed_m_s = (0.01 * math.sin(omega * (at_s + period_s)) - from_m) / period_s
            at_s += period_s
            due_s = at_s + jitter_s * chance.random()
        a = corner**2 * (from_m + speed_m_s * (t_s - from_s) - x) - 2.0 * damping * corner * v
        v += a * step_s
        x += v * step_s
        if t_s > 2.0 / frequency_Hz:
            fastest, hardest = max(fastest, abs(v)), max(hardest, abs(a))
    return fastest, hardest


@pytest.mark.parametrize(("poll_s", "frequency_Hz"), [(0.004, 12.0), (0.004, 3.0), (0.010, 5.0), (0.010, 1.0)])
def test_a_loop_that_follows_streamed_set_points_stays_within_the_planned_peaks(
    poll_s: float, frequency_Hz: float
) -> None:
    bench = STREAMED.model_copy(update={"actuator": replace(STREAMED.actuator, poll_s=poll_s)})
    own = TestPoint("p001", "sine", 0.01, frequency_Hz, 0.0)
    speed_m_s, acceleration_m_s2 = peaks(own, bench)
    for seed in range(3):
        fastest_m_s, hardest_m_s2 = follow(frequency_Hz, poll_s, JITTER_S, seed)
        assert fastest_m_s <= speed_m_s <= 1.05 * max(fastest_m_s, own.peak_speed_m_s)
        assert hardest_m_s2 <= acceleration_m_s2


@pytest.mark.parametrize(
    ("waveform", "ramp", "fade", "generator", "streamed"),
    [
        ("sine", 1.0, 1.0, 1.0126, 1.0), ("triangle", 1.0, 1.0, 1.25, 1.0), ("triangle", 0.5, 2.0, 1.125, 1.0),
        ("triangle", 1.25, 1.0, 1.25, 1.2), ("triangle", 0.75, 1.0, 1.333, 1.333),
    ],
)
def test_ramps_and_the_fade_of_a_stop_are_in_the_planned_speed(
    waveform: str, ramp: float, fade: float, generator: float, streamed: float
) -> None:
    """By the plan, and by every instant of the path that the station looks at before a start."""
    point = TestPoint("p001", waveform, 0.01, 1.0, 0.0, ramp_in_cycles=ramp, ramp_out_cycles=ramp)
    demo, alone = (
        bench.model_copy(update={"actuator": replace(bench.actuator, fade_out_cycles=fade)})
        for bench in (DEMO, STREAMED)
    )
    reached = peaks(point, demo)
    assert reached.speed_m_s == pytest.approx(generator * point.peak_speed_m_s, rel=1e-3)
    assert peaks(point, alone).speed_m_s == pytest.approx(streamed * point.peak_speed_m_s, rel=0.04)
    value, change, _ = point.shape.shape(np.arange(CYCLE_STEPS) / CYCLE_STEPS)
    unit = list(zip(value.tolist(), change.tolist(), strict=True))
    path = Cycles(unit, 0.01, 1.0, ramp, ramp, point.cycles, fade).path()
    assert reached.speed_m_s == pytest.approx(max(abs(speed_m_s) for _, speed_m_s in path), rel=1e-6)


def test_a_triangle_whose_fade_would_exceed_the_speed_limit_is_refused_with_what_fits() -> None:
    """0.52 m/s of 0.8: a controller's own fade over one cycle makes 0.65, and its corner 0.83."""
    feasible, reasons, fits_m = only(plan(one("50 mm", "2.6 Hz", waveform="triangle"), DEMO))
    assert (feasible, fits_m) == (False, pytest.approx(0.04915, abs=1e-9))
    assert "ramp-down" in reasons


def test_a_streamed_sine_leaves_its_ripple_below_the_speed_limit() -> None:
    fast = one("31 mm", "4 Hz")
    assert plan(fast, DEMO).feasible
    (item,) = plan(fast, STREAMED).points
    assert [cause.slug for cause in item.causes] == ["speed"]
    assert "0.779 m/s for the motion itself" in item.reasons[0]
    (fitted,) = plan(one(f"{item.would_fit_m} m", "4 Hz"), STREAMED).points
    assert fitted.feasible
    assert fitted.to_json()["peak_speed_m_s"] == pytest.approx(0.8, abs=1e-3)
    assert fitted.point.peak_speed_m_s < 0.78


def test_a_corner_that_the_controller_cannot_turn_as_fast_as_its_loop_adds_to_a_triangles_speed() -> None:
    """0.48 m/s at 60 m/s^2 reached 0.618 m/s on the simulated rig, 9 % of that by the loop's own overshoot."""
    (item,) = plan(one("60 mm", "2 Hz", waveform="triangle"), DEMO).points
    assert 1.092 * item.peaks.speed_m_s >= 0.618
    faded_m_s = 0.25 * item.point.peak_speed_m_s
    assert item.peaks.speed_m_s - faded_m_s < 0.65
    (slow,) = plan(one("40 mm", "2 Hz", waveform="triangle"), DEMO).points
    assert slow.peaks.speed_m_s == pytest.approx(1.25 * slow.point.peak_speed_m_s)


def test_a_plan_says_where_a_drives_own_stop_in_a_gap_is_harder_than_the_bench_allows() -> None:
    """Of 0.566 m/s 49 m/s^2, what the gaps of `benchmarks/streamed_gaps.py` measured (48)."""
    streamed = one("60 mm", "1.5 Hz")
    gentle = STREAMED.model_copy(update={"limits": replace(STREAMED.limits, acceleration_m_s2=30.0)})
    assert plan(streamed, STREAMED).warnings == plan(streamed, DEMO).warnings
    result = plan(streamed, gentle)
    assert result.feasible
    (message,) = set(result.warnings) - set(plan(streamed, STREAMED).warnings)
    numbers = [float(number) for number in re.findall(r"([\d.]+) m/s", message)]
    assert numbers == pytest.approx([0.585, 50.7, 30.0, 0.346], rel=0.01)


def test_a_plan_says_from_which_frequency_arrival_times_leave_the_skew_suspect() -> None:
    """Without pulses and a stated delay of the inputs: 2.83 ms, what the recording of a healthy rig then states."""
    unstated = STREAMED.model_copy(update={"actuator": replace(STREAMED.actuator, input_delay_s=None)})
    assert plan(one("15 mm", "1 Hz"), unstated).warnings == plan(one("15 mm", "1 Hz"), STREAMED).warnings == ()
    fast = one("15 mm", "1.2 Hz")
    (message,) = set(plan(fast, unstated).warnings) - set(plan(fast, STREAMED).warnings)
    assert re.findall(r"[\d.]+ (?:ms|Hz)", message) == ["2.83 ms", "1.06 Hz", "1.06 Hz"]
    assert "input_delay" in message
    forceless = STREAMED.model_copy(update={"actuator": replace(STREAMED.actuator, register_map="delta-rmc")})
    assert any(
        "2 ms" in message and "force input" in message for message in plan(one("15 mm", "2 Hz"), forceless).warnings
    )


def test_a_plan_warns_of_a_device_that_one_lost_answer_makes_stale() -> None:
    """Mantracourt: asked at 50 Hz, given up after 50 ms, asked again 50 ms later: 120 ms without a value."""
    cell = replace(DEMO.load_cell, format="mantracourt", rate_Hz=50.0, stale_after_s=0.1)
    hasty = {"load_cell": cell, "actuator": replace(DEMO.actuator, stale_after_s=0.045)}
    warned = lost_answer_hints(DEMO.model_copy(update=hasty))
    assert [re.findall(r"[\d.]+ ms", text) for text in warned] == [
        ["45 ms", "50 ms", "10 ms", "40 ms", "50 ms"], ["100 ms", "120 ms", "20 ms", "50 ms", "120 ms"],
    ]
    patient = {"load_cell": replace(cell, stale_after_s=0.12)}
    assert lost_answer_hints(DEMO.model_copy(update=patient)) == ()


def test_a_plan_says_which_settled_current_the_current_source_can_show() -> None:
    """The demo ECU sets and measures 1 mA, with 2 mA of noise: 1 mA was accepted, and every point invalid."""

    def settled(current: str, allowed: str) -> tuple[list[str], tuple[str, ...]]:
        motion = f'waveform = "sine"\namplitude = "5 mm"\nfrequency = "2 Hz"\ncurrent = "{current}"'
        result = plan(matrix(motion, tail=f'[campaign]\ncurrent_settled = "{allowed}"'), DEMO)
        return [cause.slug for item in result.points for cause in item.causes], result.warnings

    assert settled("500 mA", "4 mA")[0] == settled("500 mA", "1 mA")[0] == []
    assert not any("current_settled" in message for message in settled("500 mA", "4 mA")[1])
    (message,) = (message for message in settled("500 mA", "1 mA")[1] if "current_settled" in message)
    assert "4 mA or more" in message
    coarse = replace(DEMO.ecu, interface="slcan", channel="/dev/ttyACM0")
    coarse.__dict__["steps_A"] = (0.001, 0.050)
    bench = DEMO.model_copy(update={"ecu": coarse})
    causes = {
        current: [cause.slug for cause in plan(one("5 mm", "2 Hz", current=current), bench).points[0].causes]
        for current in ("500 mA", "515 mA", "525 mA")
    }
    assert causes == {"500 mA": [], "515 mA": [], "525 mA": ["current-settling"]}


def test_a_plan_says_where_an_amplitude_that_is_not_adapted_is_not_reached() -> None:
    """0.2 mm at 25 Hz reached 0.158 mm on the simulated rig: invalid."""
    sensors = {name: replace(getattr(DEMO, name), rate_Hz=2000.0) for name in ("load_cell", "lvdt")}
    quick = DEMO.model_copy(update=sensors)
    adapted = one("0.2 mm", "25 Hz")
    fixed = adapted.model_copy(update={"sweep": adapted.sweep.model_copy(update={"adapt_amplitude": False})})
    (message,) = set(plan(fixed, quick).warnings) - set(plan(adapted, quick).warnings)
    assert "83 %" in message
    assert amplitude_hints([item.point for item in plan(one("5 mm", "10 Hz"), quick).points], adapted=False) == ()


def test_a_corner_that_streamed_set_points_cannot_turn_is_refused_with_what_would_fit() -> None:
    """The loop turns 0.346 m/s with 60 m/s^2; a controller's own generator limits that by itself."""
    fast = one("45 mm", "2 Hz", waveform="triangle")
    assert plan(fast, DEMO).feasible
    (item,) = plan(fast, STREAMED).points
    assert [cause.slug for cause in item.causes] == ["acceleration"]
    assert "62.4 m/s^2" in item.reasons[0]
    (fitted,) = plan(one(f"{item.would_fit_m} m", "2 Hz", waveform="triangle"), STREAMED).points
    assert fitted.feasible
    assert fitted.point.peak_speed_m_s == pytest.approx(0.346, abs=1e-3)


@given(
    amplitude_m=st.floats(1e-4, 0.5),
    frequency_Hz=st.floats(0.01, 9.0),
    waveform=st.sampled_from(["sine", "triangle"]),
    centre_m=st.floats(-0.08, 0.08),
)
@settings(max_examples=200, deadline=None)
def test_what_would_fit_always_fits(amplitude_m: float, frequency_Hz: float, waveform: str, centre_m: float) -> None:
    specimen = f"mid_stroke_m = {centre_m}"
    _, _, would_fit_m = only(
        plan(one(f"{amplitude_m} m", f"{frequency_Hz} Hz", waveform=waveform, specimen=specimen), PAPER)
    )
    if would_fit_m is not None:
        assert would_fit_m <= amplitude_m
        corrected = one(f"{would_fit_m} m", f"{frequency_Hz} Hz", waveform=waveform, specimen=specimen)
        assert only(plan(corrected, PAPER))[0]


def test_a_triangle_is_slower_than_the_sine_of_the_same_amplitude_and_rounds_its_corners_in_a_twentieth() -> None:
    sine = TestPoint("p001", "sine", 0.05, 1.0, 0.0)
    triangle = replace(sine, waveform="triangle")
    assert triangle.peak_speed_m_s == pytest.approx(0.2)
    assert sine.peak_speed_m_s == pytest.approx(0.1 * math.pi)
    corner_s = 2 * triangle.peak_speed_m_s / triangle.peak_acceleration_m_s2
    assert corner_s == pytest.approx(0.05)


def windowed(low: str, high: str, specimen: str = "", more: str = "", bench: Bench = DEMO) -> Plan:
    """The plan of a 40 mm, 2 Hz sine at 1 A in a temperature window; ambient 23 degC, 5 W/K lost."""
    motion = 'waveform = "sine"\namplitude = "40 mm"\nfrequency = "1.5 Hz"\ncurrent = "1 A"'
    tail = f'[temperature]\nwindow = ["{low}", "{high}"]\n{more}'
    return plan(matrix(motion, specimen, tail), bench)


def test_a_window_that_the_warm_up_cannot_reach_is_refused_with_the_temperature_it_reaches() -> None:
    bound = 'max_force = "3 kN"'
    result = windowed("200 degC", "210 degC", bound, 'heat_loss = "10 W/K"')
    held_degC = 23.0 + 4.0 * 0.04 * 3000.0 * 1.5 / 10.0
    assert not result.feasible
    assert result.warm_up is not None
    assert f"warm-up reaches only {held_degC:.3g} degC, but the temperature window starts at 200 degC" in (
        result.warm_up.reasons
    )[0]
    entry = result.to_json()
    assert (entry["temperature_s"], entry["duration_s"]) == (None, None)
    assert entry["warm_up"]["verdict"] == "infeasible"


@pytest.mark.parametrize(("low", "feasible"), [("94 degC", True), ("96 degC", False)])
def test_what_the_warm_up_reaches_is_evaluated_without_its_ramps(low: str, feasible: bool) -> None:
    result = windowed(low, "115 degC", 'max_force = "3 kN"', 'heat_loss = "10 W/K"')
    held_degC = 23.0 + 4.0 * 0.04 * 3000.0 * 1.5 / 10.0
    assert held_degC == pytest.approx(95.0)
    assert result.feasible is feasible
    if feasible:
        assert result.temperature_s is not None
        assert 0.0 < result.temperature_s < 3600.0


def test_unknown_heat_gives_no_forecast_and_the_room_is_that_of_the_recorded_points() -> None:
    result = windowed("25 degC", "45 degC")
    assert result.feasible
    assert (result.temperature_s, result.duration_s) == (None, None)
    assert json.loads(json.dumps(result.to_json()))["duration_s"] is None
    (item,) = result.points
    assert item.point.motion_s < result.recorded_s < item.point.motion_s + 2.0
    assert "unknown" in str(PlanText(result))


def test_a_point_that_ends_too_hot_even_from_ambient_is_refused() -> None:
    bound = 'max_force = "3 kN"'
    energy_J = 4.0 * 0.04 * 3000.0 * (10.0 + 2.0 / 3.0)
    rise_K = energy_J / 1500.0
    assert 3.0 < rise_K < 4.0
    (item,) = windowed("15 degC", "26 degC", bound).points
    assert item.reasons == (f"the test would warm the damper by {rise_K:.3g} K; the temperature window is 3 K wide "
                            "above ambient",)
    assert windowed("15 degC", "27 degC", bound).feasible


def test_a_window_above_the_limit_of_the_coil_temperature_is_refused() -> None:
    """The limit would stop the rig while it warms up."""
    limits = replace(DEMO.limits, coil_temperature_degC=44.0)
    assert windowed("25 degC", "44 degC").feasible
    result = windowed("25 degC", "45 degC", bench=DEMO.model_copy(update={"limits": limits}))
    assert result.warm_up is not None
    assert not result.feasible
    assert [cause.slug for cause in result.warm_up.causes] == ["warm-up"]
    assert "45 degC, but the bench's [limits] coil_temperature allows at most 44 degC" in result.warm_up.reasons[0]


@pytest.mark.parametrize(("hold", "allowed"), [("60 ms", False), ("239 ms", False), ("240 ms", True)])
def test_a_current_step_shorter_than_the_coil_settles_is_refused(hold: str, allowed: bool) -> None:
    """The coil of `demo` has a time constant of 40 ms; without a prior it is not known."""
    motion = 'amplitude = "5 mm"\nfrequency = "1 Hz"\ncurrent = "0 A"'
    step = f'[[current_step]]\ncurrent = ["0 A", "1 A", "0.2 A"]\nhold = "{hold}"'
    _, item = plan(matrix(motion, 'prior = "demo"', step), DEMO).points
    assert (item.feasible, [cause.slug for cause in item.causes]) == (allowed, [] if allowed else ["current-settling"])
    assert allowed or 'Fix: hold = "240 ms"' in item.reasons[0]
    assert plan(matrix(motion, "", step), DEMO).feasible


def test_a_plan_asks_once_how_the_controller_is_given_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """And another controller in the same table's place is asked for itself."""
    requested: list[str] = []

    def made(name: str, connection: ActuatorConnection) -> Actuator:
        requested.append(name)
        return make_actuator(name, connection)

    monkeypatch.setattr("rig.bench.settings.make_actuator", made)
    bench, matrix = Bench.load(EXAMPLES / "demo-bench.toml"), load_matrix(EXAMPLES / "table1.toml")
    assert len(plan(matrix, bench).points) == 20
    assert requested == ["demo"]
    assert bench.actuator.setpoints_s is None
    streamed = replace(bench.actuator, register_map="demo-streamed", poll_s=0.02)
    assert streamed.setpoints_s == 0.02


@pytest.mark.parametrize("bench", [DEMO, STREAMED])
def test_no_command_that_the_adaption_may_give_exceeds_the_plans_bound(bench: Bench) -> None:
    table1 = load_matrix(EXAMPLES / "table1.toml")
    ceilings = conditions_of(table1, bench).ceilings
    for item in plan(table1, bench).points[::7]:
        if not item.feasible:
            continue
        largest = replace(item.point, amplitude_m=ceilings[item.point.id].amplitude_m)
        for bound, reached, limit in zip(
            item.highest_peaks, peaks(largest, bench), (bench.limits.speed_m_s, bench.limits.acceleration_m_s2),
            strict=True,
        ):
            assert reached <= bound + 1e-12
            assert bound <= limit * (1.0 + 1e-9)
    fixed = table1.model_copy(update={"sweep": table1.sweep.model_copy(update={"adapt_amplitude": False})})
    assert all(item.highest_peaks == item.peaks for item in plan(fixed, bench).points[::7])


def test_a_matrix_that_states_a_speed_gets_the_highest_speed_that_fits_at_its_stroke() -> None:
    motion = 'stroke = "50 mm"\nspeed = "{:.4f} m/s"\ncurrent = "0 A"'
    (item,) = plan(matrix(motion.format(1.0)), DEMO).points
    assert item.would_fit_m_s is not None
    assert plan(matrix(motion.format(item.would_fit_m_s)), DEMO).feasible
    assert not plan(matrix(motion.format(item.would_fit_m_s + 2e-4)), DEMO).feasible
    assert item.fits_text(SI).startswith("highest speed at this stroke that fits: 0.")
