"""Everything that a running campaign uses, in one value."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.endurance import EnduranceBook
from rig.campaign.manual_current import ManualCurrent
from rig.campaign.point_results import PointResults
from rig.campaign.results import Display
from rig.campaign.resume import Stock
from rig.campaign_folder import CampaignFolder
from rig.matrix.model import Matrix
from rig.matrix.plan import Plan
from rig.recording.journal.campaign_log import CampaignLog
from rig.station.client import StationClient


@dataclass
class CampaignContext:
    """What one campaign works with.

    Attributes:
        folder: the campaign's directory.
        bench: the rig.
        matrix: the test matrix.
        plan: the accepted plan.
        point_ids: of all its points.
        config: what the station was told.
        client: the station.
        log: the campaign's journal.
        display: what the operator sees.
        simulated: no real damper is tested.
        stock: what is kept of earlier sessions, and what remains to be run.
        results: where results are entered.
        endurance: counts the cycles of endurance tests.
        identities: what the devices said about themselves at connect.
        channels: the origin of each channel, as the drivers stated it at connect.
        hand: who sets the current by hand; None where a device drives it.
        at_rest: what the instruments may differ by, and what was seen of them before the first motion, by attribute
            of `/entry/quality`.
    """

    folder: Path
    bench: Bench
    matrix: Matrix
    plan: Plan
    point_ids: tuple[str, ...]
    config: StationConfig
    client: StationClient
    log: CampaignLog
    display: Display
    simulated: bool
    stock: Stock
    results: PointResults
    endurance: EnduranceBook
    identities: dict[str, Any] = field(default_factory=dict)
    channels: dict[str, dict[str, str]] = field(default_factory=dict)
    at_rest: dict[str, float] = field(default_factory=dict)
    hand: ManualCurrent | None = None

    @property
    def files(self) -> CampaignFolder:
        """The files of the campaign's directory."""
        return CampaignFolder(self.folder)
