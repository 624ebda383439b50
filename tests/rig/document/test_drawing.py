from __future__ import annotations

import re

import numpy as np
import pytest

from rig.document.drawing import Drawing, Line, decades, drawing_of, tick_text, ticks
from rig.document.figure import Axis, Figure, Style, Trace, box_plot, span, thinned
from rig.document.numbers import number
from rig.document.svg import svg


def drawn(*traces: Trace, x: Axis = Axis("x"), y: Axis = Axis("y")) -> str:  # noqa: B008 - a frozen value
    return svg(drawing_of(Figure(x, y, traces)))


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


def places(path: str) -> np.ndarray:
    """Points (n, 2) of a piece of a path without its M: the first one, then steps."""
    numbers = re.findall(r"-?(?:\d+\.?\d*|\.\d+)", path)
    return np.array(numbers, float).reshape(-1, 2).cumsum(axis=0)


def test_steps_of_a_path_lead_to_its_points_and_no_rounding_adds_up() -> None:
    x_px = np.random.default_rng(0).uniform(0.0, 600.0, (2000, 2)).round(1)
    (line,) = re.findall(r' d="M([^"]*)"', svg(Drawing(600.0, 600.0, "", (Line(Style.MEASURED, (x_px,)),))))
    assert places(line) == pytest.approx(x_px, abs=1e-6)


def test_a_line_is_broken_where_nothing_was_measured() -> None:
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    assert drawn(Trace(np.arange(5.0), y)).split('class="m" d="')[1].split('"')[0].count("M") == 2


def test_a_value_without_neighbours_is_a_cross() -> None:
    """Damping of a single speed is one value: as a line it would not be seen."""
    shown = drawn(Trace(np.arange(4.0), np.array([1.0, 2.0, np.nan, 0.5])))
    line, cross = shown.split('class="m" d="M')[1].split('"')[0].split("M", 1)
    assert len(places(line)) == 2
    (left, right), (middle, _) = (places(part)[:, 0] for part in cross.split("M"))
    assert right - left == pytest.approx(6.0)
    assert middle == pytest.approx((left + right) / 2.0, abs=0.1)


def test_higher_values_are_drawn_higher() -> None:
    shown = drawn(Trace(np.array([0.0, 1.0]), np.array([0.0, 1.0])))
    first, second = places(shown.split('class="m" d="M')[1].split('"')[0])
    assert second[1] < first[1]
    assert second[0] > first[0]


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


def test_a_curve_is_cut_off_where_it_leaves_the_limits_that_were_set() -> None:
    """Profiles were drawn through the frame and over the text beside it."""
    steep = Trace(np.arange(5.0), np.array([0.0, 4.0, 40.0, 4.0, 0.0]))
    (line,) = [mark for mark in drawing_of(Figure(Axis("x"), Axis("y", limits=(0.0, 8.0)), [steep])).marks
               if getattr(mark, "kind", "") == Style.MEASURED]  # fmt: skip
    heights = np.concatenate([piece[:, 1] for piece in line.pieces])  # type: ignore[union-attr]
    assert len(line.pieces) == 2  # type: ignore[union-attr]
    assert heights.min() >= 8.0
    assert heights.min() == pytest.approx(8.0, abs=0.05), "up to the frame itself"


def test_a_logarithmic_axis_has_equal_steps_for_equal_factors_and_round_ticks() -> None:
    assert decades((0.5, 2000.0)) == [1.0, 10.0, 100.0, 1000.0]
    assert decades((1.0, 20.0)) == [1.0, 2.0, 5.0, 10.0, 20.0]
    assert len(decades((1.2, 1.4))) >= 3
    x = np.array([1.0, 10.0, 100.0, -1.0])
    path = drawn(Trace(x, np.arange(4.0)), x=Axis("x", log=True)).split('class="m" d="M')[1].split('"')[0]
    x_px = places(path)[:, 0]
    assert len(x_px) == 3, "what is not positive has no place"
    assert x_px[1] - x_px[0] == pytest.approx(x_px[2] - x_px[1], abs=0.11)


def test_a_box_plot_has_quartiles_whiskers_and_outliers() -> None:
    box, middle, outliers = box_plot([1.0, 2.0, 3.0, 4.0, 5.0, 40.0], 2.0)
    assert (np.nanmin(box.x), np.nanmax(box.x)) == (1.0, 5.0)
    assert middle.x.tolist() == [3.5, 3.5]
    assert (outliers.x.tolist(), outliers.y.tolist()) == ([40.0], [2.0])
    names = ("first", "second", "third")
    shown = drawn(box, middle, outliers, y=Axis(names=names))
    heights = [float(re.findall(rf'y="([\d.]+)"[^>]*>{name}<', shown)[0]) for name in names]
    assert heights == sorted(heights), "the first one is on top"
