"""Small pieces of HTML: escaped text, tables, numbers as people write them."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

from rig.recording.estimate import Estimate

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"


def text(value: object) -> str:
    """Any value as escaped text."""
    return html.escape(str(value))


def number(value: object, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none."""
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        return NOTHING
    shown = f"{value:.{digits}g}"
    if "e" in shown and 1e-4 <= abs(value) < 1e7:
        shown = f"{value:.0f}"
    return signed(shown)


def plus_minus(value: Estimate) -> str:
    """A value and its standard deviation, with as many digits as that lets be known."""
    return signed(value.plain)


def signed(shown: str) -> str:
    """Numbers in a text with the signs of print, in place of those of a keyboard."""
    return shown.replace("+-", "\N{PLUS-MINUS SIGN}").replace("-", MINUS)


def chip(label: str, kind: str) -> str:
    """A coloured label; the word itself says what the colour says."""
    return f'<span class="chip {text(kind)}">{text(label)}</span>'


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


def data_list(pairs: Mapping[str, object]) -> str:
    """Names and values, one a line; values that are empty are left out."""
    lines = "".join(
        f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in pairs.items() if value not in {None, ""}
    )
    return f'<div class="wide"><dl class="data">{lines}</dl></div>'


def box(kind: str, content: str) -> str:
    """A remark that must not be overlooked; `warn` or `bad`."""
    return f'<div class="{kind}">{content}</div>'
