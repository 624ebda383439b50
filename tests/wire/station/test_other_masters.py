"""Somebody else at the controller of a running rig: another client's stop, and another host that wants the rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.connection import ActuatorConnection
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.map_file import controller
from drivers.roles import Command
from rig.station.client import StationClient, StationRefused

Make = Callable[..., Any]
SAME_PID = "import os\nos.getpid = lambda: 42\n"
"""Containers number their processes alike."""


@pytest.mark.few(1)
@pytest.mark.parametrize("command", [Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF])
def test_another_clients_stop_is_not_taken_for_the_end_of_the_program(station_rig: Make, command: Command) -> None:
    rig = station_rig()
    rig.prepare()
    rig.run()
    rig.await_motion(0.008)
    other = ModbusActuator(ActuatorConnection(rig.config.actuator.url, owner_id=0x7777), controller("demo"))

    def stop_it() -> None:
        other.open()
        try:
            other.send(command)
        finally:
            other.close()

    rig.inside(stop_it)
    trip = rig.event("trip")
    assert (trip["slug"], trip["stop"]) == ("second-master", "S2")
    assert command.name in trip["detail"]
    rig.event("safe")


@pytest.mark.nightly
@pytest.mark.wire
def test_of_two_hosts_with_equal_process_numbers_the_second_is_refused_and_the_first_goes_on(
    wired_station_rig: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(SAME_PID, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    # Two connections to each sensor's socket would take samples from each other: the second has sensors of its own rig.
    first, spare = wired_station_rig(), wired_station_rig()
    config = spare.config.__class__(**vars(spare.config) | {
        "actuator": first.config.actuator, "ring_path": str(tmp_path / "ring"),
    })
    second = StationClient.start(config, tmp_path / "second")
    assert first.client.ready["pid"] == second.ready["pid"] == 42
    try:
        spare.client.close()
        first.prepare()
        first.run()
        first.await_motion(0.008)
        second.request("connect")
        with pytest.raises(StationRefused, match="two-instances"):
            second.request("arm")
        first.await_motion(0.008)
        first.seen += first.client.events()
        assert not [event for event in first.seen if event["event"] == "trip"]
        assert "second-master" in [event.get("slug") for event in first.seen], "its operator is told of the other"
    finally:
        second.close()
