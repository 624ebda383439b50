"""The report for a customer: two printed pages, `[report]`, a logo that loads nothing, SIMULATED on every page."""

from __future__ import annotations

import io
import json
import struct
import time
import zlib
from pathlib import Path

import pypdf
import pytest

from rig.cli.main import main
from rig.document.blocks import Cover, Document, Paragraph, Sheet, table
from rig.document.html import page
from rig.document.moments import local_time
from rig.document.numbers import known_digits, with_uncertainty
from rig.document.pdf import pdf
from rig.document.picture import picture_of
from rig.errors import FileProblem
from rig.matrix.model import load_matrix
from rig.recording.run import Run
from rig.report.cover import Details, mark_of

SVG = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20"><rect width="40" height="20" fill="url(#g)"/></svg>'
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
[matrix]
amplitude = ["10 mm"]
frequency = ["1 Hz"]
current = ["0 A"]
[report]
customer = "ACME <b>"
operator = "J. Smith"
"""


def png(width: int = 4, height: int = 2, *, stated: int = 0) -> bytes:
    """A grey PNG; its header states another height where that is given."""
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, stated or height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"".join(b"\0" + bytes(width) for _ in range(height)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def test_a_logo_is_embedded_and_known_by_its_shape() -> None:
    assert picture_of(png()).ratio == picture_of(SVG).ratio == 2.0
    shown = page(Document("x", [Cover("x", (), picture_of(SVG))]))
    assert '<img class="logo" src="data:image/svg+xml;base64,' in shown


@pytest.mark.parametrize(("content", "reason"), [
    (b"GIF89a", "neither a PNG nor an SVG"), (png()[:20], "incomplete"), (png() + b"x" * 1_000_000, "1000"),
    (png()[:40] + b"\xff" + png()[41:], "checksum"), (png(stated=900), "does not contain as many pixels"),
    (png(stated=3_000_000), "allowed: at most 4000000"),
    (SVG.replace(b"<rect", b"<script/><rect"), "<script>"), (SVG.replace(b"<rect", b'<rect onload="x()"'), "onload"),
    (SVG.replace(b"<rect", b'<image href="/etc/passwd"/><rect'), "<image>"),
    (SVG.replace(b"<rect", b'<use href="http://x/y#z"/><rect'), "http"),
    (SVG.replace(b"url(#g)", b"url(//x/y)"), "refers to another file"),
    (SVG.replace(b"<rect", b"<style>@im/**/port 'x'</style><rect"), "refers to another file"),
    (b'<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY a "b">]>' + SVG, "entities"), (b"<svg", "not well-formed"),
    (SVG.replace(b"viewBox", b"box"), "does not state its size"),
    (SVG.replace(b"40 20\"", b"40 0\""), "does not state its size"),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_a_logo_that_could_load_run_or_burst_is_refused(content: bytes, reason: str) -> None:
    with pytest.raises(ValueError, match=reason.replace("(", r"\(")):
        picture_of(content)


def test_a_wrong_report_table_is_refused_and_a_right_one_leaves_the_digest(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_text(MATRIX)
    (tmp_path / "logo.png").write_bytes(png())
    plain = load_matrix(file).digest
    file.write_text(MATRIX + 'logo = "logo.png"\ntitle = "Test"\n')
    matrix = load_matrix(file)
    assert matrix.digest == plain
    assert matrix.report.picture is not None
    file.write_text(MATRIX + 'logo = "lost.png"\ntitle = "a\\nb"\ncustomr = "x"\n')
    with pytest.raises(FileProblem) as refused:
        load_matrix(file)
    text = "\n".join(refused.value.problems)
    assert all(words in text for words in ("line 14", "title", "customr", "customer"))
    file.write_text(MATRIX + 'logo = "/dev/zero"\n')
    with pytest.raises(FileProblem, match="device"):
        load_matrix(file)


def run_with(folder: Path, logo: str = "", *, simulated: bool = False) -> Run:
    (folder / "records").mkdir(parents=True)
    (folder / "records" / "logo.png").write_bytes(png())
    (folder / "matrix.toml").write_text(MATRIX + (f'logo = "{logo}"\n' if logo else ""))
    return Run(folder, (), {"specimen": "MR-001", "simulated": {"speed": 1} if simulated else None})


def test_details_come_from_the_matrix_and_the_page_and_a_logo_only_from_the_runs_own_folder(tmp_path: Path) -> None:
    run = run_with(tmp_path / "a", "records/logo.png")
    (run.path / "operator.json").write_text(json.dumps({"operator": "other", "notes": [
        {"utc": "2026-01-01T10:00:00.123Z", "by": "B", "text": "squeaks"}, "no note",
    ]}))  # fmt: skip
    details = Details.of(run)
    assert (details.operator, details.table.customer) == ("other", "ACME <b>")
    assert details.logo is not None
    assert details.notes == (f"{local_time('2026-01-01T10:00:00Z')} B: squeaks",)
    stranger = run_with(tmp_path / "b", str(run.path / "records" / "other.png"))
    (run.path / "records" / "other.png").write_bytes(png())
    assert Details.of(stranger).logo is None
    assert "other.png" in Details.of(stranger).problems[0]
    linked = stranger.path / "records" / "other.png"
    linked.symlink_to(run.path / "records" / "other.png")
    assert "symbolic link" in Details.of(stranger).problems[0]


def test_simulated_runs_are_named_where_only_some_are(tmp_path: Path) -> None:
    real, made = run_with(tmp_path / "real"), run_with(tmp_path / "made", simulated=True)
    assert mark_of([real]) == ""
    assert mark_of([made]).startswith("SIMULATED")
    assert "made" in mark_of([real, made])


def test_sheets_are_one_page_each_whatever_is_on_them_and_every_page_has_the_mark() -> None:
    long = table(["a", "b"], [[f"row {k}", "x" * 30] for k in range(150)])
    document = Document("t", [
        Sheet((Cover("T", ("a line",), picture_of(png())), Paragraph("short"))), Sheet((long,)), long, long,
    ], "SIMULATED: x")  # fmt: skip
    whole, sheets = (pypdf.PdfReader(io.BytesIO(pdf(one))) for one in (document, document.sheets))
    assert len(sheets.pages) == 2
    assert all("SIMULATED: x" in sheet.extract_text() for sheet in whole.pages)
    assert "row 149" in sheets.pages[1].extract_text()
    assert "page 2 of 2" in sheets.pages[1].extract_text()
    shown = page(document)
    assert '<div class="mark">SIMULATED: x</div>' in shown
    assert "@top-center" in shown


def test_an_svg_logo_is_drawn_with_vectors_and_a_png_logo_as_a_picture() -> None:
    pytest.importorskip("svglib", reason="svglib (extra pdf) is not installed")
    counts = []
    for logo in (SVG, png()):
        (sheet,) = pypdf.PdfReader(io.BytesIO(pdf(Document("t", [Cover("T", (), picture_of(logo))])))).pages
        counts.append(len(list(sheet.images)))
    assert counts == [0, 1]


def test_a_summary_without_a_pdf_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path), "--summary"]) == 2
    assert "add --pdf" in capsys.readouterr().err


@pytest.mark.parametrize(("value", "std", "shown"), [
    (0.7512, 0.57, "0.8 ± 0.6"), (50.0, 0.00081, "50.0000 ± 0.0008"), (1234.0, 57.0, "1230 ± 60"),
    (-1.807e-05, 1e-3, "0.0000 ± 0.0010"), (1.0, 0.0098, "1.000 ± 0.010"), (12.3456, float("nan"), "12.35"),
    (100.530965495, 2e-9, "100.531 ± 2e−09"),
])  # fmt: skip
def test_a_value_is_rounded_to_its_uncertainty(value: float, std: float, shown: str) -> None:
    assert with_uncertainty(value, std) == shown
    assert known_digits(value, std) == shown.partition(" ")[0]


def test_moments_are_local_with_their_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
    time.tzset()
    try:
        assert local_time("2026-07-01T12:00:00.123+00:00") == "2026-07-01 14:00:00 UTC+02:00"
        assert local_time("2026-01-01T12:00:00", seconds=False) == "2026-01-01 13:00 UTC+01:00"
        assert local_time("no time") == "no time"
    finally:
        monkeypatch.undo()
        time.tzset()
