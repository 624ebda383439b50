"""Force over velocity as dynamometers print it, after a run, import or report: a row for each current and speed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rig.campaign_folder import CampaignFolder
from rig.characteristics.force_table import CONSTANT_VELOCITY, ForceTable, tests_text
from rig.cli.output import show
from rig.document.blocks import Blocks, Column, Paragraph, table
from rig.signals.rounding import rounded
from rig.text_file import read_json

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from rig.display import Display, Shown
    from rig.report.views import MotionTerms

MOST_ROWS = 40
"""Rows of one table on a terminal; the report has all."""


def recorded_tables(run: Path) -> tuple[ForceTable, ...]:
    """The tables that were written with a run's report.

    Raises:
        FileProblem: `characteristics.json` is damaged.
    """
    return tuple(map(ForceTable.from_json, read_json(CampaignFolder(run).characteristics).get("force_tables", [])))


def show_recorded_tables(run: Path, shown: Console) -> None:
    """Print the tables that were written with a run's report, in its units."""
    from rig.files.run_display import run_display  # loads pydantic
    from rig.recording.run import Run  # loads numpy
    from rig.report.cover import terms_of  # loads numpy

    if tables := recorded_tables(run):
        shown.print()
        show(force_blocks(tables, run_display(run), terms_of(Run.open(run))), shown)
        shown.print()


def force_blocks(tables: Sequence[ForceTable], shown: Display, terms: MotionTerms) -> Blocks:
    """Each table in the units and with the signs of the display, its motions in the terms of the report."""
    return [block for one in tables for block in _blocks(one, shown, terms)]


def _blocks(one: ForceTable, shown: Display, terms: MotionTerms) -> Blocks:
    what = "constant velocity" if one.kind == CONSTANT_VELOCITY else "peak velocity (PVP)"
    stroke = [] if one.constant_stroke else [Column(terms.length_name, shown.displacement.unit, True)]
    force = shown.force.unit
    head = [
        Column("current", "A", True), Column("velocity", shown.speed.unit, True), *stroke,
        Column("compression", force, True), Column("rebound", force, True), Column("peak comp.", force, True),
        Column("peak reb.", force, True), *([Column("tests")] if one.averaged else []),
    ]  # fmt: skip
    rows = list(_rows(one, shown, terms))
    size = "" if stroke else f", {terms.length(one.rows[0].amplitude_m, shown)}"
    signs = "; compression positive" if shown.positive == "compression" else ""
    title = f"Force at {what}, {one.waveform}{size}{signs}"
    left = len(rows) - MOST_ROWS
    more = [Paragraph(f"Further rows in the report: {left}")] if left > 0 else []
    return [table(head, rows[:MOST_ROWS], title=title), *more]


def _rows(one: ForceTable, shown: Display, terms: MotionTerms) -> Iterator[list[str]]:
    places = one.places(shown.force.scale)
    for place, current_A in enumerate(one.currents_A):
        for row in one.rows:
            cell = row.cells[place]
            if cell is None:
                continue
            stroke = [] if one.constant_stroke else [f"{shown.displacement.value(terms.length_m(row.amplitude_m)):.4g}"]
            forces = (
                cell.compression_N, cell.rebound_N, cell.peak_force_compression_N, cell.peak_force_rebound_N,
            )
            yield [
                f"{current_A:.3g}", f"{shown.speed.value(row.speed_m_s):.3g}", *stroke,
                *(_signed(shown.force, force_N, places) for force_N in forces),
                *([tests_text(len(cell.points), len(cell.points))] if one.averaged else []),
            ]  # fmt: skip


def _signed(shown: Shown, force_N: float, places: int) -> str:
    return rounded(shown.signed(force_N), places) if math.isfinite(force_N) else "-"
