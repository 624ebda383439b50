"""Memory and time of a long point's alignment: ten minutes of three channels at 10 kHz, from journal to finished file.

    python benchmarks/long_alignment.py
    python benchmarks/long_alignment.py --minutes 1

Journal, alignment and file are the recorder's and finaliser's own; the samples are computed. Memory: the largest
resident size of this process so far, interpreter and libraries included.
"""

from __future__ import annotations

import argparse
import mmap
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from campaign_process import machine

from drivers.ring import CHANNELS
from drivers.roles import ProgramPhase
from rig.clock import utc_now
from rig.recording.alignment.alignment import align
from rig.recording.conversion.conversion import finish_point
from rig.recording.journal.journal_file import JournalWriter, scan_journal
from rig.recording.journal.point_journal import ChannelSplit
from rig.recording.layout import PointContext, SensorContext
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.chunked_column import parts
from rig.test_point import TestPoint

RATE_HZ, POLL_HZ, FREQUENCY_HZ = 10_000.0, 100.0, 1.0
SENSORS = {"force": 300.0, "displacement": 0.03, "auxiliary_1": 9.81}
"""Amplitude of each channel, SI."""
LIMIT_MB = 300.0


def context(seconds: float) -> PointContext:
    """The header of the point's journal."""
    return PointContext(
        point=TestPoint(
            "p001", "sine", SENSORS["displacement"], FREQUENCY_HZ, 0.0, int(seconds * FREQUENCY_HZ) - 2,
            ramp_in_cycles=1.0, ramp_out_cycles=1.0, centre_m=0.0, repeat=1, rest_s=0.0,
        ),
        sensors={name: SensorContext(name, RATE_HZ, 1e-4) for name in SENSORS}, controller_delay_s=0.0,
    )


def write_journal(path: Path, seconds: float) -> None:
    """A second at a time: three sensors, their edges, and the controller's record."""
    writer = JournalWriter(path, context(seconds).to_json())
    random = np.random.default_rng(1)
    for second in range(int(seconds)):
        found = []
        for name, amplitude in SENSORS.items():
            count = int(RATE_HZ)
            time_s = second + np.arange(count) / RATE_HZ
            value = amplitude * np.sin(2 * np.pi * FREQUENCY_HZ * time_s)
            value += 0.01 * amplitude * random.standard_normal(count)
            found.append(block(CHANNELS[name], time_s, value, second * count + np.arange(count)))
            if name != "auxiliary_1":
                pulse = np.array([float(second)])
                found.append(block(CHANNELS[f"{name}_edge"], pulse, np.zeros(1), np.array([second % 256])))
        poll_s = second + np.arange(int(POLL_HZ)) / POLL_HZ
        wave = np.sin(2 * np.pi * FREQUENCY_HZ * poll_s)
        ramps = (poll_s < 1.0 / FREQUENCY_HZ) | (poll_s > seconds - 1.0 / FREQUENCY_HZ)
        phase = np.where(ramps, float(ProgramPhase.RAMP_IN), float(ProgramPhase.FULL_AMPLITUDE))
        for name, value in (
            ("position", SENSORS["displacement"] * wave), ("controller_force", SENSORS["force"] * wave),
            ("phase", phase), ("coil_current", 0.0 * wave),
        ):
            found.append(block(CHANNELS[name], poll_s, value, 0 * poll_s.astype(np.int64)))
        found.append(block(CHANNELS["pulse"], np.array([float(second)]), np.array([float(second)]), np.array([second])))
        records = np.concatenate(found)
        writer.append(records[np.argsort(records["host_ns"], kind="stable")])
    writer.close(stopped_by=None, lost_records=0)


def block(channel: int, time_s: np.ndarray, value: np.ndarray, sequence: np.ndarray) -> np.ndarray:
    """Records of one channel (n,)."""
    records = np.zeros(len(time_s), RECORD_DTYPE)
    records["host_ns"], records["device_us"] = np.round(1e9 * (time_s + 2e-3)), np.round(1e6 * time_s)
    records["value"], records["sequence"], records["channel"] = value, sequence, channel
    return records


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--minutes", type=float, default=10.0)
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "p001.journal"
        write_journal(path, 60.0 * given.minutes)
        before_mb = peak_mb()
        with ChannelSplit(Path(folder)) as split:
            began_s = time.process_time()
            with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as journal:
                content = scan_journal(journal, str(path), split.take)
            alignment = align(split.channels(), PointContext.from_json(content.context_json))
            for values in (alignment.time_s, alignment.flags, *alignment.values.values()):
                for rows in parts(len(values)):
                    np.asarray(values[rows])
            align_s = time.process_time() - began_s
            match = alignment.timed["force"].sensor.match
        align_mb = peak_mb()
        began_s = time.process_time()
        finished = finish_point(path)
        file_s, file_mb = time.process_time() - began_s, peak_mb()
    print(f"{utc_now().date()}, {machine()}; {given.minutes:g} min, {len(SENSORS)} channels at {RATE_HZ:g} Hz")
    print(f"before: {before_mb:.0f} MB; aligned: {align_mb:.0f} MB, {align_s:.1f} s of CPU, lag of the force "
          f"{'not known' if match is None else f'{1e6 * match.lag_s:.1f} +- {1e6 * match.lag_std_s:.1f} us'}")
    print(f"finished ({finished.verdict}): {file_mb:.0f} MB, {file_s:.1f} s of CPU")
    return 0 if align_mb <= LIMIT_MB else 1


def peak_mb() -> float:
    """Largest resident size so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


if __name__ == "__main__":
    sys.exit(main())
