"""The parameters of a fit as a mapping that can be printed, indexed and converted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from protocols.near_miss import meant
from rig.dampers.arrays import FloatArray
from rig.document import html
from rig.document.blocks import Blocks, Column, Paragraph, Row, Table
from rig.document.numbers import ELLIPSIS, MINUS, NOTHING, between, number
from rig.document.terminal import lines
from rig.document.words import FAIR, PLAIN
from rig.errors import NoSuchEntry
from rig.fits.entries import Estimate
from rig.fits.residual_weights import of_physics, residual_line

if TYPE_CHECKING:
    import pandas as pd

WIDTH = 80
TABLE = ("value", "standard_error", "low", "high", "unit", "identifiable", "reason")


@dataclass(frozen=True, repr=False)
class Parameters(Mapping[str, Estimate]):
    """Estimates by name, in the order of the model: `params["beta"].value`, `.standard_error`, `.unit`, ...

    Arrays over all parameters have shape (p,), NaN where something is not known.

    Attributes:
        estimates: name -> estimate.
    """

    estimates: Mapping[str, Estimate]

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter.

        Raises:
            NoSuchEntry: the model has no such parameter.
        """
        if name not in self.estimates:
            raise NoSuchEntry(f"fit: got the parameter {name!r}; {meant(str(name), self.estimates)}")
        return self.estimates[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.estimates)

    def __len__(self) -> int:
        return len(self.estimates)

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in the order of the arrays."""
        return tuple(self.estimates)

    @property
    def units(self) -> tuple[str, ...]:
        """SI units."""
        return tuple(one.unit for one in self.estimates.values())

    @property
    def value(self) -> FloatArray:
        """Values in `units`, shape (p,)."""
        return self._array("value")

    @property
    def standard_error(self) -> FloatArray:
        """Standard errors in `units`, shape (p,)."""
        return self._array("standard_error")

    @property
    def interval(self) -> FloatArray:
        """Ends of the 95 % intervals in `units`, each parameter separately, shape (p, 2)."""
        return np.column_stack([self._array("low"), self._array("high")])

    def _array(self, name: str) -> FloatArray:
        return np.array([getattr(one, name) for one in self.estimates.values()], dtype=float)

    def to_pandas(self) -> pd.DataFrame:
        """One row a parameter: `value`, `standard_error`, `low`, `high` (95 %), `unit`, `identifiable`, `reason`."""
        import pandas as pd  # half a second that reading a fit does not need

        rows = [{name: getattr(one, name) for name in TABLE} for one in self.estimates.values()]
        return pd.DataFrame(rows, index=pd.Index(self.estimates, name="parameter"), columns=list(TABLE))

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.estimates)

    def __repr__(self) -> str:
        """A table of at most 80 columns."""
        return "\n".join(text for text, _ in lines(self._blocks(), WIDTH))

    def _repr_html_(self) -> str:
        return html.fragment(self._blocks())

    def _blocks(self) -> Blocks:
        residual = residual_line(self.estimates)
        return [parameter_table(of_physics(self.estimates)), *([Paragraph(residual)] if residual else [])]


def parameter_table(estimates: Mapping[str, Estimate]) -> Table:
    """Values rounded to what their intervals tell, standard errors, 95 % intervals and units."""
    head = (
        Column("parameter"), Column("value", "", True), Column("std. error", "", True), Column("95 % interval"),
        Column("unit"),
    )  # fmt: skip
    return Table(head, tuple(
        Row((name, *_known(one), one.unit), PLAIN if one.identifiable else FAIR) for name, one in estimates.items()
    ))  # fmt: skip


def _known(one: Estimate) -> tuple[str, str, str]:
    """Value, standard error and interval as text."""
    value, interval = between(one.value, one.low, one.high)
    if not one.has_interval:
        value, interval = number(one.value, 4), "not determined"
        if one.high is not None and one.low is None:
            interval = f"below {number(one.high, 4)}"
    return _plain(value), _plain(number(one.standard_error, 2)), _plain(interval)


def _plain(text: str) -> str:
    """Signs that every terminal has."""
    return text.replace(MINUS, "-").replace(f" {ELLIPSIS} ", " to ").replace(NOTHING, "-")
