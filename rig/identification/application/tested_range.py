"""What the tests covered: what makes a prediction one, and not a guess."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rig.dampers.arrays import BoolArray
from rig.dampers.covered import Ends
from rig.fits.entries import TestedRange
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.models.coverage import covered_by
from rig.identification.models.measurement import Measurement
from rig.identification.models.undetermined import only_at

UNKNOWN = "tested range unknown"


def beyond_tested(tested: TestedRange, motion: Motion) -> dict[str, BoolArray]:
    """Quantity -> which samples lie beyond what was tested, shape (n,); only those with such samples."""
    return tested.outside({
        "displacement_m": motion.u_m, "velocity_m_s": motion.v_m_s, "current_A": motion.current_A,
        "temperature_degC": motion.temperature_degC,
    })  # fmt: skip


def tested_range(law: Law, fitted: Sequence[Measurement], temperature_degC: Ends | None) -> TestedRange:
    """What tests covered; the band is not known yet.

    Args:
        law: the fitted model.
        fitted: tests it was fitted to.
        temperature_degC: lowest and highest recorded; None where nothing was.
    """
    levels = only_at(law.model, fitted) if law.current is None else ()
    covered = replace(covered_by(fitted), temperature_degC=temperature_degC, only_at_A=levels)
    return TestedRange(**vars(covered))
