"""The letters of PDF and PNG: the first fonts that the system has, and texts in letters that they have."""

from __future__ import annotations

import unicodedata
from functools import cache

from reportlab.pdfbase.pdfmetrics import getFont, registerFont, registerFontFamily
from reportlab.pdfbase.ttfonts import TTFError, TTFont

FILES = {
    "Sheet": ("DejaVuSans.ttf", "arial.ttf", "Vera.ttf"),
    "Sheet-Bold": ("DejaVuSans-Bold.ttf", "arialbd.ttf", "VeraBd.ttf"),
    "Sheet-Mono": ("DejaVuSansMono.ttf", "consola.ttf", "Vera.ttf"),
}  # fmt: skip
"""The first that the system has; Bitstream Vera comes with ReportLab and has Latin letters only."""


@cache
def register() -> None:
    """Make the fonts of `FILES` known to ReportLab."""
    for name, files in FILES.items():
        for file in files:
            try:
                registerFont(TTFont(name, file))
            except TTFError:
                continue
            break
    registerFontFamily("Sheet", normal="Sheet", bold="Sheet-Bold", italic="Sheet", boldItalic="Sheet-Bold")


def file(name: str) -> str:
    """Path of a font of `FILES`."""
    register()
    return str(getFont(name).face.filename)


@cache
def _has(letter: str) -> bool:
    register()
    return letter.isspace() or ord(letter) in getFont("Sheet").face.charToGlyph


def known(text: str) -> str:
    """A text with letters that the font lacks without their accents, or as `?`."""
    if all(map(_has, set(text))):
        return text
    return "".join(
        letter if _has(letter) else unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode() or "?"
        for letter in text
    )
