"""Nothing is thrown: a rod whose set-points stop for a while stays within its limits. A sample of the whole table.

`benchmarks/streamed_gaps.py` has all of it: gaps, causes, phases, motions and controllers.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from drivers.roles import Program, Waveform

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


@pytest.mark.parametrize("preset", ["float-drive", "delta-rmc"])
@pytest.mark.parametrize(("poll_s", "speed_m_s"), [(0.004, 0.34), (0.010, 0.34), (0.010, 0.456), (0.020, 0.34)])
def test_a_triangles_corner_throws_no_rod(gaps: ModuleType, preset: str, poll_s: float, speed_m_s: float) -> None:
    """At 0.456 m/s, polled every 10 ms, steps at its corners made 0.57 and 0.64 m/s of it, and 112 m/s^2 of 60."""
    order = Program(Waveform.TRIANGLE, speed_m_s / 7.6, 1.9, cycles=6.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
    gaps.MOTIONS["corners"] = (order, 1.9, speed_m_s)
    outcome = gaps.outcome(gaps.Case(preset, "corners", poll_s=poll_s, limits=RAISED))
    assert (outcome.problems(), outcome.trip) == ([], "")
    assert outcome.speed_m_s < 1.11 * speed_m_s


def test_a_slow_stream_returns_to_its_motion_without_a_step(gaps: ModuleType) -> None:
    """Polled every 40 ms, the motion was caught up with in a step of 4.7 mm: 0.67 m/s of 0.4, 131 m/s^2 of 60."""
    outcome = gaps.outcome(gaps.Case("float-drive", "sweep", "busy", 0.08, 0.447, 0.04, limits=RAISED))
    assert outcome.problems() == []


@pytest.mark.parametrize("gap_s", [0.011, 0.013])
@pytest.mark.parametrize("phase", [0.28, 0.78])
def test_a_drive_that_stood_for_a_late_set_point_does_not_run_after_the_next(
    gaps: ModuleType, gap_s: float, phase: float
) -> None:
    """One set-point a few ms late: 1.15 to 1.33 times the speed, and `setpoints-lost` on a drive that took all."""
    outcome = gaps.outcome(gaps.Case("delta-rmc", "fast-sine", "held-up", gap_s, phase, limits=RAISED))
    assert outcome.trip == ""
    assert outcome.speed_m_s < 1.12 * outcome.planned_m_s
