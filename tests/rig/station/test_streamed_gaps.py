"""Nothing is thrown: a rod whose set-points stop for a while stays within its limits. A sample of the whole table.

`benchmarks/streamed_gaps.py` has all of it: gaps, causes, phases, motions and controllers.
"""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from drivers.roles import Command, Program, Waveform

FILE = Path(__file__).resolve().parents[3] / "benchmarks" / "streamed_gaps.py"
RAISED = (('speed = "0.8 m/s"', 'speed = "2 m/s"'), ('force = "5 kN"', 'force = "9 kN"'))


@pytest.fixture(scope="module")
def gaps() -> ModuleType:
    spec = importlib.util.spec_from_file_location("streamed_gaps", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["streamed_gaps"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("preset", "motion", "cause", "gap_s", "phase", "slug"),
    [
        ("demo-streamed", "sine", "busy", 0.33, 0.05, "modbus-busy"),
        ("demo-streamed", "road", "suspended", 0.3, 0.3, "host-suspend"),
        ("float-drive", "sine", "held-up", 0.3, 0.1, "host-late"),
        ("float-drive", "fast-sine", "held-up", 0.045, 0.2, "setpoints-late"),
        ("float-drive", "sine", "held-up", 0.02, 0.2, ""),
        ("delta-rmc", "sine", "lost", 0.06, 0.9, "modbus-halfopen"),
        ("delta-rmc", "triangle", "busy", 2.0, 0.6, "modbus-busy"),
        ("demo-streamed", "sweep", "slow", 0.33, 0.0, "setpoints-late"),
    ],
)
def test_after_a_gap_the_rod_stays_within_its_limits_and_the_stop_is_proved(
    gaps: ModuleType, preset: str, motion: str, cause: str, gap_s: float, phase: float, slug: str
) -> None:
    outcome = gaps.outcome(gaps.Case(preset, motion, cause, gap_s, phase, limits=RAISED))
    assert outcome.problems() == []
    assert (outcome.trip, outcome.proved) == (slug, bool(slug))


@pytest.mark.parametrize(("preset", "share"), [("demo-streamed", 1.02), ("delta-rmc", 1.03)])
def test_an_undisturbed_sine_has_hardly_any_ripple(gaps: ModuleType, preset: str, share: float) -> None:
    """60 mm at 1.5 Hz have 0.565 m/s and 5.3 m/s^2; tangents from set-point to set-point made it 10 to 18 m/s^2.

    Without a speed the wires' jitter, 0.3 of 10 ms, is one of the speed.
    """
    outcome = gaps.outcome(gaps.Case(preset, jitter_s=0.0))
    assert outcome.speed_m_s < share * 0.5655
    assert outcome.acceleration_m_s2 < 9.0
    rows = outcome.rows[outcome.rows[:, 0] > outcome.rows[-1, 0] - 2.0 / 1.5]
    spectrum = np.abs(np.fft.rfft(rows[:, 1])) / (len(rows) / 2)
    assert spectrum[2] == pytest.approx(0.06, rel=0.01)
    assert np.sqrt(np.sum(spectrum[4:200] ** 2)) < 0.003 * spectrum[2]


@pytest.mark.few(4)
@pytest.mark.parametrize("preset", ["float-drive", "delta-rmc"])
@pytest.mark.parametrize(("poll_s", "speed_m_s"), [(0.004, 0.34), (0.010, 0.34), (0.010, 0.456), (0.020, 0.34)])
def test_a_triangles_corner_throws_no_rod(gaps: ModuleType, preset: str, poll_s: float, speed_m_s: float) -> None:
    """At 0.456 m/s, polled every 10 ms, steps at its corners made 0.57 and 0.64 m/s of it, and 112 m/s^2 of 60."""
    order = Program(Waveform.TRIANGLE, speed_m_s / 7.6, 1.9, cycles=6.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
    gaps.MOTIONS["corners"] = gaps.Motion(order, 1.9, speed_m_s)
    outcome = gaps.outcome(gaps.Case(preset, "corners", poll_s=poll_s, limits=RAISED))
    assert (outcome.problems(), outcome.trip) == ([], "")
    assert outcome.speed_m_s < 1.11 * speed_m_s


def test_a_slow_stream_returns_to_its_motion_without_a_step(gaps: ModuleType) -> None:
    """Polled every 40 ms, the motion was caught up with in a step of 4.7 mm: 0.67 m/s of 0.4, 131 m/s^2 of 60."""
    outcome = gaps.outcome(gaps.Case("float-drive", "sweep", "busy", 0.08, 0.447, 0.04, limits=RAISED))
    assert outcome.problems() == []


@pytest.mark.parametrize(
    ("motion", "cause", "gap_s", "phase", "poll_s"),
    [
        ("fast-sine", "held-up", 0.011, 0.28, 0.01),
        ("fast-sine", "held-up", 0.013, 0.78, 0.01),
        ("sine", "busy", 0.005, 0.25, 0.01),
        ("sine", "suspended", 0.007, 0.218, 0.008),
        ("triangle", "busy", 0.019, 0.5, 0.02),
    ],
)
def test_a_drive_that_was_at_rest_for_a_late_set_point_does_not_run_after_the_next(
    gaps: ModuleType, motion: str, cause: str, gap_s: float, phase: float, poll_s: float
) -> None:
    """One late or refused set-point: 1.14 to 1.37 times the speed, `setpoints-lost` on a drive that took all."""
    outcome = gaps.outcome(gaps.Case("delta-rmc", motion, cause, gap_s, phase, poll_s, limits=RAISED))
    assert outcome.trip == ""
    assert outcome.speed_m_s < 1.08 * outcome.planned_m_s


def test_a_drive_that_ended_by_itself_between_two_slow_polls_is_measured_first(gaps: ModuleType) -> None:
    """59 ms without a set-point, the drive goes on for 50: a step of 2.7 mm made 0.351 m/s of 0.300."""
    outcome = gaps.outcome(gaps.Case("float-drive", "move", "suspended", 0.019, 0.1, 0.04, limits=RAISED))
    assert (outcome.problems(), outcome.trip) == ([], "")


@pytest.mark.parametrize(
    ("preset", "motion", "again_s", "stop"),
    [
        ("delta-rmc", "hybrid", 0.03, None), ("float-drive", "return", math.nan, None),
        ("delta-rmc", "off-centre", math.nan, Command.HALT), ("float-drive", "fade", 0.05, None),
    ],
)
def test_two_gaps_and_a_stop_ordered_in_a_gap_keep_the_limits(
    gaps: ModuleType, preset: str, motion: str, again_s: float, stop: Command | None
) -> None:
    case = gaps.Case(preset, motion, again_s=again_s, stop=stop, limits=RAISED)
    found = [came.problems() for _, came in gaps.outcomes(case, [0.3], [("busy", 0.02), ("lost", 0.06)])]
    assert found == [[], []]
