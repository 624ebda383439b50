"""The report's style sheet: readable on screen and in print; colours of Okabe and Ito, never the only sign."""

from __future__ import annotations

MEASURED = "#0072B2"
FITTED = "#D55E00"
OVERLAID = "#111111"
RESIDUAL = "#55606e"

#: From low to high current: viridis up to where it is still dark enough on white. Its lightness rises evenly, so the
#: order is seen without colour vision and in grey print.
SEQUENCE = ("#440154", "#472e7c", "#3a548c", "#2b758e", "#1f958b", "#2fb47c", "#6ece58")

CHIPS = {
    "valid": ("#d9f2e3", "#0b5d33"), "good": ("#d9f2e3", "#0b5d33"), "suspect": ("#fdf0c4", "#6b4e00"),
    "fair": ("#fdf0c4", "#6b4e00"), "invalid": ("#fbdcd7", "#8c1d10"), "poor": ("#fbdcd7", "#8c1d10"),
    "plain": ("#e6ebf2", "#38455a"),
}  # fmt: skip
"""Background and letters of labels, by class."""
_CHIP_RULES = "\n".join(f".{kind} {{ background:{paper}; color:{ink}; }}" for kind, (paper, ink) in CHIPS.items())

SVG_RULES = f"""
svg text {{ font:11.5px system-ui,sans-serif; fill:#46515f; }} svg text.l {{ font-size:12.5px; fill:#1c2430; }}
svg path {{ fill:none; }} svg .g {{ stroke:#e6eaef; stroke-width:1; }}
svg .f {{ fill:none; stroke:#9aa5b1; stroke-width:1; }}
svg .m {{ stroke:{MEASURED}; stroke-width:1.8; stroke-linejoin:round; }}
svg .thin {{ stroke-width:1; }}
svg .p {{ stroke:{FITTED}; stroke-width:1.6; stroke-dasharray:5 3; }}
svg .q {{ stroke:{OVERLAID}; stroke-width:1; stroke-dasharray:3 4; }}
svg .e {{ stroke:{RESIDUAL}; stroke-width:1; }}
"""
"""What a chart is drawn with, in the page and as a file of its own."""

STYLE_SHEET = f"""
:root {{ --ink:#1c2430; --soft:#5b6675; --line:#d8dee6; --paper:#ffffff; --shade:#f4f6f9; }}
* {{ box-sizing:border-box; }}
body {{ margin:0; background:var(--shade); color:var(--ink); font:16px/1.5 system-ui,"Segoe UI",Roboto,sans-serif; }}
main {{ max-width:1320px; margin:0 auto; padding:24px; }}
h1 {{ font-size:28px; margin:0 0 4px; }}
h2 {{ font-size:21px; margin:36px 0 10px; padding-bottom:4px; border-bottom:2px solid var(--line); }}
h3 {{ font-size:17px; margin:22px 0 8px; }}
p.lead {{ margin:0 0 14px; color:var(--soft); }}
.facts {{ display:flex; flex-wrap:wrap; gap:10px; margin:14px 0; }}
.fact,.card {{ background:var(--paper); border:1px solid var(--line); border-radius:8px; }}
.fact {{ padding:10px 16px; min-width:150px; }}
.fact b {{ display:block; font-size:22px; line-height:1.25; }}
.fact span {{ color:var(--soft); font-size:14px; }}
.fact.good {{ border-left:5px solid #1e8e5a; }} .fact.fair {{ border-left:5px solid #e0a030; }}
.fact.poor {{ border-left:5px solid #c0392b; }}
{_CHIP_RULES}
.fact.good,.fact.fair,.fact.poor {{ background:var(--paper); }}
.heat {{ display:block; padding:0 4px; border-radius:4px; }}
details {{ margin:8px 0; }} summary {{ cursor:pointer; color:var(--soft); }}
pre {{ background:var(--shade); padding:8px 12px; margin:6px 0; border-radius:6px; font-size:14px; overflow-x:auto; }}
.wide + p.lead {{ margin-top:10px; }}
.wide {{ overflow-x:auto; background:var(--paper); border:1px solid var(--line); border-radius:8px; }}
table {{ border-collapse:collapse; width:100%; font-size:15px; }}
th,td {{ padding:5px 12px; text-align:left; border-bottom:1px solid var(--line); vertical-align:top; }}
tr:last-child td {{ border-bottom:0; }}
th {{ background:var(--shade); font-weight:600; vertical-align:bottom; }}
td.n,th.n {{ text-align:right; font-variant-numeric:tabular-nums; }} td.n {{ white-space:nowrap; }}
tr.no td {{ color:var(--soft); background:#faf7f2; }}
.remark {{ min-width:320px; }} .remark:empty {{ min-width:0; }}
.chip {{ display:inline-block; border-radius:5px; padding:0 8px; font-size:14px; font-weight:600; white-space:nowrap; }}
.warn {{ background:#fff8e1; border-left:5px solid #e0a030; padding:8px 14px; margin:8px 0; border-radius:4px; }}
.bad {{ background:#fdecea; border-left:5px solid #c0392b; padding:8px 14px; margin:8px 0; border-radius:4px; }}
.cards {{ display:grid; grid-template-columns:repeat(auto-fill,minmax(600px,1fr)); gap:14px; }}
.charts {{ display:grid; grid-template-columns:repeat(auto-fill,minmax(380px,1fr)); gap:14px; }}
.card {{ padding:10px 12px; break-inside:avoid; }}
.card header {{ display:flex; flex-wrap:wrap; gap:6px 12px; align-items:baseline; margin-bottom:4px; }}
.card header b {{ font-size:16px; }}
.card header span {{ color:var(--soft); font-size:15px; }}
.card header span.chip {{ color:inherit; }}
.card header .invalid {{ color:#8c1d10; }} .card header .suspect {{ color:#6b4e00; }}
.pair {{ display:grid; grid-template-columns:1fr 1fr; gap:4px; }}
svg {{ width:100%; height:auto; display:block; }}
{SVG_RULES}.key i {{ display:inline-block; width:30px; height:0; margin:0 6px 4px 16px; border-top:3px solid; }}
.key i.dash {{ border-top-style:dashed; }}
dl.data {{ display:grid; grid-template-columns:max-content 1fr; gap:2px 18px; margin:0; padding:12px 16px; }}
dl.data {{ font-size:15px; }}
dl.data dt {{ color:var(--soft); }} dl.data dd {{ margin:0; overflow-wrap:anywhere; }}
@media (max-width:700px) {{ .cards,.charts {{ grid-template-columns:1fr; }} .pair {{ grid-template-columns:1fr; }} }}
@media screen and (max-width:700px) {{
table {{ width:max-content; min-width:100%; font-size:13px; }} th,td {{ padding:4px 7px; }}
td:not(.n) {{ max-width:190px; }} th.n {{ max-width:76px; }}
.wide {{ background:linear-gradient(to left,var(--paper) 20px,transparent 40px) right/40px 100% no-repeat local,
linear-gradient(to left,#0004,transparent) right/16px 100% no-repeat scroll,var(--paper); }}
}}
@page {{ size:A4; margin:12mm 11mm 14mm; }}
@page {{ @bottom-right {{ content:counter(page) " / " counter(pages); font-size:8pt; }} }}
@media print {{
body {{ background:#fff; font-size:8pt; line-height:1.3; print-color-adjust:exact; -webkit-print-color-adjust:exact; }}
main {{ max-width:none; padding:0; }} h1 {{ font-size:15pt; }} h2 {{ font-size:11pt; margin:10px 0 4px; }}
h3 {{ font-size:9pt; margin:6px 0 3px; }} h1,h2,h3,header {{ break-after:avoid; }} p.lead {{ margin:0 0 4px; }}
.wide {{ overflow:visible; border:0; }} table {{ font-size:6.5pt; }} thead {{ display:table-header-group; }}
th,td {{ padding:1px 4px; white-space:normal; }} td.n,th.n {{ white-space:normal; }} tr {{ break-inside:avoid; }}
.remark {{ min-width:0; }} .chip {{ font-size:6.5pt; padding:0 3px; white-space:normal; }}
.fact {{ padding:3px 8px; min-width:0; }} .fact b {{ font-size:11pt; }} .fact span {{ font-size:7pt; }}
.card {{ padding:3px 5px; }} .card header b,.card header span {{ font-size:7pt; }}
.cards {{ grid-template-columns:repeat(2,1fr); gap:5px; }} .charts {{ grid-template-columns:repeat(4,1fr); gap:5px; }}
.pair {{ grid-template-columns:1fr 1fr; }} dl.data {{ font-size:7pt; padding:2px; gap:0 8px; }}
pre {{ white-space:pre-wrap; font-size:7pt; }} details::details-content {{ content-visibility:visible; display:block; }}
}}
"""


def current_colour(index: int, count: int) -> str:
    """Colour of one of several currents, by its place among them."""
    return SEQUENCE[round(index * (len(SEQUENCE) - 1) / max(count - 1, 1))]
