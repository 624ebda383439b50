"""What really happened: the plant's true state, every command and fault, in an HDF5 file of the run layout.

While the rig runs, rows go to an append-only binary beside the file (`FILE.part`) and events to `FILE.events.jsonl`, so
that a killed rig leaves them readable; at the end they become the HDF5 file and go.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.roles import State
from rig.clock import monotonic_ns
from rig.recording.atomic_write import room_for_truth
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, Event, PointFile
from simulators.actuator import MODE_STATES
from simulators.plant import step
from simulators.plant.plant import Plant

ROW = np.dtype(
    [("time", "<f8"), ("displacement", "<f4"), ("velocity", "<f4"), ("force", "<f4"), ("current", "<f4"),
     ("coil_temperature", "<f4"), ("piston_position", "<f4"), ("damper_force", "<f4"), ("damper_displacement", "<f4"),
     ("accumulator_pressure", "<f4"), ("body_temperature", "<f4"), ("controller_state", "<i2")]
)
CHANNELS = (
    ("displacement", "m", "True extension at the LVDT"),
    ("velocity", "m/s", "True velocity at the LVDT"),
    ("force", "N", "True force at the load cell"),
    ("current", "A", "True coil current"),
    ("coil_temperature", "degC", "True coil temperature"),
    ("piston_position", "m", "True position of the actuator's piston, before the load train"),
    ("damper_force", "N", "Force of the damper alone, without the moving mass"),
    ("damper_displacement", "m", "Extension of the damper itself, relative to mid-stroke"),
    ("accumulator_pressure", "Pa", "Pressure at the servo valve"),
    ("body_temperature", "degC", "True temperature of the damper's body"),
    ("controller_state", "1", "Controller state: " + ", ".join(f"{state.value} {state.name}" for state in State)),
)
COLUMNS = (
    step.DISPLACEMENT, step.VELOCITY, step.FORCE, step.CURRENT, step.COIL_TEMPERATURE, step.PISTON, step.DAMPER_FORCE,
    step.DAMPER_DISPLACEMENT, step.ACCUMULATOR, step.BODY_TEMPERATURE,
)
"""Where the plant's output holds the channels, controller_state apart."""
BLOCK_ROWS = 64
FULL_DISK_S = 600.0
"""How long the end of a session waits for room on a full disk (wall s)."""
_TRIPPED = 16
STATE_OF_MODE = np.array([int(MODE_STATES[mode]) for mode in sorted(MODE_STATES)], np.int16)

TYPES: dict[str, type] = {"controller_state": np.int8}

Attribute = str | int | float | list[str]


@dataclass(frozen=True)
class About:
    """Attributes of the truth file.

    Attributes:
        test: damper model, parameters, specimen, faults.
        quality: dropped counts.
        provenance: seed, speed, options, clocks.
    """

    test: Mapping[str, Attribute]
    quality: Mapping[str, Attribute]
    provenance: Mapping[str, Attribute]


class Truth:
    """Collects the true state; a rig without `--truth` has none of these.

    Attributes:
        path: the HDF5 file that `finish` writes.
    """

    def __init__(self, path: Path, plant: Plant, rate_Hz: float) -> None:
        self.path = path
        self._plant = plant
        self._every = max(1, round(1.0 / (plant.dt_s * rate_Hz)))
        self._rows_path = path.with_name(path.name + ".part")
        self._events_path = path.with_name(path.name + ".events.jsonl")
        path.parent.mkdir(parents=True, exist_ok=True)
        # Its lock is held until the HDF5 file is complete or this process dies: others can tell and wait.
        self._rows = Spool(self._rows_path)
        self._events = Spool(self._events_path)
        self._pending: list[tuple[int, NDArray[np.float64], int]] = []
        self._pending_rows = 0

    def slice(self) -> None:
        """Take the plant's last slice, thinned to the truth's rate."""
        plant = self._plant
        first = -(plant.first_step + 1) % self._every
        out = plant.out[first :: self._every]
        if len(out):
            self._pending.append((plant.first_step + 1 + first, out.copy(), int(plant.command["pressure"][0])))
            self._pending_rows += len(out)
            if self._pending_rows >= BLOCK_ROWS:
                self._flush()

    def note(self, code: str, text: str, time_s: float | None = None) -> None:
        """Log a command, a fault or a trip at simulated time `time_s` (s), now when not given."""
        time_ns = round((self._plant.time_s if time_s is None else time_s) * 1e9)
        record = {"time_ns": time_ns, "host_ns": monotonic_ns(), "code": code, "text": text}
        self._events.write(json.dumps(record).encode() + b"\n")

    def finish(self, about: About) -> None:
        """Write the HDF5 file from what was collected and remove the pieces; a full disk is waited for.

        Args:
            about: what the file says of its origin.

        Raises:
            OSError: the file cannot be written; the pieces stay.
        """
        self._flush()
        rate_Hz = 1.0 / (self._plant.dt_s * self._every)

        def complete() -> bool:
            if not (self._rows.push() and self._events.push()):
                return False
            convert(self.path, self._rows_path, self._events_path, rate_Hz, about)
            return True

        when_there_is_room(
            self.path.parent, lambda: room_for_truth(self._rows_path.stat().st_size), complete, FULL_DISK_S
        )
        self._events.close()
        self._rows_path.unlink()
        self._events_path.unlink()
        self._rows.close()

    def _flush(self) -> None:
        """Write what was collected as rows of the file."""
        if self._pending:
            self._rows.write(self._as_rows().tobytes())
        self._pending.clear()
        self._pending_rows = 0

    def _as_rows(self) -> NDArray[Any]:
        """What was collected: of each slice the number of its first step, outputs and ordered pressure."""
        firsts, outs, pressures = zip(*self._pending, strict=True)
        counts = [len(out) for out in outs]
        steps = [first + self._every * np.arange(count) for first, count in zip(firsts, counts, strict=True)]
        out = np.concatenate(outs)
        rows = np.empty(len(out), ROW)
        rows["time"] = np.concatenate(steps) * self._plant.dt_s
        for column, (name, _, _) in zip(COLUMNS, CHANNELS[:-1], strict=True):
            rows[name] = out[:, column]
        rows["controller_state"] = _states(out[:, step.MODE], np.repeat(pressures, counts))
        return rows


def _states(mode_and_trip: NDArray[np.float64], pressure: NDArray[np.int64]) -> NDArray[np.int16]:
    """Controller states (n,) from the plant's last column: mode, plus 16 when tripped; ordered pressure (n,)."""
    coded = mode_and_trip.astype(np.int64)
    states = STATE_OF_MODE[coded % _TRIPPED]
    states = np.where((pressure == 1) & (states == State.HOLD), np.int16(State.LOW), states)
    return np.where(coded >= _TRIPPED, np.int16(State.TRIPPED), states)


def convert(path: Path, rows_path: Path, events_path: Path, rate_Hz: float, about: About) -> None:
    """Make the HDF5 file of the collected rows and events; an unfinished last row or line is left out.

    Raises:
        OSError: a piece cannot be read or the file not be written.
    """
    raw = rows_path.read_bytes()
    rows = np.frombuffer(raw[: len(raw) // ROW.itemsize * ROW.itemsize], ROW)
    events = []
    for line in events_path.read_text(encoding="utf-8").splitlines(keepends=True):
        if line.endswith("\n"):
            record = json.loads(line)
            events.append(Event(record["time_ns"], record["code"], f"{record['text']}; host_ns={record['host_ns']}"))
    channels = [
        AlignedChannel(name, rows[name].astype(TYPES.get(name, np.float32)), unit, long_name, "plant")
        for name, unit, long_name in CHANNELS
    ]
    write_file(
        path,
        PointFile(
            rows["time"].astype(np.float64), rate_Hz, channels, events=events, test=about.test, quality=about.quality,
            provenance=about.provenance, title="True state of the simulated rig",
        ),
    )


FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
MOST_WAITING_BYTES = 1 << 29
LOOK_AGAIN_S = 0.25


class Spool:
    """A new file, locked while it is open.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        fcntl.flock(self._handle, fcntl.LOCK_EX)
        self._waiting = bytearray()

    def write(self, data: bytes) -> None:
        """Append; on a full disk later.

        Raises:
            OSError: the disk refuses for another reason, or has been full for too long.
        """
        self._waiting += data
        if not self.push() and len(self._waiting) > MOST_WAITING_BYTES:
            raise OSError(errno.ENOSPC, "no disk space for pending data", str(self.path))

    def push(self) -> bool:
        """Write what waits; True when nothing waits any more.

        Raises:
            OSError: the disk refuses for another reason than being full.
        """
        while self._waiting:
            try:
                del self._waiting[: os.write(self._handle, self._waiting)]
            except OSError as error:
                if error.errno not in FULL:
                    raise
                return False
        return True

    def close(self) -> None:
        """Give the lock back."""
        os.close(self._handle)


def when_there_is_room(folder: Path, needed: Callable[[], int], do: Callable[[], bool], longest_s: float) -> None:
    """Try again and again to write, as long as the disk is full.

    Args:
        folder: on the disk in question.
        needed: bytes that must be free before it is worth a try.
        do: tries; False when the disk was full.
        longest_s: how long to go on (wall s).

    Raises:
        OSError: the disk was full all the time, or refuses for another reason.
    """
    until_s, waits = time.monotonic() + longest_s, False
    while True:
        try:
            room = os.statvfs(folder)
            if room.f_bavail * room.f_frsize >= needed() and do():
                return
        except OSError as error:
            if error.errno not in FULL:
                raise
        if not waits:
            waits = True
            print(  # noqa: T201 - to the process that waits for this one
                f"simulated rig: no disk space in {folder}; waiting up to {longest_s:g} "
                "s; a second signal ends this process and leaves an incomplete file", file=sys.stderr, flush=True,
            )
        if time.monotonic() > until_s:
            raise OSError(errno.ENOSPC, f"no disk space for {longest_s:g} s", str(folder))
        # Room on a disk cannot be waited for otherwise.
        time.sleep(LOOK_AGAIN_S)
