from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.report import figures


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two currents of a viscous damper, 500 and 900 N s/m, at 20 mm and 1 Hz."""
    (tmp_path / "points").mkdir()
    for name, current_A, damping_N_s_m in (("p001", 0.0, 500.0), ("p002", 1.0, 900.0)):
        time_s = np.arange(1600) / 250.0
        phase = 2 * np.pi * np.clip(time_s - 0.2, 0.0, 6.0)
        force_N = damping_N_s_m * 0.02 * 2 * np.pi * np.cos(phase) * ((phase > 0) & (phase < 12 * np.pi))
        write_file(tmp_path / "points" / f"{name}.h5", PointFile(
            time_s, 250.0,
            [AlignedChannel("displacement", 0.02 * np.sin(phase), "m", "Damper extension"),
             AlignedChannel("force", force_N, "N", "Force"),
             AlignedChannel("current", np.full(1600, current_A), "A", "Current")],
            test={"id": name, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": current_A,
                  "mid_stroke_m": 0.0},
            quality={"verdict": "valid", "reasons": ()}, provenance={},
        ))  # fmt: skip
    return tmp_path


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
    with pytest.raises(ValueError, match=r"\.png"):
        chart.save(tmp_path / "loop.png")
