"""A station that is held up again and again beside a rig that goes on: whom it blames, and for how long."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

Make = Callable[..., Any]


def moving(make: Make, *arguments: str) -> Any:  # noqa: ANN401 - whatever the fixture makes
    """A rig under way."""
    rig = make(*arguments)
    rig.prepare()
    rig.run()
    rig.await_motion(0.008)
    return rig


@pytest.mark.nightly
def test_half_of_what_is_allowed_thirty_times_blames_no_device_and_is_counted(station_rig: Make) -> None:
    rig, chance = moving(station_rig), random.Random(1)
    held_s = [0.5 * rig.config.late_limit_s] * 30
    for length_s in held_s:
        rig.wait(chance.uniform(0.08, 0.2))
        rig.hold(length_s)
    status = rig.client.request("status")
    assert status["trip"] is None
    rig.seen += rig.client.events()
    assert not [event for event in rig.seen if event["event"] in {"trip", "also", "warning"}]
    late = [event for event in rig.seen if event["event"] == "late"]
    assert len(late) >= len(held_s)
    assert late[-1]["total_s"] >= sum(held_s) - 0.03
    for sensor in ("load_cell", "lvdt"):
        counted = status["devices"][sensor]
        assert counted["lost"] == 0
        assert counted["late"] >= 250.0 * sum(held_s) - len(held_s)


@pytest.mark.few(1)
@pytest.mark.parametrize("factor", [1.2, 4.0])
def test_beyond_the_limit_the_station_is_the_first_cause_whatever_else_followed(
    station_rig: Make, factor: float
) -> None:
    rig = moving(station_rig)
    held_s = factor * rig.config.late_limit_s
    rig.hold(held_s)
    trip = rig.event("trip")
    assert trip["slug"] == ("host-late" if held_s < 0.8 * rig.config.actuator.watchdog_s else "host-silent")
    assert trip["value"] >= rig.config.late_limit_s
    # What the ECU did by itself meanwhile comes after its cause.
    also = [event["slug"] for event in rig.seen if event["event"] == "also"]
    assert set(also) <= {"ecu-command", "host-silent"}
    rig.event("safe")


@pytest.mark.nightly
def test_a_device_that_really_fell_silent_is_named_although_the_station_is_held_up_all_the_time(
    station_rig: Make,
) -> None:
    rig, tripped = moving(station_rig, "--fault", "ecu-silent@1.5"), False
    for _ in range(200):
        rig.wait(0.04)
        rig.hold(0.4 * rig.config.late_limit_s)
        rig.seen += rig.client.events()
        tripped = any(event["event"] == "trip" for event in rig.seen)
        if tripped:
            break
    assert rig.event("trip")["slug"] == "ecu-silent"
    rig.event("safe")
