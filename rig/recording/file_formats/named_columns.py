"""Names of columns that state their quantity in full, such as those of our own exports: `force_N`, `Force [kN]`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rig.errors import FileProblem
from rig.recording.file_formats.columns import split_heading
from rig.recording.file_formats.file_units import named_unit, units_for
from rig.recording.file_formats.table_file import TableColumn
from rig.units import Unit, key_suffixes

SECONDS = {"": 1.0, "_s": 1.0, "_ms": 1e-3, "_us": 1e-6, "_ns": 1e-9}
TIMES = {f"{stem}{end}": scale for stem in ("time", "t") for end, scale in SECONDS.items()}
"""Names of a time (lower case) -> seconds per unit."""
STEMS = {
    "displacement": ("displacement", "length"), "force": ("force", "force"), "velocity": ("velocity", "speed"),
    "current_measured": ("current", "current"), "commanded_current": ("commanded_current", "current"),
    "current": ("current", "current"), "coil_temperature": ("coil_temperature", "temperature"),
}  # fmt: skip
"""Beginning of a column's name (lower case) -> channel of the point, and what it measures."""
FILE_QUANTITIES = {
    "displacement": "displacement", "force": "force", "current": "current", "commanded_current": "commanded_current",
    "coil_temperature": "temperature",
}  # fmt: skip
"""Channel -> quantity as the import of files calls it; a velocity is calculated from the displacement."""


@dataclass(frozen=True)
class NamedQuantity:
    """What the name of a column states.

    Attributes:
        channel: of a recorded point (`force`, `coil_temperature`, ...).
        dimension: what it measures.
        suffix: the unit in the name; empty where there is none.
    """

    channel: str
    dimension: str
    suffix: str

    @property
    def unit(self) -> Unit | None:
        """The unit in the name; None where there is none."""
        known = units_for(self.dimension)
        if self.suffix in key_suffixes(self.dimension):
            return known[key_suffixes(self.dimension)[self.suffix]]
        named = named_unit(self.suffix, self.dimension) if self.suffix else None
        return None if named is None else named[1]


def time_name(name: object) -> str:
    """The name of a column in lower case, a unit of time in brackets as its end: `Time [ms]` is `time_ms`."""
    base, text = split_heading(str(name))
    unit = named_unit(text, "time") if text else None
    return str(name).casefold() if unit is None else f"{base.casefold()}_{unit[0]}"


def named_quantity(name: str, more: Mapping[str, tuple[str, str]] | None = None) -> NamedQuantity | None:
    """The quantity that a name states in full, with its unit or without: `force`, `force_kN`, `Force [kN]`.

    Args:
        name: of the column.
        more: further entries as in `STEMS`.
    """
    base, unit = split_heading(name)
    for stem, (channel, dimension) in {**STEMS, **(more or {})}.items():
        if not base.casefold().startswith(stem):
            continue
        rest = base[len(stem) :]
        if not rest and (not unit or named_unit(unit, dimension) is not None):
            return NamedQuantity(channel, dimension, unit)
        if rest[:1] == "_" and not unit and (rest[1:] in key_suffixes(dimension) or rest[1:] in units_for(dimension)):
            return NamedQuantity(channel, dimension, rest[1:])
    return None


def stated_columns(columns: Sequence[TableColumn], given: Mapping[str, str] | None = None) -> dict[str, str]:
    """Quantity -> column of a file whose name states the quantity and whose name or file states the unit.

    Args:
        columns: the file's.
        given: quantity -> column as the user specifies it; these quantities and columns are left out.

    Raises:
        FileProblem: (without the file's name) several columns state the same quantity.
    """
    given = given or {}
    labels_of: dict[str, list[str]] = {}
    names = [column.name for column in columns]
    for place, column in enumerate(columns):
        label = column.name if names.count(column.name) == 1 else column.full or f"#{place + 1}"
        stated = named_quantity(column.name)
        if stated is not None and (stated.suffix or named_unit(column.unit, stated.dimension)):
            if stated.channel in FILE_QUANTITIES:
                labels_of.setdefault(FILE_QUANTITIES[stated.channel], []).append(label)
        elif time_name(column.name) in TIMES and ("_" in time_name(column.name) or named_unit(column.unit, "time")):
            labels_of.setdefault("time", []).append(label)
    labels_of = {
        quantity: left for quantity, labels in labels_of.items()
        if quantity not in given and (left := [label for label in labels if label not in given.values()])
    }  # fmt: skip
    twice = [
        f"columns {' and '.join(map(repr, labels))} both contain the {quantity}. Fix: specify the column to use for "
        f"the {quantity}" for quantity, labels in labels_of.items() if len(labels) > 1
    ]
    if twice:
        raise FileProblem("", twice)
    return {quantity: labels[0] for quantity, labels in labels_of.items()}
