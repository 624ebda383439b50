"""A long simulated campaign with random seeded faults, resumed until it is complete: nothing finished may be lost.

    python benchmarks/soak.py [--points 2000] [--speed 50] [--seed 1] [--json]

Each session runs until its fault, a kill -9 of the application or of the station ends it; the next one resumes. After
every session each finished point must still be there, byte by byte. Memory and descriptors of the application are
watched through /proc; the first and the last quarter of the sessions are compared.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

from rig.clock import monotonic_ns

FAULTS = (
    "ecu-silent", "ecu-crc", "can-busoff", "coil-open-short", "ecu-restart", "modbus-reset", "modbus-halfopen",
    "actuator-frozen", "actuator-reboot", "second-master", "loadcell-pulled", "lvdt-pulled", "sensor-saturated",
    "sensor-stuck", "serial-garbage", "estop", "kill-application", "kill-station", "none",
)  # fmt: skip
SESSION_S = 1800.0
LOOK_S = 0.1
CURRENTS = 20


@dataclass(frozen=True)
class Session:
    """One session: fault, exit code, valid points after it, largest memory and descriptors of its application."""

    fault: str
    exit_code: int
    valid: int
    memory_MB: float
    descriptors: int


def matrix(points: int) -> str:
    """A matrix of short points, about so many."""
    currents = ", ".join(f'"{0.1 * number:.1f} A"' for number in range(CURRENTS))
    return (
        'format = 1\n[specimen]\nserial_number = "SOAK-1"\nstroke = "170 mm"\nprior = "demo"\n[matrix]\n'
        f'amplitude = ["10 mm"]\nfrequency = ["4 Hz"]\ncurrent = [{currents}]\ncycles = 4\n'
        f"repeats = {max(1, points // CURRENTS)}\n[identify]\nenabled = false\n"
    )


def run_session(command: list[str], fault: str, after_s: float) -> Session:
    """Run one session to its end, killing what is to be killed after `after_s` wall seconds."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    began_ns, pause = monotonic_ns(), threading.Event()
    memory_MB, descriptors, killed = 0.0, 0, False
    while process.poll() is None and monotonic_ns() - began_ns < SESSION_S * 1e9:
        with contextlib.suppress(OSError, StopIteration, ValueError):
            status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
            resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
            memory_MB = max(memory_MB, int(resident.split()[1]) / 1024)
            descriptors = max(descriptors, len(os.listdir(f"/proc/{process.pid}/fd")))
        if not killed and fault.startswith("kill-") and monotonic_ns() - began_ns > after_s * 1e9:
            killed = kill(process.pid, fault)
        pause.wait(LOOK_S)
    answer = process.communicate()[0]
    valid = json.loads(answer).get("valid", -1) if answer else -1
    return Session(fault, process.returncode, valid, memory_MB, descriptors)


def kill(application: int, what: str) -> bool:
    """Kill the application or its station; True when there was one to be killed."""
    if what == "kill-application":
        os.kill(application, signal.SIGKILL)
        return True
    command = ["pgrep", "-P", str(application), "-f", "rig.station"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    for station in found.stdout.split():
        os.kill(int(station), signal.SIGKILL)
    return bool(found.stdout.split())


def finished(folder: Path) -> dict[str, str]:
    """Digest of every finished point that a fit may use."""
    from rig.recording.run import RecordedPoint

    files = sorted((folder / "points").glob("*.h5"))
    return {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if RecordedPoint.open(file).verdict != "invalid"
    }


def main() -> int:
    """Run sessions until the campaign is complete; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=2000)
    parser.add_argument("--speed", type=float, default=50.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-sessions", type=int, default=200)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    sessions: list[Session] = []
    lost: list[str] = []
    with tempfile.TemporaryDirectory(prefix="soak-") as place:
        file, out = Path(place) / "matrix.toml", Path(place) / "out"
        file.write_text(matrix(options.points), encoding="utf-8")
        known: dict[str, str] = {}
        while len(sessions) < options.most_sessions:
            fault = chance.choice(FAULTS)
            folders = list(out.iterdir()) if out.is_dir() else []
            target = ["--resume", str(folders[0])] if folders else [str(file), "--simulate", "--out", str(out)]
            injected = fault in {"none", "kill-application", "kill-station"}
            after = [] if injected else ["--", "--fault", f"{fault}@{chance.uniform(5.0, 200.0):.1f}"]
            command = [sys.executable, "-m", "rig.cli.main", "run", *target, "--json", "--speed", str(options.speed)]
            sessions.append(run_session([*command, *after], fault, chance.uniform(4.0, 12.0)))
            now = finished(next(iter(out.iterdir())))
            lost += [name for name, digest in known.items() if now.get(name) != digest]
            known = now
            last = sessions[-1]
            line = f"{len(sessions):4} {last.fault:18} exit {last.exit_code:3}  {len(known):5} finished\n"
            sys.stderr.write(line)
            if sessions[-1].exit_code == 0:
                break
    quarter = max(1, len(sessions) // 4)
    found = {
        "points": len(known), "sessions": len(sessions), "complete": sessions[-1].exit_code == 0,
        "lost_finished_points": len(lost), "exit_codes": sorted({session.exit_code for session in sessions}),
        "memory_MB_first_quarter": max(session.memory_MB for session in sessions[:quarter]),
        "memory_MB_last_quarter": max(session.memory_MB for session in sessions[-quarter:]),
        "descriptors_first_quarter": max(session.descriptors for session in sessions[:quarter]),
        "descriptors_last_quarter": max(session.descriptors for session in sessions[-quarter:]),
    }  # fmt: skip
    text = json.dumps(found) if options.json else "\n".join(f"{name}: {value}" for name, value in found.items())
    sys.stdout.write(text + "\n")
    return 0 if found["complete"] and not lost else 1


if __name__ == "__main__":
    sys.exit(main())
