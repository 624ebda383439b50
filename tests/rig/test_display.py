"""`[display]`: units and signs that people read, from the files to the shown number."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.bench.model import Bench
from rig.comparison.readings import Motion
from rig.display import Display
from rig.errors import FileProblem
from rig.files.display_table import display_of
from rig.files.run_display import run_display
from rig.matrix.model import load_matrix
from rig.recording.point_attributes import NOT_STATED, attributes_of, point_fields
from rig.signals.peak_force import peak_force
from rig.signals.test_set import MotionReading
from rig.test_point import TestPoint

EXAMPLES = Path(__file__).parents[2] / "examples"
US = '''
[display]
force = "lbf"
displacement = "in"
speed = "in/s"
temperature = "degF"
positive = "compression"
'''


def test_numbers_are_shown_in_the_units_and_with_the_signs_of_the_table_and_SI_without_it() -> None:
    usual = Display()
    assert (usual.force.signed_text(-1234.0), usual.displacement.text(0.05)) == ("-1234 N", "50 mm")
    assert (usual.force.title("Force"), usual.damping.unit, usual.usual) == ("Force", "N s/m", True)
    shown = Display.of({"force": "lbf", "displacement": "in", "positive": "compression"}, {"speed": "in/s"})
    assert shown.force.signed_text(-4.4482216152605) == "1 lbf"
    assert shown.displacement.text(0.0508) == "2 in"  # an amplitude has no sign
    assert shown.displacement.signed(np.array([0.0254, -0.0508])).tolist() == pytest.approx([-1.0, 2.0])
    assert shown.force.title("Force") == "Force, compression positive"
    assert shown.damping.unit == "lbf s/in"
    assert (shown.acceleration.text(9.80665), usual.acceleration.unit) == ("386.1 in/s^2", "m/s^2")
    assert Display.of({"speed": "mph"}).acceleration.text(9.80665) == "9.807 m/s^2"
    assert shown.damping.value(175.12683524647636) == pytest.approx(1.0)
    assert Display.of({"temperature": "degF"}).temperature.text(100.0) == "212 degF"
    assert Display.of({"energy": "ft-lb"}).energy.text(1.3558179483314) == "1 ft lbf"
    assert [Display.of({"energy": unit}).energy.text(2.0) for unit in ("mJ", "in lbf", "Nm")] == [
        "2000 mJ", "17.7 in lbf", "2 J",
    ]  # fmt: skip


def test_a_motion_stated_by_its_speed_is_described_by_it_in_the_units_of_the_display() -> None:
    us = Display.of({"displacement": "in", "speed": "in/s"})
    point = TestPoint("p1", "sine", 0.0254, 0.254 / (2.0 * np.pi * 0.0254), 0.5, by_speed=True)
    assert (point.described, point.phrase(us)) == ("sine 25.4 mm 0.254 m/s 0.5 A", "sine 1 in 10 in/s 0.5 A")
    assert us.described(point.described, point.amplitude_m) == point.phrase(us)
    assert replace(point, by_speed=False).phrase(us) == "sine 1 in 1.592 Hz 0.5 A"
    attributes = attributes_of(point, NOT_STATED)
    assert point_fields(attributes)["by_speed"] is True
    assert "by_speed" not in attributes_of(replace(point, by_speed=False), NOT_STATED)
    read = MotionReading("sine", point.amplitude_m, point.frequency_Hz)
    motion = Motion.of(read, None, 0.5, by_speed=True)
    assert (motion.phrase(us), motion.label) == ("sine, 1 in, 10 in/s, 0.5 A", "sine, 25.4 mm, 1.592 Hz, 0.5 A")
    assert motion == Motion.of(read, None, 0.5), "two runs of one motion, of which one states the frequency"


def test_bench_and_matrix_may_state_it_and_no_digest_depends_on_it(tmp_path: Path) -> None:
    bench, matrix = tmp_path / "bench.toml", tmp_path / "matrix.toml"
    bench.write_text((EXAMPLES / "demo-bench.toml").read_text() + US)
    matrix.write_text((EXAMPLES / "quick.toml").read_text() + '[display]\nforce = "kN"\n')
    loaded, tests = Bench.load(bench), load_matrix(matrix)
    assert loaded.digest == Bench.load(EXAMPLES / "demo-bench.toml").digest
    assert tests.digest == load_matrix(EXAMPLES / "quick.toml").digest
    expected = Display("kN", "in", "in/s", "degF", "compression")
    assert display_of(loaded.display, tests.display) == expected
    assert run_display(tmp_path) == expected  # the copies in a run's folder have these names
    matrix.write_text('[display]\nforce = "mm"\n')
    with pytest.raises(FileProblem, match="force = 'mm': allowed: N, kN"):
        run_display(tmp_path)
    matrix.write_text("[display")
    bench.unlink()
    assert run_display(tmp_path).usual


def test_units_and_paper_are_accepted_in_their_other_spellings(tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    entries = 'force = "lbs"\ndisplacement = "inch"\nspeed = "inch/sec"\ntemperature = "deg F"\npaper = "Letter"\n'
    matrix.write_text(f"[display]\n{entries}")
    shown = run_display(tmp_path)
    assert (shown.force_unit, shown.displacement_unit, shown.speed_unit) == ("lbf", "in", "in/s")
    assert (shown.temperature_unit, shown.paper) == ("degF", "letter")
    bench = tmp_path / "bench.toml"
    bench.write_text((EXAMPLES / "demo-bench.toml").read_text() + f"[display]\n{entries}")
    assert Bench.load(bench).display.paper == "letter"


def test_a_unit_of_another_quantity_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text((EXAMPLES / "demo-bench.toml").read_text() + '[display]\nspeed = "in"\n')
    with pytest.raises(FileProblem, match=r"line 64: display.speed .* must be 'm/s', "):
        Bench.load(path)


def test_peak_forces_are_those_of_the_mean_cycle_and_no_single_sample_is_one() -> None:
    time_s = np.arange(0.0, 5.0, 0.004)
    force_N = 1000.0 * np.cos(4.0 * np.pi * time_s) - 50.0 + np.random.default_rng(0).normal(0.0, 10.0, time_s.size)
    peak = peak_force(time_s, force_N, np.arange(0.0, 5.0, 0.5))
    assert peak.rebound_N == pytest.approx(950.0, abs=6.0)
    assert peak.compression_N == pytest.approx(-1050.0, abs=6.0)
    spike_N = np.where(np.arange(time_s.size) == 7, 9e3, 100.0)
    assert peak_force(time_s, spike_N).rebound_N == 100.0
    assert not peak_force(time_s, np.full(time_s.size, np.nan)).known
