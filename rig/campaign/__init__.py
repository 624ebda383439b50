"""The campaign: the order of events and the reaction to failures.

`run_campaign` is the entry point. `sequencer` is a pure state machine: state and event in, state and actions
out; `execution` feeds it with reports of the rig and executes its actions; `preflight` evaluates rig and damper before
they are moved. Further modules: directory, locks, resuming, the process of the simulated rig, messages. Ports, wire
formats and file formats do not belong here: the station owns the first two, `rig.recording` the last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rig.campaign.results import CampaignOptions, CampaignResult, Display, PointResult

if TYPE_CHECKING:
    from rig.campaign.campaign import run_campaign

__all__ = ["CampaignOptions", "CampaignResult", "Display", "PointResult", "run_campaign"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any name of the package
    """`run_campaign`, loaded when it is used: it needs Linux, and the analysis uses other modules of this package.

    Raises:
        AttributeError: any other name.
    """
    if name == "run_campaign":
        from rig.campaign.campaign import run_campaign

        return run_campaign
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
