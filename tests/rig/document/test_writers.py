"""Every writer has every kind of block; a terminal of any width loses nothing; HTML escapes everything."""

from __future__ import annotations

from typing import get_args

import pytest

from rig.document import html, pdf, terminal
from rig.document.blocks import (
    Block,
    Column,
    Document,
    Fact,
    Facts,
    Heading,
    Items,
    Note,
    Paragraph,
    Properties,
    Row,
    table,
)
from rig.document.words import FAIR, POOR, Code, Label, Shade, Strong, plain, verdict

LONG = "a remark that is longer than its column and has to be folded onto several lines"
TABLE = table(
    ["point", Column("force at peak velocity", "N", numeric=True), Column("energy", "J", numeric=True), "remark"],
    [["p001", "1234.5", "18.3", LONG], Row(("p002", "-5", "-", (verdict("invalid"), " \nsecond line")), POOR)],
)


def test_every_writer_has_every_kind_of_block() -> None:
    kinds = set(get_args(Block))
    assert set(html._WRITERS) == set(pdf._WRITERS) == set(terminal._WRITERS) == kinds


@pytest.mark.parametrize("width", [20, 33, 40, 57, 80, 132])
def test_a_terminal_of_any_width_shows_every_cell_of_a_table(width: int) -> None:
    shown = list(terminal.lines([Heading("Points"), TABLE], width))
    assert max(len(text) for text, _ in shown) <= width
    text = " ".join(" ".join(line.split()) for line, _ in shown)
    for part in ("p001", "1234.5", "18.3", "p002", "-5", "invalid", "second line", "folded"):
        assert part in text, part
    assert any(style == "red" and "p002" in line for line, style in shown)
    assert "force" in text
    assert "N" in text.replace(",", " ").split()


def test_columns_are_aligned_and_folded_before_they_become_blocks() -> None:
    lines = [text for text, _ in terminal.lines([TABLE], 57)]
    (first,) = (line for line in lines if "p001" in line)
    (second,) = (line for line in lines if "p002" in line)
    assert first.index("1234.5") + 6 == second.index("-5") + 2
    assert sum("p00" in line for line in lines) == 2
    wide = [text for text, _ in terminal.lines([TABLE], 200)]
    assert len(wide) == 1 + 1 + 2, "head, a line, and one with a line feed"


def test_a_terminal_shows_texts_facts_lists_and_properties() -> None:
    shown = "\n".join(text for text, _ in terminal.lines([
        Facts((Fact("20 of 20", "points valid"),)), Note(FAIR, "careful"), Items(("one",)),
        Properties({"seed": 3, "none": None, "share": 0.25}), Paragraph(("see ", Code("rig plan"))),
    ], 80))  # fmt: skip
    assert shown.splitlines() == [
        "20 of 20: points valid", "careful", "- one", "seed: 3", "share: 0.25", "see rig plan",
    ]  # fmt: skip


def test_html_escapes_texts_wherever_they_are() -> None:
    bad = "<script>&\"'"
    blocks: list[Block] = [
        Heading(bad, name=bad), Paragraph((Strong(bad), Code(bad), Shade(bad, 0.5))), Note(POOR, Label(bad)),
        table([bad, Column("x", bad)], [[bad, bad]], title=bad), Items((bad,)), Properties({bad: bad}),
    ]  # fmt: skip
    shown = html.page(Document(bad, blocks))
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;&amp;") == 15


def test_the_plain_text_of_a_cell_has_no_looks() -> None:
    assert plain((Strong("a"), " ", Shade("1.00", -0.3))) == "a 1.00"
