"""Documents as HTML: one self-contained page, readable on screen and in print, that loads nothing."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable
from typing import Any

from rig.document import blocks as b
from rig.document.drawing import drawing_of
from rig.document.style import BARS, COLD, DARKEST, LABELS, MARK_INK, MARK_PAPER, MEASURED, WARM
from rig.document.svg import SVG_RULES, svg
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Code, Key, Label, Shade, Span, Strong, Words, printed

CONTENTS = "\0contents\0"
"""Where the contents are put, once the document is known; no text has this character."""
NOTES = {GOOD: "note good", FAIR: "note fair", POOR: "note poor", PLAIN: "note"}


def page(document: b.Document) -> str:
    """A complete page."""
    links = _contents(document)
    body = "".join(map(_block, document.blocks)).replace(CONTENTS, links)
    mark, sheet = "", STYLE_SHEET
    if document.paper != "A4":
        sheet += f"@page {{ size:{document.paper}; }}\n"
    if document.mark:
        mark, sheet = f'<div class="mark">{_text(document.mark)}</div>', sheet + _marked_print(document.mark)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{_text(document.title)}</title><style>{sheet}</style></head>"
        f"<body>{mark}<main>{body}</main></body></html>\n"
    )


def _marked_print(mark: str) -> str:
    """The rule that prints a document's mark at the top of each page."""
    letters = "".join(letter for letter in mark if letter.isalnum() or letter in " .,:-")
    return f"""@page {{ @top-center {{ content:"{letters}"; font-size:9pt; font-weight:700; color:{MARK_INK}; }} }}\n"""


def fragment(blocks: Iterable[b.Block]) -> str:
    """Blocks as a part of a page."""
    return "".join(map(_block, blocks))


def inline(words: Words) -> str:
    """A text as HTML, escaped."""
    return "".join(_text(part) if isinstance(part, str) else _span(part) for part in printed(words))


def _text(value: object) -> str:
    return html.escape(str(value)).replace("\0", "").replace("\n", "<br>")


def _span(span: Span) -> str:
    content = _text(span)
    match span:
        case Strong():
            return f"<b>{content}</b>"
        case Code():
            return f"<code>{content}</code>"
        case Label():
            return f'<span class="chip {span.severity}">{content}</span>'
        case Shade():
            channels = ",".join(map(str, WARM if span.share > 0.0 else COLD))
            return (f'<span class="heat" style="background:rgba({channels},{DARKEST * min(1.0, abs(span.share)):.2f})">'
                    f"{content}</span>")  # fmt: skip
        case Key():
            kind = ' class="dash"' if span.dashed else ""
            return f'<span><i{kind} style="border-color:{span.colour}"></i>{content}</span>'
    return content


def _block(block: b.Block) -> str:
    return _WRITERS[type(block)](block)


def _heading(block: b.Heading) -> str:
    anchor = f' id="{_text(block.name)}"' if block.name else ""
    return f"<h{block.level}{anchor}>{inline(block.title)}</h{block.level}>"


def _paragraph(block: b.Paragraph) -> str:
    return f'<p class="lead">{inline(block.words)}</p>' if block.small else f"<p>{inline(block.words)}</p>"


def _note(block: b.Note) -> str:
    return f'<div class="{NOTES[block.severity]}">{inline(block.words)}</div>'


def _table(block: b.Table) -> str:
    numeric = [' class="n"' if column.numeric else "" for column in block.columns]
    head = "".join(
        f"<th{kind}>{_text(column.title)}" + (f' <span class="unit">{_text(column.unit)}</span>' if column.unit else "")
        + "</th>" for column, kind in zip(block.columns, numeric, strict=True)
    )  # fmt: skip
    rows = []
    for row in block.rows:
        kinds = " ".join([*([row.severity] if row.severity != PLAIN else []), *(["faded"] if row.faded else [])])
        cells = "".join(f"<td{kind}>{inline(cell)}</td>" for cell, kind in zip(row.cells, numeric, strict=True))
        rows.append((f'<tr class="{kinds}">' if kinds else "<tr>") + f"{cells}</tr>")
    caption = f"<caption>{_text(block.title)}</caption>" if block.title else ""
    return (f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
            f'<tbody>{"".join(rows)}</tbody></table></div>')  # fmt: skip


def _facts(block: b.Facts) -> str:
    facts = "".join(
        f'<div class="fact{"" if fact.severity == PLAIN else f" {fact.severity}"}"><b>{inline(fact.value)}</b>'
        f"<span>{inline(fact.meaning)}</span></div>" for fact in block.facts
    )  # fmt: skip
    return f'<div class="facts" style="--columns:{block.columns}">{facts}</div>'


def _keys(block: b.Keys) -> str:
    return f'<p class="key{" paper" if block.paper else ""}">{_text(block.label)}{inline(block.keys)}</p>'


def _figures(block: b.Figures) -> str:
    drawn = "".join(svg(drawing_of(figure)) for figure in block.figures)
    return f'<div class="pair">{drawn}</div>' if block.across > 1 else drawn


def _card(card: b.Card) -> str:
    header = f"<header>{inline(card.title)}</header>" if card.title else ""
    return f'<div class="card">{header}{fragment(card.blocks)}</div>'


def _cards(block: b.Cards) -> str:
    kind = f'{"cards" if block.large else "charts"}{" wide-print" if block.wide else ""}'
    return f'<div class="{kind}">{"".join(map(_card, block.cards))}</div>'


def _properties(block: b.Properties) -> str:
    lines = "".join(f"<dt>{_text(name)}</dt><dd>{_text(value)}</dd>" for name, value in block.shown)
    across = f" across{min(block.across, 3)}" if block.across > 1 else ""
    return f'<div class="wide"><dl class="data{across}">{lines}</dl></div>'


def _beside(block: b.Beside) -> str:
    share = round(100.0 * block.share)
    return (f'<div class="beside" style="grid-template-columns:minmax(0,{share}fr) minmax(0,{100 - share}fr)">'
            f"<div>{fragment(block.left)}</div><div>{fragment(block.right)}</div></div>")  # fmt: skip


def _cover(block: b.Cover) -> str:
    logo = "" if block.logo is None else (
        f'<img class="logo" src="{block.logo.data_uri}" alt="{_text(block.logo.alternative)}">'
    )
    lines = "".join(f"<p>{inline(line)}</p>" for line in block.lines)
    return f'<div class="cover"><div><h1>{inline(block.title)}</h1>{lines}</div>{logo}</div>'


def _sheet(block: b.Sheet) -> str:
    return f'<section class="sheet">{fragment(block.blocks)}</section>'


def _signatures(block: b.Signatures) -> str:
    lines = "".join(
        f"<div><span>{_text(meaning)}</span><b>{_text(name) or '&nbsp;'}</b><i>Signature</i><i>Date</i></div>"
        for meaning, name in block.lines
    )
    return f'<div class="signatures">{lines}</div>'


def _items(block: b.Items) -> str:
    return "<ul>" + "".join(f"<li>{inline(item)}</li>" for item in block.items) + "</ul>"


def _listing(block: b.Listing) -> str:
    return f"<pre>{html.escape(block.text)}</pre>"


def _details(block: b.Details) -> str:
    return f"<details><summary>{_text(block.summary)}</summary>{fragment(block.blocks)}</details>"


def _contents(document: b.Document) -> str:
    links = " ".join(f'<a href="#{_text(block.name)}">{_text(block.listed)}</a>' for block in document.listed)
    return f'<nav aria-label="Contents">{links}</nav>' if links else ""


def _markup(block: b.Markup) -> str:
    return block.html


_WRITERS: dict[type[b.Block], Callable[[Any], str]] = {
    b.Heading: _heading, b.Paragraph: _paragraph, b.Note: _note, b.Table: _table, b.Facts: _facts, b.Keys: _keys,
    b.Figures: _figures, b.Cards: _cards, b.Properties: _properties, b.Items: _items, b.Listing: _listing,
    b.Details: _details, b.Markup: _markup, b.Contents: lambda block: CONTENTS if block.screen else "",
    b.Beside: _beside, b.Cover: _cover, b.Sheet: _sheet, b.Signatures: _signatures,
}  # fmt: skip

_CHIPS = "\n".join(f".chip.{kind} {{ background:{paper}; color:{ink}; }}" for kind, (paper, ink) in LABELS.items())
_BARS = "\n".join(f".fact.{kind} {{ border-left:5px solid {BARS[kind]}; }}" for kind in (GOOD, FAIR, POOR))
STYLE_SHEET = f"""
:root {{ --ink:#1c2430; --soft:#5b6675; --line:#d8dee6; --paper:#ffffff; --shade:#f4f6f9; }}
* {{ box-sizing:border-box; }}
body {{ margin:0; background:var(--shade); color:var(--ink); font:16px/1.5 system-ui,"Segoe UI",Roboto,sans-serif; }}
main {{ max-width:1320px; margin:0 auto; padding:14px 24px 40px; }}
h1 {{ font-size:26px; line-height:1.25; margin:0 0 2px; overflow-wrap:anywhere; }}
.mark {{ position:sticky; top:0; z-index:1; text-align:center; font-weight:700; font-size:15px; padding:2px 8px; }}
.mark {{ background:{MARK_PAPER}; color:{MARK_INK}; border-bottom:2px solid {MARK_INK}; }}
.cover {{ display:flex; justify-content:space-between; align-items:flex-start; gap:24px; }}
.cover p {{ margin:0; color:var(--soft); font-size:15px; }} .cover p b {{ color:var(--ink); }}
.logo {{ height:64px; max-width:240px; object-fit:contain; flex:none; }}
.beside {{ display:grid; gap:14px; align-items:start; }}
.beside>div>:first-child {{ margin-top:0; }}
.paper {{ display:none; }}
.signatures {{ display:grid; grid-template-columns:repeat(auto-fit,minmax(240px,1fr)); gap:14px; margin:14px 0; }}
.signatures div {{ display:grid; grid-template-columns:3fr 2fr; column-gap:14px; }}
.signatures span,.signatures b {{ grid-column:1/3; }} .signatures span,.signatures i {{ color:var(--soft); }}
.signatures i {{ border-top:1px solid var(--soft); margin-top:34px; font-size:13px; font-style:normal; }}
h2 {{ font-size:20px; margin:30px 0 8px; padding-bottom:4px; border-bottom:2px solid var(--line); }}
h3 {{ font-size:17px; margin:22px 0 8px; }}
p.lead {{ margin:0 0 14px; color:var(--soft); max-width:75em; }}
nav {{ margin:4px 0 6px; line-height:1.5; font-size:14px; }} nav a {{ margin-right:16px; color:{MEASURED}; }}
nav a {{ white-space:nowrap; text-decoration:none; }} nav a:hover {{ text-decoration:underline; }}
h2[id] {{ scroll-margin-top:36px; }}
.facts {{ display:grid; grid-template-columns:repeat(var(--columns),minmax(0,1fr)); gap:10px; margin:8px 0; }}
.fact,.card {{ background:var(--paper); border:1px solid var(--line); border-radius:8px; }}
.fact {{ padding:6px 14px; min-width:0; overflow-wrap:anywhere; }}
.fact b {{ display:block; font-size:20px; line-height:1.25; }}
.fact span {{ color:var(--soft); font-size:14px; }}
{_BARS}
{_CHIPS}
.heat {{ display:block; padding:0 4px; border-radius:4px; }}
details {{ margin:8px 0; }} summary {{ cursor:pointer; color:var(--soft); }}
pre {{ background:var(--shade); padding:8px 12px; margin:6px 0; border-radius:6px; font-size:14px; overflow-x:auto; }}
.wide + p.lead {{ margin-top:10px; }} .wide + .wide {{ margin-top:10px; }}
.wide {{ overflow-x:auto; background:var(--paper); border:1px solid var(--line); border-radius:8px; }}
table {{ border-collapse:collapse; width:100%; font-size:15px; }}
caption {{ text-align:left; font-weight:600; padding:5px 12px; }}
th,td {{ padding:5px 12px; text-align:left; border-bottom:1px solid var(--line); vertical-align:top; }}
tr:last-child td {{ border-bottom:0; }}
th {{ background:var(--shade); font-weight:600; vertical-align:bottom; }}
th .unit {{ font-weight:400; color:var(--soft); }}
td.n,th.n {{ text-align:right; font-variant-numeric:tabular-nums; }} td.n {{ white-space:nowrap; }}
tr.faded td {{ color:var(--soft); background:#faf7f2; }}
.chip {{ display:inline-block; border-radius:5px; padding:0 8px; font-size:14px; font-weight:600; white-space:nowrap; }}
.note {{ padding:8px 14px; margin:8px 0; border-radius:4px; }}
.note {{ background:var(--paper); border-left:5px solid var(--line); }}
.note.good {{ background:#eaf7f0; border-color:{BARS[GOOD]}; }}
.note.fair,.warn {{ background:#fff8e1; border-left:5px solid {BARS[FAIR]}; }}
.note.poor,.bad {{ background:#fdecea; border-left:5px solid {BARS[POOR]}; }}
.cards {{ display:grid; grid-template-columns:repeat(auto-fill,minmax(600px,1fr)); gap:14px; }}
.charts {{ display:grid; grid-template-columns:repeat(auto-fill,minmax(380px,1fr)); gap:14px; }}
.card {{ padding:10px 12px; break-inside:avoid; }}
.card header {{ margin-bottom:4px; color:var(--soft); font-size:15px; }}
.card header b {{ font-size:16px; color:var(--ink); margin-right:6px; }} .card header .chip {{ margin-right:6px; }}
.pair {{ display:grid; grid-template-columns:1fr 1fr; gap:4px; }}
svg {{ width:100%; height:auto; display:block; }} main>svg {{ max-width:62rem; }}
{SVG_RULES}.key span {{ white-space:nowrap; margin-right:18px; }}
.key i {{ display:inline-block; width:30px; height:0; margin:0 6px 4px 0; border-top:3px solid; }}
.key i.dash {{ border-top-style:dashed; }}
dl.data {{ display:grid; grid-template-columns:max-content 1fr; gap:2px 18px; margin:0; padding:12px 16px; }}
dl.data {{ font-size:15px; }}
dl.data.across2 {{ grid-template-columns:max-content 1fr max-content 1fr; }}
dl.data.across3 {{ grid-template-columns:max-content 1fr max-content 1fr max-content 1fr; }}
dl.data dt {{ color:var(--soft); }} dl.data dd {{ margin:0; overflow-wrap:anywhere; }}
@media screen and (max-width:1000px) {{ .beside {{ grid-template-columns:minmax(0,1fr) !important; }} }}
@media (max-width:700px) {{ .cards,.charts {{ grid-template-columns:1fr; }} .pair {{ grid-template-columns:1fr; }} }}
@media screen and (max-width:700px) {{ main {{ padding:10px 12px 30px; }}
dl.data {{ grid-template-columns:1fr; gap:0; }}
h1 {{ font-size:21px; }} .cover {{ flex-direction:column-reverse; gap:6px; }} .logo {{ height:44px; }}
dl.data.across2,dl.data.across3 {{ grid-template-columns:1fr; gap:0; }} dl.data dd {{ margin-bottom:6px; }}
.facts {{ grid-template-columns:repeat(2,minmax(0,1fr)); }} .fact:last-child:nth-child(odd) {{ grid-column:1/-1; }}
.fact {{ padding:5px 10px; }} .fact b {{ font-size:17px; }}
nav a,.key span {{ white-space:normal !important; }} }}
@media screen and (max-width:700px) {{
table {{ width:max-content; min-width:100%; font-size:13px; }} th,td {{ padding:4px 7px; }}
td:not(.n) {{ max-width:190px; }} th.n {{ max-width:76px; }}
}}
@media screen and (min-width:701px) and (max-width:1320px) {{
table {{ font-size:13px; }} th,td {{ padding:4px 6px; }} .chip {{ font-size:12px; padding:0 5px; }}
}}
@media screen and (max-width:1320px) {{
.wide {{ background:linear-gradient(to left,var(--paper) 20px,transparent 40px) right/40px 100% no-repeat local,
linear-gradient(to left,#0004,transparent) right/16px 100% no-repeat scroll,var(--paper); }}
}}
@page {{ size:A4; margin:14mm 11mm 14mm; }}
@page {{ @bottom-right {{ content:counter(page) " / " counter(pages); font-size:8pt; }} }}
@media print {{
body {{ background:#fff; font-size:8pt; line-height:1.3; print-color-adjust:exact; -webkit-print-color-adjust:exact; }}
.mark {{ display:none; }} .paper {{ display:block; }} .sheet {{ break-after:page; }}
.logo {{ height:14mm; }} .cover p {{ font-size:8pt; }}
nav {{ font-size:7pt; }} main {{ max-width:none; padding:0; }}
h1 {{ font-size:15pt; }} h2 {{ font-size:11pt; margin:10px 0 4px; }}
h3 {{ font-size:9pt; margin:6px 0 3px; }} h1,h2,h3,header {{ break-after:avoid; }} p.lead {{ margin:0 0 4px; }}
.wide {{ overflow:visible; border:0; }} table {{ font-size:6.5pt; }} thead {{ display:table-header-group; }}
th,td {{ padding:1px 4px; white-space:normal; }} td.n,th.n {{ white-space:normal; }} tr {{ break-inside:avoid; }}
.chip {{ font-size:6.5pt; padding:0 3px; white-space:normal; }}
.fact {{ padding:3px 8px; min-width:0; }} .fact b {{ font-size:11pt; }} .fact span {{ font-size:7pt; }}
.card {{ padding:3px 5px; }} .card header b,.card header {{ font-size:7pt; }}
.cards {{ grid-template-columns:repeat(2,1fr); gap:5px; }} .wide-print {{ grid-template-columns:1fr; }}
.wide-print svg {{ max-height:50mm; }} .beside svg {{ max-height:66mm; }}
.charts {{ grid-template-columns:repeat(4,1fr); gap:5px; }}
.pair {{ grid-template-columns:1fr 1fr; }} dl.data {{ font-size:7pt; padding:2px; gap:0 8px; }}
pre {{ white-space:pre-wrap; font-size:7pt; }} details::details-content {{ content-visibility:visible; display:block; }}
}}
"""
