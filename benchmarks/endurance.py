"""An endurance test of a million cycles with faults and deaths, in virtual time: nothing lost, nothing counted twice.

    python benchmarks/endurance.py
    python benchmarks/endurance.py --cycles 60000

The matrix file, the sequencer, the journals, the conversion of each block to its file, the count of the cycles, the
stop rules and the resume are the product's own. The motion, the damper and the sensors are computed for a whole block
at once, and the actions of the sequencer are answered at once: the station, the drivers, the ring and the recorder's
thread do not take part (`rig scenarios` and the fault suite run them). Faults of the devices stop blocks at random
times; `kill -9` leaves journals without an end, while the rod goes on for some cycles.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import Counter, deque
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from campaign_process import machine
from long_alignment import block, peak_mb

from drivers.ring import CHANNELS
from drivers.roles import ProgramPhase
from rig.bench.model import Bench
from rig.campaign.endurance import EnduranceBook
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.state import Phase, State, campaign_state
from rig.campaign.sequencer.step import step
from rig.campaign.stop_cause import because
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.faults.row import StopKind
from rig.matrix.model import Matrix, load_matrix
from rig.recording.conversion.conversion import finish_alone
from rig.recording.hdf5.reading import read_cycles
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.layout import PointContext, SensorContext
from rig.recording.point_attributes import Commanded
from rig.recording.point_files import attempt_name, unfinished
from rig.test_point import ENDURANCE, TestPoint

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ, POLL_HZ = 250.0, 25.0
AT_ONCE_S = 20.0
"""Of a program, computed and appended to its journal at a time."""
MOST_S, MOST_MB, MOST_GB = 600.0, 200.0, 2.0
WHOLE, FADED, CUT = "whole", "faded", "cut"
"""How a program ends."""
TRIP_SHARE, KILL_SHARE = 0.08, 0.05
"""Of the blocks, that a fault of a device stops, and during which the software is killed."""

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["sine"]
amplitude = ["10 mm"]
frequency = ["2 Hz"]
current = ["0.5 A"]
cycles = 5
adapt_amplitude = false
[campaign]
retries = 2
[[endurance]]
id = "wear"
amplitude = "4 mm"
frequency = "10 Hz"
current = "1 A"
cycles = {cycles}
performance_every = {every}
full_samples_every = 1000
[endurance.stop]
force_down = "90 %"
friction_up = "900 %"
temperature = "120 degC"
"""


@dataclass
class Truth:
    """What the specimen went through: full cycles on record, cycles after a record was cut off, starts of blocks."""

    recorded: int = 0
    unseen: int = 0
    counts: Counter[str] = field(default_factory=Counter)


class Damper:
    """A damper that wears: its viscous force and its friction over the cycles so far."""

    def force_N(self, position_m: np.ndarray, velocity_m_s: np.ndarray, cycles: float) -> np.ndarray:
        """Force at a position and velocity (n,)."""
        wear = 1.0 - 0.3 * cycles / 1e6
        friction_N = 80.0 * (1.0 + 0.5 * cycles / 1e6)
        return 900.0 * wear * velocity_m_s + friction_N * np.tanh(velocity_m_s / 0.01) + 4000.0 * position_m - 120.0


class Session:
    """One session of the campaign: it answers the sequencer at once, and writes what sensors would have measured.

    Args:
        folder: the campaign's directory.
        matrix, bench: of the campaign.
        truth: what the specimen has gone through.
        random: faults and deaths.
    """

    def __init__(self, folder: Path, matrix: Matrix, bench: Bench, truth: Truth, random: np.random.Generator) -> None:
        self.points = CampaignFolder(folder).points
        self.matrix, self.bench, self.truth, self.random = matrix, bench, truth, random
        self.book = EnduranceBook(folder, matrix, truth.counts)
        done = {file.stem for file in self.points.glob("*.h5")}
        left = [point for point in matrix.points() if point.kind == ENDURANCE or point.id not in done]
        self.ids = [point.id for point in matrix.points()]
        queue = self.book.remaining(left)
        self.state: State | None = campaign_state(queue, matrix, bench) if queue else None
        self.events: deque[ev.Event] = deque([ev.Begin()])
        self.journal: tuple[Path, TestPoint, PointContext] | None = None
        self.killed = False

    def run(self) -> bool:
        """Run to the end of the campaign, or of this process; returns whether the campaign is complete."""
        while self.state is not None and self.events and not self.killed:
            self.state, actions = step(self.state, self.events.popleft())
            for action in actions:
                self.carry_out(action)
                if self.killed:
                    return False
        return self.state is None or self.state.phase is Phase.ENDED

    def carry_out(self, action: act.Action) -> None:
        """Answer one action."""
        answers: dict[type, ev.Event] = {
            act.Move: ev.Centred(), act.SetCurrent: ev.CurrentSettled(), act.Rest: ev.RestOver(),
            act.AwaitStandstill: ev.Standstill(), act.Stop: ev.Safe(StopKind.FADE_OUT),
        }  # fmt: skip
        if isinstance(action, act.Ask):
            self.events.append(ev.Done(action.request))
        elif isinstance(action, act.WatchZeros):
            self.events.append(ev.ZerosReturned() if action.again else ev.ZerosJudged(None))
        elif isinstance(action, act.ProveSensors):
            self.events.append(ev.ProofJudged(None) if action.leg else ev.ProofLegDone())
        elif isinstance(action, act.BeginRecording):
            self.begin(action)
        elif isinstance(action, act.Start):
            self.start(action.point)
        elif isinstance(action, act.EndRecording):
            self.end(action)
        elif isinstance(action, act.Withdraw):
            self.book.withdraw(action.test, action.points)
        elif type(action) in answers:
            self.events.append(answers[type(action)])

    def begin(self, action: act.BeginRecording) -> None:
        """Choose the journal's name, as the recording of points does."""
        point = self.book.begun(action.point, self.bench)
        block = point.kind == ENDURANCE
        name = self.book.name_of(point, self.ids) if block else attempt_name(point.id, action.attempt, self.ids)
        self.truth.counts[point.id] += 1
        sensors = {
            "force": SensorContext("force", RATE_HZ, 0.0, 5000.0), "displacement": SensorContext(
                "displacement", RATE_HZ, 0.0, 0.1),
        }  # fmt: skip
        context = PointContext(
            point=TestPoint(**{**vars(point), "id": name}), sensors=sensors, controller_delay_s=0.0,
            provenance={"point": point.id, "attempt": str(action.attempt)}, commanded=Commanded(point.amplitude_m, 0.0),
        )  # fmt: skip
        self.journal = self.points / f"{name}.journal", point, context

    def start(self, program: TestPoint) -> None:
        """Run a program: to its end, until a fault stops it, or until this process is killed."""
        path, point, context = self.journal if self.journal is not None else (None, program, None)
        whole = round(program.cycles)
        fate, share = self.random.random(), self.random.random()
        stops = path is not None and point.kind == ENDURANCE and fate < TRIP_SHARE + KILL_SHARE
        run = int(whole * share) if stops else whole
        if path is None or context is None:
            self.events.append(ev.ProgramEnded(at_centre=True))
            return
        killed = stops and fate >= TRIP_SHARE
        self.writer = JournalWriter(path, context.to_json())
        write_block(self.writer, program, run, self.random, FADED if stops and not killed else CUT if stops else WHOLE)
        if point.kind == ENDURANCE:
            self.truth.recorded += run
        if killed:
            self.killed = True
            self.truth.unseen += int(self.random.integers(0, point.endurance.unseen_cycles + 1))
            self.writer.close(stopped_by=None, lost_records=0)
            os.truncate(path, path.stat().st_size - 1)  # as after kill -9: the end was not written
        elif stops:
            self.events.append(ev.Tripped(StopKind.FADE_OUT, because("sample-gap", "said", text="a fault"), first=True))
            self.events.append(ev.Safe(StopKind.FADE_OUT))
        else:
            motion = ev.MeasuredMotion(program.amplitude_m, program.centre_m)
            self.events.append(ev.ProgramEnded(at_centre=True, motion=motion))

    def end(self, action: act.EndRecording) -> None:
        """Close the journal, have its file made, count its cycles."""
        path, point, _ = self.journal
        self.journal = None
        self.writer.close(stopped_by=None if action.fault is None else action.fault.slug, lost_records=0)
        finished = finish_alone(path)
        if finished.error:
            raise RuntimeError(finished.error)
        block = None
        if point.kind == ENDURANCE:
            block = self.book.count(action.point, self.points / Path(finished.file).name)
            self.book.save()
        self.events.append(ev.Judged(point.id, finished.verdict == "valid", block))


def write_block(
    writer: JournalWriter, program: TestPoint, run: int, random: np.random.Generator, end: str
) -> None:
    """Write what the rig's sensors and controller send during a program, of which `run` full cycles are run.

    At its end it ramps out; stopped, it fades out in the same way, but the controller counts fewer cycles; cut off, the
    records end within the next cycle.
    """
    rate = program.frequency_Hz
    lead_s, ramp = 0.3, 1.0
    cut = end == CUT
    cycles_s = (ramp + run + (random.uniform(0.15, 0.95) if cut else ramp)) / rate
    before = 0 if program.endurance is None else program.endurance.cycles_before
    damper = Damper()
    records = []

    def path(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        done = np.clip((time_s - lead_s) * rate, 0.0, None)
        total = np.inf if cut else 2.0 * ramp + run
        share = np.clip(np.minimum(done / ramp, total - done), 0.0, 1.0)
        angle = 2.0 * np.pi * done
        size = program.amplitude_m * share
        return size * np.sin(angle), size * 2.0 * np.pi * rate * np.cos(angle)

    end_s = lead_s + cycles_s + (0.0 if cut else 0.3)

    def sent(begin_s: float, rate_Hz: float, last_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Numbers and times of what is sent at a rate from one time up to another."""
        numbers = np.arange(int(np.ceil(begin_s * rate_Hz - 1e-9)), int(np.ceil(last_s * rate_Hz - 1e-9)))
        return numbers, numbers / rate_Hz

    for begin_s in np.arange(0.0, end_s, AT_ONCE_S):
        last_s = min(end_s, begin_s + AT_ONCE_S)
        numbers, time_s = sent(begin_s, RATE_HZ, last_s)
        position_m, velocity_m_s = path(time_s)
        force_N = damper.force_N(position_m, velocity_m_s, before + run / 2)
        records = [
            block(CHANNELS[name], time_s, value + noise * random.normal(size=len(time_s)), numbers)
            for name, value, noise in (("displacement", position_m, 2e-6), ("force", force_N, 2.0))
        ]
        _, poll_s = sent(begin_s, POLL_HZ, last_s)
        done = np.clip((poll_s - lead_s) * rate, 0.0, None)
        polled_m, polled_m_s = path(poll_s)
        full = (done >= ramp) & (done < ramp + run)
        phase = np.where(full, float(ProgramPhase.FULL_AMPLITUDE), float(ProgramPhase.RAMP_IN))
        whole = np.floor(np.minimum(done, ramp + run + (ramp if end == WHOLE else 0.0)) + 1e-9)
        for name, value in (
            ("position", polled_m), ("controller_force", damper.force_N(polled_m, polled_m_s, before)),
            ("phase", phase), ("cycles_done", whole), ("coil_current", np.full(len(poll_s), program.current_A)),
            ("coil_temperature", 30.0 + 0.0 * poll_s),
        ):
            records.append(block(CHANNELS[name], poll_s, value, 0 * poll_s.astype(np.int64)))
        count, pulse_s = sent(max(0.0, begin_s - lead_s), rate, min(cycles_s, last_s - lead_s))
        pulse_s = pulse_s + lead_s
        records.append(block(CHANNELS["pulse"], pulse_s, count + 1.0, count + 1))
        for name in ("force_edge", "displacement_edge"):
            records.append(block(CHANNELS[name], pulse_s, np.zeros(len(count)), (count + 1) % 256))
        joined = np.concatenate(records)
        writer.append(joined[np.argsort(joined["host_ns"], kind="stable")])


def numbers_of(points: Path) -> np.ndarray:
    """The numbers of all cycles with statistics, in all files."""
    return np.concatenate([
        columns["number"][np.isfinite(columns["displacement_max"])]
        for file in sorted(points.glob("wear-b*.h5")) if (columns := read_cycles(file)) is not None
    ])


def main() -> int:
    """Run it, and check the count of every cycle."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--cycles", type=int, default=1_000_000)
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    random, truth, sessions = np.random.default_rng(given.seed), Truth(), 0
    began_s = time.process_time()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        points = CampaignFolder(folder).points
        points.mkdir()
        file = folder / "matrix.toml"
        file.write_text(MATRIX.format(cycles=given.cycles, every=max(10, given.cycles // 10)), encoding="utf-8")
        matrix, bench = load_matrix(file), Bench.load(ROOT / "examples" / "demo-bench.toml")
        complete = False
        while not complete:
            sessions += 1
            for journal in unfinished(points):
                finish_alone(journal, recovered=True)
            session = Session(folder, matrix, bench, truth, random)
            complete = session.run()
        cpu_s = time.process_time() - began_s
        (test,) = EnduranceBook(folder, matrix, truth.counts).to_json()
        numbers = numbers_of(points)
        size_gb = sum(path.stat().st_size for path in points.iterdir()) / 1e9
        files = len(list(points.glob("*.h5")))
    twice, lost = len(numbers) - len(np.unique(numbers)), given.cycles - len(np.unique(numbers))
    print(f"{utc_now().date()}, {machine()}; {given.cycles:,} cycles, {sessions} sessions, {files} files")
    print(f"cycles run {test['cycles_run']:,}, recorded {test['cycles_recorded']:,}, truly on record "
          f"{truth.recorded:,}; counted twice {twice}, lost {lost}")
    print(f"cycles without a record: {truth.unseen:,} truly, at most {test['cycles_unrecorded_at_most']:,} stated")
    print(f"{cpu_s:.0f} s of CPU (goal {MOST_S:g}), {peak_mb():.0f} MB (goal {MOST_MB:g}), {size_gb:.2f} GB on disk "
          f"(goal {MOST_GB:g})")
    right = twice == 0 and lost == 0 and test["cycles_run"] == given.cycles == truth.recorded
    right = right and truth.unseen <= test["cycles_unrecorded_at_most"]
    within = cpu_s <= MOST_S * given.cycles / 1e6 and peak_mb() <= MOST_MB and size_gb <= MOST_GB
    return 0 if right and within else 1


if __name__ == "__main__":
    sys.exit(main())
