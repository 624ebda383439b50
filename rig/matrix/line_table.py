"""`[line]` of a matrix file: which serial numbers a production line accepts. Nothing that is measured depends on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from protocols.descriptions import Problem
from protocols.patterns import Pattern, PatternError
from rig.files.section import Section
from rig.matrix.report_table import FileName

LONGEST_PATTERN = 200
Retest = Literal["explicit", "next-day", "free"]


class LineTable(Section):
    """Serial numbers of a line, and the specimens that a simulated rig emulates."""

    serial: str | None = Field(
        default=None, min_length=1, max_length=LONGEST_PATTERN, examples=["MR-[0-9]{3}"],
        description="regular expression that the whole serial number must match",
    )
    retest: Retest = Field(
        default="explicit",
        description="when a specimen that already has a verdict is tested again: only if the operator requests it "
            "(explicit), also on a later day (next-day), or always (free)",
    )
    simulated: FileName | None = Field(
        default=None, description="specimens file for a simulated rig, relative to the folder of this file",
        examples=["line-specimens.toml"],
    )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if self.serial is None:
            return
        try:
            Pattern(self.serial)
        except PatternError as error:
            yield ("serial",), f"not a valid regular expression: {error}"

    def problem_with(self, serial_number: str) -> str:
        """Why a serial number is not one of this line; empty if it is."""
        if self.serial is None or Pattern(self.serial).fullmatch(serial_number):
            return ""
        return f"does not match [line] serial = {self.serial!r} in the matrix file"
