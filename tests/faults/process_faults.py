"""Faults put around the processes of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from watched_campaign import Campaign, Ending



def signalled(campaign: Campaign, number: int) -> Ending:
    """Send the application a signal and wait for the end."""
    sent_ns = campaign.now_ns
    campaign.send(number)
    return campaign.finish(sent_ns)
