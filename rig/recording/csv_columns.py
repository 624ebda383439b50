"""Columns of a foreign CSV file: which is which, in what unit, and where a value in it is wrong."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.signals.arrays import FloatArray
from rig.units import ALIASES, UNITS, Unit, key_suffixes, units_of

LARGEST_BYTES = 512 * 1024 * 1024
SEPARATORS = ",;\t"
MOST_PROBLEMS = 5
DIMENSION = {"time": "time", "displacement": "length", "force": "force", "current": "current",
             "commanded_current": "current"}
REQUIRED = ("time", "displacement", "force")
NOTHING = ("", "nan", "na", "null", "none", "-")


@dataclass(frozen=True)
class ColumnChoice:
    """`text` as the user wrote it; SI value = number in `column` x scale + offset of `unit`."""

    text: str
    column: str
    unit: Unit


def parse_columns(columns: Mapping[str, str]) -> dict[str, ColumnChoice]:
    """Read `{"displacement": "x_mm", "force": "F:kN", ...}`.

    Raises:
        FileProblem: one line for each quantity that is unknown, missing, or whose unit is not known.
    """
    chosen, problems = {}, []
    for quantity, text in columns.items():
        if quantity not in DIMENSION:
            problems.append(f"{quantity}={text}: unknown quantity; known: {', '.join(DIMENSION)}")
            continue
        try:
            chosen[quantity] = _choice(text, DIMENSION[quantity])
        except ValueError as error:
            problems.append(f"{quantity}={text}: {error}")
    problems += [f"{name}: no column named; write --column {name}=NAME" for name in REQUIRED if name not in columns]
    if problems:
        raise FileProblem("--column", problems)
    return chosen


def _choice(text: str, dimension: str) -> ColumnChoice:
    column, colon, name = text.rpartition(":")
    if colon:
        unit = UNITS.get(ALIASES.get(name, name))
        if unit is None or unit.dimension != dimension:
            raise ValueError(f"{name!r} is no unit of {dimension}; units: {', '.join(units_of(dimension))}")
        return ColumnChoice(text, column, unit)
    fitting = [unit for suffix, unit in key_suffixes(dimension).items() if text.endswith(f"_{suffix}")]
    if not fitting:
        example = f"{text}:{units_of(dimension)[0]}"
        raise ValueError(f"its unit is not known: end the name with it (x_mm) or write it after a colon ({example})")
    return ColumnChoice(text, text, UNITS[max(fitting, key=len)])


def read_table(file: Path, choices: Mapping[str, ColumnChoice]) -> tuple[dict[str, FloatArray], str]:
    """Read the chosen columns in SI and the file's SHA-256.

    Returns:
        Arrays (n,) by quantity, NaN where the file has nothing or NaN (never in the time), and the hash.

    Raises:
        FileProblem: no such file, too large, a missing column, or a value that is not a number, with line and column.
    """
    data = _bytes(file)
    text = _text(file, data)
    header = text.split("\n", 1)[0].strip().lstrip("\ufeff")
    separator = max(SEPARATORS, key=header.count)
    names = [name.strip().strip('"') for name in header.split(separator)]
    missing = [choice.column for choice in choices.values() if choice.column not in names]
    if missing:
        raise FileProblem(str(file), [f"line 1: no column {name!r}; columns: {', '.join(names)}" for name in missing])
    raw = _numbers(file, text, separator, names, choices)
    table = {quantity: values * choices[quantity].unit.scale for quantity, values in raw.items()}
    blank = np.flatnonzero(~np.isfinite(table["time"]))
    if len(blank):
        place = f"line {int(blank[0]) + 2}, column {choices['time'].column!r}"
        raise FileProblem(str(file), [f"{place}: no time ({len(blank)} such line(s))"])
    return table, hashlib.sha256(data).hexdigest()


def _bytes(file: Path) -> bytes:
    if not file.is_file():
        raise FileProblem(str(file), ["no such file"])
    size = file.stat().st_size
    if size > LARGEST_BYTES:
        raise FileProblem(str(file), [f"{size} bytes; at most {LARGEST_BYTES} can be imported"])
    try:
        return file.read_bytes()
    except OSError as error:
        raise FileProblem(str(file), [f"cannot be read: {error}"]) from error


def _text(file: Path, data: bytes) -> str:
    if b"\0" in data:
        raise FileProblem(str(file), ["not a text file: it contains zero bytes"])
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileProblem(str(file), [f"line {line}: not UTF-8 text"]) from error


def _numbers(
    file: Path, text: str, separator: str, names: list[str], choices: Mapping[str, ColumnChoice],
) -> dict[str, FloatArray]:
    import pandas as pd

    wanted = {choice.column for choice in choices.values()}
    try:
        table = pd.read_csv(
            io.StringIO(text), sep=separator, header=0, names=names, usecols=lambda name: name in wanted,
            index_col=False, dtype=np.float64, skipinitialspace=True, skip_blank_lines=False,
        )
    except (ValueError, OverflowError) as error:
        raise FileProblem(str(file), _wrong_values(text, separator, names, wanted) or [str(error)]) from error
    numbers = {quantity: table[choice.column].to_numpy(np.float64) for quantity, choice in choices.items()}
    end = len(table)
    while end and all(np.isnan(values[end - 1]) for values in numbers.values()):
        end -= 1
    problems = [
        f"line {int(np.flatnonzero(np.isinf(values))[0]) + 2}, column {choices[quantity].column!r}: infinite"
        for quantity, values in numbers.items() if np.isinf(values).any()
    ]
    if problems:
        raise FileProblem(str(file), problems)
    return {quantity: values[:end] for quantity, values in numbers.items()}


def _wrong_values(text: str, separator: str, names: list[str], wanted: set[str]) -> list[str]:
    """Where the values are that are no numbers, the first few."""
    problems = []
    for line, row in enumerate(text.splitlines()[1:], start=2):
        cells = [cell.strip().strip('"') for cell in row.split(separator)]
        if len(cells) > len(names):
            problems.append(f"line {line}: {len(cells)} values for {len(names)} columns")
        for name, cell in zip(names, cells, strict=False):
            if name in wanted and cell.lower() not in NOTHING and not _is_number(cell):
                hint = "; decimals are written with a point" if "," in cell else ""
                problems.append(f"line {line}, column {name!r}: {cell[:40]!r} is not a number{hint}")
        if len(problems) >= MOST_PROBLEMS:
            return [*problems[:MOST_PROBLEMS], "and maybe more"]
    return problems


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
