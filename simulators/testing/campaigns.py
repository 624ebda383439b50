"""A lab's matrix on the simulated rig of its bench file, in virtual time: one campaign, or one world of a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from rig.campaign_folder import CampaignFolder
from rig.cli.words import ending
from rig.identification import identify_run
from rig.matrix.model import load_matrix
from rig.recording.run import Run
from simulators.scenarios.invariants import violations
from simulators.scenarios.request import NOTHING, Files, ScenarioRequest, request_for
from simulators.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from rig.identification import Fit

TICK_S, TURN_S = 0.004, 0.004
"""The finest of drawn worlds."""
HELD_UP = 0.0
"""No thread is kept waiting for nothing: the same campaign on a machine that does nothing else."""


class EventNotReached(Exception):
    """A requested event cannot occur, or was scheduled after the end of the campaign: the test would show nothing."""


NotHappened = EventNotReached
"""Its name until 2.0."""


@dataclass(frozen=True)
class Truth:
    """What the simulated rig really did, every millisecond; arrays (n,).

    Attributes:
        time_s: from its first millisecond.
        displacement_m, velocity_m_s, force_N, current_A: of the damper.
        pressure: 0 off, 1 low, 2 on.
        coil_degC: the coil's temperature.
        log: what the devices did, (time_s, code, text), such as (1.2, "START", "...") or (3.0, "FAULT", "estop").
    """

    time_s: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    force_N: NDArray[np.float64]
    current_A: NDArray[np.float64]
    pressure: NDArray[np.float64]
    coil_degC: NDArray[np.float64]
    log: tuple[tuple[float, str, str], ...]


@dataclass(frozen=True)
class CampaignEnd:
    """How a campaign ended and what it left.

    Attributes:
        exit_code: of `rig run`.
        slug: of what stopped or refused it; empty when it ran to its end.
        message: what `rig run` would show to the operator.
        answer: the keys of `rig run --json` that the campaign knows; empty when it was refused before it had a folder.
        folder: the campaign's directory; None when it did not come to one.
        at_rest: in truth neither pressure nor motion nor current was left.
        truth: what really happened.
    """

    exit_code: int
    slug: str
    message: str
    answer: Mapping[str, Any]
    folder: Path | None
    at_rest: bool
    truth: Truth

    @property
    def said(self) -> str:
        """Earlier name of `message`, available until 2.0."""
        return self.message

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict of every point of the matrix by its id: `valid`, `suspect`, `invalid`, `not run`."""
        return {point["id"]: point["verdict"] for point in self.answer.get("points", ())}

    @property
    def reasons(self) -> dict[str, list[str]]:
        """Why points are not valid, by id."""
        return {point["id"]: point["reasons"] for point in self.answer.get("points", ()) if point["reasons"]}

    @cached_property
    def run(self) -> Run:
        """What was recorded.

        Raises:
            FileProblem: nothing was.
        """
        return Run.open(self.folder or Path())

    @cached_property
    def fit(self) -> Fit:
        """The run identified as its matrix says; `fit.json` is written, too.

        Raises:
            IdentificationFailed: no model could be fitted.
        """
        folder = self.run.path
        settings = load_matrix(CampaignFolder(folder).matrix).identify
        return identify_run([folder], **settings.model_dump(exclude={"enabled"}))


@dataclass(frozen=True)
class ScenarioEnd:
    """How the scenario of a seed ended.

    Attributes:
        seed: its seed.
        failed: (check, message, virtual time in s) of every failed check.
        happenings: scheduled events; `events` is the new name.
        exit_codes: of the campaign's sessions; None for one that was killed or never ended.
        again: the command that repeats this scenario.
    """

    seed: int
    failed: tuple[tuple[str, str, float], ...]
    happenings: tuple[str, ...]
    exit_codes: tuple[int | None, ...]
    again: str

    @property
    def passed(self) -> bool:
        """All checks passed."""
        return not self.failed

    @property
    def held(self) -> bool:
        """The name of `passed` until 2.0."""
        return self.passed

    @property
    def events(self) -> tuple[str, ...]:
        """Scheduled events."""
        return self.happenings


WorldEnd = ScenarioEnd
"""Its name until 2.0."""


def run_campaign(files: Files, faults: tuple[str, ...], seed: int, root: Path) -> CampaignEnd:
    """Run one session of a campaign on the simulated rig of a bench file, in virtual time.

    Args:
        files: matrix, and bench or None for the usual simulated rig.
        faults: what goes wrong, as `rig scenarios --event` has it; none: an undisturbed rig.
        seed: of noise, clocks and latencies.
        root: an empty folder.

    Raises:
        EventNotReached: a fault cannot happen on this rig, or the campaign was over before it.
        FileProblem: a file cannot be used, or no simulated rig can stand in for the bench.
        Refused: the matrix does not fit the bench.
    """
    request = _request(files, faults or (NOTHING,))
    drawn = request.plan(seed)
    scenario = Scenario(replace(drawn, tick_s=min(TICK_S, drawn.tick_s), turn_s=TURN_S, held_up=HELD_UP), root, None, 1)
    scenario.run()
    if scenario.not_happened:
        late = ", ".join(map(str, scenario.not_happened))
        raise EventNotReached(f"{late}: the campaign had already ended. Fix: use an earlier time or a longer matrix")
    if scenario.ended:
        raise EventNotReached(f"the scenario ended before its campaign ended: {scenario.ended}")
    session = scenario.sessions[0]
    answer = session.answer
    message, slug = session.refusal[1], session.refusal[0]
    if answer is not None:
        message, slug = "\n".join(text for _, text in ending(answer)), answer.stopped_by or ""
    return CampaignEnd(
        int(session.exit_code or 0), slug, message, {} if answer is None else answer.to_json(), scenario.folder,
        scenario.stage.at_rest, _truth(scenario),
    )  # fmt: skip


def run_scenario(files: Files, events: tuple[str, ...], seed: int, root: Path) -> ScenarioEnd:
    """Run the world of a seed to its end, resumed as often as it takes, and judge what must hold in every world.

    Args:
        files: matrix and bench; what is None the seed draws, or is the usual rig.
        events: in place of what the seed draws; none: drawn.
        seed: the world's.
        root: an empty folder.

    Raises:
        EventNotReached: a happening that cannot be.
        FileProblem: a file cannot be used, or no simulated rig can stand in for the bench.
        Refused: the matrix does not fit the bench.
    """
    request = _request(files, events)
    plan = request.plan(seed)
    scenario = Scenario(plan, root)
    scenario.run()
    failed = tuple((name, words.replace(f"{root}/", ""), at_s) for name, words, at_s in violations(scenario))
    codes = tuple(session.exit_code for session in scenario.sessions)
    return ScenarioEnd(seed, failed, tuple(map(str, plan.events)), codes, request.again(seed))


def _request(files: Files, events: tuple[str, ...]) -> ScenarioRequest:
    try:
        return request_for(files, events, None)
    except click.BadParameter as error:
        raise EventNotReached(error.message) from error


def _truth(scenario: Scenario) -> Truth:
    truth = scenario.sessions[0].truth
    host_ns, velocity, current, displacement, force, pressure, coil = truth.arrays.T
    began_ns = float(host_ns[0]) if len(host_ns) else 0.0
    log = tuple(((note.host_ns - began_ns) * 1e-9, note.code, note.text) for note in truth.log)
    return Truth((host_ns - began_ns) * 1e-9, displacement, velocity, force, current, pressure, coil, log)
