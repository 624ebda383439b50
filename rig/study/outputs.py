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
from rig.study.table import Table, written

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; margin: .5rem 0 1rem; } th, td { padding: .2rem .6rem; border-bottom: 1px solid
#d5dae0; } th { text-align: left; background: #f4f6f8; } td { text-align: right; font-variant-numeric: tabular-nums; }
td:first-child { text-align: left; } .note { color: #57606a; font-size: .9em; } svg { max-width: 100%; height: auto; }
@media (prefers-color-scheme: dark) { body { background: #fff; } }
"""


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
        facts: About the study: name, samples, searches.

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
        "kruskal_wallis": {
            name: None if test is None else _test_as_json(test)
            for name, test in tests.items()
        },
        "tables": [
            {
                "name": table.name,
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
    parts = [f"<h1>{html.escape(title)}</h1>"]
    parts.append("<p>" + html.escape(", ".join(f"{key}: {value}" for key, value in facts.items())) + "</p>")
    parts += [_html_table(table) for table in tables]
    parts.append("<h2>Kruskal-Wallis test</h2><p class='note'>Hypothesis: all settings draw from one distribution. "
                 "Over all settings it is honest; over best-tuned settings only (as the paper does) it is not: the "
                 "settings were chosen on the same values.</p>")  # fmt: skip
    parts += [_html_test(name, test) for name, test in tests.items()]
    for name, svg in figures.items():
        parts.append(f"<h2>{html.escape(name)}</h2>{svg}")
    head = f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{html.escape(title)}</title>"
    return f"{head}<style>{STYLE}</style><body>{''.join(parts)}</body></html>\n"


def _html_table(table: Table) -> str:
    heads = "".join(f"<th>{html.escape(column)}</th>" for column in table.columns)
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(written(cell))}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    note = f"<p class='note'>{html.escape(table.note)}</p>" if table.note else ""
    return f"<h2>{html.escape(table.name)}: {html.escape(table.title)}</h2><table><tr>{heads}</tr>{rows}</table>{note}"


def _html_test(name: str, test: KruskalWallis | None) -> str:
    if test is None:
        return f"<p>{html.escape(name)}: not possible (too few values, or all equal).</p>"
    ranked = sorted(test.mean_ranks.items(), key=lambda entry: entry[1])
    rows = "".join(f"<tr><td>{html.escape(each)}</td><td>{rank:.1f}</td></tr>" for each, rank in ranked)
    head = f"<p>{html.escape(name)}: H = {test.statistic:.3f}, p = {test.p:.3g}. {html.escape(test.note)}</p>"
    return f"{head}<table><tr><th>setting</th><th>mean rank</th></tr>{rows}</table>"
