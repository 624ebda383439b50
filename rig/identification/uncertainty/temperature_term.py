"""How a fitted damper follows its temperature, as a value of the fit; the rates are among its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TemperatureTerm:
    """A fit's temperature law.

    Attributes:
        law: which (`rig.dampers.temperature_law.RATES`).
        reference_degC: temperature (degC) at which the other parameters hold.
        lowest_degC: lowest recorded temperature of the fitted tests.
        highest_degC: highest.
    """

    law: str
    reference_degC: float
    lowest_degC: float
    highest_degC: float

    @classmethod
    def from_json(cls, entry: Mapping[str, Any] | None) -> TemperatureTerm | None:
        """The inverse of `vars`; None where there is none.

        Raises:
            KeyError, TypeError, ValueError: the entry is not what a fit writes.
        """
        if entry is None:
            return None
        ends = (float(entry[name]) for name in ("reference_degC", "lowest_degC", "highest_degC"))
        return cls(str(entry["law"]), *ends)
