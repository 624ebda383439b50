"""The corrections that a fit may take into account besides its model, as data: a new one is a module and a line here.

A correction is a module with the functions of `rig.identification.fit_state.Stages`, which is loaded when it is made.
The options of `rig identify`, the keys of `[identify]` in a matrix file and the keywords of `identify` come from here.
"""

from __future__ import annotations

from dataclasses import dataclass

from rig.files.quantity import Quantity
from rig.matrix.methods import TEMPERATURE_LAWS


@dataclass(frozen=True)
class Correction:
    """One correction.

    Attributes:
        name: keyword of `identify`; with hyphens the option of `rig identify`.
        home: module of its stages.
        about: help of the option.
        choices: what may be requested, first what requests nothing; (False, True) for a switch; empty: always made.
        quantity: of a correction requested by a number: dimension, lowest and highest value. It is held in SI, and None
            requests nothing; `choices` does not matter then.
    """

    name: str
    home: str
    about: str = ""
    choices: tuple[str | bool, ...] = (False, True)
    quantity: Quantity | None = None

    @property
    def requestable(self) -> bool:
        """Whether it is made only on request."""
        return self.quantity is not None or bool(self.choices)

    @property
    def switch(self) -> bool:
        """Whether it is requested by true."""
        return self.quantity is None and self.choices == (False, True)

    @property
    def nothing(self) -> str | bool | None:
        """The setting that requests nothing."""
        return None if self.quantity is not None else self.choices[0]

    @property
    def flag(self) -> str:
        """Its option of `rig identify`."""
        return f"--{self.name.replace('_', '-')}"


CORRECTIONS = (
    Correction("series_spring", "rig.identification.series_spring", "Add a spring in series with the damper, for "
        "compliant mounts."),
    Correction("coil_lag", "rig.identification.coil_lag", choices=()),
    Correction(
        "temperature_law", "rig.identification.temperature",
        "Parameters that depend on temperature: viscosity, yield force, both with a common rate, or both with "
        "separate rates.",
        TEMPERATURE_LAWS,
    ),
)  # fmt: skip
"""In the order in which tests are corrected, and fits completed."""
SETTINGS = {one.name: one.nothing for one in CORRECTIONS if one.requestable}
"""Corrections that can be requested, and the setting that requests nothing."""
