"""The report says what the bench can and cannot compare, and opens with what it disproves."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest

from rig.identification import identify_run
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.quality.cross_checks import point_reasons
from rig.recording.quality.point_quality import PointQuality, Tolerances
from rig.recording.quality.verdict import Verdict
from rig.report import write_report

TABLE = "Sensor cross-checks"


def record(folder: Path, number: int, gain: float = 1.0, **quality: object) -> None:
    """A loop whose load cell shows `gain` against the controller's force input; judged as when its file is made."""
    time_s = np.arange(1500) / 250.0
    u, v = 0.02 * np.sin(2 * np.pi * time_s), 0.04 * np.pi * np.cos(2 * np.pi * time_s)
    test = {"id": f"p{number:03d}", "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0,
            "current_A": 0.5 * (number % 3), "controller_clock_at_zero_s": 9.0 * number, "mid_stroke_m": 0.0}
    seen = {
        "force_reference_gain": gain, "force_reference_gain_std": 0.002, "force_reference_offset_N": 0.4,
        "force_reference_offset_std_N": 0.5, "force_matched_lag_s": 1e-5, "force_matched_lag_std_s": 5e-5,
        "displacement_reference_gain": 1.0003, "displacement_reference_gain_std": 2e-4,
        "displacement_reference_offset_m": 1e-6, "displacement_reference_offset_std_m": 3e-6,
        "rest_current_A": 0.0004, "rest_current_std_A": 0.0005, **Tolerances().attributes, **quality,
    }
    force_N = 900.0 * v + 200.0 * np.tanh(v / 0.02) + np.random.default_rng(number).standard_normal(len(v))
    verdict = Verdict.of(point_reasons(str(test["id"]), test, PointQuality.read(seen)))
    write_file(folder / "points" / f"p{number:03d}.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", u, "m", "Damper extension"),
         AlignedChannel("force", force_N, "N", "Force"),
         AlignedChannel("current", np.full(len(u), 0.5), "A", "Current"),
         AlignedChannel("auxiliary_1", u, "bar", "Pressure", "pressure", {"serial_number": "A-1"})],
        test=test, quality={**verdict.attributes, **seen}, provenance={"bench_hash": "b"},
    ))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "points").mkdir()
    return tmp_path


def page(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


def rows_of(shown: str) -> list[list[str]]:
    part = shown[shown.index(f"{TABLE}</h2>"):]
    part = part[: part.index("</table>")]
    return [
        [html.unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall("<td.*?</td>", row)]
        for row in re.findall("<tr.*?</tr>", part)[1:]
    ]


def test_every_instrument_is_compared_with_numbers_or_reported_not_to_be(folder: Path) -> None:
    for number in range(1, 7):
        record(folder, number)
    rows = rows_of(page(folder))
    named = {(row[0], row[1]): row for row in rows}
    assert named["load cell", "sensitivity"][2] == "controller's force input"
    assert "%" in named["load cell", "sensitivity"][3]
    assert named["load cell", "sensitivity"][5] == "agrees"
    assert named["ECU's current measurement", "sensitivity"][5] == "not cross-checked"
    assert "no second current sensor" in named["ECU's current measurement", "sensitivity"][2]
    assert "mA" in named["ECU's current measurement", "zero"][3]
    assert named["pressure", "everything"][5] == "not cross-checked"
    assert named["LVDT", "delay in addition to the declared delays"][5] == "not cross-checked"
    assert all(row[3] != "" for row in rows)


def test_what_is_too_uncertain_is_not_reported_to_agree(folder: Path) -> None:
    for number in range(1, 4):
        record(folder, number, force_matched_lag_s=-1.5e-3, force_matched_lag_std_s=9e-4, force_reference_gain_std=0.03)
    named = {(row[0], row[1]): row for row in rows_of(page(folder))}
    for what in ("sensitivity", "delay in addition to the declared delays"):
        row = named["load cell", what]
        assert row[5] == "not cross-checked"
        assert "too uncertain" in row[2]
        assert "\N{PLUS-MINUS SIGN}" in row[3]


def test_a_calibration_in_doubt_comes_before_everything_else(folder: Path) -> None:
    for number in range(1, 7):
        record(folder, number, gain=1.05)
    shown = page(folder)
    doubt = shown.index("Calibration in doubt")
    assert doubt < shown.index("Test points</h2>")
    assert shown.count("Calibration in doubt") == 1
    assert "load cell" in shown[doubt : doubt + 300]
    assert "controller&#x27;s force input" in shown[doubt : doubt + 300]
    assert next(row for row in rows_of(shown) if row[:2] == ["load cell", "sensitivity"])[5] == "disagrees"


@pytest.mark.parametrize(("counted_by", "lost", "fact", "stated"), [
    ("sequence", 0, "", "<dt>samples lost</dt><dd>0</dd>"), ("rate", 0, "", "single losses may go undetected"),
    ("sequence", 3, "samples lost</span>", "<dd>3</dd>"), ("nothing", 0, "has no sequence number", ""),
])
def test_lost_samples_are_a_first_fact_where_any_is_lost_or_a_loss_cannot_be_counted(
    folder: Path, counted_by: str, lost: int, fact: str, stated: str
) -> None:
    record(folder, 1, loss_counted_by=counted_by, lost_samples=lost)
    shown = page(folder)
    facts = [part for part in re.findall(r'<div class="fact.*?</div>', shown) if "samples lost" in part]
    assert [fact in one and 'class="fact fair"' in one for one in facts] == ([True] if fact else [])
    assert stated in shown


def test_a_run_without_a_bench_has_no_such_table(folder: Path) -> None:
    record(folder, 1)
    (folder / "points" / "p001.h5").unlink()
    time_s = np.arange(1500) / 250.0
    write_file(folder / "points" / "a.h5", PointFile(
        time_s, 250.0, [AlignedChannel("displacement", np.sin(time_s), "m", "x"),
                        AlignedChannel("force", np.cos(time_s), "N", "F")],
        test={"id": "a", "waveform": "sine", "amplitude_m": 1.0, "frequency_Hz": 0.16, "current_A": 0.0,
              "imported": True},
        quality={"verdict": "valid"},
    ))
    assert TABLE not in page(folder)


def test_a_fit_to_points_whose_calibration_is_in_doubt_says_so_first(folder: Path) -> None:
    for number in range(1, 5):
        record(folder, number, gain=1.05)
    fit = identify_run([folder], suspect=True)
    assert "doubtful calibration" in fit.warnings[0]
    assert "load cell" in fit.warnings[0]
    assert sum("doubtful calibration" in warning for warning in fit.warnings) == 1
