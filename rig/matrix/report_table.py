"""`[report]` of a matrix file: what a customer's report states in addition to what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr

from protocols.descriptions import Problem
from rig.document.picture import MOST_BYTES, Picture, picture_of
from rig.errors import FileProblem
from rig.files.display_table import DisplayTable
from rig.files.loader import load_section
from rig.files.quantity import Wording
from rig.files.section import Section
from rig.matrix.named_files import with_paths
from rig.text_file import read_bytes

LONGEST_LINE, LONGEST_TEXT = 120, 1000
Line = Annotated[
    str, Field(pattern=rf"^[^\x00-\x1f\x7f]{{1,{LONGEST_LINE}}}$"),
    Wording(f"1 to {LONGEST_LINE} characters in one line", "Acceptance test"),
]  # fmt: skip
Passage = Annotated[
    str, Field(pattern=rf"^[^\x00-\x08\x0b-\x1f\x7f]{{1,{LONGEST_TEXT}}}$"),
    Wording(f"1 to {LONGEST_TEXT} characters", "Damper kept at 23 degC for 12 h"),
]  # fmt: skip
FileName = Annotated[
    str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,4096}$"), Wording("the name of a file", "logo.png"),
]  # fmt: skip


class ReportTable(Section):
    """Title, customer, people and logo of the report. Nothing that is measured depends on this table."""

    title: Line | None = Field(default=None, description="title of the report")
    customer: Line | None = Field(default=None, description="customer for whom the test is performed")
    order_number: Line | None = Field(default=None, description="order or project number")
    laboratory: Line | None = Field(default=None, description="laboratory that performs the test")
    description: Line | None = Field(default=None, description="type or part number of the specimen")
    operator: Line | None = Field(default=None, description="person who performs the test")
    conditions: Passage | None = Field(
        default=None, description="test conditions that the rig does not record, such as preconditioning"
    )
    approved_by: Line | None = Field(
        default=None, description="person who approves the report; the report contains a signature line for this person"
    )
    logo: FileName | None = Field(
        default=None, description="PNG or SVG image of at most 1 MB, relative to the folder of this file",
        examples=["logo.png"],
    )

    _picture: Picture | None = PrivateAttr(default=None)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; the logo is read here."""
        if self.logo is None:
            return
        try:
            self._picture = picture_of(read_bytes(Path(self.logo), MOST_BYTES))
        except FileProblem as error:
            yield from ((("logo",), f"{Path(self.logo).name}: {problem}") for problem in error.problems)
        except ValueError as error:
            yield ("logo",), f"{Path(self.logo).name}: {error}"

    @property
    def picture(self) -> Picture | None:
        """The logo; None without one."""
        return self._picture


class DetailsFile(Section):
    """A file with `[report]`, `[display]` or both, for `rig report --details` and `rig import --details`."""

    report: ReportTable | None = None
    display: DisplayTable = Field(default_factory=DisplayTable)


def load_details(path: Path) -> DetailsFile:
    """The `[report]` and `[display]` tables of a file that contains nothing else.

    Raises:
        FileProblem: with every wrong entry of the file.
    """
    return load_section(path, DetailsFile, located=with_paths)[0]
