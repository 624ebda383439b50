"""One world from its plan to its end: campaign, trouble, repair, resume, until the campaign is complete."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import pkgutil
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rig.errors import RigError
from simulators.options import RigOptions, with_option
from simulators.schedule import ScheduledFault, parse_fault
from simulators.world import device_loop
from simulators.world.disk import Disk
from simulators.world.kernel import Kernel, NothingHappens
from simulators.world.machine import Machine, Process
from simulators.world.plan import DEATHS, DISK, SIGNALS, STALLS, Happening, WorldPlan
from simulators.world.stands import Installed
from simulators.world.truth import WorldTruth

MOST_SESSIONS = 6
SESSION_S = 400.0
"""A campaign of a world that has not ended by then never will (virtual s)."""
REST_S = 90.0
"""So long after the end of the application everything must be at rest (virtual s)."""
LOADED = (
    "protocols", "drivers", "rig.bench", "rig.station", "rig.campaign", "rig.recording", "rig.matrix", "rig.signals",
    "rig.faults", "rig.dampers", "simulators",
)


def load_everything() -> None:
    """Import every module of the program, so that none finds the real machine when it is imported later."""
    for place in LOADED:
        package = importlib.import_module(place)
        for module in pkgutil.walk_packages(package.__path__, f"{place}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)


@dataclass
class Session:
    """One run of the application in a world, and the rig it ran on.

    Attributes:
        number: from 1.
        began_ns, ended_ns: of the application; `rest_ns` when everything was at rest.
        exit_code: of the application, negative for a signal; None when it never ended.
        answer: what `run_campaign` returned; None when it raised or was killed.
        refusal: slug and words of what it raised.
        truth: what the rig really did.
        happened: what happened in it.
    """

    number: int
    began_ns: int
    truth: WorldTruth
    ended_ns: int = 0
    rest_ns: int = 0
    exit_code: int | None = None
    answer: Any = None
    refusal: tuple[str, str] = ("", "")
    happened: list[tuple[int, Happening]] = field(default_factory=list)
    journal_lines: int = 0


class Silent:
    """A display nobody looks at."""

    def __getattr__(self, _name: str) -> Callable[..., None]:
        return lambda *_arguments, **_named: None


class World:
    """A world under way.

    Args:
        plan: what it begins with.
        root: an empty folder for its files.
        display: what the campaign's display shows; by default nothing.
    """

    def __init__(self, plan: WorldPlan, root: Path, display: Any = None) -> None:  # noqa: ANN401
        self.plan = plan
        self.root = root
        self.display = display or Silent()
        self.kernel = Kernel(plan.seed)
        self.disk = Disk(self.kernel, root, plan.seed)
        self.machine = Machine(self.kernel, self.disk, plan.seed)
        self.sessions: list[Session] = []
        self.ended = ""
        """Why the world ended before its campaign was complete; empty otherwise."""
        self._devices: Process | None = None
        self._rig: Any = None
        self._pending: list[Happening] = list(plan.happenings)
        self._fate = Process(self.machine, "fate", None, None)

    # The course of things

    def run(self, until_s: float | None = None) -> None:
        """From the first session to a complete campaign, or to the world's end."""
        from rig.recording.conversion import converter, finaliser
        from rig.station import process

        self.machine.programs = {
            "rig.station": process.main,
            "rig.recording.conversion.finaliser": lambda _: finaliser.main(),
            "rig.recording.conversion.converter": lambda _: converter.main(),
        }
        (self.root / "matrix.toml").write_text(self.plan.matrix, encoding="utf-8")
        with Installed(self.machine) as installed:
            import rig.campaign.execution.runner
            import rig.campaign.machine_resources
            import rig.clock
            import simulators.rig
            import simulators.slcan_bus

            memory = self.root / "memory"
            memory.mkdir()
            installed.put(rig.campaign.machine_resources, "SHARED_MEMORY", memory)
            installed.put(rig.campaign.machine_resources, "LOCK_FOLDERS", (memory,))
            installed.put(
                simulators.rig, "open_port", lambda _: device_loop.WirePort(self.kernel, self.machine.network)
            )
            installed.put(simulators.slcan_bus, "PeerQueue", device_loop.Queue)
            installed.put(rig.clock, "datetime", SimpleNamespace(now=lambda zone: self.machine.now().astimezone(zone)))
            # Coarser than in production: adapters that hand over every few milliseconds, a busy application.
            installed.put(simulators.rig, "TICK_S", self.plan.tick_s)
            installed.put(rig.campaign.execution.runner, "TURN_S", self.plan.turn_s)
            try:
                self._sessions(until_s)
            except NothingHappens as stuck:
                self.ended = f"nothing can happen any more: {stuck}"
            finally:
                for left in list(self.machine.processes.values()):
                    self.machine.end(left, -int(signal.SIGKILL))

    def _sessions(self, until_s: float | None) -> None:
        for number in range(1, MOST_SESSIONS + 1):
            session = self._session(number, until_s)
            if session.exit_code == 0 or self.ended or self._complete(session):
                return
        self.ended = f"the campaign is not complete after {MOST_SESSIONS} sessions"

    @staticmethod
    def _complete(session: Session) -> bool:
        """Every point has been run: what is suspect stays so."""
        answer = session.answer
        return answer is not None and session.exit_code == 5 and all(
            point.verdict in {"valid", "suspect"} for point in answer.points
        )

    def _session(self, number: int, until_s: float | None) -> Session:
        self._serve_devices(self._device_faults() if number == 1 else ())
        session = Session(number, self.kernel.now_ns, self._rig.truth)
        self.sessions.append(session)
        application = self.machine.start(
            "application", lambda: self._application(session), stderr=self.root / "application.log"
        )
        if number == 1:
            for happening in self.plan.happenings:
                if happening.around:
                    self._arrange(happening, session)
        end_ns = session.began_ns + int(SESSION_S * 1e9)
        last_ns = end_ns if until_s is None else self.kernel.start_ns + int(until_s * 1e9)
        self.kernel.run(lambda: not application.alive or self.kernel.now_ns > min(end_ns, last_ns))
        session.exit_code, session.ended_ns = application.exit_code, self.kernel.now_ns
        if until_s is not None and self.kernel.now_ns > last_ns:
            self.ended = "as asked"
            return session
        if application.alive:
            self.ended = f"session {number} does not end"
            return session
        self._pending.clear()
        rest_ns = self.kernel.now_ns + int(REST_S * 1e9)
        self.kernel.run(lambda: self._at_rest() or self.kernel.now_ns > rest_ns)
        session.rest_ns = self.kernel.now_ns
        self._repair()
        return session

    def _application(self, session: Session) -> int:
        from rig.campaign import CampaignOptions, run_campaign

        options = CampaignOptions(self.root / "matrix.toml", self.root / "out", bench_path=self.root / "bench.toml")
        folder = self.folder
        if folder is not None and (folder / "campaign.json").exists():
            options = CampaignOptions(
                self.root / "matrix.toml", self.root / "out", resume_path=folder, requalified="looked at in this world",
            )
        try:
            session.answer = run_campaign(options, self.display)
        except RigError as error:
            session.refusal = (getattr(error, "slug", ""), str(error))
            return int(getattr(error, "exit_code", 1))
        return int(session.answer.exit_code)

    @property
    def folder(self) -> Path | None:
        """The campaign's directory, the one with the most points if there are several; None before there is one."""
        out = self.root / "out"
        folders = sorted(out.iterdir()) if out.exists() else []
        return max(folders, key=lambda folder: len(list((folder / "points").glob("*"))), default=None)

    # Devices

    def _device_faults(self) -> tuple[ScheduledFault, ...]:
        return tuple(parse_fault(str(happening)) for happening in self.plan.happenings if not happening.around)

    def _serve_devices(self, faults: tuple[ScheduledFault, ...]) -> None:
        """A rig as new at the addresses of the one before."""
        from simulators.rig import RunOptions, SimulatedRig

        options = RigOptions()
        for assignment in self.plan.options:
            options = with_option(options, assignment)
        plan = self.plan
        run = RunOptions(seed=plan.seed, ports="socket", actuator=plan.actuator, faults=faults, drop_unread=True)
        self.machine.network.restart()
        rig = SimulatedRig(options, run)
        rig.truth = WorldTruth(rig.plant, self.kernel)  # type: ignore[assignment]  # stands where one would
        bench = self.root / "bench.toml"
        opened: list[str] = []

        def devices() -> None:
            loop = device_loop.WorldLoop(self.kernel, self.machine.network)

            async def serve() -> None:
                addresses = await rig.open()
                opened.append(rig.bench(addresses, real_time=True))
                await rig.run()

            loop.run_until_complete(serve())

        self._rig = rig
        rig.warm_up()
        self._devices = self.machine.start("devices", devices, stderr=self.root / "devices.log")
        self.kernel.run(lambda: bool(opened))
        bench.write_text(opened[0], encoding="utf-8")

    def _repair(self) -> None:
        """Everything is as it should be again: other devices, room on the disk, clocks."""
        if self._devices is not None:
            self.machine.end(self._devices, -int(signal.SIGKILL))
        self.disk.refuses, self.disk.flush_fails, self.disk.slow_ns = 0, False, 0

    def _at_rest(self) -> bool:
        """No process of the host is left, and the rig has neither pressure nor motion nor current."""
        processes = self.machine.processes.values()
        return self.still and not any(process.alive and process is not self._devices for process in processes)

    @property
    def still(self) -> bool:
        """The rig has neither pressure nor motion nor current."""
        plant = self._rig.plant
        return (
            int(plant.command["pressure"][0]) == 0 and abs(plant.value("velocity_m_s")) < 1e-3
            and abs(plant.value("current_A")) < 0.02
        )

    # What happens around the devices

    def _arrange(self, happening: Happening, session: Session) -> None:
        """Have something happen at its time."""
        after_ns = int((happening.at_s or 0.0) * 1e9)

        def do() -> None:
            if session.exit_code is not None or happening not in self._pending:
                return
            session.happened.append((self.kernel.now_ns, happening))
            self._happen(happening)

        self.kernel.spawn(str(happening), self._fate, do, after_ns)

    def _happen(self, happening: Happening) -> None:
        what, lasts_ns = happening.what, int((happening.lasts_s or 0.0) * 1e9)
        if what == "pause":
            self._signal("application", signal.SIGTSTP)
            self.kernel.spawn("resume", self._fate, lambda: self._signal("application", signal.SIGTSTP), lasts_ns)
        elif what in SIGNALS:
            self._signal("application", getattr(signal, SIGNALS[what]))
        elif what in DEATHS:
            self._signal(DEATHS[what], signal.SIGKILL)
        elif what in STALLS:
            for process in self._named(STALLS[what]):
                process.stalled_ns = self.kernel.now_ns + lasts_ns
        elif what == "fsync-error":
            self.disk.flush_fails = True
        elif what in DISK:
            self.disk.refuses = DISK[what]
        elif what == "slow-disk":
            self.disk.slow_ns = lasts_ns
        elif what == "clock-step":
            self.machine.wall_step_s += 3600.0 * (happening.lasts_s or 1.0)
        elif what == "power-cut":
            for process in [process for process in self.machine.processes.values() if process is not self._devices]:
                self.machine.end(process, -int(signal.SIGKILL))
            self.disk.power_cut()

    def _named(self, name: str) -> list[Process]:
        return [process for process in self.machine.processes.values() if process.alive and process.name == name]

    def _signal(self, name: str, number: int) -> None:
        for process in self._named(name):
            self.machine.signal(process, number)

    # What came of it

    @property
    def journal(self) -> list[dict[str, Any]]:
        """The campaign's journal, whole lines."""
        folder = self.folder
        path = None if folder is None else folder / "journal.jsonl"
        if path is None or not path.exists():
            return []
        lines = []
        for line in path.read_bytes().split(b"\n"):
            try:
                lines.append(json.loads(line))
            except ValueError:
                continue
        return lines

    def digest(self) -> str:
        """One number for everything that the world has made: files, their names, the truth."""
        whole = hashlib.sha256()
        place = os.fsencode(str(self.root))
        for path in sorted(self.root.rglob("*")):
            if path.is_file():
                whole.update(os.fsencode(str(path.relative_to(self.root))) + b"\0")
                whole.update(path.read_bytes().replace(place, b"ROOT"))
        for session in self.sessions:
            whole.update(session.truth.arrays.tobytes())
            whole.update(repr(session.truth.log).replace(str(self.root), "ROOT").encode())
        return whole.hexdigest()[:16]
