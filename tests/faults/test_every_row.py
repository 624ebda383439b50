"""Every row of the fault matrix in a world of its own, at speed 1 and with the time limits of hardware.

Most worlds are copies of one that stands where the first point begins: up to there they are the same.

Asserted by the row's reaction. A stop: exit code 4, the row named as the one latched cause, the rig "safe", the first
stop command within the row's time, in truth 0 A and standstill within their times and no pressure in the end, the
point invalid by that name. A warning or a spoiled point: exit code 0 or 5, the flag, no stop. A refusal: exit code,
slug, nothing moved. What a row has beside or instead of that stands in `row_scenarios.py`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import pytest
from copied_scenario import StandingCampaigns, without_faults
from end_states import assert_never_moved, assert_spoiled, assert_stopped, assert_warned_only
from row_scenarios import ONCE, PERIOD_S, RowScenario, assert_pressure_off, scenario_of, within_s

from rig.faults.matrix import MATRIX
from rig.faults.row import Ending as Reaction

if TYPE_CHECKING:
    from conftest import Start
    from scenario_campaign import ScenarioCampaign
    from watched_campaign import Ending

DEAF = frozenset({"modbus-busy", "modbus-reject", "modbus-write-lost"})
"""Rows whose controller obeys no command any more: its own watchdog ends the motion."""
TRIPS_BY_ITSELF = DEAF | {"host-silent"}
STILL_ON = DEAF | {"rtu-crc", "modbus-mismatch"}
"""Rows in which the pressure cannot be taken away by command; the operator is told."""
NOT_RIGID = {"wrong-damper": 5e-3}
"""Rows that the slow proof move finds (m)."""


@pytest.mark.apart
@pytest.mark.parametrize("slug", MATRIX)
def test_every_row_ends_as_the_matrix_says(
    slug: str, begin_scenario: Start, standing_campaigns: StandingCampaigns
) -> None:
    setting = scenario_of(slug).setting
    common = without_faults(setting)
    if common is not None and replace(common, simulator=()) == ONCE:
        standing_campaigns.judge(setting, partial(check_row, slug))
    else:
        check_row(slug, begin_scenario(setting))


def check_row(slug: str, campaign: ScenarioCampaign, scenario: RowScenario | None = None) -> None:
    """Run a row's world, or another one, to its end and judge that."""
    here = scenario or scenario_of(slug)
    fault_ns = None
    if here.around is not None:
        here.begins(campaign)
        fault_ns = campaign.now_ns
        here.around(campaign)
    ending = campaign.finish(fault_ns)
    if here.check is not None:
        here.check(campaign, ending)
    elif isinstance(MATRIX[slug].end, Reaction):
        JUDGES[MATRIX[slug].end](ending, slug)
        assert_pressure_off(campaign)
    else:
        assert_stopped_in_time(campaign, ending, slug, here)
    here.also(campaign, ending)


def assert_stopped_in_time(campaign: ScenarioCampaign, ending: Ending, slug: str, here: RowScenario) -> None:
    """The end state of a stop, within the row's own times; the running point is invalid by its name."""
    assert_stopped(
        ending, slug, finished=(), broken=None, speed=1.0, period_s=PERIOD_S, settling_s=here.settling_s,
        slug_of_station=here.named or None, allowed_s=here.allowed_s or within_s(slug),
        first="TRIP" if slug in TRIPS_BY_ITSELF else None, logged=slug != "disk-full",
    )  # fmt: skip
    if slug in STILL_ON:
        assert "HYDRAULICS STILL ON" in ending.output
    else:
        assert_pressure_off(campaign)
    (point,) = ending.answer["points"]
    assert point["verdict"] == "invalid"
    assert any(reason.startswith(here.named or slug) for reason in point["reasons"]), point["reasons"]


def assert_refused_by_name(ending: Ending, slug: str) -> None:
    """Exit code and name of the row, and nothing moved; a campaign that had its folder keeps a refusal record only."""
    assert ending.exit_code == MATRIX[slug].exit_code, ending.output
    assert (ending.answer.get("stopped_by") or ending.answer["slug"]) == slug
    assert_never_moved(ending.truth, NOT_RIGID.get(slug, 1e-6))
    if (ending.folder / "points").exists():
        assert not list((ending.folder / "points").iterdir())
        assert [line["slug"] for line in ending.log if line["event"] == "refused"] == [slug]


JUDGES = {
    Reaction.WARN: assert_warned_only,
    Reaction.INVALID: lambda ending, slug: assert_spoiled(ending, slug, points=("p001",)),
    Reaction.REFUSE: assert_refused_by_name,
}
