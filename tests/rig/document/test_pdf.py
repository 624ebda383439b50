from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest

from rig.cli.main import main
from rig.document.blocks import (
    Card,
    Cards,
    Details,
    Document,
    Figures,
    Heading,
    Items,
    Listing,
    Note,
    Paragraph,
    Properties,
    Sheet,
    table,
)
from rig.document.figure import Axis, Figure, Trace
from rig.document.html import page as page_of
from rig.document.numbers import number
from rig.document.pdf import pdf as pdf_of
from rig.document.words import FAIR, POOR, Strong

A4_WIDTH, A4_HEIGHT = 595.3, 841.9
X = np.linspace(0.0, 1.0, 50)
CURVE = Trace(X, np.sin(9.0 * X), name="measured", colour="#2fb47c")
FIGURES = Figures((Figure(Axis("Velocity", "m/s"), Axis("Force", "N"), [CURVE]),))


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
    rows = [[f"p{row:03d}", *(number(1e3 * np.sin(row + k), 5) for k in range(13))] for row in range(120)]
    return pdf_of(Document("Damper test report <x>", [
        Heading("Damper test report: <script>", 1), Paragraph("simulated rig", small=True),
        Note(POOR, Strong("The model does not fit.")), Heading("A long table"), table(wide, rows, range(1, 14)),
        Details("Further warnings: 9", (Note(FAIR, "warning nine"),)),
        Heading("Loops"), Cards(tuple(Card(Strong(f"p{k}"), (FIGURES,)) for k in range(9)), large=True),
        Heading("Charts"), Cards((Card(Strong("chart"), (FIGURES,)),) * 3),
        Properties({"operator": "Jos\u00e9 \u4e2d", "empty": ""}), Items(("an item",)), Listing("[[point]]\n  x = 1"),
    ]))  # fmt: skip


def test_every_page_is_A4_and_has_its_number(pdf: bytes) -> None:
    reader = read(pdf)
    for number_, sheet in enumerate(reader.pages, start=1):
        size = float(sheet.mediabox.width), float(sheet.mediabox.height)
        assert size == pytest.approx((A4_WIDTH, A4_HEIGHT), abs=1)
        assert f"page {number_} of {len(reader.pages)}" in sheet.extract_text()


def test_on_letter_paper_a_sheet_is_one_page_of_that_size_and_the_print_style_states_it() -> None:
    sheet = Sheet((Heading("One page", 1), table(["a", "b"], [["1", "2"]] * 90, range(2))))
    document = Document("Letter", [sheet, Paragraph("after it")], "SIMULATED", "letter")
    reader = read(pdf_of(document))
    assert [(float(one.mediabox.width), float(one.mediabox.height)) for one in reader.pages] == [(612.0, 792.0)] * 2
    assert all(0.0 < x < 612.0 and 0.0 < y < 792.0 for _, x, y in letters(reader))
    assert ("size:letter" in page_of(document), "size:letter" in page_of(Document("A4"))) == (True, False)


def test_nothing_of_a_wide_and_long_table_is_cut_off_or_lost(pdf: bytes) -> None:
    reader = read(pdf)
    reported = "\n".join(sheet.extract_text() for sheet in reader.pages)
    assert all(f"p{row:03d}" in reported for row in range(120))
    assert reported.count("of many") > 14, "heads are repeated on every page"
    for words, x, y in letters(reader):
        assert 0.0 < x < A4_WIDTH - 10.0, words
        assert 0.0 < y < A4_HEIGHT, words
    assert "warning nine" in reported, "what is folded on screen is printed"
    assert "<script>" in reported


def test_charts_are_vectors_and_letters_are_letters(pdf: bytes) -> None:
    reader = read(pdf)
    assert [image for sheet in reader.pages for image in sheet.images] == []
    reported = "".join(sheet.extract_text() for sheet in reader.pages)
    assert reported.count("Velocity (m/s)") == 12
    drawn = b"".join(sheet.get_contents().get_data() for sheet in reader.pages)  # type: ignore[union-attr]
    assert drawn.count(b" l") >= 12 * 49, "twelve curves of fifty points"


def test_headings_are_bookmarks_that_lead_to_their_pages(pdf: bytes) -> None:
    reader = read(pdf)
    found = [(str(one.title), reader.get_destination_page_number(one)) for one in flat(reader.outline)]
    assert [title for title, _ in found] == ["Damper test report: <script>", "A long table", "Loops", "Charts"]
    for title, page in found:
        assert title in reader.pages[page].extract_text()  # type: ignore[index]


def flat(outline: list[Any]) -> list[Any]:
    return [one for part in outline for one in (flat(part) if isinstance(part, list) else [part])]


def test_letters_that_a_font_does_not_have_are_replaced_and_the_title_is_in_the_properties(pdf: bytes) -> None:
    reader = read(pdf)
    text = "".join(sheet.extract_text() for sheet in reader.pages)
    assert reader.metadata.title == "Damper test report <x>"  # type: ignore[union-attr]
    assert "Jos\u00e9 ?" in text
    assert "an item" in text
    assert "[[point]]" in text
    assert "empty" not in text


def test_without_its_library_the_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    report = (tmp_path / "report.html", Document("x"))
    monkeypatch.setattr("rig.report.document.written_report", lambda run, details: report)
    monkeypatch.delitem(sys.modules, "rig.document.pdf", raising=False)
    monkeypatch.setitem(sys.modules, "reportlab.lib.colors", None)
    assert main(["report", str(tmp_path), "--pdf"]) == 2
    assert "pip install" in capsys.readouterr().err
