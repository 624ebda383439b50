"""A campaign of the fault suite in virtual time: the same questions as `watched_campaign.Campaign`, no waiting."""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from watched_campaign import Campaign, Ending

from rig.campaign import CampaignOptions
from rig.cli import words
from simulators.__main__ import collect
from simulators.__main__ import main as simulators_command
from simulators.options import RigOptions
from simulators.rig import RunOptions, SimulatedRig
from simulators.world.machine import Process
from simulators.world.stage import Application, Stage
from simulators.world.world import Silent

LONGEST_S = 600.0
REST_S = 60.0
SEED = 1


class Handle:
    """A process of a world, as `subprocess.Popen` has it."""

    def __init__(self, stage: Stage, process: Process) -> None:
        self.pid = process.pid
        self._stage = stage
        self._process = process

    def poll(self) -> int | None:
        return self._process.exit_code

    def send_signal(self, number: int) -> None:
        if number == signal.SIGSTOP:
            self._process.stalled_ns = self._stage.kernel.now_ns + int(LONGEST_S * 1e9)
        elif number == signal.SIGCONT:
            self._process.stalled_ns = 0
        else:
            self._stage.machine.signal(self._process, number)


@dataclasses.dataclass(frozen=True)
class WorldCampaign(Campaign):
    """A campaign in a world; what it waits for comes at once."""

    stage: Stage = None  # type: ignore[assignment]  # fields of the base have defaults
    application: Application = None  # type: ignore[assignment]
    rig_options: RigOptions = None  # type: ignore[assignment]
    rig_run: RunOptions = None  # type: ignore[assignment]

    def until(self, true: Callable[[], bool], what: str) -> None:
        """Let the world go on until something is true."""
        last_ns = self.stage.kernel.now_ns + int(LONGEST_S * 1e9)
        self.stage.kernel.run(lambda: true() or self.stage.kernel.now_ns > last_ns)
        assert self.stage.kernel.now_ns <= last_ns, f"{what} did not come within {LONGEST_S:g} s"

    @property
    def now_ns(self) -> int:
        """The host's clock."""
        return self.stage.kernel.now_ns

    @property
    def folder(self) -> Path:
        self.until(lambda: self.process.poll() is not None or any(self.out.iterdir()), "the campaign's directory")
        return next(iter(self.out.iterdir()))

    def wait_for(self, code: str, text: str = "", count: int = 1) -> None:
        self.until(
            lambda: self.process.poll() is not None or self.happened(code, text, count), f"{count} x {code} {text}"
        )
        assert self.process.poll() is None, f"it ended before {code} {text}"

    def run_on(self, seconds: float) -> None:
        until_s = self.stage.rig.plant.time_s + seconds
        self.until(
            lambda: self.process.poll() is not None or self.stage.rig.plant.time_s >= until_s, f"{seconds} s of motion"
        )
        assert self.process.poll() is None

    def send(self, number: int, role: str = "application") -> None:
        (process,) = self.stage.named(role)
        Handle(self.stage, process).send_signal(number)

    def assert_completed(self, kept: str = "p001") -> None:
        """Resuming on a mended rig finishes the campaign: the finished point is not touched, all points are valid."""
        folder, stage = next(iter(self.out.iterdir())), self.stage
        file = folder / "points" / f"{kept}.h5"
        before = file.read_bytes() if file.exists() else None
        stage.repair()
        mended = dataclasses.replace(self.rig_run, faults=(), truth=None)
        stage.serve(SimulatedRig(self.rig_options, mended), real_time=False)
        options = CampaignOptions(self.out.parent / "matrix.toml", self.out, resume_path=folder)
        again = Application(stage, options, Silent())
        self.until(lambda: not again.process.alive, "the resumed campaign's end")
        assert again.process.exit_code == 0, again.refusal or again.answer
        assert [(point.id, point.verdict) for point in again.answer.points] == [("p001", "valid"), ("p002", "valid")]
        assert sorted(path.name for path in (folder / "points").glob("*.h5")) == ["p001.h5", "p002.h5"]
        assert before is None or file.read_bytes() == before
        assert not list((folder / "points").glob("*.journal"))

    def finish(self, stopped_from_ns: int | None = None) -> Ending:
        self.until(lambda: self.process.poll() is not None, "the end")
        kernel, stage = self.stage.kernel, self.stage
        rest_ns = kernel.now_ns + int(REST_S * 1e9)
        kernel.run(lambda: (stage.alone and stage.stands) or kernel.now_ns > rest_ns)
        settled_ns = kernel.now_ns + int(1e9)
        kernel.run(lambda: kernel.now_ns > settled_ns)
        stage.rig.stop()
        devices = stage.devices
        self.until(lambda: devices is None or not devices.alive, "the truth file")
        ran = self.application
        answer: dict[str, Any] = {} if ran.answer is None else ran.answer.to_json()
        said = ran.refusal[1] if ran.answer is None else "\n".join(text for _, text in words.ending(ran.answer))
        folders = list(self.out.iterdir())
        return Ending(
            int(self.process.poll() or 0), answer, folders[0] if folders else self.out, said, self.truth_path,
            stopped_from_ns,
        )


def begin(
    stage: Stage, folder: Path, simulator: tuple[str, ...], matrix: str, speed: float
) -> WorldCampaign:
    """Start a campaign in a world whose rig is what these arguments of `python -m simulators` say."""
    out = folder / "out"
    out.mkdir()
    (folder / "matrix.toml").write_text(matrix, encoding="utf-8")
    arguments = ["--speed", str(speed), "--seed", str(SEED), "--no-real-time", *simulator]
    with simulators_command.make_context("simulators", arguments) as context:
        asked = collect({**context.params})
    run = dataclasses.replace(asked["run"], ports="socket", truth=folder / "truth.h5")
    bench = stage.serve(SimulatedRig(asked["options"], run), real_time=False)
    application = Application(stage, CampaignOptions(folder / "matrix.toml", out, bench_path=bench), Silent())
    process: Any = Handle(stage, application.process)
    return WorldCampaign(process, out, folder / "truth.h5", stage, application, asked["options"], run)
