"""Exit code 4 is said only where standstill, 0 A and what the stop promised of the pressure are proved; 7 otherwise.

Controllers of others, of their own bytes: one that takes the order to switch off and keeps its power, and ones that
trip by themselves and show behind their trip whether they have power.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from other_controllers import DeltaRmc, FloatDrive, OtherController
from preset_campaign import begun
from scenario_campaign import SEED, ScenarioCampaign

from drivers.roles import Command, FaultBit
from simulators.scenarios.stage import Stage


class StaysOn(FloatDrive):
    """Takes the order to switch off, and keeps its power."""

    def order(self, command: Command) -> None:
        if command is not Command.HYDRAULICS_OFF:
            super().order(command)


class SaysSo(FloatDrive):
    """Has a code of its own for a trip without power."""

    def shown(self) -> dict[int, int]:
        shown = super().shown()
        return shown | ({2: 4} if shown[2] == 3 and self.pressure == 0 else {})


def streamed(campaign: ScenarioCampaign) -> None:
    """A point's motion of set-points runs."""
    journal = campaign.folder / "journal.jsonl"
    campaign.until(lambda: '"event": "point"' in journal.read_text("utf-8"), "the first point")
    campaign.run_on(0.8)


def trips(campaign: ScenarioCampaign) -> None:
    """The controller trips by itself."""
    streamed(campaign)
    plant = campaign.stage.rig.plant
    plant.state["fault_bits"] = int(FaultBit.FOLLOWING_ERROR)
    plant.state["tripped"] = 1
    campaign.stage.rig.actuator.order_limits()


def interrupted(campaign: ScenarioCampaign) -> None:
    """Ctrl-C."""
    streamed(campaign)
    campaign.send(signal.SIGINT)


def nothing(_: ScenarioCampaign) -> None:
    """The devices' own fault is enough."""


@pytest.mark.nightly
@pytest.mark.apart
@pytest.mark.parametrize(
    ("name", "controller", "fault", "around", "code"),
    [
        ("float-drive", StaysOn, "loadcell-pulled@0.4", nothing, 7),
        ("float-drive", StaysOn, "", interrupted, 7),
        ("float-drive", StaysOn, "", trips, 7),
        ("float-drive", FloatDrive, "", trips, 7),
        ("float-drive", SaysSo, "", trips, 4),
        ("delta-rmc", DeltaRmc, "", trips, 4),
    ],
)
def test_a_pressure_that_is_not_proved_off_is_no_safe_end(
    name: str, controller: type[OtherController], fault: str, around: Callable[[ScenarioCampaign], None], code: int,
    tmp_path: Path,
) -> None:
    with Stage(SEED, tmp_path) as stage:
        campaign = begun(stage, tmp_path, name, controller, *(("--fault", fault) if fault else ()))
        around(campaign)
        ending = campaign.finish()
        on = bool(stage.rig.plant.command["pressure"][0])
    stop = ending.answer["stop"]
    assert (ending.exit_code, ending.answer["rig_state"]) == (code, "safe" if code == 4 else "unknown"), ending.output
    assert on is issubclass(controller, StaysOn)
    assert stop["proved"]
    assert stop["pressure_off"] is (code == 4)
    if code == 7:
        unsaid = name == "float-drive" and around is trips
        assert ("HYDRAULICS NOT CONFIRMED OFF" if unsaid else "HYDRAULICS STILL ON") in stop["stands"]
        assert "hydraulics off could not be confirmed" in ending.output
        assert "Inspect" in ending.output
