from __future__ import annotations

import json
from pathlib import Path

import pytest
from synthetic_rig import SyntheticRig

from rig.recording.journal.campaign_log import CampaignLog, read_log
from rig.recording.layout import PointContext
from rig.recording.point_attributes import commanded_of, point_fields
from rig.test_point import TestPoint


def test_events_are_appended_one_readable_line_each(tmp_path: Path) -> None:
    first = CampaignLog(tmp_path)
    first.write("started", bench="demo")
    first.close()
    second = CampaignLog(tmp_path)
    second.write("trip", slug="force-limit", value_N=5100.0)
    second.close()
    lines = (tmp_path / "journal.jsonl").read_text().splitlines()
    assert [json.loads(line)["event"] for line in lines] == ["started", "trip"]
    assert json.loads(lines[1])["slug"] == "force-limit"
    assert json.loads(lines[0])["host_ns"] < json.loads(lines[1])["host_ns"]
    assert json.loads(lines[0])["utc"].endswith("+00:00")


def test_a_line_cut_off_by_a_crash_does_not_hide_the_others(tmp_path: Path) -> None:
    log = CampaignLog(tmp_path)
    log.write("started")
    log.write("finished")
    log.close()
    data = (tmp_path / "journal.jsonl").read_bytes()
    (tmp_path / "journal.jsonl").write_bytes(data[:-20])
    assert [event["event"] for event in read_log(tmp_path)] == ["started"]


EARLIER = {
    "temperature": (
        "warming up from 24.1 degC: 12 s of motion",
        "p003: cooling down from 46.2 to 41.0 degC, about 180 s of the rig's clock",
    ),
    "amplitude": (
        "p002: 9.12 mm of 10 mm reached; correction 1: command 10.97 mm",
        "p002: 9.99 mm of 10 mm reached; within tolerance",
    ),
}
"""Lines of programs that wrote no code."""


@pytest.mark.parametrize(("code", "text"), [(code, text) for code, texts in EARLIER.items() for text in texts])
def test_a_line_of_an_earlier_program_gets_the_code_that_its_words_stand_for(
    tmp_path: Path, code: str, text: str
) -> None:
    log = CampaignLog(tmp_path)
    log.write("info", text=text)
    log.close()
    (line,) = read_log(tmp_path)
    assert (line["code"], line["text"]) == (code, text)


def test_words_give_no_code_to_other_lines_nor_replace_one(tmp_path: Path) -> None:
    log = CampaignLog(tmp_path)
    log.write("info", text="p001: 26.0 degC after 90 s of warming up", code="other")
    log.write("info", text="paused before p002")
    log.write("warning", text="2 mm of 10 mm reached; the machine cannot")
    log.close()
    assert [line.get("code") for line in read_log(tmp_path)] == ["other", None, None]


def test_a_point_s_context_survives_its_journal_header() -> None:
    context = SyntheticRig().context(mid_stroke_m=None, device_rate=50.0)
    assert PointContext.from_json(context.to_json()) == context


def test_a_header_holds_what_was_stated_of_a_point_by_name_and_nothing_else() -> None:
    expected = {
        "id": "p002", "waveform": "hold", "amplitude_m": 0.0, "frequency_Hz": 0.5, "current_A": 2.0, "cycles": 3,
        "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0, "centre_m": 0.0, "repeat": 1, "rest_s": 0.0,
        "kind": "current_step", "steps_A": "0 1 2", "commanded_amplitude_m": 0.0, "commanded_centre_m": 0.001,
        "temperature_low_degC": 15.0, "temperature_high_degC": 45.0,
    }
    context = SyntheticRig().context(point=TestPoint(**point_fields(expected)), commanded=commanded_of(expected))
    header = json.loads(context.to_json())
    assert list(header["point"].items()) == list(expected.items())
    again = PointContext.from_json(json.dumps(header))
    assert again == context
    assert (again.point.steps_A, again.point.at_rest) == ((0.0, 1.0, 2.0), True)
    assert again.commanded.temperature_window_degC == (15.0, 45.0)


@pytest.mark.parametrize("point", [{}, [], {"id": "p001"}, {"id": "p001", "colour": "red"}], ids=str)
def test_a_header_whose_point_is_of_another_shape_is_refused(point: object) -> None:
    header = json.loads(SyntheticRig().context().to_json())
    with pytest.raises(ValueError, match="does not describe a point"):
        PointContext.from_json(json.dumps({**header, "point": point}))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"sensors": {"force": {"rate": 1}}, "point": {}}'])
def test_a_header_of_another_shape_is_refused(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - JSON's own error and ours are both right
        PointContext.from_json(text)
