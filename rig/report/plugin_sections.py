"""Sections of the report from other packages: entry points `mr_rig.report_sections`, in the order of their names.

A section is a function of the run and its fit (`fit.json` as an object, or None) that returns a list of blocks
(`rig.document.blocks`), or HTML as in earlier versions. One that fails leaves a remark in its place: no report is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html.parser import HTMLParser
from typing import Any, get_args

from rig.document.blocks import Block, Blocks, Heading, Items, Listing, Markup, Note, Paragraph, Table, table
from rig.document.words import FAIR, POOR
from rig.fits.fit_record import FitRecord
from rig.plugins import REPORT_SECTIONS, BrokenPlugIn, PlugIn, found, made_of
from rig.recording.run import Run

Section = Callable[[Run, Mapping[str, Any] | None], Sequence[Block] | str]
KINDS: tuple[type[Block], ...] = get_args(Block)


def section_of(name: str, brought: object) -> Section:
    """What an entry point names, as a section.

    Raises:
        ValueError: it cannot be called.
    """
    if not callable(brought):
        raise ValueError(f"{name}: got {type(brought).__name__}, expected a function that takes a run and its fit")
    return brought


def installed_sections(run: Run, fit: FitRecord | None) -> Blocks:
    """The blocks of every installed section."""
    return [block for plug_in in found(REPORT_SECTIONS) for block in _blocks(plug_in, run, fit)]


def _blocks(plug_in: PlugIn, run: Run, fit: FitRecord | None) -> Sequence[Block]:
    named = f"section {plug_in.name!r} from {plug_in.place}"
    try:
        content: object = made_of(plug_in, section_of)(run, None if fit is None else fit.to_json())
    except BrokenPlugIn as error:
        return [Note(FAIR, f"A section could not be created: {error}")]
    except Exception as error:  # noqa: BLE001 - whatever a plug-in raises is reported in the section's place
        return [Note(FAIR, f"A section could not be created: {named} failed: {type(error).__name__}: {error}")]
    if isinstance(content, str):
        return [Markup(content, tuple(blocks_of(content)))]
    if isinstance(content, Sequence) and all(isinstance(block, KINDS) for block in content):
        return content
    got = type(content).__name__
    return [Note(FAIR, f"A section could not be created: {named} returned {got}, expected blocks or HTML")]


def blocks_of(markup: str) -> Blocks:
    """HTML of a section as blocks, for the writers that are not HTML: its texts and tables; drawings are left out."""
    reader = _Reader()
    reader.feed(markup)
    reader.close()
    return reader.blocks


class _Reader(HTMLParser):
    """Collects the text of each element that is a block; elements it does not know are transparent."""

    TEXTS = frozenset({"h1", "h2", "h3", "p", "pre", "summary", "li", "th", "td", "dt", "dd"})
    SILENT = frozenset({"script", "style", "svg"})

    def __init__(self) -> None:
        super().__init__()
        self.blocks: Blocks = []
        self._silent = 0
        self._text: list[str] = []
        self._kinds: list[str] = []
        self._rows: list[list[str]] = []
        self._items: list[str] = []
        self._small = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a block, or close one that is open."""
        kinds = (dict(attrs).get("class") or "").split()
        self._silent += tag in self.SILENT
        if tag == "br":
            self._text.append("\n")
        elif tag == "tr":
            self._rows.append([])
        elif tag in self.TEXTS or tag in {"div", "table", "ul"}:
            self._end_text()
            self._small = "lead" in kinds
        if tag == "div":
            self._kinds.append(next((kind for kind in kinds if kind in {"warn", "bad"}), ""))

    def handle_endtag(self, tag: str) -> None:
        """End a block."""
        self._silent -= tag in self.SILENT and self._silent > 0
        text = "".join(self._text).strip()
        if tag in {"th", "td"} and self._rows:
            self._rows[-1].append(text)
        elif tag == "li":
            self._items.append(text)
        elif tag == "pre":
            self.blocks.append(Listing("".join(self._text).strip("\n")))
        elif tag in {"h1", "h2", "h3"}:
            self.blocks.append(Heading(text, int(tag[1])))
        elif tag == "ul" and self._items:
            self.blocks.append(Items(tuple(self._items)))
            self._items = []
        elif tag == "table" and self._rows:
            self.blocks.append(self._table())
            self._rows = []
        elif tag in self.TEXTS or tag == "div":
            self._end_text()
            if tag == "div" and self._kinds:
                self._kinds.pop()
        else:
            return
        self._text = []

    def handle_data(self, data: str) -> None:
        """Collect text."""
        if not self._silent:
            self._text.append(data)

    def close(self) -> None:
        """What is left is a paragraph."""
        super().close()
        self._end_text()

    def _table(self) -> Table:
        head, *rows = self._rows
        filled = [[*row, *[""] * (len(head) - len(row))][: len(head)] for row in rows]
        first = "0123456789.+-\N{MINUS SIGN}"
        numeric = [place for place in range(len(head)) if all(row[place][:1] in first for row in filled)]
        return table(head, filled, numeric)

    def _end_text(self) -> None:
        text, self._text = "".join(self._text).strip(), []
        if not text:
            return
        kind = next((kind for kind in reversed(self._kinds) if kind), "")
        self.blocks.append(Note(POOR if kind == "bad" else FAIR, text) if kind else Paragraph(text, small=self._small))
        self._small = False
