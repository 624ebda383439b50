"""What follows a stop: an automatic restart where row and matrix file allow it, and campaigns resumed by hand."""

from __future__ import annotations

import json
import signal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import pytest
from end_states import assert_stopped
from watched_campaign import FINISH_S, resumed, wait_until

if TYPE_CHECKING:
    from conftest import BeginScenario, Run, Start
    from watched_campaign import Campaign, Ending


POINTS = """
format = 1
[specimen]
serial_number = "MR-007"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0.5 A", "1.5 A"]
cycles = 6
[identify]
enabled = false
[campaign]
retries = 1
"""


def restarted(ending: Ending, slug: str) -> None:
    """Stopped once for this cause, reset, every proof made again, and the point repeated beside its broken attempt."""
    assert ending.exit_code == 0, ending.output
    assert ending.trips() == [(slug, "S2")]
    assert ending.verdicts() == {"p001": "valid", "p002": "valid"}
    broken = ending.point("p002")
    assert broken.verdict == "invalid"
    assert broken.reasons[0].startswith(slug)
    files = {each["id"]: Path(each["file"]).name for each in ending.answer["points"]}
    assert files == {"p001": "p001.h5", "p002": "p002-attempt2.h5"}
    truth = ending.truth
    stop = truth.first("FADE_STOP")
    order = [each.code for each in truth.all("RESET", "TRIP", "HYDRAULICS_ON", "MOVE_TO", "START", after=stop)]
    assert order[: order.index("START")].count("TRIP") == 1, "the watchdog was starved again"
    assert order.index("TRIP") < order.index("HYDRAULICS_ON") < order.index("MOVE_TO") < order.index("START")
    assert len(truth.all("START")) == 3


@pytest.mark.few(1)
@pytest.mark.parametrize("fault", ["ecu-crc@6.3+0.5", "serial-garbage@6.3+0.8"])
def test_a_fault_that_passes_repeats_the_point_after_every_proof_was_made_again(run: Run, fault: str) -> None:
    restarted(run(fault, matrix=POINTS), fault.partition("@")[0])


@pytest.mark.nightly
def test_a_hot_ecu_is_left_to_cool_down_before_the_point_is_repeated(run: Run) -> None:
    ending = run("ecu-overtemp@6.3+36", matrix=POINTS)
    restarted(ending, "ecu-overtemp")
    truth = ending.truth
    cooled, again = truth.first("FAULT_ENDS"), truth.all("START")[2]
    assert cooled.time_s < again.time_s
    waits = [line for line in ending.log if "cool down" in str(line.get("text"))]
    assert len(waits) >= 2, "once was not enough: the ECU kept its fault"


@pytest.mark.few(1)
@pytest.mark.parametrize("slug", ["ecu-silent", "serial-garbage"])
def test_a_fault_that_stays_is_not_restarted_into(run: Run, slug: str) -> None:
    ending = run(f"{slug}@6.3", matrix=POINTS)
    assert_stopped(ending, slug)
    assert len(ending.truth.all("START")) == 2


@pytest.mark.nightly
def test_a_row_that_wants_the_operator_is_never_restarted_by_itself(run: Run) -> None:
    ending = run("can-foreign@6.3+0.3", matrix=POINTS)
    assert_stopped(ending, "can-foreign")
    assert len(ending.truth.all("START")) == 2


@pytest.mark.nightly
def test_ctrl_c_during_an_automatic_stop_ends_the_campaign(begin_scenario: BeginScenario) -> None:
    campaign = begin_scenario(simulator=("--fault", "ecu-crc@6.3+0.5"), matrix=POINTS, speed=2.0)
    campaign.wait_for("FADE_STOP")
    campaign.send(signal.SIGINT)
    ending = campaign.finish()
    assert (ending.exit_code, ending.answer["stopped_by"]) == (4, "ecu-crc")
    assert len(ending.truth.all("START")) == 2


# By hand


STARVED = frozenset({
    "modbus-halfopen", "loadcell-pulled", "lvdt-pulled", "ecu-silent", "host-stalled", "host-late",
})
"""What stops a rig whose simulated devices, or whose station, a busy machine keeps from running for half a second."""
TRIES = 3


def stopped_in_point_2(start: Start) -> Campaign:
    """A campaign that a SIGTERM has stopped in its second point; one that starved before that is begun again."""
    for _ in range(TRIES):
        campaign = start(matrix=POINTS)
        wait_until(
            partial(lambda begun: begun.process.poll() is not None or begun.happened("START", count=2), campaign),
            "the second point",
        )
        if campaign.process.poll() is None:
            campaign.process.send_signal(signal.SIGTERM)
            assert campaign.finish().exit_code == 4
            return campaign
        ending = campaign.finish()
        assert ending.answer["stopped_by"] in STARVED, ending.output
    raise AssertionError(f"starved {TRIES} times")


def resumed_unstarved(folder: Path, *arguments: str) -> tuple[int, dict[str, Any]]:
    """`resumed`, and again where the machine let the rig starve: that is what resuming is for."""
    for _ in range(TRIES):
        code, answer = resumed(folder, *arguments)
        if code != 4 or answer["stopped_by"] not in STARVED:
            break
    return code, answer


@pytest.mark.nightly
@pytest.mark.wire
def test_a_resumed_simulated_campaign_has_its_specimen_and_seed_and_equals_an_undisturbed_one(
    start: Start, run: Run
) -> None:
    folder = stopped_in_point_2(start).folder
    code, answer = resumed_unstarved(folder, "--simulate", "--", "--option", "damper.start_degC=60")
    assert (code, answer["stopped_by"]) == (3, "temperature-window")
    assert "let it cool down" in answer["error"]
    kept = (folder / "points" / "p001.h5").read_bytes()
    code, answer = resumed_unstarved(folder, "--simulate")
    undisturbed = run(matrix=POINTS)
    assert (code, undisturbed.exit_code) == (0, 0)
    for key in ("id", "verdict", "current_A", "lost_samples"):
        assert [each[key] for each in answer["points"]] == [each[key] for each in undisturbed.answer["points"]]
    assert (folder / "points" / "p001.h5").read_bytes() == kept
    with h5py.File(folder / "truth.h5") as file:
        assert file["entry/test"].attrs["specimen"] in {"MR-007", b"MR-007"}
        assert file["entry/provenance"].attrs["seed"] == 1


@pytest.mark.nightly
@pytest.mark.wire
def test_a_campaign_killed_before_its_rig_was_known_is_resumed_whole(start: Start) -> None:
    campaign = start(matrix=POINTS)
    description = campaign.folder / "campaign.json"
    while not (description.exists() and json.loads(description.read_text(encoding="utf-8"))["hash"] == ""):
        assert campaign.process.poll() is None
    campaign.process.send_signal(signal.SIGKILL)
    campaign.process.communicate(timeout=FINISH_S)
    assert not list((campaign.folder / "points").iterdir())
    code, answer = resumed(campaign.folder)
    assert code == 0, answer
    assert [each["verdict"] for each in answer["points"]] == ["valid", "valid"]
