"""Tables as values, and what a study writes: one CSV a table, one JSON, one HTML page that needs nothing else."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.recording.atomic_write import inner_folder, write_text_durably
from rig.report.fragment import bullet_list, code_block, data_list, details, table, text
from rig.study.provenance import CITE_PAPERS, CITE_SOFTWARE, METHODS
from rig.study.settings import TITLES, KruskalWallis

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """A table of the study.

    Attributes:
        name: File name without ending, such as `table-02`.
        heading: What the paper calls it, such as `Table 2`.
        title: As above the paper's table.
        columns: Headings, with units.
        rows: As many cells each as there are columns.
        note: What the reader must know; empty when nothing.
    """

    name: str
    heading: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


def known(number: float) -> float | None:
    """A number, or None where there is none (nan)."""
    return None if math.isnan(number) else number


def written(cell: Cell) -> str:
    """A cell as text: numbers with four significant digits, empty where there is none.

    Args:
        cell: Text, number or None.

    Returns:
        Text without markup.
    """
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    if isinstance(cell, float):
        return f"{cell:.2e}" if cell != 0.0 and not 1e-3 <= abs(cell) < 1e5 else f"{cell:.4g}"
    return str(cell)


FIGURE_TITLES = {
    "figure-03": "Figure 3: a triangle's position and velocity",
    "figure-04": "Figure 4: force over velocity in a triangle of displacement, without noise",
    "figure-05": "Figure 5: the recordings at the lowest frequency",
    "figure-08": "Figure 8: box plots of every setting",
    "figure-08-pair": "Figure 8 as printed: best-tuned PSO and c-FOA",
    "figure-09": "Figure 9: convergence, each method at its best setting (right: its second half, near the lowest)",
    "figure-10": "Figure 10: recorded and fitted force over velocity",
    "figure-11": "Figure 11: recorded and fitted force over extension",
    "figure-12": "Figure 12: force over velocity of the fits of c-FOA, GA and PSO, printed (Table 5) and this study's",
    "figure-13": "Figure 13: response of a car with the fits of c-FOA, GA and PSO, printed (Table 5) and this study's",
    "paper2-figure-08": "Paper 2, Figure 8: the recordings",
    "paper2-figure-10": "Paper 2, Figure 10: minimum error, and its running average, against generations",
    "paper2-figure-11": "Paper 2, Figure 11: distribution of the minimum error, and the exponential one",
    "paper2-figure-12": "Paper 2, Figure 12: recorded and reconstructed hysteresis",
    "paper2-figure-13-bars": "Paper 2, Figure 13: errors and generations of each method",
    "paper2-figure-relations": "Paper 2, Table 1 drawn: parameters against current, and their relations to it",
}
COMPARED = (
    "What of the papers' statements holds on these recordings. The papers' own are not public: orders and ratios are "
    "compared, never sizes."
)
SYNTHETIC = (
    "The recordings are synthetic: simulated dampers with known parameters (truth) and white noise. Searched models "
    "can fit these to their noise, which none does with a real damper: what is said here of algorithms need not hold "
    "there, and nothing here tells how well a model fits a real damper."
)
NOT_DRAWN = (
    "Not here: photographs, schemes and flow charts (Figures 1, 2, 6 and 7; paper 2, Figures 1 to 7 and 9), which "
    "show nothing that is computed."
)
HYPOTHESIS = (
    "Hypothesis: all settings draw from one distribution. Over all settings it is honest; over best-tuned settings "
    "only (as the paper does) it is not: the settings were chosen on the same values."
)
SIGNIFICANT = 0.05
FIGURE_STYLE = ".figure path { fill:unset; } .figure svg { max-width:65rem; }"
"""Drawn figures carry their own colours; the report's sheet is for its own charts."""
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
        facts: About the study: name, recordings, tests, samples, searches, repeats, left_out, wall_s, `made` (from
            `provenance`); `summary` in place of a sentence made of them.

    Returns:
        Path of the page.
    """
    written, drawn = inner_folder(folder, "tables"), inner_folder(folder, "figures")
    for part in tables:
        text = io.StringIO(newline="")
        csv.writer(text).writerows([part.columns, *part.rows])
        write_text_durably(written / f"{part.name}.csv", text.getvalue())
    for name, svg in figures.items():
        write_text_durably(drawn / f"{name}.svg", svg)
    write_text_durably(folder / "study.json", json.dumps(as_json(tables, tests, facts), indent=2) + "\n")
    page = folder / "study.html"
    write_text_durably(page, _page(title, tables, figures, tests, facts))
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
                "name": part.name,
                "heading": part.heading,
                "title": part.title,
                "columns": list(part.columns),
                "rows": [[_plain(cell) for cell in row] for row in part.rows],
                "note": part.note,
            }
            for part in tables
        ],
    }


def _test_as_json(test: KruskalWallis) -> dict[str, object]:
    pairs = [dataclasses.asdict(pair) for pair in test.pairs]
    return {"H": test.statistic, "p": test.p, "mean_ranks": dict(test.mean_ranks), "note": test.note, "pairs": pairs}


def _plain(cell: object) -> object:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _page(
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, str],
    tests: Mapping[str, KruskalWallis | None],
    facts: Mapping[str, Any],
) -> str:
    from rig.report.fragment import page

    parts = [f"<style>{FIGURE_STYLE}</style><h1>{text(title)}</h1><p class='lead'>{text(_summary(facts))}</p>"]
    made = f"Written {facts['made']['written_utc']} UTC by {facts['made']['software']}"
    more = "<a href='#made'>how this was made</a>, <a href='#cite'>how to cite</a>"
    parts.append(f"<p class='lead'>{text(made)}: {more}.</p>")
    parts += [f"<p class='lead'>{text(line)}</p>" for line in facts["left_out"]]
    parts += [f"<p class='lead'>{SYNTHETIC}</p>"] if facts["recordings"] == "synthetic" else []
    parts += [_html_findings(facts["findings"])] if facts.get("findings") else []
    parts.append(_contents(tables, figures, tests))
    parts += [_html_table(part) for part in tables]
    if tests:
        parts.append(f"<h2 id='kruskal-wallis'>Kruskal-Wallis test</h2><p class='lead'>{HYPOTHESIS}</p>")
    parts += [_html_test(name, test) for name, test in tests.items()]
    for name, svg in figures.items():
        parts.append(f"<h2 id='{name}'>{text(FIGURE_TITLES.get(name, name))}</h2><div class='figure'>{svg}</div>")
    parts += [f"<p class='lead'>{NOT_DRAWN}</p>"] if facts.get("findings") else []
    return page(title, "".join([*parts, _made(facts), _cite(facts)]))


def _html_findings(statements: Sequence[Mapping[str, str]]) -> str:
    """What of the papers holds on these recordings, in words."""
    said = "".join(
        f"<li><b>{text(one['slug'])}: {text(one['verdict'])}.</b> {text(one['text'])}</li>" for one in statements
    )
    return f"<h2 id='findings'>Findings</h2><p class='lead'>{text(COMPARED)}</p><ul>{said}</ul>"


def _html_table(part: Table) -> str:
    numeric = [
        place for place in range(len(part.columns)) if any(isinstance(row[place], int | float) for row in part.rows)
    ]
    rows = [("", [text(written(cell)) for cell in row]) for row in part.rows]
    note = f"<p class='lead'>{text(part.note)}</p>" if part.note else ""
    head = f"<h2 id='{part.name}'>{text(part.heading)}</h2><p>{text(part.title)}</p>"
    return head + table([text(column) for column in part.columns], rows, numeric) + note


def _contents(tables: Sequence[Table], figures: Mapping[str, str], tests: Collection[str]) -> str:
    places = {part.name: f"{part.heading}{_suffix(part)}" for part in tables}
    places |= {"kruskal-wallis": "Kruskal-Wallis test"} if tests else {}
    places |= {**{name: FIGURE_TITLES.get(name, name) for name in figures}}
    places |= {"made": "How this was made", "cite": "How to cite"}
    links = " | ".join(f"<a href='#{name}'>{text(label)}</a>" for name, label in places.items())
    return f"<nav>{links}</nav>"


def _suffix(part: Table) -> str:
    """What tells apart tables of one heading, for the list of contents."""
    return f", {part.title.rpartition(', ')[2].partition(' (')[0]}" if part.heading in SEVERAL else ""


def _summary(facts: Mapping[str, Any]) -> str:
    if "summary" in facts:
        return str(facts["summary"])
    return (
        f"{facts['tests']} tests ({facts['recordings']}), {facts['samples']:,} samples; {facts['searches']} searches, "
        f"{facts['repeats']} repeats of each setting of the comparison."
    )


def _html_test(name: str, test: KruskalWallis | None) -> str:
    if test is None:
        return f"<p>{text(name)}: not possible (too few values, or all equal).</p>"
    ranked = sorted(test.mean_ranks.items(), key=lambda entry: entry[1])
    head = f"<p>{text(name)}: H = {test.statistic:.3f}, p = {test.p:.3g}. {text(test.note)}</p>"
    ranks = table(["setting", "mean rank"], [("", [text(setting), f"{rank:.1f}"]) for setting, rank in ranked], (1,))
    return head + ranks + (_html_pairs(test) if test.pairs else "")


def _html_pairs(test: KruskalWallis) -> str:
    """The pairs that differ, after Holm; the others counted."""
    clear = [pair for pair in test.pairs if pair.p_holm < SIGNIFICANT]
    counted = f"{len(clear)} of {len(test.pairs)} pairs differ (p &lt; {SIGNIFICANT:g})"
    said = f"<p>Dunn's test with Holm's correction: {counted}.</p>"
    rows = [("", [text(pair.first), text(pair.second), f"{pair.z:.2f}", f"{pair.p_holm:.2g}"]) for pair in clear]
    return said + (table(["lower ranks", "higher ranks", "z", "p after Holm"], rows, (2, 3)) if rows else "")


def _made(facts: Mapping[str, Any]) -> str:
    """Date, versions, machine, seed, the command and the study file (HTML).

    Args:
        facts: About the study, with `made`.
    """
    made = facts["made"]
    libraries = ", ".join(f"{name} {version}" for name, version in made["libraries"].items())
    pairs = {
        "written": f"{made['written_utc']} UTC",
        "software": f"{made['software']}; Python {made['python']}; {libraries}",
        "searched with": ", ".join(made["searched_with"]),
        "plug-ins": "; ".join(made.get("plug_ins", ())),
        "machine that wrote this page": made["machine"],
        "time": f"{made['searched_s']:,.0f} s of searches, all sessions and workers together; {facts['wall_s']:,.0f} s "
        "in the session that wrote this page",
        "seed": str(made["seed"]),
        "fingerprint": f"{made['fingerprint']} (of the study's decisions and its recordings)",
    }
    again = (
        "Again, with the file below (finished searches in the folder are kept; with the same versions, seed "
        "and kind of processor every search returns the same value, only the times differ):"
    )
    file = details("The study file", code_block(made["file"]))
    return f"<h2 id='made'>How this was made</h2>{data_list(pairs)}<p>{again}</p>{code_block(made['command'])}{file}"


def _cite(facts: Mapping[str, Any]) -> str:
    """The software, the papers or the recordings' sources, and what each method follows (HTML).

    Args:
        facts: About the study; `recordings` is a list of sources where it is a benchmark.
    """
    of_benchmark = isinstance(facts["recordings"], list)
    sources = [
        f"Recordings {one['name']}: {one['title']}. {one['source']}. Licence: {one['licence']}. Split: {one['split']}."
        for one in facts["recordings"] if of_benchmark and one["complete"]
    ]  # fmt: skip
    cited = bullet_list([CITE_SOFTWARE, *(sources if of_benchmark else CITE_PAPERS)])
    models = "Each damper model's source: <code>rig models NAME</code>."
    head = f"<h2 id='cite'>How to cite</h2>{cited}<p class='lead'>{models}</p>"
    if of_benchmark:
        return head
    rows = [("", [text(TITLES[name]), text(source)]) for name, source in METHODS.items()]
    return head + table(["method", "follows"], rows)
