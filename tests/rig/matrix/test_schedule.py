"""The heat model against small steps, and the order by heat against every order."""

from __future__ import annotations

import itertools
import math
import random
from pathlib import Path

import pytest

from rig.errors import FileProblem
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.order_by_heat import HeatModel, Load, Thermal, fastest_order

EXAMPLES = Path(__file__).parents[3] / "examples"
HEAD = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["40 mm"]
frequency = ["1 Hz", "2 Hz"]
current = ["0 A", "2 A"]
"""


def load(tmp_path: Path, text: str) -> Matrix:
    path = tmp_path / "matrix.toml"
    path.write_text(text)
    return load_matrix(path)


def test_the_heat_model_agrees_with_small_steps_of_its_equation() -> None:
    heat, temperature_degC = HeatModel(1500.0, 5.0, 23.0), 40.0
    for _ in range(100_000):
        temperature_degC += 0.001 * (200.0 - 5.0 * (temperature_degC - 23.0)) / 1500.0
    assert heat.after(40.0, 200.0, 100.0) == pytest.approx(temperature_degC, abs=1e-3)
    assert heat.time_to(temperature_degC, 40.0, 200.0) == pytest.approx(100.0, abs=0.1)


def test_a_temperature_that_is_never_reached_takes_for_ever() -> None:
    heat = HeatModel(1500.0, 5.0, 23.0)
    assert math.isinf(heat.time_to(22.0, 40.0))
    assert math.isinf(heat.time_to(80.0, 40.0, 200.0))
    assert heat.time_to(40.0, 40.0) == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_the_order_found_is_as_fast_as_the_best_of_all_orders(seed: int) -> None:
    dice = random.Random(seed)
    loads = [Load(dice.uniform(5.0, 30.0), dice.uniform(0.0, 800.0)) for _ in range(6)]
    thermal = Thermal(HeatModel(400.0, 3.0, 23.0), 30.0, 60.0, 23.0, 500.0)
    found = thermal.total_s([loads[index] for index in fastest_order(loads, thermal)])
    assert found == pytest.approx(min(thermal.total_s(order) for order in itertools.permutations(loads)), rel=2e-3)


def test_points_stay_as_written_where_no_order_is_faster(tmp_path: Path) -> None:
    text = HEAD + 'order = "by heat"\n[temperature]\nwindow = ["10 degC", "200 degC"]'
    assert [point.id for point in load(tmp_path, text).points()] == ["p001", "p002", "p003", "p004"]


def test_by_heat_keeps_every_point_and_its_name(tmp_path: Path) -> None:
    text = HEAD + 'order = "by heat"\n[temperature]\nwindow = ["30 degC", "33 degC"]\nheat_capacity = "0.4 kJ/K"'
    ordered, written = load(tmp_path, text).points(), load(tmp_path, HEAD).points()
    assert sorted(ordered, key=lambda point: point.id) == list(written)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[temperature]\nwindow = ["45 degC", "25 degC"]', "must be at least 2 K below"),
        ('[temperature]\nwindow = ["30 degC", "31 degC"]', "must be at least 2 K below"),
        ('[temperature]\nwindow = ["10 degC", "20 degC"]', "a damper does not cool to 20 degC"),
        ('order = "by heat"', "requires the entry window in [temperature]"),
        ('[[current_step]]\ncurrent = ["1 A", "1 A"]', "two consecutive currents are equal"),
        ("amplitude_tolerance = 0.01", "amplitude_tolerance"),
    ],
)
def test_an_impossible_wish_is_refused_with_what_would_do(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, HEAD + text)
    assert expected in "\n".join(caught.value.problems)


def test_the_quality_example_holds_every_kind_of_point() -> None:
    points = load_matrix(EXAMPLES / "quality.toml").points()
    assert {point.kind for point in points} == {"loop", "friction", "current_step"}
    (slow,) = (point for point in points if point.kind == "friction")
    assert slow.peak_speed_m_s == pytest.approx(0.005)
    (steps,) = (point for point in points if point.kind == "current_step")
    assert (steps.first_current_A, steps.current_A, steps.motion_s) == (0.0, 2.0, pytest.approx(7 * 0.6))
