"""Tables as values, and what a study writes: one CSV a table, one JSON, one HTML page that needs nothing else."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.document import html
from rig.document.blocks import (
    Blocks,
    Contents,
    Details,
    Document,
    Figures,
    Heading,
    Items,
    Listing,
    Paragraph,
    Properties,
    table,
)
from rig.document.drawing import drawing_of
from rig.document.figure import Figure, Panels
from rig.document.svg import standalone
from rig.document.words import Code, Strong
from rig.recording.atomic_write import inner_folder, write_text_durably
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
        earlier_names: Of renamed columns: name -> deprecated name until 2.0; files have both columns, the page one.
    """

    name: str
    heading: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    earlier_names: Mapping[str, str] = field(default_factory=dict)

    def in_files(self) -> tuple[list[str], list[list[Cell]]]:
        """Headings and rows for CSV and JSON: renamed columns again at the end, by their deprecated names."""
        again = [self.columns.index(name) for name in self.earlier_names]
        rows = [[*row, *(row[place] for place in again)] for row in self.rows]
        return [*self.columns, *self.earlier_names.values()], rows


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
    "figure-03": "Figure 3: position and velocity of a triangular motion",
    "figure-04": "Figure 4: force vs. velocity for a triangular displacement, without noise",
    "figure-05": "Figure 5: the recordings at the lowest frequency",
    "figure-08": "Figure 8: box plot of each setting",
    "figure-08-pair": "Figure 8 as printed: best-tuned PSO and c-FOA",
    "figure-09": (
        "Figure 9: convergence, each method at its best setting (right: the second half, near the lowest value)"
    ),
    "figure-10": "Figure 10: recorded and fitted force vs. velocity",
    "figure-11": "Figure 11: recorded and fitted force vs. extension",
    "figure-12": (
        "Figure 12: force vs. velocity for the c-FOA, GA and PSO fits, as printed (Table 5) and from this study"
    ),
    "figure-13": (
        "Figure 13: response of a car with the c-FOA, GA and PSO fits, as printed (Table 5) and from this study"
    ),
    "paper2-figure-08": "Paper 2, Figure 8: the recordings",
    "paper2-figure-10": "Paper 2, Figure 10: minimum error and its running average vs. generations",
    "paper2-figure-11": "Paper 2, Figure 11: distribution of the minimum error, and an exponential distribution",
    "paper2-figure-12": "Paper 2, Figure 12: recorded and reconstructed hysteresis",
    "paper2-figure-13-bars": "Paper 2, Figure 13: errors and generations of each method",
    "paper2-figure-relations": "Paper 2, Table 1 as a figure: parameters vs. current, and the fitted relations",
}
COMPARED = (
    "Statements in the papers, checked with these recordings. The papers' own recordings are not public, so orders and "
    "ratios are compared, not magnitudes."
)
SYNTHETIC = (
    "The recordings are synthetic: simulated dampers with known parameters (truth) and white noise. The models can fit "
    "these recordings to within the noise, which no model achieves for a real damper. The findings on algorithms may "
    "not apply to real dampers, and these results do not show how well a model fits a real damper."
)
NOT_DRAWN = (
    "Not included: photographs, diagrams and flow charts (Figures 1, 2, 6 and 7; paper 2, Figures 1 to 7 and 9), which "
    "contain no computed results."
)
HYPOTHESIS = (
    "Null hypothesis: all settings have the same distribution. The test is unbiased if it includes all settings. If it "
    "includes only the best-tuned settings, as in the paper, it is biased because these settings were chosen on the "
    "same values."
)
SIGNIFICANT = 0.05
SEVERAL = {"Paper 2, Table 1", "Paper 2, relations"}


def write_outputs(
    folder: Path,
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, Figure | Panels],
    tests: Mapping[str, KruskalWallis | None],
    facts: Mapping[str, Any],
) -> Path:
    """Write `tables/*.csv`, `figures/*.svg`, `study.json` and `study.html`.

    Args:
        folder: Where; made if it is missing.
        title: Of the page.
        tables: All tables.
        figures: By name.
        tests: What was compared -> Kruskal-Wallis test, None where it cannot be done.
        facts: About the study: name, recordings, tests, samples, searches, repeats, left_out, wall_s, `made` (from
            `provenance`); `summary` in place of a sentence made of them.

    Returns:
        Path of the page.
    """
    written, drawn = inner_folder(folder, "tables"), inner_folder(folder, "figures")
    for part in tables:
        text = io.StringIO(newline="")
        columns, rows = part.in_files()
        csv.writer(text).writerows([columns, *rows])
        write_text_durably(written / f"{part.name}.csv", text.getvalue())
    for name, figure in figures.items():
        write_text_durably(drawn / f"{name}.svg", standalone(drawing_of(figure)))
    write_text_durably(folder / "study.json", json.dumps(as_json(tables, tests, facts), indent=2) + "\n")
    page = folder / "study.html"
    write_text_durably(page, html.page(study_document(title, tables, figures, tests, facts)))
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
        "tables": [_table_as_json(part) for part in tables],
    }


def _table_as_json(part: Table) -> dict[str, object]:
    columns, rows = part.in_files()
    return {
        "name": part.name, "heading": part.heading, "title": part.title, "columns": columns,
        "rows": [[_plain(cell) for cell in row] for row in rows], "note": part.note,
    }  # fmt: skip


def _test_as_json(test: KruskalWallis) -> dict[str, object]:
    pairs = [dataclasses.asdict(pair) for pair in test.pairs]
    return {"H": test.statistic, "p": test.p, "mean_ranks": dict(test.mean_ranks), "note": test.note, "pairs": pairs}


def _plain(cell: object) -> object:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def study_document(
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, Figure | Panels],
    tests: Mapping[str, KruskalWallis | None],
    facts: Mapping[str, Any],
) -> Document:
    """The study as a document; arguments as of `write_outputs`."""
    made = f"Written {facts['made']['written_utc']} UTC by {facts['made']['software']}."
    lines = [_summary(facts), made, *facts["left_out"], *([SYNTHETIC] if facts["recordings"] == "synthetic" else [])]
    blocks: Blocks = [Heading(title, 1), *(Paragraph(line, small=True) for line in lines)]
    blocks += _findings(facts["findings"]) if facts.get("findings") else []
    blocks.append(Contents())
    blocks += [block for part in tables for block in _table(part)]
    if tests:
        blocks += [
            Heading("Kruskal-Wallis test", name="kruskal-wallis", listed="Kruskal-Wallis test"),
            Paragraph(HYPOTHESIS, small=True), *(block for name, test in tests.items() for block in _test(name, test)),
        ]  # fmt: skip
    for name, figure in figures.items():
        caption = FIGURE_TITLES.get(name, name)
        blocks += [Heading(caption, name=name, listed=caption), Figures((figure,))]
    blocks += [Paragraph(NOT_DRAWN, small=True)] if facts.get("findings") else []
    return Document(title, [*blocks, *_made(facts), *_cite(facts)])


def _findings(statements: Sequence[Mapping[str, str]]) -> Blocks:
    """Which of the papers' statements hold on these recordings."""
    items = tuple((Strong(f"{one['slug']}: {one['verdict']}."), f" {one['text']}") for one in statements)
    return [Heading("Findings", name="findings"), Paragraph(COMPARED, small=True), Items(items)]


def _table(part: Table) -> Blocks:
    numeric = [
        place for place in range(len(part.columns)) if any(isinstance(row[place], int | float) for row in part.rows)
    ]
    made = table(part.columns, [[written(cell) for cell in row] for row in part.rows], numeric)
    note: Blocks = [Paragraph(part.note, small=True)] if part.note else []
    heading = Heading(part.heading, name=part.name, listed=f"{part.heading}{_suffix(part)}")
    return [heading, Paragraph(part.title), made, *note]


def _suffix(part: Table) -> str:
    """What distinguishes tables of one heading, for the list of contents."""
    return f", {part.title.rpartition(', ')[2].partition(' (')[0]}" if part.heading in SEVERAL else ""


def _summary(facts: Mapping[str, Any]) -> str:
    if "summary" in facts:
        return str(facts["summary"])
    return (
        f"{facts['tests']} tests ({facts['recordings']}), {facts['samples']:,} samples; {facts['searches']} searches, "
        f"{facts['repeats']} repeats of each setting in the comparison."
    )


def _test(name: str, test: KruskalWallis | None) -> Blocks:
    if test is None:
        return [Paragraph(f"{name}: test not possible (too few values, or all values are equal).")]
    ranked = sorted(test.mean_ranks.items(), key=lambda entry: entry[1])
    ranks = table(["setting", "mean rank"], [[setting, f"{rank:.1f}"] for setting, rank in ranked], (1,))
    stated = Paragraph(f"{name}: H = {test.statistic:.3f}, p = {test.p:.3g}. {test.note}")
    return [stated, ranks, *(_pairs(test) if test.pairs else [])]


def _pairs(test: KruskalWallis) -> Blocks:
    """The pairs that differ, after Holm; the others counted."""
    clear = [pair for pair in test.pairs if pair.p_holm < SIGNIFICANT]
    counted = f"{len(clear)} of {len(test.pairs)} pairs differ (p < {SIGNIFICANT:g})"
    stated = Paragraph(f"Dunn's test with Holm's correction: {counted}.")
    rows = [[pair.first, pair.second, f"{pair.z:.2f}", f"{pair.p_holm:.2g}"] for pair in clear]
    return [stated, *([table(["lower ranks", "higher ranks", "z", "p after Holm"], rows, (2, 3))] if rows else [])]


def _made(facts: Mapping[str, Any]) -> Blocks:
    """Date, versions, machine, seed, the command and the study file.

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
        "computer that generated this page": made["machine"],
        "time": f"{made['searched_s']:,.0f} s of searches in all sessions and workers together; {facts['wall_s']:,.0f} "
        "s in the session that generated this page",
        "seed": str(made["seed"]),
        "fingerprint": f"{made['fingerprint']} (settings of the study and its recordings)",
    }
    again = (
        "Finished searches in the folder are reused. With the same versions, seed and type of processor, every search "
        "returns the same value; only the times differ. To repeat the study with the file below:"
    )
    return [
        Heading("Provenance", name="made", listed="Provenance"), Properties(pairs), Paragraph(again),
        Listing(made["command"]), Details("The study file", (Listing(made["file"]),)),
    ]  # fmt: skip


def _cite(facts: Mapping[str, Any]) -> Blocks:
    """The software, the papers or the recordings' sources, and what each method follows.

    Args:
        facts: About the study; `recordings` is a list of sources where it is a benchmark.
    """
    of_benchmark = isinstance(facts["recordings"], list)
    sources = [
        f"Recordings {one['name']}: {one['title']}. {one['source']}. Licence: {one['licence']}. Split: {one['split']}."
        for one in facts["recordings"] if of_benchmark and one["complete"]
    ]  # fmt: skip
    cited = Items((CITE_SOFTWARE, *(sources if of_benchmark else CITE_PAPERS)))
    models = Paragraph(("Source of each damper model: ", Code("rig models NAME"), "."), small=True)
    head: Blocks = [Heading("How to cite", name="cite", listed="How to cite"), cited, models]
    if of_benchmark:
        return head
    return [*head, table(["method", "follows"], [[TITLES[name], source] for name, source in METHODS.items()])]
