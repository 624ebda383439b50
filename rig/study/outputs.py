"""Writes what a study found: one CSV a table, one JSON, one HTML page that needs nothing else."""

from __future__ import annotations

import csv
import html
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.study.statistics import KruskalWallis
from rig.study.table import Cell, Table, written

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; margin: .5rem 0 1rem; } th, td { padding: .2rem .6rem; border-bottom: 1px solid
#d5dae0; white-space: nowrap; } th { text-align: left; vertical-align: bottom; background: #f4f6f8; }
th, td.long { white-space: normal; } .number { text-align: right; font-variant-numeric: tabular-nums; }
h2 { font-size: 1.15rem; margin: 2rem 0 0; } .caption { margin: .1rem 0 .4rem; } .table { overflow-x: auto; }
nav { columns: 3; font-size: .9em; } nav a { display: block; } .note { color: #57606a; font-size: .9em; }
svg { max-width: 100%; height: auto; }
@media (prefers-color-scheme: dark) { body { background: #fff; } }
"""


FIGURE_TITLES = {
    "figure-08": "Figure 8: box plots of every setting",
    "figure-09": "Figure 9: convergence, each method at its best setting",
    "paper2-figure-10": "Paper 2, Figure 10: minimum error against evaluations",
    "paper2-figure-relations": "Paper 2: parameters against current",
}
LONG_TEXT = 40
HYPOTHESIS = (
    "Hypothesis: all settings draw from one distribution. Over all settings it is honest; over best-tuned settings "
    "only (as the paper does) it is not: the settings were chosen on the same values."
)
SEVERAL = {"Paper 2, Table 1", "Paper 2, relations"}


def write_outputs(
    folder: Path,
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, str],
    tests: Mapping[str, KruskalWallis | None],
    facts: Mapping[str, Any],
) -> Path:
    """Write `tables/*.csv`, `figures/*.svg`, `study.json` and `study.html`.

    Args:
        folder: Where; made if it is missing.
        title: Of the page.
        tables: All tables.
        figures: Name -> SVG.
        tests: What was compared -> Kruskal-Wallis test, None where it cannot be done.
        facts: About the study: name, recordings, tests, samples, searches, repeats, left_out, wall_s.

    Returns:
        Path of the page.
    """
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    (folder / "figures").mkdir(exist_ok=True)
    for table in tables:
        with (folder / "tables" / f"{table.name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(table.columns)
            writer.writerows(table.rows)
    for name, svg in figures.items():
        (folder / "figures" / f"{name}.svg").write_text(svg, encoding="utf-8")
    (folder / "study.json").write_text(json.dumps(as_json(tables, tests, facts), indent=2) + "\n", encoding="utf-8")
    page = folder / "study.html"
    page.write_text(_page(title, tables, figures, tests, facts), encoding="utf-8")
    return page


def as_json(
    tables: Sequence[Table], tests: Mapping[str, KruskalWallis | None], facts: Mapping[str, Any]
) -> dict[str, Any]:
    """The whole study as plain values; inf and nan, which JSON lacks, become null.

    Args:
        tables: All tables.
        tests: Kruskal-Wallis tests.
        facts: About the study.

    Returns:
        Keys `study`, `kruskal_wallis`, `tables`.
    """
    return {
        "study": dict(facts),
        "kruskal_wallis": {name: None if test is None else _test_as_json(test) for name, test in tests.items()},
        "tables": [
            {
                "name": table.name,
                "heading": table.heading,
                "title": table.title,
                "columns": list(table.columns),
                "rows": [[_plain(cell) for cell in row] for row in table.rows],
                "note": table.note,
            }
            for table in tables
        ],
    }


def _test_as_json(test: KruskalWallis) -> dict[str, object]:
    return {"H": test.statistic, "p": test.p, "mean_ranks": dict(test.mean_ranks), "note": test.note}


def _plain(cell: object) -> object:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _page(
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, str],
    tests: Mapping[str, KruskalWallis | None],
    facts: Mapping[str, Any],
) -> str:
    parts = [f"<h1>{html.escape(title)}</h1>", f"<p>{html.escape(_summary(facts))}</p>"]
    parts += [f"<p class='note'>{html.escape(line)}</p>" for line in facts["left_out"]]
    parts.append(_contents(tables, figures))
    parts += [_html_table(table) for table in tables]
    parts.append(f"<h2 id='kruskal-wallis'>Kruskal-Wallis test</h2><p class='note'>{HYPOTHESIS}</p>")
    parts += [_html_test(name, test) for name, test in tests.items()]
    for name, svg in figures.items():
        parts.append(f"<h2 id='{name}'>{html.escape(FIGURE_TITLES.get(name, name))}</h2>{svg}")
    head = f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{html.escape(title)}</title>"
    return f"{head}<style>{STYLE}</style><body>{''.join(parts)}</body></html>\n"


def _html_table(table: Table) -> str:
    numeric = [any(isinstance(row[place], int | float) for row in table.rows) for place in range(len(table.columns))]
    heads = "".join(
        f"<th{_align(right)}>{html.escape(column)}</th>" for column, right in zip(table.columns, numeric, strict=True)
    )
    rows = "".join(f"<tr>{''.join(_html_cell(cell) for cell in row)}</tr>" for row in table.rows)
    note = f"<p class='note'>{html.escape(table.note)}</p>" if table.note else ""
    head = f"<h2 id='{table.name}'>{html.escape(table.heading)}</h2><p class='caption'>{html.escape(table.title)}</p>"
    return f"{head}<div class='table'><table><tr>{heads}</tr>{rows}</table></div>{note}"


def _html_cell(cell: Cell) -> str:
    text = html.escape(written(cell))
    long = " class='long'" if len(text) > LONG_TEXT else ""
    return f"<td{_align(isinstance(cell, int | float)) or long}>{text}</td>"


def _align(right: bool) -> str:
    return " class='number'" if right else ""


def _contents(tables: Sequence[Table], figures: Mapping[str, str]) -> str:
    places = {table.name: f"{table.heading}{_suffix(table)}" for table in tables}
    places |= {"kruskal-wallis": "Kruskal-Wallis test", **{name: FIGURE_TITLES.get(name, name) for name in figures}}
    links = "".join(f"<a href='#{name}'>{html.escape(text)}</a>" for name, text in places.items())
    return f"<nav>{links}</nav>"


def _suffix(table: Table) -> str:
    """What tells apart tables of one heading, for the list of contents."""
    return f", {table.title.rpartition(', ')[2].partition(' (')[0]}" if table.heading in SEVERAL else ""


def _summary(facts: Mapping[str, Any]) -> str:
    return (
        f"{facts['tests']} tests ({facts['recordings']}), {facts['samples']:,} samples; {facts['searches']} searches, "
        f"{facts['repeats']} repeats of each setting; {facts['wall_s']:g} s in the session that wrote this page."
    )


def _html_test(name: str, test: KruskalWallis | None) -> str:
    if test is None:
        return f"<p>{html.escape(name)}: not possible (too few values, or all equal).</p>"
    ranked = sorted(test.mean_ranks.items(), key=lambda entry: entry[1])
    rows = "".join(f"<tr><td>{html.escape(each)}</td><td>{rank:.1f}</td></tr>" for each, rank in ranked)
    head = f"<p>{html.escape(name)}: H = {test.statistic:.3f}, p = {test.p:.3g}. {html.escape(test.note)}</p>"
    return f"{head}<table><tr><th>setting</th><th>mean rank</th></tr>{rows}</table>"
