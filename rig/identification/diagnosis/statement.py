"""What is diagnosed, and what a statement of the diagnosis is: its slug and its words in one declaration.

A statement that follows from the tests alone is declared in `plausibility` with the function that finds it
(`FROM_TESTS`), one that a fit with its cause shows in `trials` (`FROM_FITS`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rig.dampers.model import DamperModel
from rig.fits.entries import Cause
from rig.identification.models.measurement import Measurement
from rig.identification.models.projection import Weighting
from rig.identification.remarks import UNTRIED, Remark, filled


@dataclass(frozen=True)
class Fitted:
    """What is diagnosed: a model, its values (SI), the names of those that were fitted, its tests and their weights.

    `untried` begins the advice where another model may do better (`words.UNTRIED`); empty where all were compared.
    """

    model: DamperModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    tests: Sequence[Measurement]
    weighting: Weighting
    untried: str = UNTRIED


@dataclass(frozen=True, eq=False)
class Statement:
    """One statement of the diagnosis.

    Attributes:
        slug: of the cause; `rig/explanations/diagnosis.toml` explains it.
        text: what was found; numbers in braces.
        next: what to measure or correct; numbers in braces.
        seen: whether it is visible in the tests themselves, so that the report shows no share of the misfit.
        parts: further texts by name: instead of `text`, or filled into it.
    """

    slug: str
    text: str
    next: str
    seen: bool = False
    parts: Mapping[str, str] = field(default_factory=dict)

    def say(self, part: str = "", **numbers: object) -> Remark:
        """The text, or one of `parts`, with its numbers.

        Raises:
            KeyError: there is no such part, or one of its numbers is missing.
        """
        template = self.parts[part] if part else self.text
        return filled(f"{self.slug}-{part}" if part else self.slug, template, numbers)

    def cause(self, explains: float, part: str = "", **numbers: object) -> Cause:
        """The statement as an entry of the fit.

        Args:
            explains: share of the misfit (0 to 1).
            part: of `parts`, instead of `text`.
            **numbers: of the text and of `next`.

        Raises:
            KeyError: as `say`.
        """
        text = self.say(part, **numbers)
        return Cause(self.slug, text, explains, filled(f"next-{self.slug}", self.next, numbers))
