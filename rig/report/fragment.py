"""The writer of the report's HTML: escaped text, numbers as people write them, tables, boxes, headings, the page."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

from rig.dampers.covered import in_words
from rig.report.style import STYLE_SHEET
from rig.signals.estimate import Estimate

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
MOST_DECIMALS = 9
CONFIDENCE = 1.96
"""Standard deviations of a 95 % interval."""


def text(value: object) -> str:
    """Any value as escaped text."""
    return html.escape(str(value))


def number(value: object, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none."""
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        return NOTHING
    shown = f"{value + 0.0:.{digits}g}"  # no minus before a zero
    if "e" in shown and 1e-4 <= abs(value) < 1e7:
        shown = f"{value:.0f}"
    return signed(shown)


def between(value: object, low: object, high: object) -> tuple[str, str]:
    """A value and its interval with as many digits as the interval lets be known: two of its half width."""
    ends = [end for end in (low, high) if isinstance(end, (int, float)) and math.isfinite(end)]
    if not isinstance(value, (int, float)) or not math.isfinite(value) or len(ends) < 2 or ends[0] == ends[1]:
        return number(value, 5), f"{number(low, 5)} {ELLIPSIS} {number(high, 5)}"
    decimals = 1 - math.floor(math.log10(abs(ends[1] - ends[0]) / 2.0))
    if decimals > MOST_DECIMALS:
        return number(value, 5), f"{number(low, 5)} {ELLIPSIS} {number(high, 5)}"
    if decimals < 0:
        shown = [_in_full(round(one, decimals), decimals) for one in (value, *ends)]
    else:
        shown = [signed(f"{one:.{decimals}f}") for one in (value, *ends)]
    return shown[0], f"{shown[1]} {ELLIPSIS} {shown[2]}"


def _in_full(rounded: float, decimals: int) -> str:
    """A large number that was rounded before its point, as `number` writes it."""
    size = math.floor(math.log10(abs(rounded))) if rounded else 0
    return number(rounded, max(1, size + 1 + decimals))


def plus_minus(value: Estimate) -> str:
    """A value and its standard deviation, with as many digits as that lets be known."""
    return signed(value.plain)


def signed(shown: str) -> str:
    """Numbers in a text with the signs of print, in place of those of a keyboard."""
    return shown.replace("+-", "\N{PLUS-MINUS SIGN}").replace("-", MINUS)


def chip(label: str, kind: str) -> str:
    """A coloured label; the word itself says what the colour says."""
    return f'<span class="chip {text(kind)}">{text(label)}</span>'


def shaded(content: str, colour: str) -> str:
    """A cell's content on a background of its own (HTML, a CSS colour)."""
    return f'<span class="heat" style="background:{colour}">{content}</span>'


def table(head: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]], numeric: Sequence[int] = ()) -> str:
    """A table of already escaped cells; each row comes with its class; `numeric` columns are set to the right."""

    def cell(tag: str, column: int, content: str) -> str:
        return f'<{tag} class="n">{content}</{tag}>' if column in numeric else f"<{tag}>{content}</{tag}>"

    header = "".join(cell("th", column, title) for column, title in enumerate(head))
    body = "".join(
        f'<tr class="{kind}">' + "".join(cell("td", column, content) for column, content in enumerate(cells)) + "</tr>"
        for kind, cells in rows
    )
    return f'<div class="wide"><table><thead><tr>{header}</tr></thead><tbody>{body}</tbody></table></div>'


def beyond(names: Sequence[str] | None) -> str:
    """In which quantities an unseen test lies beyond the data of its fit; empty where in none, or not told."""
    return in_words(names or ())


def held_out(test: Mapping[str, Any]) -> str:
    """That a test was held out, and in what it lies beyond the fitted data."""
    told = beyond(test.get("beyond"))
    return f"held out, beyond the fitted data: {told}" if told else "held out"


def data_list(pairs: Mapping[str, object]) -> str:
    """Names and values, one a line; values that are empty are left out."""
    lines = "".join(
        f"<dt>{text(name)}</dt><dd>{number(value) if isinstance(value, float) else text(value)}</dd>"
        for name, value in pairs.items() if value not in {None, ""}
    )
    return f'<div class="wide"><dl class="data">{lines}</dl></div>'


def box(kind: str, content: str) -> str:
    """A remark that must not be overlooked; `warn` or `bad`."""
    return block(kind, content)


def heading(title: str, note: str = "", level: int = 2) -> str:
    """A heading, and under it what must be known to read what follows (HTML)."""
    return f"<h{level}>{title}</h{level}>" + (lead(note) if note else "")


def lead(note: str) -> str:
    """A remark in small print (HTML)."""
    return f'<p class="lead">{note}</p>'


def paragraph(content: str) -> str:
    """A paragraph (HTML)."""
    return f"<p>{content}</p>"


def key_line(label: str, keys: str) -> str:
    """A drawing's key on a line of its own (HTML)."""
    return f'<p class="key">{label}{keys}</p>'


def block(kind: str, content: str) -> str:
    """HTML in a block of a class of the style sheet: `facts`, `cards`, `pair`, `card`, `remark`."""
    return f'<div class="{kind}">{content}</div>'


def lines(parts: Sequence[object]) -> str:
    """Texts, one under the other."""
    return "<br>".join(text(part) for part in parts)


def code_block(content: object) -> str:
    """Text as it is typed into a file."""
    return f"<pre>{text(content)}</pre>"


def bullet_list(lines: Sequence[str]) -> str:
    """Lines of text as a list; nothing for none."""
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>" if lines else ""


def card(header: str, *parts: str) -> str:
    """A framed drawing or remark under its header (HTML)."""
    return f'<div class="card"><header>{header}</header>{"".join(parts)}</div>'


def charts(cards: Sequence[str]) -> str:
    """Cards side by side."""
    return f'<div class="charts">{"".join(cards)}</div>'


def key(label: str, colour: str, *, dashed: bool = False) -> str:
    """One line of a drawing's key; the label is HTML."""
    kind = ' class="dash"' if dashed else ""
    return f'<i{kind} style="border-color:{colour}"></i>{label}'


def fact(value: str, meaning: str, kind: str = "") -> str:
    """One of the few numbers at the top of the report (HTML)."""
    return f'<div class="fact {kind}"><b>{value}</b><span>{meaning}</span></div>'


def details(summary: str, content: str) -> str:
    """What is unfolded on demand."""
    return f"<details><summary>{summary}</summary>{content}</details>"


def page(title: str, body: str) -> str:
    """A complete HTML document."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{text(title)}</title><style>{STYLE_SHEET}</style></head><body><main>{body}</main></body></html>\n"
    )
