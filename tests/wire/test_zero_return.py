"""Zeros at the end of a campaign against those of its start, on the simulated rig's own drifting load cell."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matrices import matrix_text
from simulated_campaign import simulated

from rig.campaign.preflight.zero_return import read_zero_checks

MATRIX = matrix_text("0 A", "1 A", frequency="1 Hz", cycles=4)
SHORT = matrix_text("0 A", cycles=4)
LONG = MATRIX.replace("cycles = 4", "cycles = 15")


@pytest.mark.nightly
def test_a_load_cell_whose_zero_creeps_is_found_at_the_end_and_kept_with_both_windows(tmp_path: Path) -> None:
    # Slow enough that the zero passes at the start.
    ended = simulated(tmp_path, LONG, "--load-cell-zero-drift", "1.5 N/s", speed=4.0)
    (finding,) = ended.answer["findings"]
    assert (finding["slug"], finding["blamed"]) == ("zero-drift", "bench")
    assert finding["instruments"] == ["load cell", "controller's force input"]
    (check,) = read_zero_checks(ended.folder)
    assert check.start is not None
    assert check.end is not None
    drift_N = check.end.force_N.mean - check.start.force_N.mean
    lasted_s = ended.truth.time_s[-1]
    assert 0.3 * 1.5 * lasted_s < drift_N < 1.5 * lasted_s
    assert finding["values"]["drift"] == pytest.approx(drift_N, abs=30.0)
    assert [line["slug"] for line in ended.story if line["event"] == "finding"] == ["zero-drift"]
    assert [line["which"] for line in ended.story if line["event"] == "rest"] == ["start", "end"]
    assert finding["text"] in ended.output.replace("\n", " ")


@pytest.mark.few(1)
@pytest.mark.parametrize("speed", [5.0, 50.0])
def test_a_clean_rig_says_nothing(tmp_path: Path, speed: float) -> None:
    ended = simulated(tmp_path, SHORT, speed=speed)
    assert ended.exit_code == 0, ended.output
    assert ended.answer["findings"] == []
    described = json.loads((ended.folder / "campaign.json").read_text(encoding="utf-8"))
    assert described["zero_checks"][0]["end"]["force_N"]["count"] > 10
