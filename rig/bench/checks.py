"""What two instruments of the bench may differ by before one of them is doubted: section `[checks]`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rig.bench.quantity import Quantity, Section

ZERO_SHARE_OF_RANGE = 0.0025
CHANGE_OF_ZERO = 0.4
SHARE_OF_TEST = 0.02
"""Of the test's largest force: a zero that is wrong by so much is no longer small beside what is measured."""
LEAST_SHARE_OF_RANGE = 0.001
"""A controller's coarse force input is not better than that."""


class Checks(Section):
    """Load cell and LVDT against the controller's own inputs, as far as both classes of instruments allow."""

    force_gain: Annotated[float, Quantity("ratio", "0.1 %", "50 %")] = Field(
        default=0.02, description="difference of sensitivity of load cell and the controller's force input"
    )
    displacement_gain: Annotated[float, Quantity("ratio", "0.1 %", "50 %")] = Field(
        default=0.01, description="difference of sensitivity of LVDT and the controller's position input"
    )
    force_zero_N: Annotated[float, Quantity("force", "0 N", "20 kN", above=True)] | None = Field(
        default=None, alias="force_zero",
        description="difference of their zeros; not stated: 0.25 % of the load cell's range, less for a weak test",
    )
    displacement_zero_m: Annotated[float, Quantity("length", "0 mm", "100 mm", above=True)] = Field(
        default=0.5e-3, alias="displacement_zero", description="difference of the zeros of LVDT and position input"
    )
    time_s: Annotated[float, Quantity("time", "0.01 ms", "100 ms")] = Field(
        default=0.5e-3, alias="time", description="how much later an input may be than the declared delays say"
    )
    current_zero_A: Annotated[float, Quantity("current", "1 mA", "5 A")] = Field(
        default=0.02, alias="current_zero", description="what the ECU may report while its output stage is off"
    )

    def zero_N(self, range_N: float, largest_N: float | None) -> float:
        """What load cell and force input may differ by at zero (N).

        Args:
            range_N: the load cell's range.
            largest_N: the largest force the test is expected to show (N); None: unknown.
        """
        if self.force_zero_N is not None:
            return self.force_zero_N
        usual_N = ZERO_SHARE_OF_RANGE * range_N
        if largest_N is None:
            return usual_N
        return min(usual_N, max(SHARE_OF_TEST * largest_N, LEAST_SHARE_OF_RANGE * range_N))
