from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageColor

from rig.document.blocks import Cards, Figures
from rig.document.drawing import Line, drawing_of
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.plot import Plot
from rig.document.style import FITTED, MEASURED
from rig.errors import RigError
from rig.export import export
from rig.extras import how_to_install
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.run import Run
from rig.report import figures, loops
from rig.report.document import Material


def write_point(run: Path, name: str, current_A: float, damping_N_s_m: float, frequency_Hz: float = 1.0) -> None:
    """A point of a viscous damper at 20 mm: six seconds of a sine between two rests."""
    time_s = np.arange(1600) / 250.0
    phase = 2 * np.pi * frequency_Hz * np.clip(time_s - 0.2, 0.0, 6.0)
    moves = (phase > 0) & (phase < 12 * np.pi * frequency_Hz)
    force_N = damping_N_s_m * 0.02 * 2 * np.pi * frequency_Hz * np.cos(phase) * moves
    (run / "points").mkdir(exist_ok=True)
    write_file(run / "points" / f"{name}.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", 0.02 * np.sin(phase), "m", "Damper extension"),
         AlignedChannel("force", force_N, "N", "Force"),
         AlignedChannel("current", np.full(1600, current_A), "A", "Current")],
        test={"id": name, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": frequency_Hz,
              "current_A": current_A, "mid_stroke_m": 0.0},
        quality={"verdict": "valid", "reasons": ()}, provenance={},
    ))  # fmt: skip


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two currents of a viscous damper, 500 and 900 N s/m, at 20 mm and 1 Hz."""
    write_point(tmp_path, "p001", 0.0, 500.0)
    write_point(tmp_path, "p002", 1.0, 900.0)
    return tmp_path


def test_loops_of_two_motions_at_one_current_are_closed_and_in_one_chart(run: Path) -> None:
    write_point(run, "p003", 1.0, 900.0, frequency_Hz=2.0)
    (cards,) = [block for block in loops.all_motions(Material.of(Run.open(run)).views) if isinstance(block, Cards)]
    (card,) = cards.cards
    (charts,) = [block for block in card.blocks if isinstance(block, Figures)]
    over_displacement, over_velocity = [one for one in charts.figures if isinstance(one, Figure)]
    for figure in (over_displacement, over_velocity):
        assert [trace.name for trace in figure.traces] == ["1 A, p002", "1 A, p003"]
    forces_N = [900.0 * 0.02 * 2 * np.pi * frequency_Hz for frequency_Hz in (1.0, 2.0)]
    for trace, force_N in zip(over_displacement.traces, forces_N, strict=True):
        assert np.nanmax(trace.y) == pytest.approx(force_N, rel=5e-3)
        assert (trace.x[-1], trace.y[-1]) == (pytest.approx(trace.x[0], abs=0.2), pytest.approx(trace.y[0], rel=0.01))


def test_one_call_gives_every_figure_of_the_report_with_its_arrays(run: Path) -> None:
    drawn = figures(run)
    assert {"overview/sine, 20 mm, 1 Hz", "loops/p001/displacement", "loops/p002/velocity", "traces/p002/force",
            "standard/force", "standard/energy"} <= drawn.keys()
    assert not any(name.endswith("residual") for name in drawn), "nothing was fitted"
    (loop,) = drawn["loops/p002/velocity"].traces
    peak_m_s = 0.02 * 2 * np.pi
    assert np.nanmax(loop.x) == pytest.approx(peak_m_s, rel=2e-3)
    assert np.nanmax(loop.y) == pytest.approx(900.0 * peak_m_s, rel=5e-3)
    low, high = drawn["standard/energy"].traces
    assert high.y[0] / low.y[0] == pytest.approx(900.0 / 500.0, rel=1e-3)
    assert [trace.name for trace in drawn["overview/sine, 20 mm, 1 Hz"].traces] == ["0 A, p001", "1 A, p002"]


def test_a_figure_is_an_svg_file_of_its_own_with_its_style(run: Path, tmp_path: Path) -> None:
    chart = figures(run)["loops/p001/velocity"]
    root = ElementTree.parse(chart.save(tmp_path / "loop.svg")).getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    (style,) = root.findall("{http://www.w3.org/2000/svg}style")
    assert ".m {" in str(style.text)
    assert chart._repr_svg_() == (tmp_path / "loop.svg").read_text(encoding="utf-8")
    assert chart.save(tmp_path / "loop.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(ValueError, match=r"\.jpg"):
        chart.save(tmp_path / "loop.jpg")


def inked(picture: Image.Image, colour: str) -> tuple[int, int, int, int]:
    """Left, top, right and bottom pixel of a colour."""
    expected = np.array(ImageColor.getrgb(colour))
    rows, columns = np.nonzero(np.abs(np.asarray(picture.convert("RGB"), float) - expected).max(axis=2) < 60.0)
    return int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())


def test_a_png_has_the_lines_of_the_drawing_where_they_belong_at_any_resolution(tmp_path: Path) -> None:
    step = Trace(np.array([0.0, 5.0, 5.0, 10.0]), np.array([0.0, 0.0, 100.0, 100.0]), Style.MEASURED)
    dashed = Trace(np.array([0.0, 10.0]), np.array([50.0, 50.0]), Style.FITTED)
    axes = Axis("Time", "s", limits=(0.0, 10.0)), Axis("Force", "N", limits=(-20.0, 120.0))
    plot = Plot(Figure(*axes, [step, dashed], 300, 200))
    drawn = [mark for mark in drawing_of(plot.figure).marks if isinstance(mark, Line)]
    (left, top), (right, bottom) = (end(drawn[2].pieces[0], axis=0) for end in (np.min, np.max))
    for dpi in (96.0, 240.0):
        picture = Image.open(plot.save(tmp_path / "step.png", dpi=dpi))
        scale = dpi / 96.0
        assert picture.size == (round(300 * scale), round(200 * scale))
        assert picture.info["dpi"] == pytest.approx((dpi, dpi), rel=1e-3)
        edges = np.array(inked(picture, MEASURED)) / scale
        assert edges == pytest.approx([left, top, right, bottom], abs=1.5)
        row = np.asarray(picture.convert("RGB"), float)[round(scale * float(drawn[3].pieces[0][0, 1]))]
        off = np.abs(row - ImageColor.getrgb(FITTED)).max(axis=1) < 60.0
        assert np.count_nonzero(np.diff(off.astype(int)) == 1) == pytest.approx((right - left) / 8.0, abs=2.0)
    letters = np.asarray(picture.convert("L"))[:, : round(20 * scale)]
    assert np.count_nonzero(letters < 128) > 50, "the turned label of the axis"
    with pytest.raises(ValueError, match="dpi"):
        plot.save(tmp_path / "step.png", dpi=5.0)


@pytest.mark.parametrize(("ending", "needs"), [("png", "PIL"), ("pdf", "reportlab")])
def test_without_its_library_a_file_is_refused_with_the_command_that_installs_it(
    ending: str, needs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [one for one in sys.modules if one.startswith((f"rig.document.{ending}", "rig.document.fonts", needs))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("rig.document.fonts", raising=False)
    monkeypatch.delattr(f"rig.document.{ending}", raising=False)
    monkeypatch.setitem(sys.modules, needs, None)
    plot = Plot(Figure(Axis("Time", "s"), Axis("Force", "N"), [Trace(np.arange(2.0), np.arange(2.0))]))
    with pytest.raises(RigError, match=re.escape(how_to_install("pdf"))):
        plot.save(tmp_path / f"a.{ending}")
    assert not list(tmp_path.iterdir())


def test_the_figures_of_a_report_are_exported_one_file_each(run: Path, tmp_path: Path) -> None:
    made = export(run, "svg", tmp_path / "figures")
    assert len(made) == len(figures(run)) == len(set(made))
    assert tmp_path / "figures" / "overview-sine-20-mm-1-Hz.svg" in made
    assert all(re.fullmatch(r"[\w.+-]+", path.name) for path in made)
