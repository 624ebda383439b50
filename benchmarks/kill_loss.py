"""How much of a running point kill -9 of the application costs: wall time from the last recorded sample to the kill.

    python benchmarks/kill_loss.py [--kills 100] [--rate 250] [--json]

A process feeds a ring as the station does (force, displacement and status), another one records from it and is killed
at a random moment. The journal is then recovered: every sample must be a true one and in order.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.ring import Channel, RingWriter
from rig.clock import monotonic_ns
from rig.recording.journal.journal_file import read_journal
from rig.recording.journal.recorder import PointRecorder
from rig.recording.layout import PointContext, SensorContext
from rig.test_point import TestPoint

TICK_S = 0.004
STATUS_CHANNELS = (Channel.POSITION, Channel.STATE, Channel.COIL_CURRENT, Channel.COIL_TEMPERATURE)
EARLIEST_S, LATEST_S = 0.15, 0.60


@dataclass(frozen=True)
class Kill:
    """One kill: loss (s), samples recorded, and whether all of them were true."""

    loss_s: float
    samples: int
    true: bool


def feed(path: Path, rate_Hz: float) -> None:
    """Fill a ring for ever, at `rate_Hz` a sensor; a sample's value is its own sequence."""
    pause = threading.Event()
    with RingWriter(path, 1 << 16) as ring:
        sequence, began_ns = 0, monotonic_ns()
        while True:
            now_ns = monotonic_ns()
            due = int((now_ns - began_ns) * 1e-9 * rate_Hz)
            records = [
                (now_ns, -1, float(number), number, channel, 0)
                for number in range(sequence, due)
                for channel in (Channel.FORCE, Channel.DISPLACEMENT)
            ]
            sequence = due
            ring.append(records + [(now_ns, -1, 0.0, 0, channel, 0) for channel in STATUS_CHANNELS])
            pause.wait(TICK_S)


def record(ring: Path, folder: Path, rate_Hz: float) -> None:
    """Record one point until killed."""
    sensors = {name: SensorContext(name, rate_Hz) for name in ("force", "displacement")}
    point = TestPoint("p001", "sine", 0.01, 1.0, 0.0, 9)
    recorder = PointRecorder(ring, folder)
    recorder.begin(PointContext(point=point, sensors=sensors), expected_s=10.0)
    threading.Event().wait()


def forked(work: object, *arguments: object) -> int:
    """Run `work` in a process of its own; returns its id."""
    child = os.fork()
    if child == 0:
        try:
            work(*arguments)  # type: ignore[operator]  # a function of this file
        finally:
            os._exit(0)
    return child


def one_kill(folder: Path, ring: Path, rate_Hz: float, delay_s: float) -> Kill:
    """Record for a while, kill, and look at what is there."""
    folder.mkdir()
    recorder = forked(record, ring, folder, rate_Hz)
    threading.Event().wait(delay_s)
    killed_ns = monotonic_ns()
    os.kill(recorder, signal.SIGKILL)
    os.waitpid(recorder, 0)
    content = read_journal(folder / "p001.journal")
    records = content.records
    sensors = records[np.isin(records["channel"], (Channel.FORCE, Channel.DISPLACEMENT))]
    force = sensors[sensors["channel"] == Channel.FORCE]
    true = bool(np.array_equal(sensors["value"], sensors["sequence"]) and np.all(np.diff(force["sequence"]) == 1))
    last_ns = int(records["host_ns"].max()) if len(records) else killed_ns - int(1e9 * delay_s)
    return Kill((killed_ns - last_ns) * 1e-9, len(sensors), true and content.damaged_bytes == 0)


def main() -> int:
    """Kill, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--rate", type=float, default=250.0, help="samples a second of each of two sensors")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as place:
        ring = Path(place) / "ring"
        feeder = forked(feed, ring, options.rate)
        pause = threading.Event()
        while not ring.exists():
            pause.wait(0.01)
        pause.wait(0.1)
        try:
            kills = [
                one_kill(Path(place) / f"k{number}", ring, options.rate, chance.uniform(EARLIEST_S, LATEST_S))
                for number in range(options.kills)
            ]
        finally:
            os.kill(feeder, signal.SIGKILL)
            os.waitpid(feeder, 0)
    loss_ms = 1e3 * np.array([kill.loss_s for kill in kills])
    found = {
        "kills": len(kills), "rate_Hz": options.rate, "samples": sum(kill.samples for kill in kills),
        "false_samples": sum(not kill.true for kill in kills), "median_ms": float(np.median(loss_ms)),
        "p99_ms": float(np.percentile(loss_ms, 99)), "largest_ms": float(loss_ms.max()),
    }  # fmt: skip
    text = "{kills} kills at 2 x {rate_Hz:g} Hz, {samples} samples: loss median {median_ms:.1f} ms, " \
        "p99 {p99_ms:.1f} ms, largest {largest_ms:.1f} ms; journals with a false sample: {false_samples}"
    sys.stdout.write((json.dumps(found) if options.json else text.format(**found)) + "\n")
    return 0 if found["largest_ms"] < 100.0 and found["false_samples"] == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
