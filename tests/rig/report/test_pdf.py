from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pypdf
import pytest

from rig.cli.main import main
from rig.report.chart import Chart, Trace
from rig.report.fragment import block, box, card, charts, details, heading, number, page, table, text
from rig.report.html_tree import tree_of
from rig.report.pdf import pdf_of, write_pdf

A4_WIDTH, A4_HEIGHT = 595.3, 841.9
X = np.linspace(0.0, 1.0, 50)
CHART = Chart("Velocity m/s", "Force N", [Trace(X, np.sin(9.0 * X), "m", "measured", "#2fb47c")])


def read(pdf: bytes) -> pypdf.PdfReader:
    return pypdf.PdfReader(io.BytesIO(pdf))


def letters(reader: pypdf.PdfReader) -> list[tuple[str, float, float]]:
    """Every text of a PDF with the place (points) at which it begins."""
    seen: list[tuple[str, float, float]] = []
    for sheet in reader.pages:
        sheet.extract_text(visitor_text=lambda text, outer, own, font, size: seen.append((
            text, outer[4] + outer[0] * own[4] + outer[2] * own[5], outer[5] + outer[1] * own[4] + outer[3] * own[5],
        )))
    return [one for one in seen if one[0].strip()]


@pytest.fixture(scope="module")
def pdf() -> bytes:
    wide = [f"column {k} of many" for k in range(14)]
    rows = [("", [text(f"p{row:03d}"), *(number(1e3 * np.sin(row + k), 5) for k in range(13))]) for row in range(120)]
    body = "".join([
        heading("Damper test report: &lt;script&gt;", "simulated rig", 1), box("bad", "<b>The model does not fit.</b>"),
        heading("A long table"), table(wide, rows, range(1, 14)),
        details("9 more warnings", box("warn", "warning nine")),
        heading("Loops"), block("cards", "".join(card(f"<b>p{k}</b>", CHART.svg()) for k in range(9))),
        heading("Charts"), charts([card("<b>chart</b>", CHART.svg())] * 3),
    ])  # fmt: skip
    return pdf_of(page("Damper test report <x>", body), "Damper test report <x>")


def test_every_page_is_A4_and_has_its_number(pdf: bytes) -> None:
    reader = read(pdf)
    for number_, sheet in enumerate(reader.pages, start=1):
        size = float(sheet.mediabox.width), float(sheet.mediabox.height)
        assert size == pytest.approx((A4_WIDTH, A4_HEIGHT), abs=1)
        assert f"page {number_} of {len(reader.pages)}" in sheet.extract_text()


def test_nothing_of_a_wide_and_long_table_is_cut_off_or_lost(pdf: bytes) -> None:
    reader = read(pdf)
    told = "\n".join(sheet.extract_text() for sheet in reader.pages)
    assert all(f"p{row:03d}" in told for row in range(120))
    assert told.count("of many") > 14, "heads are repeated on every page"
    for words, x, y in letters(reader):
        assert 0.0 < x < A4_WIDTH - 10.0, words
        assert 0.0 < y < A4_HEIGHT, words
    assert "warning nine" in told, "what is folded on screen is printed"
    assert "<script>" in told


def test_charts_are_vectors_and_letters_are_letters(pdf: bytes) -> None:
    reader = read(pdf)
    assert [image for sheet in reader.pages for image in sheet.images] == []
    told = "".join(sheet.extract_text() for sheet in reader.pages)
    assert told.count("Velocity m/s") == 12
    drawn = b"".join(sheet.get_contents().get_data() for sheet in reader.pages)  # type: ignore[union-attr]
    assert drawn.count(b" l") >= 12 * 49, "twelve curves of fifty points"


def test_the_tree_of_a_page_survives_ends_without_a_beginning() -> None:
    root = tree_of("<main><div class='a b'>one<br>two</p><b>three</b></div></section></main>")
    (node,) = root.elements("div")
    assert node.kinds == {"a", "b"}
    assert node.text == "onetwothree"


def test_the_command_writes_the_pdf_beside_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = tmp_path / "report.html"
    report.write_text(page("R & D", heading("Title", level=1)), encoding="utf-8")
    assert write_pdf(report) == tmp_path / "report.pdf"
    assert read((tmp_path / "report.pdf").read_bytes()).metadata.title == "R & D"  # type: ignore[union-attr]


def test_without_its_library_the_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.report.write_report", lambda run: tmp_path / "report.html")
    monkeypatch.delitem(sys.modules, "rig.report.pdf", raising=False)
    monkeypatch.setitem(sys.modules, "reportlab.lib.colors", None)
    assert main(["report", str(tmp_path), "--pdf"]) == 2
    assert "pip install" in capsys.readouterr().err
