"""The campaign: what happens in which order, and what happens when it does not.

Here live the sequencer (pure: state and event in, state and actions out), the runner that feeds it with what the rig
reports and carries out its actions, the set-up of a campaign's directory, and the start of a simulated rig. Ports, wire
formats and file formats may not live here: the station owns the first two, `rig.recording` the last.
"""

from rig.campaign.campaign import run_campaign
from rig.campaign.results import CampaignOptions, CampaignResult, Display, PointResult

__all__ = ["CampaignOptions", "CampaignResult", "Display", "PointResult", "run_campaign"]
