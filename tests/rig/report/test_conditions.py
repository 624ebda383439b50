from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np

from rig.characteristics.force_table import ForceCell, ForceRow, ForceTable
from rig.display import Display
from rig.document.figure import Style
from rig.document.html import fragment
from rig.recording.journal.campaign_log import CampaignLog, read_log
from rig.recording.point_attributes import NOT_STATED, Commanded
from rig.recording.quality.point_quality import PointQuality
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.report.cover import Details, conditions
from rig.report.display_text import in_display
from rig.report.document import Material, largest_forces, unfinished
from rig.report.peak_forces import force_text, greatest, peak_forces, peak_velocity_plot
from rig.report.point_tables import point_details
from rig.report.views import MotionTerms, PointView

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


def test_the_stroke_of_the_specimen_is_stated_in_the_unit_of_the_display() -> None:
    details = Details(specimen={"stroke": "170 mm", "coil_resistance": "5 ohm"})
    run = Run(Path("run"), (a_point(None).point,), {})
    page = fragment(conditions(run, details, Display.of({"displacement": "in"})))
    assert "6.693 in" in page
    assert "5 ohm" in page
    inch = [
        replace(run.points[0], amplitude_m=size_m, test={"motion_measured": True})
        for size_m in (0.025397, 0.0254, 0.0508)
    ]
    page = fragment(conditions(replace(run, points=tuple(inch)), details, Display.of({"displacement": "in"})))
    assert "sine, amplitude 1, 2 in, 2 Hz" in page
    assert "170 mm" in fragment(conditions(run, details, Display()))


def test_an_incomplete_test_is_stated_with_what_stopped_it() -> None:
    run = Run(Path("run"), (a_point(None).point,), {"points": ["p001", "p002", "p003"]})
    result = {"event": "result", "stopped_by": "sigint", "detail": "Ctrl-C"}
    page = fragment(unfinished(run, [result]))
    assert "Planned points that were not recorded: 2 of 3. It was stopped: Ctrl-C." in page
    assert unfinished(Run(run.path, run.points, {"points": ["p001"]}), [result]) == []


def test_the_greatest_forces_are_those_of_each_direction_where_the_gas_force_exceeds_the_damping_force() -> None:
    slow, fast = (
        ForceRow(speed_m_s, 0.0254, 1.0, (ForceCell(("p001",), rebound_N, compression_N, std_N, std_N, 0.0, 0.0),))
        for speed_m_s, rebound_N, compression_N, std_N in (
            (0.0508, -219.05, -300.647, 0.03), (0.3556, 55.43, -453.7, 1.2),
        )
    )
    table = ForceTable("peak velocity", "sine", (0.0,), (slow, fast))
    us = Display.of({"force": "lbf", "displacement": "in", "speed": "in/s", "positive": "compression"})
    material = SimpleNamespace(display=us, characteristics=SimpleNamespace(
        force_tables=[ForceTable("peak velocity", "sine", (0.0,), (slow,))]
    ))  # fmt: skip
    rebound_fact, compression_fact = largest_forces(cast("Material", material))
    assert (rebound_fact.value, compression_fact.value) == ("none", "67.59 lbf"), "the gas force exceeds the damping"
    for rebound, force in ((True, "\N{MINUS SIGN}12.5"), (False, "102.0")):
        found = greatest([table], rebound=rebound)
        assert found is not None
        assert found[2:] == (fast, fast.cells[0])
        assert force_text(table, found[3], us, rebound=rebound) == force
    assert force_text(table, ForceCell((), -219.05, 0.0, 0.03, 0.03, 0.0, 0.0), us, rebound=True) == "49.2"
    page = fragment(peak_forces([table], us, gas="60.7 lbf"))
    assert "mean of" not in page
    repeated = replace(slow, cells=(replace(slow.cells[0], points=("p001", "p002")),))
    assert "mean of 2" in fragment(peak_forces([ForceTable("peak velocity", "sine", (0.0,), (repeated, fast))], us))
    flank = ForceTable("constant velocity", "triangle", (0.0,), (replace(slow, speed_m_s=0.1),))
    plot = peak_velocity_plot([table, flank], us)
    assert plot is not None
    crosses, dots = ([trace for trace in plot.traces if (trace.style is Style.POINTS) is points and (
        "triangle" in trace.name) is not points] for points in (False, True))
    assert [len(trace.x) for trace in dots] == [2, 2], "no point of the triangle"
    assert [np.isfinite(trace.x).tolist() for trace in crosses] == [[True, False]] * 2
    assert "Crosses: triangle at constant velocity" in fragment(peak_forces([table, flank], us))
    assert "A positive rebound force means that the gas force exceeds the damping force." in page
    table = ForceTable("peak velocity", "sine", (0.0,), (fast,))
    assert "positive rebound force" not in fragment(peak_forces([table], us))
    terms = MotionTerms.of({"matrix": {"stroke": ["2 in"], "speed_in_s": ["2 in/s"]}})
    assert terms.words("sine", 0.0254, 1.0 / np.pi, us) == "sine, stroke 2 in, 2 in/s"
    assert MotionTerms.of({}).words("sine", 0.0254, 1.0, us) == "sine, amplitude 1 in, 1 Hz"
    assert in_display("+0.35 +- 0.12 N", us, directed=True) == "-0.079 +- 0.027 lbf"
    assert in_display("a sine of 81 mm at 1.5 Hz", us) == "a sine of 3.189 in at 1.5 Hz"


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
