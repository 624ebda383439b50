"""The models of a comparison as a tuple that can be printed and converted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.document import html
from rig.document.blocks import Column, Row, Table
from rig.document.numbers import number
from rig.document.terminal import lines
from rig.document.words import FAIR, PLAIN
from rig.fits.entries import ModelScore
from rig.fits.parameters import WIDTH

if TYPE_CHECKING:
    import pandas as pd


class Scores(tuple[ModelScore, ...]):
    """The models that were compared, the recommended one first."""

    __slots__ = ()

    def to_pandas(self) -> pd.DataFrame:
        """One row a model, with the attributes of `ModelScore` as columns; the index is `model`."""
        import pandas as pd  # half a second that reading a fit does not need

        rows = [vars(score) for score in self]
        return pd.DataFrame(rows, columns=list(ModelScore.__dataclass_fields__)).set_index("model")

    def __repr__(self) -> str:
        """A table of at most 80 columns."""
        return "\n".join(text for text, _ in lines([self._table()], WIDTH)) if self else "()"

    def _repr_html_(self) -> str:
        return html.fragment([self._table()])

    def _table(self) -> Table:
        reasons = any(score.reason for score in self)
        head = (
            Column("model"), Column("validation error", "%", True), Column("RMS error", "N", True),
            Column("parameters", "", True), Column("BIC", "", True),
            *([Column("not fitted because")] if reasons else []),
        )  # fmt: skip
        return Table(head, tuple(
            Row((
                score.model, number(score.holdout_nrmse_percent_of_peak, 3), number(score.rmse_N, 3),
                str(score.parameters), number(score.bic, 6), *([score.reason] if reasons else []),
            ), FAIR if score.reason else PLAIN) for score in self
        ))  # fmt: skip
