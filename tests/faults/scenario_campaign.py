"""A campaign of the fault suite in virtual time: the same questions as `watched_campaign.Campaign`, no waiting."""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from matrices import TWO_POINTS
from watched_campaign import Campaign, Ending

from rig.bench.settings import StationConfig
from rig.campaign import CampaignOptions, machine_resources
from rig.cli import words
from simulators.__main__ import collect
from simulators.__main__ import main as simulators_command
from simulators.options import RigOptions
from simulators.rig import RunOptions, SimulatedRig
from simulators.scenarios.machine import Process
from simulators.scenarios.scenario import Silent
from simulators.scenarios.stage import Application, Stage
from simulators.schedule import BY_ID

LONGEST_S = 120.0
REST_S = 60.0
LOOK_NS = 500_000
SEED = 1
OUT = "out"
Result = TypeVar("Result")

Answer = tuple[int, dict[str, Any]]
"""Exit code and answer."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """What a campaign in a world begins with.

    Attributes:
        simulator: arguments of `python -m simulators`.
        matrix: the matrix file's text.
        speed: of the rig.
        real_time: the bench file's time limits are those of hardware, not those of a busy machine.
        bench_edit: a text of the bench file, and what it is replaced by.
        out: the campaigns' folder.
        ring_records: how many records the ring holds; 0: as many as the bench file says.
    """

    simulator: tuple[str, ...] = ()
    matrix: str = TWO_POINTS
    speed: float = 5.0
    real_time: bool = False
    bench_edit: tuple[str, str] = ("", "")
    out: str = OUT
    ring_records: int = 0

    @property
    def arguments(self) -> tuple[str, ...]:
        """Of `python -m simulators`, with the speed."""
        return "--speed", str(self.speed), *self.simulator


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
class ScenarioCampaign(Campaign):
    """A campaign in a world; what it waits for comes at once."""

    stage: Stage = None  # type: ignore[assignment]  # fields of the base have defaults
    application: Application = None  # type: ignore[assignment]
    setting: Setting = dataclasses.field(default_factory=Setting)

    def until(self, true: Callable[[], bool], what: str) -> None:
        """Let the world go on until something is true; it is asked every `LOOK_NS`."""
        kernel = self.stage.kernel
        last_ns, next_ns = kernel.now_ns + int(LONGEST_S * 1e9), 0

        def over() -> bool:
            nonlocal next_ns
            if kernel.now_ns < next_ns and kernel.tasks:
                return False
            next_ns = kernel.now_ns + LOOK_NS
            return true() or kernel.now_ns > last_ns

        kernel.run(over)
        assert kernel.now_ns <= last_ns, f"{what} did not come within {LONGEST_S:g} s"

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

    def move(self, seconds: float = 0.8) -> None:
        """Let the first point run for so long (s of motion)."""
        self.wait_for("START")
        self.run_on(seconds)

    def on_the_road(self, count: int = 1) -> None:
        """Let so many hybrid tests, counted from the first, come to their road."""
        journal = self.folder / "journal.jsonl"
        self.until(
            lambda: self.process.poll() is not None or journal.read_text("utf-8").count('"phase": "test"') >= count,
            f"{count} x the road",
        )
        assert self.process.poll() is None, "it ended before the road"

    def hold(self, role: str, seconds: float) -> None:
        """Keep a process from running for so long on the host's clock."""
        (process,) = self.stage.named(role)
        process.stalled_ns = self.now_ns + int(seconds * 1e9)

    def do(self, what: Callable[[], Result]) -> Result:
        """Have something done in a process of this machine; what it returns."""
        returned: list[Any] = []
        process = self.stage.machine.start("operator", lambda: returned.append(what()))
        self.until(lambda: not process.alive, "the end of what the operator does")
        assert returned, process.errors
        return returned[0]

    def kill_thread(self, role: str, name: str) -> None:
        """A thread of a process ends by an error that nobody expects."""
        (task,) = [task for task in self.stage.kernel.tasks if task.process.name == role and task.name == name]
        task.raises = RuntimeError("a defect in a thread")
        self.stage.kernel.wake(task)

    def another(self, **options: object) -> Answer:
        """A further run of the application on this machine, to its end."""
        chosen = CampaignOptions(**{"matrix_path": self.out.parent / "matrix.toml", "out": self.out, **options})
        ran = Application(self.stage, chosen, Silent())
        self.until(lambda: not ran.process.alive, "the end of the other one")
        return int(ran.process.exit_code or 0), answered(ran)

    def resumed(self, setting: Setting | None = None, **options: object) -> Answer:
        """`rig run --resume` on a repaired rig, or on one that is as `setting` says: exit code and answer."""
        stage, repaired = self.stage, dataclasses.replace(self.setting, simulator=())
        stage.repair()
        serve(stage, self.out.parent, setting or repaired, truth=None)
        folder = self.campaign_folder
        return self.another(matrix_path=folder / "matrix.toml", resume_path=folder, **options)

    @property
    def campaign_folder(self) -> Path:
        """The campaign's directory; it is there."""
        return next(iter(self.out.iterdir()))

    def assert_completed(self, kept: str = "p001", **options: object) -> None:
        """Resuming on a repaired rig finishes the campaign: the finished point is not touched, all points are valid."""
        points = self.campaign_folder / "points"
        file = points / f"{kept}.h5"
        before = file.read_bytes() if file.exists() else None
        code, answer = self.resumed(**options)
        assert code == 0, answer
        assert [(point["id"], point["verdict"]) for point in answer["points"]] == [("p001", "valid"), ("p002", "valid")]
        assert sorted(path.name for path in points.glob("*.h5")) == ["p001.h5", "p002.h5"]
        assert before is None or file.read_bytes() == before
        assert not list(points.glob("*.journal"))

    def finish(self, stopped_from_ns: int | None = None) -> Ending:
        self.until(lambda: self.process.poll() is not None, "the end")
        kernel, stage = self.stage.kernel, self.stage
        stage.disk.repair()
        rest_ns = kernel.now_ns + int(REST_S * 1e9)
        kernel.run(lambda: (stage.alone and stage.is_still) or kernel.now_ns > rest_ns)
        settled_ns = kernel.now_ns + int(1e9)
        kernel.run(lambda: kernel.now_ns > settled_ns)
        stage.rig.stop()
        devices = stage.devices
        self.until(lambda: devices is None or not devices.alive, "the truth file")
        ran = self.application
        output = ran.refusal[1] if ran.answer is None else "\n".join(text for _, text in words.ending(ran.answer))
        folders = list(self.out.iterdir()) if self.out.is_dir() else []
        return Ending(
            int(self.process.poll() or 0), answered(ran), folders[0] if folders else self.out, output, self.truth_path,
            stopped_from_ns,
        )


def answered(ran: Application) -> dict[str, Any]:
    """What the command would print with `--json`: the campaign's answer, or the refusal's slug and words."""
    if ran.answer is not None:
        return dict(ran.answer.to_json())
    return {"slug": ran.refusal[0], "error": ran.refusal[1]}


def rig_options(*arguments: str) -> tuple[RigOptions, RunOptions]:
    """The rig of `python -m simulators ARGUMENTS`, with the ports of a world."""
    with simulators_command.make_context("simulators", ["--seed", str(SEED), *arguments]) as context:
        collected = collect({**context.params})
    run = collected["run"]
    return collected["options"], dataclasses.replace(run, ports=BY_ID if run.ports == BY_ID else "socket")


def simulated_rig(*arguments: str, truth: Path | None) -> SimulatedRig:
    """The same, as new."""
    options, run = rig_options(*arguments)
    return SimulatedRig(options, dataclasses.replace(run, truth=truth))


def serve(stage: Stage, folder: Path, setting: Setting, truth: Path | None) -> Path:
    """Have the rig of a setting served; its bench file."""
    bench = stage.serve(simulated_rig(*setting.arguments, truth=truth), real_time=setting.real_time)
    text = bench.read_text(encoding="utf-8")
    assert setting.bench_edit[0] in text
    bench.write_text(text.replace(*setting.bench_edit), encoding="utf-8")
    return bench


def smaller_ring(usual: Callable[..., StationConfig], records: int, *given: object) -> StationConfig:
    """The station's settings with a ring of so many records."""
    return dataclasses.replace(usual(*given), ring_capacity=records)


def begin(stage: Stage, folder: Path, setting: Setting) -> ScenarioCampaign:
    """Start a campaign in a world."""
    out = folder / setting.out
    if setting.out == OUT:
        out.mkdir()
    (folder / "matrix.toml").write_text(setting.matrix, encoding="utf-8")
    truth = folder / "truth.h5"
    if setting.ring_records:
        config = partial(smaller_ring, machine_resources.station_config, setting.ring_records)
        stage.installed.put(machine_resources, "station_config", config)
    bench = serve(stage, folder, setting, truth)
    application = Application(stage, CampaignOptions(folder / "matrix.toml", out, bench_path=bench), Silent())
    process: Any = Handle(stage, application.process)
    return ScenarioCampaign(process, out, truth, stage, application, setting)
