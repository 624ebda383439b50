"""The fault suite's frame: `rig run` as a user starts it, one fault, and what must then be true in truth and files.

Most of it happens in worlds (`simulators.scenarios`); what only real processes and wires can prove uses `start`.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from copied_scenario import StandingCampaigns
from matrices import TWO_POINTS
from scenario_campaign import SEED, ScenarioCampaign, Setting, begin
from watched_campaign import FINISH_S, RIG, Campaign, Ending

from simulators.scenarios.stage import Stage

Start = Callable[..., Campaign]
BeginScenario = Callable[..., ScenarioCampaign]
InMotion = Callable[..., Campaign]
Run = Callable[..., Ending]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts `rig run` on a simulated rig; what still runs at the end of the test is ended."""
    begun: list[Campaign] = []

    def begin(
        *simulator: str, matrix: str = TWO_POINTS, speed: float = 5.0, arguments: tuple[str, ...] = ()
    ) -> Campaign:
        path, out = tmp_path / f"matrix{len(begun)}.toml", tmp_path / f"out{len(begun)}"
        path.write_text(matrix, encoding="utf-8")
        out.mkdir()
        command = [RIG, "run", str(path), "--simulate", "--speed", str(speed), "--seed", "1", "--no-identify", "--json"]
        # Real-time processes of several tests would keep each other from running; the benchmarks measure with them.
        process = subprocess.Popen(
            [*command, "--out", str(out), *arguments, "--", "--no-real-time", *simulator],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"COLUMNS": "200"},
            cwd=tmp_path,
        )  # fmt: skip
        begun.append(Campaign(process, out))
        return begun[-1]

    yield begin
    for campaign in begun:
        if campaign.process.poll() is None:
            campaign.process.send_signal(signal.SIGTERM)
            campaign.process.communicate(timeout=FINISH_S)


def injected(faults: tuple[str, ...]) -> tuple[str, ...]:
    """Arguments of the simulated rig for these faults."""
    return tuple(part for fault in faults for part in ("--fault", fault))


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs a campaign in virtual time, with faults of the simulated rig, to its end: `run("estop@6")`."""
    scenarios = itertools.count()

    def to_the_end(*faults: str, simulator: tuple[str, ...] = (), **setting: object) -> Ending:
        folder = tmp_path / f"world{next(scenarios)}"
        folder.mkdir()
        with Stage(SEED, folder) as stage:
            return begin(stage, folder, Setting((*injected(faults), *simulator), **setting)).finish()

    return to_the_end


@pytest.fixture
def run_wired(start: Start) -> Run:
    """The same on real processes and wires, where only they have what a row is about."""

    def to_the_end(*faults: str, simulator: tuple[str, ...] = ()) -> Ending:
        return start(*injected(faults), *simulator).finish()

    return to_the_end


def second_point_running(start: Start) -> InMotion:
    """Starts campaigns that way, and lets their second point run for a while (simulated s)."""

    def begun(seconds: float = 1.6, **options: object) -> Campaign:
        campaign = start(**options)
        campaign.wait_for("START", count=2)
        campaign.run_on(seconds)
        return campaign

    return begun


@pytest.fixture
def in_motion(start: Start) -> InMotion:
    """Starts a campaign whose second point runs for a while (simulated s): `in_motion(seconds=1.6)`."""
    return second_point_running(start)


@pytest.fixture
def begin_scenario(tmp_path: Path) -> Iterator[BeginScenario]:
    """Starts a campaign in virtual time that waits to be looked at; one a test."""
    with ExitStack() as ends:

        def start_there(setting: Setting | None = None, **differing: object) -> ScenarioCampaign:
            folder = tmp_path / "world"
            folder.mkdir()
            return begin(ends.enter_context(Stage(SEED, folder)), folder, setting or Setting(**differing))

        yield start_there


@pytest.fixture(scope="session")
def standing_campaigns(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandingCampaigns]:
    """Campaigns that stand where their first point begins, to be copied (`copied_scenario`)."""
    campaigns = StandingCampaigns(lambda: tmp_path_factory.mktemp("standing"))
    yield campaigns
    campaigns.end()


@pytest.fixture
def moving(begin_scenario: Start) -> InMotion:
    """The same in virtual time: `moving(seconds=1.6)`."""
    return second_point_running(begin_scenario)
