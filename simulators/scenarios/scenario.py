"""One world from its plan to its end: campaign, trouble, repair, resume, until the campaign is complete."""

from __future__ import annotations

import hashlib
import json
import os
import signal
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.roles import Command, State
from rig.campaign import CampaignOptions
from rig.campaign.results import Display
from rig.campaign_folder import CampaignFolder
from rig.matrix.model import load_matrix
from rig.recording.journal.campaign_log import read_log
from simulators.emulated_ecu import DEMO_ECU
from simulators.options import RigOptions, with_option
from simulators.plant import step
from simulators.plant.plant import Plant
from simulators.rig import RunOptions, SimulatedRig
from simulators.scenarios.drawn_rig import RECORD
from simulators.scenarios.kernel import Kernel, NothingHappens
from simulators.scenarios.machine import Process
from simulators.scenarios.plan import DEATHS, DISK, OTHER_STOPS, SIGNALS, STALLS, FaultEvent, ScenarioPlan
from simulators.scenarios.stage import Application, Stage
from simulators.scenarios.user_bench import UserBench
from simulators.schedule import parse_fault

MOST_SESSIONS = 6
SESSION_S = 400.0
"""A campaign of a world that has not ended by then never will (virtual s)."""
OTHER_SEQUENCE = 1000
LOOK_AGAIN_NS = 100_000_000
REST_S = 90.0
"""So long after the end of the application everything must be at rest (virtual s)."""
COLUMNS = (step.VELOCITY, step.CURRENT, step.DISPLACEMENT, step.FORCE, step.COIL_TEMPERATURE)
EVERY_S = 1e-3
MOVES_M_S = 2e-3
NAMES = ("event", "phase", "what", "slug", "id", "verdict", "exit_code")
"""What a line of the journal says without numbers."""


@dataclass(frozen=True)
class Noted:
    """A line of the devices' log: host's clock (ns), what."""

    host_ns: int
    code: str
    text: str


class ScenarioTruth:
    """Stands where `simulators.truth.Truth` would, and keeps in memory what that would write.

    Attributes:
        log: what the devices did.
        setpoints: each streamed one that the controller took: host's clock (ns), position (m), velocity (m/s).
    """

    def __init__(self, plant: Plant, kernel: Kernel) -> None:
        self.log: list[Noted] = []
        self.setpoints: list[tuple[int, float, float]] = []
        self._plant = plant
        self._kernel = kernel
        self._every = max(1, round(EVERY_S / plant.dt_s))
        self._taken = self._sliced_ns = 0
        self._slices: list[tuple[NDArray[np.float64], NDArray[Any]]] = []
        self._pressures: list[tuple[int, float]] = [(0, 0.0)]
        """From when on (ns) which pressure level: a slice lasts longer than a stop takes it away."""

    def slice(self) -> None:
        """Take the plant's last slice: one row for each millisecond of the plant, however long the slices are."""
        # The slice ends now; before it the rig's clock may have waited.
        self._take_pressure(self._sliced_ns)
        self._sliced_ns = self._kernel.now_ns
        steps, first = len(self._plant.out), -self._taken % self._every
        self._taken += steps
        if first < steps:
            out, dt_s = self._plant.out[first :: self._every].copy(), self._plant.dt_s
            times_ns = [self._sliced_ns - (steps - 1 - row) * dt_s * 1e9 for row in range(first, steps, self._every)]
            self._slices.append((np.array(times_ns), out))

    def note(self, code: str, text: str, time_s: float | None = None) -> None:
        """A line of the log."""
        del time_s
        self._take_pressure(self._kernel.now_ns)
        self.log.append(Noted(self._kernel.now_ns, code, text))

    def take_setpoint(self, position_m: float, velocity_m_s: float) -> None:
        """The controller takes a streamed set-point."""
        self.setpoints.append((self._kernel.now_ns, position_m, velocity_m_s))

    def _take_pressure(self, since_ns: int) -> None:
        """The pressure has its level since then, where it had another one before."""
        last_ns, last = self._pressures[-1]
        level = float(self._plant.command["pressure"][0])
        if level != last:
            self._pressures.append((max(last_ns, since_ns), level))

    def finish(self, about: Any) -> None:  # noqa: ANN401 - nothing is written
        """Nothing is written."""
        del about

    @cached_property
    def arrays(self) -> NDArray[np.float64]:
        """Host's clock (ns), velocity (m/s), current (A), displacement (m), force (N), pressure level, coil (degC)."""
        if not self._slices:
            return np.empty((0, 7))
        times_ns, rows = (np.concatenate(parts) for parts in zip(*self._slices, strict=True))
        rows = rows[:, COLUMNS]
        since_ns, levels = map(np.array, zip(*self._pressures, strict=True))
        pressures = levels[np.searchsorted(since_ns, times_ns, side="right") - 1]
        return np.column_stack((times_ns, rows[:, :4], pressures, rows[:, 4]))

    @property
    def moved_s(self) -> float:
        """For how long the rod moved (s)."""
        return float(np.count_nonzero(np.abs(self.arrays[:, 1]) > MOVES_M_S)) * EVERY_S


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
    truth: ScenarioTruth
    ended_ns: int = 0
    rest_ns: int = 0
    exit_code: int | None = None
    answer: Any = None
    refusal: tuple[str, str] = ("", "")
    happened: list[tuple[int, FaultEvent]] = field(default_factory=list)


class Silent:
    """A display without an operator."""

    def phase(self, *_: object, **__: object) -> None:
        """Nothing is shown."""

    planned = progress = point_done = message = phase


class Scenario:
    """A world under way.

    Args:
        plan: what it begins with.
        root: an empty folder for its files.
        display: what the campaign's display shows; by default nothing.
        most_sessions: it ends after so many, complete or not.
    """

    def __init__(
        self, plan: ScenarioPlan, root: Path, display: Display | None = None, most_sessions: int = MOST_SESSIONS
    ) -> None:
        self.plan = plan = plan.fitted()
        self.root = root
        self.display = display or Silent()
        self.most_sessions = most_sessions
        self.stage = Stage(plan.seed, root, plan.tick_s, plan.turn_s)
        self.kernel, self.machine = self.stage.kernel, self.stage.machine
        self.kernel.held_up = plan.held_up
        self.sessions: list[Session] = []
        self.ended = ""
        """Why the world ended before its campaign was complete; empty otherwise."""
        self._fate = Process(self.machine, "fate", None, None)

    # The course of things

    def run(self, until_s: float | None = None) -> None:
        """From the first session to a complete campaign, or to the world's end."""
        (self.root / "matrix.toml").write_text(self.plan.matrix, encoding="utf-8")
        if self.plan.record:
            (self.root / RECORD).write_text(self.plan.record, encoding="utf-8")
        _ = self._user  # its plug-ins are loaded before the world's machine stands in for the real one
        with self.stage:
            try:
                self._sessions(until_s)
            except NothingHappens as stuck:
                self.ended = f"deadlock: {stuck}"

    def _sessions(self, until_s: float | None) -> None:
        for number in range(1, self.most_sessions + 1):
            session = self._session(number, until_s)
            if session.exit_code == 0 or self.ended or self._complete(session):
                return
        if self.most_sessions >= MOST_SESSIONS:
            self.ended = f"the campaign is not complete after {MOST_SESSIONS} sessions"

    @staticmethod
    def _complete(session: Session) -> bool:
        """Every point has been run: what is suspect stays so."""
        answer = session.answer
        return answer is not None and session.exit_code == 5 and all(
            point.verdict in {"valid", "suspect"} for point in answer.points
        )

    def _session(self, number: int, until_s: float | None) -> Session:
        truth = self._serve_devices(with_faults=number == 1)
        session = Session(number, self.kernel.now_ns, truth)
        self.sessions.append(session)
        ran = Application(self.stage, self._options(), self.display)
        application = ran.process
        if number == 1:
            for event in self.plan.events:
                if event.around:
                    self._arrange(event, session)
        end_ns = session.began_ns + int((SESSION_S + self.plan.lasts_s) * 1e9)
        last_ns = end_ns if until_s is None else self.kernel.start_ns + int(until_s * 1e9)
        self.kernel.run(lambda: not application.alive or self.kernel.now_ns > min(end_ns, last_ns))
        session.exit_code, session.ended_ns = application.exit_code, self.kernel.now_ns
        session.answer, session.refusal = ran.answer, ran.refusal
        if until_s is not None and self.kernel.now_ns > last_ns:
            self.ended = "as requested"
            return session
        if application.alive:
            self.ended = f"session {number} did not finish"
            return session
        rest_ns = self.kernel.now_ns + int(REST_S * 1e9)
        self.kernel.run(lambda: self.stage.at_rest or self.kernel.now_ns > rest_ns)
        session.rest_ns = self.kernel.now_ns
        self.stage.repair()
        return session

    def _options(self) -> CampaignOptions:
        """A new campaign, or the one that was begun."""
        matrix, out, folder = self.root / "matrix.toml", self.root / "out", self.folder
        if folder is not None and CampaignFolder(folder).description.exists():
            return CampaignOptions(matrix, out, resume_path=folder, requalified="checked in this scenario")
        return CampaignOptions(matrix, out, bench_path=self.root / "bench.toml")

    @property
    def folder(self) -> Path | None:
        """The campaign's directory, the one with the most points if there are several; None before there is one."""
        out = self.root / "out"
        folders = sorted(out.iterdir()) if out.exists() else []
        return max(folders, key=lambda folder: len(list(CampaignFolder(folder).points.glob("*"))), default=None)

    def _serve_devices(self, *, with_faults: bool) -> ScenarioTruth:
        plan, options, user = self.plan, RigOptions(), self._user
        if user is not None:
            options = user.options
        for assignment in plan.options:
            options = with_option(options, assignment)
        faulty = plan.events if with_faults else ()
        faults = tuple(parse_fault(str(event)) for event in faulty if not event.around)
        run = RunOptions(
            seed=plan.seed, ports="socket", actuator=plan.actuator, faults=faults, drop_unread=True,
            auxiliaries=() if user is None else user.auxiliaries,
            emulated_ecu=DEMO_ECU if user is None else user.emulated_ecu, supply="" if user is None else user.supply,
            supply_line="" if user is None else user.supply_line,
        )
        rig = SimulatedRig(options, run)
        truth = ScenarioTruth(rig.plant, self.kernel)
        rig.actuator.taken = truth.take_setpoint
        rig.truth = truth  # type: ignore[assignment]  # stands where one would that writes a file
        self.stage.serve(rig, bench=None if user is None else user.text)
        return truth

    @cached_property
    def _user(self) -> UserBench | None:
        """The rig of the user's bench file; None where the rig is the usual one."""
        if not self.plan.bench:
            return None
        path = self.root / "user-bench.toml"
        path.write_text(self.plan.bench, encoding="utf-8")
        return UserBench.load(path, load_matrix(self.root / "matrix.toml"))

    # What happens around the devices

    def _arrange(self, event: FaultEvent, session: Session) -> None:
        """Have something happen at its time."""
        after_ns = int((event.at_s or 0.0) * 1e9)

        def do() -> None:
            if session.exit_code is None:
                session.happened.append((self.kernel.now_ns, event))
                self._happen(event)

        self.kernel.spawn(str(event), self._fate, do, after_ns)

    def _happen(self, event: FaultEvent) -> None:
        what, lasts_ns, stage = event.what, int((event.lasts_s or 0.0) * 1e9), self.stage
        if what == "pause":
            stage.signal("application", signal.SIGTSTP)
            paused = self.sessions[-1]
            self.kernel.spawn("resume", self._fate, lambda: self._go_on(paused), lasts_ns)
        elif what in SIGNALS:
            stage.signal("application", getattr(signal, SIGNALS[what]))
        elif what in DEATHS:
            stage.signal(DEATHS[what], signal.SIGKILL)
        elif what in STALLS:
            for name in STALLS[what]:
                for process in stage.named(name):
                    process.stalled_ns = max(process.stalled_ns, self.kernel.now_ns + lasts_ns)
        elif what in DISK or what in {"slow-disk", "log-full"}:
            self._spoil_the_disk(what, lasts_ns)
        elif what == "clock-step":
            self.machine.wall_step_s += 3600.0 * (event.lasts_s or 1.0)
        elif what == "power-cut":
            stage.power_cut()
        elif what in OTHER_STOPS:
            self._stop_by_somebody_else(event)

    def _go_on(self, paused: Session) -> None:
        """The pause's key again, unless the session that it paused is over: it would pause the next one, for good."""
        if self.sessions[-1] is paused:
            self.stage.signal("application", signal.SIGTSTP)

    def _spoil_the_disk(self, what: str, lasts_ns: int) -> None:
        """It refuses writes or flushes, or takes longer, until it is repaired."""
        disk = self.stage.disk
        if what == "fsync-error":
            disk.flush_fails = True
        elif what == "slow-disk":
            disk.slow_ns = lasts_ns
        elif what == "log-full":
            self.machine.log_full = True
        else:
            disk.refuses = DISK[what]

    def _stop_by_somebody_else(self, event: FaultEvent) -> None:
        """A running program is stopped by a command of another client, or at the panel; the next one if none runs."""
        what, session, actuator = event.what, self.sessions[-1], self.stage.rig.actuator
        if actuator.motion_state is not (State.RUNNING if actuator.options.generator else State.MOVING):
            if self.stage.named("application"):
                self.kernel.spawn(what, self._fate, lambda: self._stop_by_somebody_else(event), LOOK_AGAIN_NS)
            return
        if what == "foreign-stop":
            sequence = (actuator.sequence + OTHER_SEQUENCE) % 0xFFFF or 1
            command = Command.FADE_STOP if actuator.options.generator else Command.HALT
            actuator.execute({"sequence": sequence, "command": int(command), "owner_id": 0})
        else:
            actuator.stop_at_panel()
        if not any(known is event for _, known in session.happened):
            session.happened.append((self.kernel.now_ns, event))
        session.truth.note("FOREIGN", what)

    # What came of it

    @property
    def not_happened(self) -> tuple[FaultEvent, ...]:
        """What was to happen later than the campaign's first session lasted."""
        if not self.sessions:
            return self.plan.events
        first = self.sessions[0]
        begun = {line.text for line in first.truth.log if line.code == "FAULT"}
        return tuple(
            event for event in self.plan.events
            if (event.what not in begun if not event.around else
                not any(known is event for _, known in first.happened))
        )

    @property
    def journal(self) -> list[dict[str, Any]]:
        """The campaign's journal, whole lines."""
        folder = self.folder
        return [] if folder is None or not CampaignFolder(folder).journal.exists() else read_log(folder)

    def digests(self) -> dict[str, str]:
        """A number for each of what the world has made: the journals, all files and their names, the truth."""
        journal, files, truth = hashlib.sha256(), hashlib.sha256(), hashlib.sha256()
        place = os.fsencode(str(self.root))
        for path in sorted(self.root.rglob("*")):
            if path.is_file():
                content = path.read_bytes().replace(place, b"ROOT")
                files.update(os.fsencode(str(path.relative_to(self.root))) + b"\0" + content)
                if path.name == CampaignFolder.journal:
                    journal.update(content)
        for session in self.sessions:
            truth.update(session.truth.arrays.tobytes())
            truth.update(repr(session.truth.log).replace(str(self.root), "ROOT").encode())
        named = (("journal", journal), ("files", files), ("truth", truth))
        return {name: whole.hexdigest()[:16] for name, whole in named}

    def events(self) -> str:
        """One number for what happened by name, which another Python or processor makes the same."""
        journal = [[line.get(key) for key in NAMES] for line in self.journal]
        obeyed = [line.code for session in self.sessions for line in session.truth.log]
        return hashlib.sha256(json.dumps([journal, obeyed]).encode()).hexdigest()[:16]

    def digest(self) -> str:
        """One number for everything that the world has made."""
        return hashlib.sha256(json.dumps(self.digests()).encode()).hexdigest()[:16]
