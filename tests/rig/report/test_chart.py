from __future__ import annotations

import numpy as np
import pytest

from rig.report.chart import Chart, Trace, span, thinned, tick_text, ticks
from rig.report.fragment import number


@pytest.mark.parametrize("limits", [(0.0, 1.0), (-0.63, 0.63), (-1234.0, 5678.0), (1e-6, 3e-6), (-2.0, -1.9)])
def test_ticks_are_round_few_and_inside(limits: tuple[float, float]) -> None:
    found = ticks(limits)
    assert 3 <= len(found) <= 7
    assert all(limits[0] - 1e-12 <= value <= limits[1] + 1e-12 for value in found)
    assert all(len(tick_text(value, limits)) <= 8 for value in found)


def test_a_tick_at_zero_is_written_as_zero() -> None:
    assert tick_text(-1e-17, (-1.0, 1.0)) == "0"
    assert tick_text(-0.5, (-1.0, 1.0)) == "\N{MINUS SIGN}0.5"


def test_the_range_of_nothing_can_still_be_drawn() -> None:
    assert span([np.array([np.nan])]) == (-1.0, 1.0)
    assert span([np.zeros(5)]) == (-1.0, 1.0)
    assert span([np.full(5, 2.0)]) == pytest.approx((1.9, 2.1))


def test_a_line_is_broken_where_nothing_was_measured() -> None:
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    svg = Chart("x", "y", [Trace(np.arange(5.0), y, "m")]).svg()
    assert svg.split('class="m" d="')[1].split('"')[0].count("M") == 2


def test_a_value_without_neighbours_is_a_cross() -> None:
    """Damping of a single speed is one value: as a line it would not be seen."""
    svg = Chart("x", "y", [Trace(np.arange(4.0), np.array([1.0, 2.0, np.nan, 0.5]), "m")]).svg()
    line, cross = svg.split('class="m" d="M')[1].split('"')[0].split("M", 1)
    assert "L" in line
    across, down = cross.split("M")
    left, right = float(across.split()[0]), float(across.split("H")[1])
    assert right - left == pytest.approx(6.0)
    assert float(down.split()[0]) == pytest.approx((left + right) / 2.0, abs=0.1)


def test_higher_values_are_drawn_higher() -> None:
    svg = Chart("x", "y", [Trace(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "m")]).svg()
    first, second = svg.split('class="m" d="M')[1].split('"')[0].split("L")
    assert float(second.split()[1]) < float(first.split()[1])
    assert float(second.split()[0]) > float(first.split()[0])


def test_thinning_keeps_both_ends() -> None:
    kept = thinned(10_001, 300)
    assert (kept[0], kept[-1], len(kept)) == (0, 10_000, 300)
    assert thinned(5).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("value", "shown"), [
    (1234567.0, "1234567"), (-0.05, "\N{MINUS SIGN}0.05"), (None, "\N{EN DASH}"), (float("nan"), "\N{EN DASH}"),
    (0, "0"), (True, "\N{EN DASH}"), (1.23456, "1.235"),
])
def test_numbers_are_written_as_people_write_them(value: object, shown: str) -> None:
    assert number(value) == shown
