"""Campaigns as a user starts them, for the benchmarks: `rig run` in a process, its answer, the memory of its family."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SAMPLING_S = 0.25


@dataclass
class Answer:
    """What `rig run --json` said, its exit code, and the largest resident memory of each process (bytes, by role)."""

    exit_code: int
    json: dict[str, Any]
    memory: dict[str, int] = field(default_factory=dict)


def sines(frequency: Sequence[str], current: Sequence[str], amplitude: str, cycles: int, *, identify: bool) -> str:
    """The matrix file of these sines on the demo damper."""
    return f"""format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["{amplitude}"]
frequency = {json.dumps(frequency)}
current = {json.dumps(current)}
cycles = {cycles}
[identify]
enabled = {json.dumps(identify)}
"""


def run(matrix: Path, out: Path, *arguments: str, speed: float = 1.0, seed: int = 0) -> Answer:
    """Run a matrix on a simulated rig; `arguments` go to the simulated rig."""
    command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--simulate", "--speed", str(speed)]
    command += ["--seed", str(seed), "--out", str(out), "--json", "--", *arguments]
    memory: dict[str, int] = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        done = threading.Event()
        watch = threading.Thread(target=_watch, args=(process.pid, memory, done))
        watch.start()
        output, errors = process.communicate()
        done.set()
        watch.join()
    if not output.strip():
        raise RuntimeError(f"rig run ended with {process.returncode} and said nothing:\n{errors[-2000:]}")
    return Answer(process.returncode, json.loads(output), memory)


def _watch(root: int, memory: dict[str, int], done: threading.Event) -> None:
    while not done.wait(SAMPLING_S):
        for pid in family(root):
            role, size = role_and_size(pid)
            if role:
                memory[role] = max(memory.get(role, 0), size)


def family(root: int) -> Iterator[int]:
    """A process and all its descendants."""
    children: dict[int, list[int]] = {}
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                parent = int(Path(entry.path, "stat").read_text().rsplit(")", 1)[1].split()[1])
            except (OSError, IndexError):
                continue
            children.setdefault(parent, []).append(int(entry.name))
    waiting = [root]
    while waiting:
        pid = waiting.pop()
        yield pid
        waiting += children.get(pid, [])


ROLES = {
    "rig.station": "station", "simulators": "simulated rig", "rig.recording.conversion.finaliser": "finaliser",
    "rig.cli.analyst": "analyst", "rig.cli.main": "application",
}


def role_and_size(pid: int) -> tuple[str, int]:
    """What a process is of a campaign, empty when nothing, and its resident memory (bytes)."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return "", 0
    module = words[words.index("-m") + 1] if "-m" in words[:-1] else ""
    return ROLES.get(module, ""), pages * os.sysconf("SC_PAGE_SIZE")


def machine() -> str:
    """Processor and number of cores."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return f"{line.partition(':')[2].strip()}, {os.cpu_count()} cores"
    return f"{os.cpu_count()} cores"
