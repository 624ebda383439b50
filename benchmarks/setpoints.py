"""How late streamed set-points are, and how often a status block can be polled, over loopback TCP.

    python benchmarks/setpoints.py [--seconds 600] [--poll-ms 4] [--no-real-time] [--json]

A whole campaign, `rig run` with recorder, interlocks and real-time priority where it is allowed, streams one slow sine
to a simulated rig without a function generator, another process. The counts are the station's own. Goals: p99 of
lateness within 2 ms with real-time rights, fewer than 0.1 % of the set-points left out, 1,000 polls a second. Beside it
stand what the host of this machine gave to others meanwhile (steal), and how late a loop is that only sleeps, at
real-time priority where that is allowed: no set-point is sent earlier than its thread wakes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from campaign_process import sines

from drivers.catalogue import make_actuator
from drivers.connection import ActuatorConnection
from rig.bench.model import Bench

GOAL_P99_S, GOAL_SKIPPED, GOAL_POLLS_HZ = 0.002, 0.001, 1000.0
POLLED_S = 3.0
FREQUENCY_HZ, AMPLITUDE = 0.5, "10 mm"


def stolen_s() -> float:
    """Time that the host of this machine gave to others, summed over its processors, since boot (s)."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK")


def polled_hz(url: str) -> float:
    """Status blocks read one after the other in a second."""
    driver = make_actuator("demo-streamed", ActuatorConnection(url))
    driver.open()
    try:
        count, end_s = 0, time.monotonic() + POLLED_S
        while time.monotonic() < end_s:
            driver.read_status()
            count += 1
        return count / POLLED_S
    finally:
        driver.close()


def bare_p99_s(poll_s: float, real_time: bool) -> float:
    """How late a loop of that period wakes that does nothing else (s)."""
    code = (
        "import os, time\n"
        f"if {real_time}: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))\n"
        f"due, late = time.monotonic(), []\nfor _ in range({int(POLLED_S / poll_s)}):\n"
        f"    due += {poll_s}\n    time.sleep(max(0.0, due - time.monotonic()))\n"
        "    late.append(time.monotonic() - due)\n    due = max(due, time.monotonic() - late[-1])\n"
        "print(sorted(late)[int(0.99 * len(late))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return float(done.stdout) if done.returncode == 0 else bare_p99_s(poll_s, real_time=False)


def streamed(bench: Path, seconds: float, folder: Path) -> dict[str, Any]:
    """Run one point for so long; the result's count of its set-points, and whether the station had real-time priority.

    Raises:
        RuntimeError: the campaign did not stream.
    """
    matrix = folder / "matrix.toml"
    cycles = max(3, round(seconds * FREQUENCY_HZ))
    matrix.write_text(sines([f"{FREQUENCY_HZ:g} Hz"], ["0 A"], AMPLITUDE, cycles, identify=False), encoding="utf-8")
    command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--bench", str(bench), "--json"]
    held: list[bool] = []
    with subprocess.Popen(
        [*command, "--out", str(folder / "out")], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as running:
        while running.poll() is None:
            time.sleep(0.5)
            held += [has_priority(process) for process in stations_of(running.pid)]
        answer = json.loads(running.stdout.read() if running.stdout is not None else "")
    if not answer.get("setpoints"):
        raise RuntimeError(f"the campaign ended with {running.returncode}: {answer.get('error')}")
    verdicts = [point["verdict"] for point in answer["points"]]
    ended = {"exit_code": running.returncode, "stopped_by": answer["stopped_by"], "error": answer.get("error")}
    return {**answer["setpoints"], **ended, "verdicts": verdicts, "real_time_share": sum(held) / max(1, len(held))}


def stations_of(parent: int) -> list[int]:
    """Process ids of the stations that a process has started."""
    command = ["pgrep", "-P", str(parent), "-f", "rig.station"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    return [int(word) for word in found.stdout.split()]


def has_priority(process: int) -> bool:
    """Whether a process has real-time priority at this moment: what was given can be taken back."""
    try:
        return os.sched_getscheduler(process) == os.SCHED_FIFO
    except ProcessLookupError:
        return False


@contextmanager
def simulated_rig(folder: Path, real_time: bool) -> Iterator[Path]:
    """A simulated rig without a function generator, in a process of its own, and the bench file that it wrote.

    Raises:
        RuntimeError: it did not start.
    """
    bench = folder / "bench.toml"
    rights = ["--real-time"] if real_time else ["--no-real-time", "--drop-unread"]
    command = [sys.executable, "-m", "simulators", "--actuator", "setpoints", *rights, "--bench", str(bench)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as rig:
        try:
            if rig.stdout is None or not rig.stdout.readline():
                raise RuntimeError("the simulated rig did not start")
            yield bench
        finally:
            rig.terminate()


def be_patient(bench: Path, poll_ms: float) -> None:
    """Give a bench file this poll, and other time limits that stop nothing before it is measured."""
    text = bench.read_text(encoding="utf-8")
    text = re.sub(r'(\nstale_after|\ntimeout|\nlate_limit) = "\d+ ms"', r'\1 = "500 ms"', text)
    text = re.sub(r'\nwatchdog = "\d+ ms"', '\nwatchdog = "2000 ms"\nsetpoint_late = "500 ms"', text)
    bench.write_text(text.replace('poll = "10 ms"', f'poll = "{poll_ms:g} ms"'), encoding="utf-8")


def measure(seconds: float, poll_ms: float, real_time: bool, folder: Path) -> dict[str, Any]:
    """Start the simulated rig, poll it, stream to it, end it."""
    with simulated_rig(folder, real_time) as bench:
        polls_hz = polled_hz(Bench.load(bench).actuator.url)
        be_patient(bench, poll_ms)
        bare_s = bare_p99_s(1e-3 * poll_ms, real_time)
        before_s, began_s = stolen_s(), time.monotonic()
        counted = streamed(bench, seconds, folder)
        share = (stolen_s() - before_s) / ((time.monotonic() - began_s) * (os.cpu_count() or 1))
    skipped = counted["skipped"] / max(1, counted["steps"])
    return {
        **counted, "skipped_share": skipped, "rate_Hz": 1e3 / poll_ms, "polls_Hz": polls_hz,
        "steal_share": share, "bare_p99_s": bare_s, "processors": os.cpu_count(),
        "within": counted["p99_s"] <= GOAL_P99_S and skipped < GOAL_SKIPPED and polls_hz >= GOAL_POLLS_HZ,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--poll-ms", type=float, default=4.0)
    parser.add_argument("--no-real-time", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="setpoints-") as name:
        result = measure(given.seconds, given.poll_ms, not given.no_real_time, Path(name))
    if given.json:
        print(json.dumps(result, indent=1))
        return
    if result["exit_code"]:
        print(f"the campaign ended with {result['exit_code']}: {result['error']}")
    rights, late = 100 * result["real_time_share"], 1e3 * result["p99_s"]
    print(
        f"{result['steps']} set-points at {result['rate_Hz']:g} Hz, real-time priority {rights:.0f} % of the time\n"
        f"p99 {late:.1f} ms late (goal {1e3 * GOAL_P99_S:g}), worst {1e3 * result['worst_s']:.1f} ms; "
        f"{result['skipped']} left out, {100 * result['skipped_share']:.3f} % (goal below {100 * GOAL_SKIPPED:g} %)\n"
        f"a loop that only sleeps: p99 {1e3 * result['bare_p99_s']:.1f} ms late; steal "
        f"{100 * result['steal_share']:.1f} % of {result['processors']} processors\n"
        f"{result['polls_Hz']:.0f} status blocks a second (goal {GOAL_POLLS_HZ:g})"
    )


if __name__ == "__main__":
    main()
