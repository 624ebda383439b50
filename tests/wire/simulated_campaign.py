"""Campaigns on a simulated rig in virtual time, and what is left of them: answer, journal, points, truth."""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from scenario_campaign import Handle, ScenarioCampaign, Setting, begin, serve
from true_states import Truth

from rig.campaign import CampaignOptions
from rig.cli import words
from rig.matrix.model import load_matrix
from rig.recording.journal.campaign_log import read_log
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from simulators.scenarios.scenario import Silent
from simulators.scenarios.stage import Application, Stage


@dataclass(frozen=True)
class Ended:
    """How a session of a campaign ended; `told` lines of the journal are of the sessions before it."""

    exit_code: int
    output: str
    answer: dict[str, Any]
    truth_path: Path
    seen_lines: int = 0

    @property
    def folder(self) -> Path:
        return Path(self.answer["campaign"])

    @cached_property
    def story(self) -> list[dict[str, Any]]:
        """What the campaign's journal says of this session; empty when it did not come to one."""
        return read_log(self.folder)[self.seen_lines :] if "campaign" in self.answer else []

    @cached_property
    def run(self) -> Run:
        return Run.open(self.folder)

    @cached_property
    def truth(self) -> Truth:
        return Truth.load(self.truth_path)

    def point(self, name: str) -> RecordedPoint:
        return next(point for point in self.run.points if point.id == name)

    def phases(self) -> list[str]:
        return [line["phase"] for line in self.story if line["event"] == "phase"]

    def analysed(self) -> dict[str, Any]:
        """Identified and reported as its matrix asks, as after `rig run`."""
        from rig.cli.analyst import _reported, evaluate

        identify = load_matrix(self.folder / "matrix.toml").identify
        answer = evaluate(self.folder, identify.model_dump(exclude={"enabled"}) if identify.enabled else None)
        report, report_error = _reported(self.folder)
        return {**answer, "report": report, "report_error": report_error}


@dataclass
class Session:
    """One run of the application; a resumed campaign has several."""

    campaign: ScenarioCampaign
    seen_lines: int = 0

    def until(self, true: Callable[[dict[str, Any]], bool]) -> None:
        """Let it go on to a line of its journal."""
        size = 0

        def has_event() -> bool:
            nonlocal size
            grown = [path for path in self.campaign.out.glob("*/journal.jsonl") if path.stat().st_size > size]
            if not grown:
                assert self.campaign.process.poll() is None, "it ended without that line"
                return False
            size = grown[0].stat().st_size
            return any(true(line) for line in read_log(grown[0].parent)[self.seen_lines :])

        self.campaign.until(has_event, "that line of the journal")

    def interrupt(self) -> None:
        """Ctrl-C."""
        self.campaign.send(signal.SIGINT)

    def end(self) -> Ended:
        """Its end, the rig at rest, the truth written."""
        campaign, ran = self.campaign, self.campaign.application
        ending = campaign.finish()
        if ran.answer is None:
            answer = {"error": ran.refusal[1], "slug": ran.refusal[0], "exit_code": ending.exit_code}
        else:
            failed = {"error": words.error_words(ran.answer)} if ran.answer.detail else {}
            answer = {**ending.answer, **failed}
        return Ended(ending.exit_code, ending.output, answer, ending.truth_path, self.seen_lines)

    def resumed(self, folder: Path, requalified: str = "") -> Session:
        """The same campaign taken up again on a rig as new, without faults."""
        before = self.campaign
        before.stage.repair()
        arguments = before.setting.simulator
        pairs = zip(arguments, ("", *arguments), strict=False)
        kept = tuple(part for part, one_before in pairs if "--fault" not in {part, one_before})
        setting = dataclasses.replace(before.setting, simulator=kept)
        path = before.truth_path.with_name(f"again-{before.truth_path.name}")
        return _resumed(before.stage, folder, setting, path, requalified)


def _resumed(stage: Stage, folder: Path, setting: Setting, truth: Path, requalified: str = "") -> Session:
    """A session that takes up the campaign in `folder`."""
    seen_lines = len(read_log(folder))
    bench = serve(stage, stage.root, setting, truth)
    options = CampaignOptions(
        folder / "matrix.toml", folder.parent, bench_path=bench, resume_path=folder, requalified=requalified
    )
    application = Application(stage, options, Silent())
    handle: Any = Handle(stage, application.process)
    return Session(ScenarioCampaign(handle, folder.parent, truth, stage, application, setting), seen_lines)


@contextmanager
def session(folder: Path, matrix: str, *simulator: str, speed: float = 20.0, seed: int = 5) -> Iterator[Session]:
    """A campaign of this matrix on a rig with these arguments of `python -m simulators`; `folder` is empty."""
    with Stage(seed, folder) as stage:
        yield Session(begin(stage, folder, Setting(("--seed", str(seed), *simulator), matrix, speed)))


@contextmanager
def taken_up(root: Path, folder: Path, speed: float, seed: int) -> Iterator[Session]:
    """A campaign that somebody else began, taken up on a rig of that seed; it lies in `root`."""
    with Stage(seed, root) as stage:
        setting = Setting(("--seed", str(seed)), speed=speed)
        yield _resumed(stage, folder, setting, root / "truth.h5")


def simulated(folder: Path, matrix: str, *simulator: str, speed: float = 20.0, seed: int = 5) -> Ended:
    """The same to its end."""
    with session(folder, matrix, *simulator, speed=speed, seed=seed) as begun:
        return begun.end()


def options(*settings: str) -> list[str]:
    """Settings of the simulated rig as its arguments."""
    return [part for setting in settings for part in ("--option", setting)]
