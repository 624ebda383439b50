"""The campaign: the order of events and the reaction to failures.

`run_campaign` is the entry point. `sequencer` is a pure state machine: state and event in, state and actions out;
`execution` feeds it with reports of the rig and executes its actions; `preflight` evaluates rig and damper before they
are moved. Further modules: directory, locks, resuming, the process of the simulated rig, messages. Ports, wire formats
and file formats do not belong here: the station owns the first two, `rig.recording` the last.
"""

from rig.campaign.campaign import run_campaign
from rig.campaign.results import CampaignOptions, CampaignResult, Display, PointResult

__all__ = ["CampaignOptions", "CampaignResult", "Display", "PointResult", "run_campaign"]
