"""A long simulated campaign with random seeded faults, resumed until it is complete: nothing finished may be lost.

    python benchmarks/soak.py [--points 2000] [--speed 50] [--seed 1] [--within 3600] [--json]

Each session ends by what its seed draws (`--fault-seed`), by a kill -9 of application, station or simulated rig, by
Ctrl-C (a fault that stops nothing is not left to spoil every point), or at the last point; the next one resumes. After
every session each finished point must still be there, byte by byte; files that the journal says were written again for
their skew at the end are counted apart. Memory and descriptors are watched through /proc: the quarters of the soak are
compared, and within each session what came after the first 20 s. A session is the campaign as `rig run` runs it,
without fit and report.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from campaign_process import family, machine, role_and_size

from rig.clock import monotonic_ns

KILLED = ("application", "station", "simulated rig")
KILL_SHARE = 0.3
FAULT_WITHIN_S = 300.0
"""Simulated time in which a session's faults begin, a hundred points or so."""
KILL_WITHIN_S = 40.0
LONGEST_S = 120.0
SESSION_S = 900.0
LOOK_S = 0.25
SETTLED_S = 20.0
CURRENTS = 20
COMPLETE = {0, 5}  # every point was run; some may be suspect, or invalid after all their retries
MB = 1 << 20


@dataclass
class Usage:
    """Resident memory (bytes) and descriptors of one role in one session: the largest, and those after `SETTLED_S`."""

    memory: int = 0
    descriptors: int = 0
    settled_memory: int = 0
    settled_descriptors: int = 0
    began_ns: int = field(default_factory=monotonic_ns)

    def see(self, memory: int, descriptors: int) -> None:
        """Take a reading."""
        self.memory, self.descriptors = max(self.memory, memory), max(self.descriptors, descriptors)
        if monotonic_ns() - self.began_ns < SETTLED_S * 1e9 or self.settled_memory == 0:
            self.settled_memory, self.settled_descriptors = self.memory, self.descriptors


@dataclass
class Session:
    """One session: how it was to end, how it ended, what its processes used, and what was done."""

    order: str
    exit_code: int = 0
    stopped_by: str | None = None
    wall_s: float = 0.0
    used: dict[str, Usage] = field(default_factory=dict)


def matrix(points: int) -> str:
    """A matrix of short points, about so many."""
    currents = ", ".join(f'"{0.1 * number:.1f} A"' for number in range(CURRENTS))
    return (
        'format = 1\n[specimen]\nserial_number = "SOAK-1"\nstroke = "170 mm"\nprior = "demo"\n[matrix]\n'
        f'amplitude = ["10 mm"]\nfrequency = ["4 Hz"]\ncurrent = [{currents}]\ncycles = 4\n'
        f"repeats = {max(1, points // CURRENTS)}\n[identify]\nenabled = false\n"
    )


class Silent:
    """Without a display."""

    def planned(self, plan: object) -> None:
        """Nothing is shown."""

    def phase(self, text: str) -> None:
        """Nothing is shown."""

    def progress(self, *live: object) -> None:
        """Nothing is shown."""

    def point_done(self, result: object) -> None:
        """Nothing is shown."""

    def message(self, level: str, text: str) -> None:
        """Nothing is shown."""


def run_one(place: Path, speed: float, arguments: list[str]) -> int:
    """Begin or resume the campaign in `place`, in this process; prints its result."""
    from rig.campaign import run_campaign
    from rig.campaign.results import CampaignOptions
    from rig.errors import RigError

    begun = next(iter((place / "out").glob("*/campaign.json")), None)
    resumed = None if begun is None else begun.parent
    options = CampaignOptions(
        matrix_path=place / "matrix.toml" if resumed is None else resumed / "matrix.toml",
        out=place / "out", simulate=True, speed=speed, simulator_args=tuple(arguments), resume_path=resumed,
    )  # fmt: skip
    try:
        result = run_campaign(options, Silent())
    except RigError as error:
        sys.stdout.write(json.dumps({"error": str(error)}) + "\n")
        return error.exit_code
    sys.stdout.write(json.dumps({"valid": result.valid, "stopped_by": result.stopped_by}) + "\n")
    return result.exit_code


def look(root: int, used: dict[str, Usage]) -> dict[str, int]:
    """Note what every process of a session uses; returns their ids by role."""
    found: dict[str, int] = {}
    for pid in family(root):
        role, memory = role_and_size(pid)
        role = "application" if pid == root else role
        try:
            descriptors = len(os.listdir(f"/proc/{pid}/fd"))
        except OSError:
            continue
        if role:
            found[role] = pid
            used.setdefault(role, Usage()).see(memory, descriptors)
    return found


def run_session(command: list[str], disturbance: str, end_after_s: float) -> Session:
    """Run one session to its end; `end_after_s` wall seconds after the station is up kill what is to be, or stop it."""
    session, pause = Session(disturbance), threading.Event()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    began_ns, up_ns = monotonic_ns(), 0
    while process.poll() is None:
        roles = look(process.pid, session.used)
        now_ns = monotonic_ns()
        up_ns = up_ns or (now_ns if "station" in roles else 0)
        killed = disturbance.startswith("kill ")
        victim = roles.get(disturbance.removeprefix("kill ")) if killed else process.pid
        if disturbance and victim is not None and up_ns and now_ns - up_ns > end_after_s * 1e9:
            os.kill(victim, signal.SIGKILL if killed else signal.SIGINT)
            disturbance = ""
        if now_ns - began_ns > SESSION_S * 1e9:
            process.kill()
        pause.wait(LOOK_S)
    answer, errors = process.communicate()
    session.exit_code, session.wall_s = process.returncode, (monotonic_ns() - began_ns) * 1e-9
    if answer:
        session.stopped_by = json.loads(answer).get("stopped_by")
    elif process.returncode != -signal.SIGKILL:
        sys.stderr.write(errors[-2000:])
    return session


class Finished:
    """The finished points of the campaign, by their bytes."""

    def __init__(self) -> None:
        self.known: dict[str, str] = {}
        self.lost: set[str] = set()
        self.retimed: set[str] = set()

    def check(self, points: Path) -> None:
        """Compare with what was there before, and take up what is new."""
        from rig.recording.journal.campaign_log import read_log
        from rig.recording.recorded_point import RecordedPoint

        now = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in points.glob("*.h5")}
        changed = {name for name, digest in self.known.items() if now.get(name) != digest}
        retimed = {f"{line['file']}.h5" for line in read_log(points.parent) if line["event"] == "retimed"}
        self.retimed |= changed & retimed & now.keys()
        self.lost |= changed - self.retimed
        new = [name for name in now if name not in self.known]
        self.known |= {name: now[name] for name in new if RecordedPoint.open(points / name).verdict != "invalid"}


def table(sessions: list[Session]) -> list[dict[str, object]]:
    """For each role, largest memory (MB) and descriptors in each quarter of the sessions, and most growth in one."""
    size = max(1, len(sessions) // 4)
    quarters = [sessions[number * size : (number + 1) * size if number < 3 else None] for number in range(4)]
    rows = []
    for role in sorted({role for session in sessions for role in session.used}):
        uses = [[session.used[role] for session in quarter if role in session.used] for quarter in quarters]
        rows.append({
            "role": role,
            "memory_MB": [round(max((use.memory for use in quarter), default=0) / MB, 1) for quarter in uses],
            "descriptors": [max((use.descriptors for use in quarter), default=0) for quarter in uses],
            "grown_MB": round(max(use.memory - use.settled_memory for quarter in uses for use in quarter) / MB, 1),
            "grown_descriptors": max(use.descriptors - use.settled_descriptors for quarter in uses for use in quarter),
        })
    return rows


def soak(place: Path, points: int, speed: float, seed: int, within_s: float) -> tuple[list[Session], Finished]:
    """Run sessions until the campaign is complete, or the time is over."""
    chance, sessions, finished = random.Random(seed), [], Finished()
    until_ns = monotonic_ns() + int(within_s * 1e9)
    (place / "matrix.toml").write_text(matrix(points), encoding="utf-8")
    while monotonic_ns() < until_ns and (not sessions or sessions[-1].exit_code not in COMPLETE):
        kills = chance.random() < KILL_SHARE
        disturbance = f"kill {chance.choice(KILLED)}" if kills else f"faults {chance.randrange(1 << 30)}"
        command = [sys.executable, __file__, "--session", str(place), "--speed", str(speed)]
        if not kills:
            command += ["--fault-seed", disturbance.split()[1], "--fault-within", str(FAULT_WITHIN_S)]
        sessions.append(run_session(command, disturbance, chance.uniform(0.0, KILL_WITHIN_S if kills else LONGEST_S)))
        for folder in (place / "out").glob("*/points"):
            finished.check(folder)
        report(sessions, finished)
    return sessions, finished


def report(sessions: list[Session], finished: Finished) -> None:
    """One line about the last session."""
    last = sessions[-1]
    sys.stderr.write(
        f"{len(sessions):4} {last.order:22} exit {last.exit_code:3} {last.stopped_by or '':18} {last.wall_s:6.1f} s "
        f"{len(finished.known):5} finished, {len(finished.lost)} lost\n"
    )
    sys.stderr.flush()


def summary(sessions: list[Session], finished: Finished, wall_s: float) -> dict[str, object]:
    """The result in numbers."""
    return {
        "machine": machine(), "wall_s": round(wall_s), "points": len(finished.known), "sessions": len(sessions),
        "complete": sessions[-1].exit_code in COMPLETE, "lost_finished_points": len(finished.lost),
        "written_again_for_their_skew": len(finished.retimed),
        "exit_codes": dict(Counter(str(session.exit_code) for session in sessions)),
        "causes": dict(Counter(session.stopped_by or session.order.split(" ", 1)[0] for session in sessions)),
        "used": table(sessions),
    }  # fmt: skip


def main(arguments: Iterable[str] | None = None) -> int:
    """Run the soak, or one session of it; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=2000)
    parser.add_argument("--speed", type=float, default=50.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--within", type=float, default=3600.0, help="begin no further session after so many seconds")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--session", type=Path, help=argparse.SUPPRESS)
    options, simulator = parser.parse_known_args(arguments)
    if options.session is not None:
        return run_one(options.session, options.speed, simulator)
    began_ns = monotonic_ns()
    with tempfile.TemporaryDirectory(prefix="soak-") as place:
        sessions, finished = soak(Path(place), options.points, options.speed, options.seed, options.within)
        found = summary(sessions, finished, (monotonic_ns() - began_ns) * 1e-9)
    text = json.dumps(found) if options.json else "\n".join(f"{name}: {value}" for name, value in found.items())
    sys.stdout.write(text + "\n")
    return 0 if found["complete"] and not finished.lost else 1


if __name__ == "__main__":
    sys.exit(main())
