"""The uncertainty budget: every channel's own, and the skew's share where an MR loop reverses."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.characteristics import characterise
from rig.identification.points.preparation import prepare
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.quality.point_quality import RestQuality
from rig.recording.run import Run
from rig.report import write_report
from rig.report.budget import channels_of

YIELD_N, KNEE_M_S, AMPLITUDE_M, SKEW_STD_S = 1000.0, 0.02, 0.02, 5e-4


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """One loop of a damper that yields, 8 cycles at 1 Hz, with an auxiliary channel of 2 % stated uncertainty."""
    (tmp_path / "points").mkdir()
    time_s = np.arange(2000) / 250.0
    omega = 2.0 * math.pi
    u, v = AMPLITUDE_M * np.sin(omega * time_s), AMPLITUDE_M * omega * np.cos(omega * time_s)
    certificate = {"serial_number": "A-1", "uncertainty_percent": 2.0}
    write_file(tmp_path / "points" / "p001.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", u, "m", "Extension"),
         AlignedChannel("force", YIELD_N * np.tanh(v / KNEE_M_S), "N", "Force"),
         AlignedChannel("current", np.full(len(u), 1.0), "A", "Current"),
         AlignedChannel("auxiliary_1", 5.0 * u / AMPLITUDE_M, "bar", "Pressure", "pressure", certificate)],
        test={"id": "p001", "waveform": "sine", "amplitude_m": AMPLITUDE_M, "frequency_Hz": 1.0, "current_A": 1.0,
              "force_uncertainty_percent": 0.5},
        quality={"verdict": "valid", "reasons": (), "force_span_N": 2.0 * YIELD_N, "force_noise_N": 3.0,
                 "force_scatter_N": 0.0, "skew_std_s": SKEW_STD_S, "displacement_clock_std_s": 1e-4,
                 "measured_current_A": 1.0, "measured_current_std_A": 0.004, "coil_temperature_low_degC": 30.0,
                 "coil_temperature_high_degC": 33.0},
    ))
    return Run.open(tmp_path)


def test_the_skews_share_is_that_of_the_reversals(run: Run) -> None:
    (loop,) = characterise(run).loops
    force = channels_of(run.points[0], prepare(run.points[0]), loop.steepest_N_s)[0]
    shares = {share.what: share.value for share in force.shares}
    steepest_N_s = YIELD_N / KNEE_M_S * AMPLITUDE_M * (2.0 * math.pi) ** 2
    assert shares["timing, at the reversals"] == pytest.approx(steepest_N_s * SKEW_STD_S, rel=0.1)
    assert shares["timing, at the reversals"] > 5.0 * YIELD_N * 2.0 * math.pi * SKEW_STD_S
    assert shares["calibration"] == pytest.approx(5.0, rel=1e-3)
    assert force.peak == pytest.approx(YIELD_N, rel=0.01)
    assert force.combined == pytest.approx(math.hypot(5.0, 3.0), rel=1e-3)  # a delay changes no peak
    assert math.isnan(shares["zero"])
    assert math.isnan(shares["zero drift"])


def test_the_zero_and_its_drift_are_in_the_forces_budget(run: Run) -> None:
    force = channels_of(run.points[0], prepare(run.points[0]), 1.0, 4.0)[0]
    assert {share.what: share.value for share in force.shares}["zero drift"] == 4.0
    quality = run.points[0].quality
    known = replace(run.points[0], quality=replace(quality, rest=RestQuality(force_zero_std_N=0.7)))
    force = channels_of(known, prepare(known), 1.0)[0]
    assert {share.what: share.value for share in force.shares}["zero"] == 0.7


def test_current_temperature_and_calibrated_auxiliaries_have_budgets_of_their_own(run: Run) -> None:
    channels = {channel.title: channel for channel in channels_of(run.points[0], prepare(run.points[0]), 1.0)}
    assert set(channels) == {"Force", "Displacement", "Coil current", "Coil temperature", "pressure"}
    assert channels["Coil current"].combined == pytest.approx(0.004)
    assert channels["Coil temperature"].combined == pytest.approx(3.0 / math.sqrt(12.0))
    assert channels["pressure"].peak == pytest.approx(5.0, rel=1e-3)
    assert channels["pressure"].shares[0].value == pytest.approx(0.1, rel=1e-3)
    assert channels["Displacement"].combined < 1e-3 * channels["Displacement"].peak  # its clock's 0.1 ms is no part


def test_the_report_shows_each_budget_and_what_nobody_stated(run: Run) -> None:
    page = write_report(run.path).read_text(encoding="utf-8")
    budget = page[page.index("Uncertainty budget"):]
    assert "timing, at the reversals" in budget
    assert "pressure, peak 5 bar" in budget
    assert budget.index("Coil current, peak 1 A") < budget.index("not stated", budget.index("Coil current"))
