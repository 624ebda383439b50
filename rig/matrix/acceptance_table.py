"""`[acceptance]` of a matrix file: the acceptance bands that the specimen must meet, and the decision rule.

The bands themselves are read by `rig.comparison`, which knows what a test measures.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, PrivateAttr

from protocols.descriptions import Problem
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.files.section import Section
from rig.files.toml_source import read_toml
from rig.matrix.report_table import FileName
from rig.text_file import read_bytes

LARGEST_BANDS_BYTES = 262_144
Decision = Literal["simple", "guarded", "guarded-acceptance", "guarded-rejection"]
DECISION: Any = Field(
    default="simple",
    description="guarded-acceptance (or guarded): a value passes only if it lies within its limits by at least the "
        "expanded uncertainty; guarded-rejection: a value fails only if it lies outside its limits by more than the "
        "expanded uncertainty (ISO 14253-1)",
)


class AcceptanceTable(Section):
    """Limits that the specimen must meet; the campaign then ends with a verdict on the specimen."""

    bands: FileName = Field(
        description="acceptance bands file, relative to the folder of this file", examples=["acceptance-bands.toml"]
    )
    decision: Decision | None = Field(
        default=None, description="decision rule in place of the one in the bands file", examples=["guarded-acceptance"]
    )

    _sha256: str = PrivateAttr(default="")

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        try:
            content = read_bytes(Path(self.bands), LARGEST_BANDS_BYTES)
        except FileProblem as error:
            yield from ((("bands",), f"{Path(self.bands).name}: {problem}") for problem in error.problems)
        else:
            self._sha256 = hashlib.sha256(content).hexdigest()

    @property
    def sha256(self) -> str:
        """SHA-256 (hex) of the bands file."""
        return self._sha256

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of all that decides on the specimen: the content of the bands file, and the decision rule."""
        return hashlib.sha256(f"{self._sha256} {self.decision or ''}".encode()).hexdigest()


def has_acceptance(run: Path) -> bool:
    """Whether the matrix of a run in this folder names acceptance bands."""
    try:
        return "acceptance" in read_toml(CampaignFolder(run).matrix).data
    except FileProblem:
        return False
