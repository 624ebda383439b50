"""A reference that is no model, as a value of the fit beside which it stands."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """What stands beside the models compared and is none.

    Attributes:
        name: `mean_cycle` or `regression`.
        holdout_nrmse_percent_of_peak: its error on tests it has not seen, scored as the models' are; None if unknown.
        nrmse_percent_of_peak: its error on the fitted tests; None if unknown.
        reason: why something is unknown; empty otherwise.
        within_nrmse_percent_of_peak: of `holdout_nrmse_percent_of_peak` the mean over those tests that lie within the
            data; None if none does, or unknown.
    """

    name: str
    holdout_nrmse_percent_of_peak: float | None
    nrmse_percent_of_peak: float | None
    reason: str = ""
    within_nrmse_percent_of_peak: float | None = None
