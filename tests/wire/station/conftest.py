"""Stations on simulated rigs, for tests that drive the station directly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from station_rigs import Change, ScenarioStationRig, StationRig, WiredStationRig


def maker(kind: type[WiredStationRig | ScenarioStationRig], folder: Path) -> Iterator[Callable[..., StationRig]]:
    """Makes stations on simulated rigs, and ends them after the test."""
    made: list[WiredStationRig | ScenarioStationRig] = []

    def make(*arguments: str, speed: float = 1.0, **changes: Change) -> StationRig:
        place = folder / str(len(made))
        place.mkdir()
        made.append(kind(place, speed, arguments, **changes))
        return made[-1]

    yield make
    for rig in made:
        rig.end()


@pytest.fixture
def station_rig(tmp_path: Path) -> Iterator[Callable[..., StationRig]]:
    """In virtual time, one at a time: `station_rig("--fault", "estop@1", speed=1.0, **config_changes)`."""
    yield from maker(ScenarioStationRig, tmp_path)


@pytest.fixture
def wired_station_rig(tmp_path: Path) -> Iterator[Callable[..., StationRig]]:
    """The same on real processes and wires."""
    yield from maker(WiredStationRig, tmp_path)
