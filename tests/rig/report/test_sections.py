from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.document.blocks import Cards, Figures
from rig.document.moments import local_time
from rig.document.numbers import between, number
from rig.document.style import SEQUENCE, current_colour
from rig.fits.entries import Corrections, Estimate, TestedRange, Uncertainty
from rig.fits.fit_record import FitRecord
from rig.fits.relation import CurrentRelations, Relation
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.recorded_point import RecordedPoint
from rig.report import write_report
from rig.report.events import campaign_events
from rig.report.iteration import iteration_section
from rig.report.loops import details, loop_figures
from rig.report.over_current import parameter_figures
from rig.report.traces import envelope
from rig.report.views import motion_of, view_of
from rig.signals.record import RecordFacts


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """One point of a viscous damper, with a journal, and names that are markup."""
    folder = tmp_path / "20260101T000000Z-X-abcd"
    (folder / "points").mkdir(parents=True)
    time_s = np.arange(1600) / 250.0
    phase = 2 * np.pi * np.clip(time_s - 0.2, 0.0, 6.0)
    force_N = 800.0 * 0.02 * 2 * np.pi * np.cos(phase) * ((phase > 0) & (phase < 12 * np.pi))
    force_N[777] = 4321.0
    write_file(folder / "points" / "p001.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", 0.02 * np.sin(phase), "m", "Damper extension"),
         AlignedChannel("force", force_N, "N", "Force"),
         AlignedChannel("current", np.full(1600, 0.5), "A", "Current")],
        test={"id": "p001", "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": 0.5,
              "mid_stroke_m": 0.0},
        quality={"verdict": "valid", "reasons": ()},
        provenance={"bench": "<script>bench()</script>", "specimen": "X"},
    ))  # fmt: skip
    (folder / "campaign.json").write_text(json.dumps({
        "specimen": "<script>x()</script>", "operator": "A. <b>Tester</b>", "notes": "third mounting", "dt": 0.1 + 0.2,
    }))
    (folder / "matrix.toml").write_text('format = 1\n[specimen]\nserial_number = "X"\nstroke = "170 mm"\n')
    lines = [
        {"utc": "2026-01-01T10:00:00.123+00:00", "event": "phase", "phase": "connecting"},
        {"utc": "2026-01-01T10:00:01.123+00:00", "event": "station", "slug": "host-late", "late_s": 0.0123456789},
        {"utc": "2026-01-01T10:00:07.123+00:00", "event": "station", "slug": "host-late", "late_s": 0.0234567891},
        {"utc": "2026-01-01T10:00:09.000+00:00", "event": "judged", "id": "p001", "verdict": "valid"},
        {"utc": "2026-01-01T10:00:10.000+00:00", "event": "judged", "id": "p002", "verdict": "invalid",
         "reasons": ["estop: <i>pressed</i>"]},
    ]  # fmt: skip
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def test_specimen_operator_notes_and_events_are_in_the_report_and_stay_text(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    assert "<script" not in page
    assert "&lt;script&gt;bench()&lt;/script&gt;" in page
    assert "Damper test report: &lt;script&gt;x()&lt;/script&gt;" in page
    reported = page[page.index("Specimen and test conditions</h2>"):]
    assert "A. &lt;b&gt;Tester&lt;/b&gt;" in reported
    assert all(words in reported for words in ("third mounting", "170 mm"))
    happened = page[page.index("Events</h2>"):page.index("Provenance</h2>")]
    assert "estop: &lt;i&gt;pressed&lt;/i&gt;" in happened
    assert "<td class=\"n\">2</td><td>late_s 0.02346</td>" in happened
    assert "connecting" not in happened


def test_what_was_typed_on_the_operators_page_is_in_the_report(run: Path) -> None:
    (run / "campaign.json").write_text('{"specimen": "X"}')
    (run / "operator.json").write_text(json.dumps({
        "operator": "B. Typist", "specimen": "oil <b>changed</b>",
        "notes": [{"utc": "2026-01-01T10:00:00+00:00", "by": "B. Typist", "text": "<script>n()</script> squeaks"}],
    }))  # fmt: skip
    page = write_report(run).read_text(encoding="utf-8")
    reported = page[page.index("Specimen and test conditions</h2>"):]
    assert "oil &lt;b&gt;changed&lt;/b&gt;" in reported
    assert f"{local_time('2026-01-01T10:00:00+00:00')} B. Typist: &lt;script&gt;n()&lt;/script&gt; squeaks" in reported
    assert "not given" not in reported


def test_numbers_have_the_digits_that_are_known_and_no_more(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    assert "<dt>dt</dt><dd>0.3</dd>" in page
    assert not re.search(r">[^<]*\d\.\d{8,}[^<]*</(td|dd)>", page)
    assert between(237.93904759, 237.80612, 238.07197) == ("237.94", "237.81 \N{HORIZONTAL ELLIPSIS} 238.07")
    assert between(-0.012345, -0.0223, -0.0023)[0] == "\N{MINUS SIGN}0.012"
    assert between(5.5, None, 7.0) == ("5.5", "\N{EN DASH} \N{HORIZONTAL ELLIPSIS} 7")


def test_time_traces_show_the_whole_test_with_its_highest_peak(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    part = page[page.index("Time traces</h2>"):page.index("Provenance</h2>")]
    for label in ("Force (N) vs. time (s)", "Displacement (mm) vs.", "Current (A) vs.", "time in the cycle (ms)"):
        assert label in part
    values = np.sin(np.arange(10_000) / 500.0)
    values[7003] = 9.0
    at, drawn = envelope(np.arange(10_000) / 100.0, values, 50)
    assert len(at) <= 100
    assert np.all(np.diff(at) >= 0.0)
    assert (np.max(drawn), at[np.argmax(drawn)]) == (9.0, 70.03)
    short = np.arange(20.0)
    assert envelope(short, short, 50)[1] is short


def range_of(current_A: tuple[float, float]) -> TestedRange:
    return TestedRange(displacement_m=(0.0, 0.1), velocity_m_s=(0.0, 1.0), current_A=current_A)


def test_a_parameter_over_current_is_its_line_with_a_band_by_the_covariance() -> None:
    fit = FitRecord(
        "asymmetric",
        {"Fya": Estimate(50.0, "N", standard_error=3.0), "Fyb": Estimate(200.0, "N/A", standard_error=4.0)},
        uncertainty=Uncertainty(correlation={"Fya": {"Fyb": -0.5}, "Fyb": {"Fya": -0.5}}), tested=range_of((0.0, 2.0)),
    )  # fmt: skip
    line, low, high = parameter_figures(fit)["Fy"].traces
    assert line.x[[0, -1]].tolist() == [0.0, 2.0]
    assert line.y[[0, -1]] == pytest.approx([50.0, 450.0])
    # var at 2 A: 3^2 + 2^2 4^2 + 2 (2) (-0.5) (3) (4) = 9 + 64 - 24 = 49
    assert high.y[-1] - line.y[-1] == pytest.approx(1.96 * 7.0)
    assert line.y[0] - low.y[0] == pytest.approx(1.96 * 3.0)
    assert parameter_figures(replace(fit, tested=range_of((0.5, 0.5)))) == {}
    assert parameter_figures(replace(fit, tested=None)) == {}


def test_a_fit_for_each_current_shows_every_value_beside_the_relation() -> None:
    relation = Relation("affine", (10.0, 100.0), 1.0)
    fit = FitRecord(
        "asymmetric", {"Fy at 0 A": Estimate(12.0, "N", 8.0, 16.0), "Fy at 2 A": Estimate(208.0, "N")},
        corrections=Corrections(current=CurrentRelations(
            "per-current-affine", (0.0, 1.0, 2.0), {"Fy": relation}, {"Fy": (12.0, 208.0)},
        )),
    )  # fmt: skip
    chart = parameter_figures(fit)["Fy"]
    assert chart.traces[0].y[-1] == pytest.approx(210.0)
    assert chart.traces[1].y.tolist() == [8.0, 16.0]
    assert [trace.name for trace in chart.traces[1::2]] == ["Fy at 0 A", "Fy at 2 A"]


def test_a_zero_has_no_sign() -> None:
    assert (number(-0.0), number(0.0), number(-0.5)) == ("0", "0", "\N{MINUS SIGN}0.5")


def test_events_that_are_identical_are_reported_once_with_their_number() -> None:
    log = [{"utc": f"2026-01-01T10:00:0{k}", "event": "station", "what": "late", "count": k} for k in range(5)]
    (one,) = campaign_events([{"event": "phase"}, *log])
    assert (one.count, one.first[-1], one.last[-1]) == (5, "0", "4")


LINEAR_TO_XYZ_Y = np.array([0.2126, 0.7152, 0.0722])
PROTANOPIA = np.array([  # Machado, Oliveira, Fernandes 2009, severity 1.0, on linear RGB
    [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998],
])  # fmt: skip


def lightness(linear: np.ndarray) -> float:
    """CIE L*."""
    y = float(LINEAR_TO_XYZ_Y @ linear)
    return 116.0 * np.cbrt(y) - 16.0 if y > 0.008856 else 903.3 * y


def linear(colour: str) -> np.ndarray:
    """Linear RGB of a CSS colour."""
    values = np.array([int(colour[place:place + 2], 16) for place in (1, 3, 5)]) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("count", [2, 3, 5, 7])
def test_currents_are_distinguished_in_grey_print_and_by_protanopes(count: int) -> None:
    colours = [linear(current_colour(index, count)) for index in range(count)]
    grey = [lightness(colour) for colour in colours]
    seen = [lightness(np.clip(PROTANOPIA @ colour, 0.0, 1.0)) for colour in colours]
    for steps in (np.diff(grey), np.diff(seen)):
        assert np.all(steps > 5.0), steps
    assert grey[-1] - grey[0] > 50.0
    assert grey[-1] < 80.0, "a line must be seen on white"
    assert len({tuple(pair) for pair in itertools.pairwise(SEQUENCE)}) == len(SEQUENCE) - 1


def test_a_record_is_reported_by_its_name_and_drawn_with_its_reversals_where_it_is_evaluated() -> None:
    time_s = np.arange(5000) / 250.0
    phase = 2 * np.pi * 5.0 * time_s
    point = RecordedPoint.from_arrays(
        id="p003", waveform="road", amplitude_m=0.01, frequency_Hz=4.97, current_A=1.0, mid_stroke_m=0.0, kind="signal",
        record=RecordFacts("iso8608-c", 20.0, 1.0, 5.0), time_s=time_s, displacement_m=0.01 * np.sin(phase),
        force_N=300.0 * np.cos(phase),
    )
    view = view_of(point)
    assert (motion_of(view), view.why) == ("road iso8608-c, 10 mm", "")
    assert view.loop is not None
    turns = np.count_nonzero(np.diff(np.sign(np.diff(view.loop.displacement_mm))))
    assert turns == pytest.approx(200, abs=4), "every one of 20 s at 5 Hz"
    assert loop_figures(view).keys() == {"displacement", "velocity"}
    hybrid = replace(point, waveform="hold", kind="hybrid", record=None)
    shown = view_of(hybrid)
    assert motion_of(shown) == "hybrid test, 10 mm"
    assert details([shown], fitted=False) == [], "it has its own section"


def test_an_iterated_signal_shows_its_trials_its_response_and_its_outcome(tmp_path: Path) -> None:
    lines = [0.5 * k for k in range(1, 21)]
    iteration = {
        "outcome": "limit", "reason": "valve", "start": "target", "errors": [0.4321, 0.0765], "best": 1,
        "delays_s": [0.02, 0.0], "band_Hz": [0.5, 9.5], "delay_s": 0.0213, "least_coherence": 0.8,
        "frequency_Hz": lines, "gain": [1.0] * 20, "phase_rad": [0.0] * 20, "coherence": [0.99] * 20,
    }
    time_s = np.arange(1000) / 100.0
    write_file(tmp_path / "p001.h5", PointFile(
        time_s, 100.0, [AlignedChannel("displacement", np.sin(time_s), "m", "Damper extension"),
                        AlignedChannel("force", np.cos(time_s), "N", "Force")],
        test={"id": "p001", "waveform": "road", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": 0.5,
              "kind": "signal", "tracking_tolerance": 0.02, "iteration": json.dumps(iteration)},
        quality={"verdict": "suspect", "reasons": ("iteration: limit",)},
    ))  # fmt: skip
    view = view_of(RecordedPoint.open(tmp_path / "p001.h5"))
    blocks = iteration_section([view])
    text = repr(blocks)
    for shown in ("43.2, 7.65", "0.5", "9.5", "21.3", "limit reached"):
        assert shown in text, shown
    figures = [figure for block in blocks if isinstance(block, Cards) for card in block.cards
               for part in card.blocks if isinstance(part, Figures) for figure in part.figures]
    assert [figure.title for figure in figures] == [
        "p001: RMS error of each trial", "p001: gain from command to rod", "p001: coherence",
    ]
    assert figures[0].traces[1].y.tolist() == pytest.approx([43.21, 7.65])
