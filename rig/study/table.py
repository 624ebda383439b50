"""A table as a value, and how its numbers are written."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
