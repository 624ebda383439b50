"""The corrections that a fit may take into account besides its model, as data: a new one is a module and a line here.

A correction is a module with the functions of `rig.identification.fit_state.Stages`. Nothing is loaded of one before it
is made; `rig identify --help` reads its options from here.
"""

from __future__ import annotations

from dataclasses import dataclass

from rig.matrix.methods import TEMPERATURE_LAWS


@dataclass(frozen=True)
class Correction:
    """One correction.

    Attributes:
        name: keyword of `identify`; with hyphens the option of `rig identify`.
        home: module of its stages.
        about: help of the option.
        choices: what may be requested, first what requests nothing; (False, True) for a switch; empty: always made.
    """

    name: str
    home: str
    about: str = ""
    choices: tuple[str | bool, ...] = (False, True)


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
SETTINGS = {one.name: one.choices[0] for one in CORRECTIONS if one.choices}
"""Corrections that can be requested, and the setting that requests nothing."""
