"""The fixtures of the pytest plug-in, on the usual simulated rig: what they run, and what they refuse to pass over."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
import pytest

from rig.errors import Refused
from simulators.testing.campaigns import EventNotReached

if TYPE_CHECKING:
    from rig.faults.row import FaultRow
    from simulators.testing.pytest_plugin import RunCampaign, RunWorld, StartRig

MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0.5 A"]
cycles = 3
[identify]
model = "bingham"
"""


def test_a_campaign_runs_to_its_end_and_says_what_really_happened(campaign: RunCampaign) -> None:
    end = campaign(matrix=MATRIX)
    assert (end.exit_code, end.slug, end.verdicts, end.reasons) == (0, "", {"p001": "valid"}, {})
    assert end.at_rest
    assert end.truth.velocity_m_s.max() == pytest.approx(0.02 * 2 * np.pi * 2.0, rel=0.02), "A times omega, by hand"
    assert [point.id for point in end.run.points] == ["p001"]
    assert end.fit.model == "bingham"
    assert end.answer["rig_state"] == "safe"


def test_a_fault_by_its_slug_ends_the_campaign_as_its_row_says(
    campaign: RunCampaign, faults: Mapping[str, FaultRow]
) -> None:
    end = campaign("estop@0.5", matrix=MATRIX)
    assert (end.exit_code, end.slug) == (faults["estop"].exit_code, "estop")
    assert end.verdicts == {"p001": "invalid"}
    assert end.reasons["p001"]
    (opened_s,) = [time_s for time_s, code, text in end.truth.log if (code, text) == ("FAULT", "estop")]
    moves = end.truth.time_s[np.abs(end.truth.velocity_m_s) > 2e-3]
    assert opened_s < moves.max() < opened_s + 0.3, "the rod stands within 300 ms"
    assert end.truth.pressure[-1] == 0.0
    assert end.at_rest


@pytest.mark.nightly
def test_a_fault_that_does_not_happen_fails_the_test(campaign: RunCampaign) -> None:
    with pytest.raises(EventNotReached, match=r"estop@90: the campaign had already ended"):
        campaign("estop@90", matrix=MATRIX)
    with pytest.raises(EventNotReached, match="'earthquake' is neither a row of the fault matrix"):
        campaign("earthquake@1", matrix=MATRIX)


def test_a_matrix_that_does_not_fit_is_refused_as_by_the_command(campaign: RunCampaign) -> None:
    with pytest.raises(Refused, match="p001"):
        campaign(matrix=MATRIX.replace('"20 mm"', '"84 mm"').replace('"2 Hz"', '"9 Hz"'))


def test_a_scenario_of_a_seed_is_evaluated_and_says_how_to_run_it_again(world: RunWorld) -> None:
    end = world(5, "sigint@6", matrix=MATRIX)
    assert end.held, end.failed
    assert end.happenings == ("sigint@6",)
    assert end.exit_codes[-1] == 0
    assert end.again.startswith("rig scenarios --seeds 5 --matrix ")


def test_a_rig_on_real_wires_answers_until_it_is_stopped(simulated_rig: StartRig) -> None:
    rig = simulated_rig("--seed", "2", usual=True)
    address = urlsplit(rig.bench.actuator.url)
    with socket.create_connection((address.hostname, address.port), timeout=5.0):
        pass
    rig.stop()
    rig.stop()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((address.hostname, address.port), timeout=5.0)
