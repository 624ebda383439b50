"""Numbers in texts have typographic signs on page and paper; what is typed into a terminal stays."""

from __future__ import annotations

from rig.document import html
from rig.document.blocks import Paragraph
from rig.document.terminal import lines
from rig.document.words import Code, Strong


def test_signs_of_numbers_in_a_text_are_those_of_the_tables() -> None:
    text = "margin -7.87 N (-3.2 %), +-0.46; -.5 to +- 2; p001-2, 2026-03-02, 1e-5; Fix: `--low -5`"
    shown = "margin −7.87 N (−3.2 %), ±0.46; −.5 to ± 2; p001-2, 2026-03-02, 1e-5; Fix: `--low -5`"
    assert html.inline(text) == shown
    assert [line for line, _ in lines([Paragraph(shown)], 120)] == [shown.replace("−", "-")]
    assert html.inline((Strong("-5 N"), Code("-5"))) == "<b>−5 N</b><code>-5</code>"
