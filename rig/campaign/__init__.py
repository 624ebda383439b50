"""The campaign: what happens in which order, and what happens when it does not.

`run_campaign` is the door. `sequencer` decides, pure: state and event in, state and actions out; `execution` feeds it
with what the rig reports and carries out its actions; `preflight` judges what rig and damper show before they are
moved. Beside them: directory, locks, resuming, the simulated rig's process, the words. Ports, wire formats and file
formats may not live here: the station owns the first two, `rig.recording` the last.
"""

from rig.campaign.campaign import run_campaign
from rig.campaign.results import CampaignOptions, CampaignResult, Display, PointResult

__all__ = ["CampaignOptions", "CampaignResult", "Display", "PointResult", "run_campaign"]
