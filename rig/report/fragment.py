"""HTML for report sections of earlier plug-ins, which return text. Deprecated: return blocks of `rig.document.blocks`.

Every function returns HTML and takes HTML, escaped by `text`.
"""

from __future__ import annotations

import html
from collections.abc import Sequence

from rig.document.numbers import number

__all__ = ["box", "bullet_list", "chip", "heading", "key", "key_line", "lead", "number", "paragraph", "table", "text"]


def text(value: object) -> str:
    """Any value as escaped text."""
    return html.escape(str(value))


def heading(title: str, note: str = "", level: int = 2) -> str:
    """A heading, and under it what a reader must know first."""
    return f"<h{level}>{title}</h{level}>" + (lead(note) if note else "")


def lead(note: str) -> str:
    """A remark in small print."""
    return f'<p class="lead">{note}</p>'


def paragraph(content: str) -> str:
    """A paragraph."""
    return f"<p>{content}</p>"


def box(kind: str, content: str) -> str:
    """A remark that must not be overlooked; `warn` or `bad`."""
    return f'<div class="{kind}">{content}</div>'


def chip(label: str, kind: str) -> str:
    """A coloured label."""
    known = {"valid": "good", "suspect": "fair", "invalid": "poor"}
    return f'<span class="chip {text(known.get(kind, kind))}">{text(label)}</span>'


def bullet_list(lines: Sequence[str]) -> str:
    """Lines of text as a list; nothing for none."""
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>" if lines else ""


def key(label: str, colour: str, *, dashed: bool = False) -> str:
    """One line of a drawing's key."""
    return f'<span><i{" class=dash" if dashed else ""} style="border-color:{colour}"></i>{label}</span>'


def key_line(label: str, keys: str) -> str:
    """A drawing's key on a line of its own."""
    return f'<p class="key">{label}{keys}</p>'


def table(head: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]], numeric: Sequence[int] = ()) -> str:
    """A table; each row comes with its class; `numeric` columns are aligned to the right."""

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = (' class="n"' if place in numeric else "" for place in range(len(cells)))
        return "".join(f"<{tag}{kind}>{cell}</{tag}>" for cell, kind in zip(cells, kinds, strict=True))

    body = "".join(f'<tr class="{kind}">{line("td", cells)}</tr>' for kind, cells in rows)
    return f'<div class="wide"><table><thead><tr>{line("th", head)}</tr></thead><tbody>{body}</tbody></table></div>'
