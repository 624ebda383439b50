"""What the bench file allows two of its instruments to differ by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any


@dataclass(frozen=True)
class Tolerances:
    """By how much two instruments of the bench may differ before one of them is doubted (bench `[checks]`).

    Attributes:
        force_gain, displacement_gain: relative difference of sensitivity.
        force_zero_N, displacement_zero_m: difference at zero.
        force_zero_change_N: how much that may change over a campaign.
        time_s: how much later an input may be than the declared delays say.
        current_zero_A: what the ECU may report while its output stage is off.
        coil_temperature_K: by how much the coil may seem colder than the ECU before anything was warmed.
    """

    force_gain: float = 0.02
    displacement_gain: float = 0.01
    force_zero_N: float = 25.0
    force_zero_change_N: float = 10.0
    displacement_zero_m: float = 0.5e-3
    time_s: float = 0.5e-3
    current_zero_A: float = 0.02
    coil_temperature_K: float = 10.0

    @classmethod
    def stored(cls, quality: Mapping[str, Any]) -> Tolerances:
        """Those that a point's file was judged by; the usual ones where it says nothing."""
        known = {each.name: quality.get(f"tolerance_{each.name}") for each in fields(cls)}
        return cls(**{name: float(value) for name, value in known.items() if isinstance(value, (int, float))})

    @property
    def attributes(self) -> dict[str, float]:
        """What `/entry/quality` holds of them."""
        return {f"tolerance_{each.name}": float(getattr(self, each.name)) for each in fields(self)}
