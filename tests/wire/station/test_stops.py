"""The station on the simulated rig: what stops the rig, and what the rig's physics did then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.connection import ActuatorConnection
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.map_file import controller
from drivers.roles import FaultBit
from rig.station.client import StationLost, StationRefused

Make = Callable[..., Any]
FAR_M = 0.008
FADE_S = 0.5
HALT_S = 0.3


def moved(rig: Any) -> None:  # noqa: ANN401 - whatever the fixture makes
    """Wait until the program has really moved the rod."""
    rig.prepare()
    rig.run()
    rig.await_motion(FAR_M)


@pytest.mark.parametrize("made", ["station_rig", pytest.param("wired_station_rig", marks=pytest.mark.wire)])
def test_stop_s2_takes_current_away_fades_out_and_holds_powered(made: str, request: pytest.FixtureRequest) -> None:
    rig = request.getfixturevalue(made)()
    moved(rig)
    answer = rig.client.request("stop", timeout_s=30, kind="S2", reason="sigint")
    assert answer["standstill"]
    assert answer["state"] == "HOLD"
    assert abs(answer["current_A"]) < 0.05
    assert rig.event("trip")["slug"] == "sigint"
    safe = rig.event("safe")
    assert safe["stopped_s"] >= FADE_S * 0.5
    truth = rig.truth()
    assert np.ptp(truth.displacement_m) > 0.015
    assert truth.at_rest(0.1)
    assert abs(truth.current_A[-1]) < 0.05


def test_nothing_moves_after_a_stop_until_reset_and_then_it_moves_again(station_rig: Make) -> None:
    rig = station_rig()
    with pytest.raises(StationRefused, match="not-connected"):
        rig.client.request("move", target_m=0.0, speed_m_s=0.05)
    rig.client.request("connect")
    with pytest.raises(StationRefused, match="not-armed"):
        rig.client.request("move", target_m=0.0, speed_m_s=0.05)
    rig.client.request("arm")
    rig.client.request("hydraulics", level="low")
    rig.client.request("hydraulics", level="on")
    rig.run()
    rig.client.request("stop", timeout_s=30, kind="S2", reason="sigint")
    for do, arguments in (
        ("move", {"target_m": 0.0, "speed_m_s": 0.05}),
        ("set_current", {"current_A": 1.0}),
        ("hydraulics", {"level": "on"}),
        ("arm", {}),
    ):
        with pytest.raises(StationRefused, match="tripped"):
            rig.client.request(do, **arguments)
    rig.client.request("reset")
    rig.client.request("arm")
    assert rig.client.request("move", target_m=0.005, speed_m_s=0.05)["state"] in {"MOVING", "HOLD"}
    assert rig.client.request("status")["trip"] is None


def test_stop_s1_ends_with_hydraulics_off(station_rig: Make) -> None:
    rig = station_rig()
    moved(rig)
    answer = rig.client.request("stop", timeout_s=30, kind="S1", reason="sigterm")
    assert answer["state"] == "OFF"
    steps = [event["step"] for event in rig.client.events() if event["event"] == "stop"]
    assert steps == ["lowering", "off"]


def test_force_beyond_its_limit_halts_the_rod_at_once(station_rig: Make) -> None:
    rig = station_rig(limits=lambda usual: replace(usual, force_N=400.0))
    rig.prepare()
    rig.run()
    trip = rig.event("trip")
    assert trip["slug"] == "force-limit"
    assert rig.event("safe")["standstill"]
    truth = rig.truth()
    assert truth.still_after("HALT", HALT_S)
    assert np.ptp(truth.displacement_m) < 0.018


@pytest.mark.nightly
def test_application_that_falls_silent_stops_the_rig_within_its_timeout(station_rig: Make) -> None:
    rig = station_rig()
    moved(rig)
    silent_ns = rig.stop_beating()
    trip = rig.event("trip")
    assert trip["slug"] == "host-stalled"
    silent_s = (trip["latched_ns"] - silent_ns) / 1e9
    assert rig.config.heartbeat_timeout_s * 0.8 < silent_s < rig.config.heartbeat_timeout_s + 0.05
    assert rig.event("safe")["standstill"]
    assert rig.truth().at_rest(0.1)


@pytest.mark.nightly
def test_unwell_recorder_stops_the_rig(station_rig: Make) -> None:
    rig = station_rig()
    moved(rig)
    rig.stop_beating()
    rig.client.beat(False)
    assert rig.event("trip")["slug"] == "recorder-unwell"
    assert rig.event("safe")["standstill"]


def test_end_of_the_applications_link_stops_the_rig_switches_hydraulics_off_and_ends_the_station(
    station_rig: Make,
) -> None:
    rig = station_rig()
    moved(rig)
    rig.stop_beating()
    assert rig.client.close(timeout_s=20.0) == 0
    with pytest.raises(StationLost):
        rig.client.request("status")
    assert rig.event("trip")["slug"] == "sigkill"
    assert rig.event("safe")["state"] in {"OFF", "HOLD"}
    truth = rig.truth()
    assert truth.at_rest(0.05)
    assert abs(truth.current_A[-1]) < 0.05


def test_killed_station_leaves_controller_and_ecu_to_stop_by_themselves(station_rig: Make) -> None:
    rig = station_rig()
    moved(rig)
    rig.kill_station()
    assert not rig.client.alive
    rig.client.close(timeout_s=1.0)
    rig.wait(rig.config.actuator.watchdog_s + FADE_S + 0.2)
    witness = ModbusActuator(ActuatorConnection(rig.config.actuator.url, timeout_s=1.0), controller("demo"))
    rig.inside(witness.open)
    status = rig.inside(witness.read_status)
    assert status.fault_bits == FaultBit.WATCHDOG
    assert abs(status.velocity_m_s) < 1e-3
    rig.inside(witness.close)
    rig.wait(0.5)
    truth = rig.truth()
    assert truth.at_rest(0.3)
    assert abs(truth.current_A[-1]) < 0.05


@pytest.mark.nightly
def test_watchdog_is_proved_by_starving_it_and_works_on_afterwards(station_rig: Make) -> None:
    rig = station_rig()
    rig.client.request("connect")
    rig.client.request("arm")
    answer = rig.client.request("starve_watchdog")
    watchdog_s = rig.config.actuator.watchdog_s
    assert 0.8 * watchdog_s < answer["tripped_after_s"] < 2.0 * watchdog_s + 1.0
    rig.client.request("hydraulics", level="low")
    assert rig.client.request("status")["trip"] is None


def test_absent_watchdog_is_refused(station_rig: Make) -> None:
    rig = station_rig("--fault", "watchdog-absent")
    rig.client.request("connect")
    rig.client.request("arm")
    with pytest.raises(StationRefused, match="watchdog-absent"):
        rig.client.request("starve_watchdog")


@pytest.mark.parametrize(
    ("fault", "slug", "stop"),
    [
        ("coil-open-short", "coil-open-short", "S2"),
        ("ecu-silent", "ecu-silent", "S2"),
        ("lvdt-pulled", "lvdt-pulled", "S2"),
        ("actuator-frozen", "actuator-frozen", "SO"),
        ("modbus-halfopen", "modbus-halfopen", "S2"),
        ("estop", "estop", "S1"),
    ],
)
def test_fault_trips_by_its_name_and_the_rod_comes_to_rest(station_rig: Make, fault: str, slug: str, stop: str) -> None:
    rig = station_rig("--fault", f"{fault}@0.7")
    rig.prepare()
    rig.run()
    trip = rig.event("trip")
    assert (trip["slug"], trip["stop"]) == (slug, stop)
    assert rig.event("safe")["standstill"]
    truth = rig.truth()
    assert truth.at_rest(0.05)
    assert abs(truth.current_A[-1]) < 0.05


@pytest.mark.nightly
def test_a_coil_whose_temperature_is_not_reported_any_more_stops_the_rig(station_rig: Make) -> None:
    rig = station_rig("--option", "coil.temperatures_until_s=12", speed=2.0)
    rig.client.request("connect")
    rig.client.request("arm")
    trip = rig.event("trip")
    assert (trip["slug"], trip["stop"]) == ("ecu-silent", "S2")
    assert "no coil temperature" in trip["detail"]
    assert rig.event("safe")["current_zero"]


@pytest.mark.nightly
def test_an_lvdt_that_sends_no_number_any_more_is_as_good_as_pulled(station_rig: Make) -> None:
    rig = station_rig("--option", "lvdt.numbers_until_s=25", speed=2.0)
    rig.prepare()
    rig.run()
    trip = rig.event("trip")
    assert (trip["slug"], trip["stop"]) == ("lvdt-pulled", "S2")
    assert rig.event("safe")["position_m"] is None, "standstill was proved by the controller"
    truth = rig.truth()
    assert truth.at_rest(0.05)
    assert abs(truth.current_A[-1]) < 0.05


def test_an_ecu_that_never_tells_the_coils_temperature_is_refused_at_connect(station_rig: Make) -> None:
    rig = station_rig("--option", "coil.temperatures_until_s=0")
    with pytest.raises(StationRefused, match="ecu: no valid temperature frames within 3 s"):
        rig.client.request("connect")


def test_fast_rig_stops_like_a_slow_one(station_rig: Make) -> None:
    rig = station_rig(speed=20.0)
    rig.prepare()
    rig.run()
    answer = rig.client.request("stop", timeout_s=30, kind="S2", reason="sigint")
    assert answer["standstill"]
    rig.client.request("reset")
    rig.client.request("arm")
    rig.client.request("disarm")
    assert rig.client.request("status")["state"] == "OFF"
