"""What a reader takes from the report: no digit that is not known, no line that joins what does not belong together."""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.display import SI
from rig.document.drawing import drawing_of
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.html import fragment
from rig.document.numbers import between
from rig.document.svg import svg
from rig.document.terminal import lines
from rig.fits.entries import (
    Cause,
    ErrorSummary,
    Estimate,
    Evaluation,
    ModelScore,
    Residual,
    TestedRange,
    TestError,
    Uncertainty,
)
from rig.fits.fit_record import FitRecord
from rig.report.fit import parameters, quality
from rig.report.over_current import parameter_figures
from rig.report.ride import band
from rig.report.standard import plots
from rig.signals.peak_force import PeakForce


@pytest.mark.parametrize(("value", "low", "high", "shown"), [
    (828.785, 669.58, 987.99, ("830", "670 … 990")),
    (15.402, -94.368, 125.17, ("20", "−90 … 130")),
    (2.0, -940.0, 944.0, ("0", "−900 … 900")),
    (1.6378e7, 1.3531e7, 1.9226e7, ("1.64e+07", "1.35e+07 … 1.92e+07")),
    (48.654, 44.58, 52.729, ("49", "45 … 53")),
])  # fmt: skip
def test_no_number_has_more_digits_than_its_interval_lets_be_known(
    value: float, low: float, high: float, shown: tuple[str, str]
) -> None:
    assert between(value, low, high) == shown


def test_a_title_stands_clear_of_wide_ticks_beside_it() -> None:
    rising = Trace(np.arange(3.0), np.array([0.0, 2e4, 42_600.0]))
    steep = svg(drawing_of(Figure(Axis("Current", "A"), Axis("Damping", "N s/m"), [rising])))
    ends = [float(x) for x in re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="end">', steep)]
    assert len(ends) >= 3
    widest = len("40000") * 7.3  # of 11.5 px letters
    title = float(re.findall(r"translate\(([\d.]+) ", steep)[0])
    assert min(ends) - widest > title + 3.0, "half of the title's letters reach into the frame"
    frame = float(re.findall(r'class="f" d="M([\d.]+) ', steep)[0])
    (first,) = re.findall(r'class="m" d="M([\d.]+) ', steep)
    assert float(first) > frame


def loop(amplitude_level_m: float, speed_m_s: float, energy_J: float) -> Any:  # noqa: ANN401 - stands for a loop
    measured = SimpleNamespace(value=energy_J, std=0.1)
    return SimpleNamespace(
        level_A=1.0, waveform="sine", amplitude_level_m=amplitude_level_m, peak_speed_m_s=speed_m_s, energy_J=measured,
        equivalent_damping_N_s_m=measured, rebound_N=measured, jounce_N=measured, group=(amplitude_level_m, speed_m_s),
        id="p001", peak_force_N=PeakForce(energy_J, -energy_J),
    )


def test_energies_of_different_strokes_are_not_joined() -> None:
    loops = [loop(0.025, 0.04, 132.0), loop(0.0016, 0.053, 7.9), loop(0.025, 0.08, 137.0)]
    drawn = plots(cast("Any", loops), SI)
    assert [(trace.name, trace.y.tolist()) for trace in drawn["energy"].traces] == [
        ("1 A, sine, 25 mm", [132.0, 137.0]), ("1 A, sine, 1.6 mm", [7.9, 7.9]),
    ]
    lines = [trace.x.size for trace in drawn["force"].traces if trace.style != Style.POINTS]
    assert lines == [3, 3], "a peak-velocity plot has one line a current"


def test_reversed_signs_explain_no_share_of_the_misfit() -> None:
    causes = (
        Cause("signs-reversed", "the middle is at +47 N", 1.0, "look"),
        Cause("clipping", "a channel that ends", 0.186, "look"),
    )
    page = fragment(parameters(FitRecord("bingham", {}, diagnosis=causes)))
    assert re.findall(r'<td class="n">([^<]*)</td>', page) == ["–", "18.6"]


def test_a_chance_that_no_computer_tells_from_0_and_correlations_are_written_short() -> None:
    test = TestError("p001", energy_J=1.0, residual=Residual(portmanteau_p=2.2e-16, runs_p=0.5))
    page = fragment(quality(FitRecord(
        "bouc_wen", {"kx": Estimate(1.0), "f0": Estimate(1.0)},
        evaluation=Evaluation(error=ErrorSummary(per_test=(test,))),
        uncertainty=Uncertainty(correlation={"kx": {"kx": 1.0, "f0": -9.1e-5}, "f0": {"kx": -9.1e-5, "f0": 1.0}}),
    )))  # fmt: skip
    assert ">&lt; 0.001<" in page
    assert re.findall(r'class="heat"[^>]*>([^<]*)<', page) == ["1.00", "0.00", "0.00", "1.00"]


def test_the_band_of_what_is_never_negative_ends_at_0() -> None:
    kv, kv_b = (Estimate(value, "N s/m", standard_error=230.0) for value in (0.0, 2168.0))
    fit = FitRecord(
        "sprung_bouc_wen", {"kv": kv, "kv_b": kv_b}, uncertainty=Uncertainty(correlation={"kv": {"kv_b": 0.0}}),
        tested=TestedRange(displacement_m=(0.0, 0.1), velocity_m_s=(0.0, 1.0), current_A=(0.0, 1.0)),
    )  # fmt: skip
    line, low, high = parameter_figures(fit)["kv"].traces
    assert low.y[0] == 0.0 == line.y[0]
    assert high.y[0] == pytest.approx(1.96 * 230.0)
    assert low.y[-1] < line.y[-1]


def test_a_band_has_a_gap_where_no_draw_follows_the_road_and_says_nothing_of_it() -> None:
    drawn = np.array([[1.0, np.nan, np.nan], [2.0, 4.0, np.nan], [3.0, 6.0, np.nan]])
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        edges = band(drawn)
    assert edges[:, 0] == pytest.approx([1.05, 2.95])
    assert edges[:, 1] == pytest.approx([4.05, 5.95])
    assert np.isnan(edges[:, 2]).all()


def test_a_model_that_was_given_up_says_why() -> None:
    reason = "dahl: stopped after 40 evaluations: its error, 42.5 N, is 8.0 times that of the best model so far"
    scores = (ModelScore("bingham", 1.1, 40054.0), ModelScore("dahl", reason=reason))
    fit = FitRecord("bingham", {}, evaluation=Evaluation(selection=scores))
    assert fragment(parameters(fit)).count(reason) == 1
    assert "\n".join(text for text, _ in lines(fit_tables(fit), 200)).count(reason) == 1
