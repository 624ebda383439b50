"""Object and peer of the test: the files of this folder are collected as the options state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.conformance.choice import chosen_files
from rig.conformance.peer import ACTUATOR, CURRENT_SOURCE, SENSOR, Peer, bench_text, kind_of


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Collect the tests of what was named, and no others."""
    if not collection_path.name.startswith("test_") or collection_path.parent != Path(__file__).parent:
        return None
    return collection_path.name not in chosen_files(config)


@pytest.fixture(scope="session")
def driver_name(request: pytest.FixtureRequest) -> str:
    """The driver to try."""
    return str(request.config.getoption("rig_driver"))


@pytest.fixture(scope="session")
def model_name(request: pytest.FixtureRequest) -> str:
    """The damper model to try."""
    return str(request.config.getoption("rig_model"))


@pytest.fixture(scope="session")
def method_name(request: pytest.FixtureRequest) -> str:
    """The method to try."""
    return str(request.config.getoption("rig_method"))


@pytest.fixture(scope="session")
def served_url(request: pytest.FixtureRequest, driver_name: str) -> str:
    """Where the peer is: as `--peer` says, else a simulated device that is started for it."""
    given = request.config.getoption("rig_peer")
    if given:
        return str(given)
    start: Callable[..., Any] = request.getfixturevalue("simulated_rigs")
    kind = str(kind_of(driver_name))
    bench = start(bench=bench_text(driver_name)).bench
    return str({ACTUATOR: bench.actuator.url, CURRENT_SOURCE: bench.ecu.channel, SENSOR: bench.load_cell.url}[kind])


@pytest.fixture
def peer(served_url: str) -> Iterator[Peer]:
    """The peer behind a wire that can be cut, for one test."""
    with Peer(served_url) as reached:
        yield reached
