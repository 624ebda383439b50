"""A CSV file of time and displacement or force: its content as numbers, or every wrong line.

One line of names, separated by commas, semicolons or tabs; the unit is part of the name: `time_s,displacement_mm`.
Other columns, empty lines and lines that start with # are ignored.
"""

from __future__ import annotations

import csv
import hashlib
from itertools import pairwise
from pathlib import Path

import numpy as np

from rig import units
from rig.errors import FileProblem
from rig.signals.arrays import FloatArray
from rig.text_file import read_bytes

LARGEST_BYTES = 50_000_000
FEWEST_ROWS = 4
MOST_SHOWN = 8
LARGEST_VALUE = 1e16
"""Of a value as written: microseconds since 1970 are 2e15; beyond it whole numbers are not distinguished."""
SEPARATORS = ",;\t"
TIME, DISPLACEMENT, FORCE = "time", "displacement", "force"
EXAMPLE = {TIME: "time_s", DISPLACEMENT: "displacement_mm", FORCE: "force_N"}
DIMENSION = {TIME: "time", DISPLACEMENT: "length", FORCE: "force"}


def read_record(path: Path, quantity: str = DISPLACEMENT) -> tuple[FloatArray, FloatArray, str]:
    """Time (s) and displacement (m) or force (N) of each row, both (n,), and the SHA-256 (hex) of the file.

    Args:
        path: of the file.
        quantity: `DISPLACEMENT` or `FORCE`.

    Raises:
        FileProblem: no such file, columns without names and units, or rows that are no rising finite numbers: every
            wrong line (the first `MOST_SHOWN` of them).
    """
    content = read_bytes(path, LARGEST_BYTES)
    lines = [
        (number, line) for number, line in enumerate(content.decode("utf-8-sig", errors="replace").splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise FileProblem(str(path), ["the file is empty; expected a header line such as "
            f"{EXAMPLE[TIME]},{EXAMPLE[quantity]}, followed by rows of numbers"])
    separator = max(SEPARATORS, key=lines[0][1].count)
    names = [name.strip().strip('"') for name in lines[0][1].split(separator)]
    places = {column: _place(path, names, column) for column in (TIME, quantity)}
    rows, problems = _numbers(lines[1:], separator, [place for place, _ in places.values()], len(names))
    problems += _falling(rows)
    if not problems and len(rows) < FEWEST_ROWS:
        problems.append(f"the file has {len(rows)} rows; a motion requires at least {FEWEST_ROWS}")
    if problems:
        more = [f"{len(problems) - MOST_SHOWN} further invalid lines"] if len(problems) > MOST_SHOWN else []
        raise FileProblem(str(path), [*problems[:MOST_SHOWN], *more])
    scale = np.array([scale for _, scale in places.values()])
    table = np.array([values for _, values in rows], np.float64) * scale
    return table[:, 0], table[:, 1], hashlib.sha256(content).hexdigest()


def _place(path: Path, names: list[str], column: str) -> tuple[int, float]:
    """Where a column stands, and what one of its units is in SI.

    Raises:
        FileProblem: there is none of that name with a unit, or several.
    """
    suffixes = units.key_suffixes(DIMENSION[column])
    columns = [
        (place, units.UNITS[unit].scale) for place, name in enumerate(names)
        for suffix, unit in suffixes.items() if name == f"{column}_{suffix}"
    ]
    if len(columns) != 1:
        count_text = "no column" if not columns else f"{len(columns)} columns"
        known = ", ".join(f"{column}_{suffix}" for suffix in suffixes)
        raise FileProblem(
            str(path), [f"line 1: {count_text} for {column} in {', '.join(names)[:80]!r}. Fix: include the unit in the "
                f"name of the column, such as {EXAMPLE[column]} (one of {known})"],
        )
    return columns[0]


def _numbers(
    lines: list[tuple[int, str]], separator: str, places: list[int], columns: int
) -> tuple[list[tuple[int, list[float]]], list[str]]:
    """The rows that are finite numbers, each with its line, and what is wrong with the others."""
    rows, problems = [], []
    for number, line in lines:
        cells = next(csv.reader([line], delimiter=separator)) if '"' in line else line.split(separator)
        try:
            values = [float(cells[place]) for place in places] if len(cells) == columns else []
        except ValueError:
            values = []
        if len(values) == len(places) and all(abs(value) <= LARGEST_VALUE for value in values):
            rows.append((number, values))
        else:
            comma = "; the decimal separator must be a point" if separator != "," and "," in line else ""
            problems.append(
                f"line {number}: {line.strip()[:60]!r} is not a row with {columns} columns of finite numbers{comma}"
            )
    return rows, problems


def _falling(rows: list[tuple[int, list[float]]]) -> list[str]:
    """The lines whose time is not after the one before."""
    return [
        f"line {number}: time {now[0]:.10g} is not after {before[0]:.10g}, the time of the previous row"
        for (_, before), (number, now) in pairwise(rows) if not now[0] > before[0]
    ]
