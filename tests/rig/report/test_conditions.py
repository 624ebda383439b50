from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from rig.document.html import fragment
from rig.recording.journal.campaign_log import CampaignLog, read_log
from rig.recording.point_attributes import NOT_STATED, Commanded
from rig.recording.quality.point_quality import PointQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.point_tables import point_details
from rig.report.views import PointView

TIME_S = np.arange(0.0, 4.0, 0.004)


def a_point(commanded_mm: float | None) -> PointView:
    commanded = NOT_STATED if commanded_mm is None else Commanded(1e-3 * commanded_mm)
    return PointView(RecordedPoint.from_arrays(
        id="p001", waveform="sine", amplitude_m=0.03, frequency_Hz=2.0, current_A=1.0, time_s=TIME_S,
        displacement_m=0.03 * np.sin(4.0 * np.pi * TIME_S), force_N=np.zeros(len(TIME_S)), commanded=commanded,
        quality=PointQuality.read({
            "measured_amplitude_m": 0.03, "measured_amplitude_std_m": 2e-6, "measured_cycles": 4,
            "coil_temperature_low_degC": 41.2, "coil_temperature_high_degC": 43.7,
        }),
    ), None)  # fmt: skip


def test_a_servo_that_falls_short_is_stated_with_its_uncertainty_and_correction() -> None:
    page = fragment(point_details([a_point(32.4)], ()))
    for words in ("30.0000 \N{PLUS-MINUS SIGN} 0.0020", ">8<", ">41.2<", ">43.7<"):
        assert words in page, page


def test_what_the_campaign_waited_for_is_reported_in_its_own_words(tmp_path: Path) -> None:
    lines = [
        {"event": "info", "code": "temperature",
         "text": "p001: cooling down from 55 to 44.8 degC, about 98 s of the rig's time"},
        {"event": "info", "text": "pause after the running point"},
    ]
    (tmp_path / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    page = fragment(point_details([a_point(30.0)], read_log(tmp_path)))
    assert page.count("<li>") == 1
    assert "cooling down from 55 to 44.8 degC" in page


def test_tests_without_a_command_have_no_such_column() -> None:
    assert "Command correction</th>" not in re.sub(" <span.*?</span>", "", fragment(point_details([a_point(None)], ())))


def test_a_campaign_of_an_earlier_program_shows_its_waits_and_corrections(tmp_path: Path) -> None:
    waited, corrected = "warming up from 24.1 degC: 12 s of motion", "p001: 9.1 mm of 10 mm reached; correction 1"
    log = CampaignLog(tmp_path)
    log.write("info", text=waited)
    log.write("info", text="paused before p001")
    log.write("info", text=corrected)
    log.close()
    page = fragment(point_details([a_point(30.0)], read_log(tmp_path)))
    assert waited in page
    assert corrected in page
    assert "paused before" not in page
