"""The simulated rig as a process: started as hardware is switched on, known only by the bench file it prints."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.posix import fcntl
from drivers.prepared import Prepared, start_program
from drivers.processes import stat_fields
from rig.bench.model import Bench
from rig.campaign.results import CampaignOptions, Display
from rig.campaign.words import say
from rig.campaign_folder import CampaignFolder
from rig.clock import monotonic_ns
from rig.errors import EXIT_USAGE, FileProblem, Refused, RigError
from rig.matrix.sections import Specimen
from rig.recording.atomic_write import open_to_append, room_for_truth

SLOW_START_S = 3.0
START_TIMEOUT_S = 180.0
"""Time without any CPU use (s); the first start on a computer compiles the loop: 8 s, or 45 s on two busy cores."""
STOP_TIMEOUT_S = 60.0
EARLIER_RIG_S = 120.0
"""How long a simulated rig whose campaign was killed may need to come to rest and complete its truth file."""
DISK_PATIENCE_S = 5.0
"""A simulated rig on a full disk completes its truth file when there is room again: it is not waited for."""
LOOK_AGAIN_S = 0.1
STREAMED = "setpoints"
REACHED = {"position_m": 0.085, "speed_m_s": 0.8, "acceleration_m_s2": 60.0, "force_N": 5e3, "current_A": 3.0}
"""What the simulated machine reaches."""


def wearing(path: Path) -> tuple[str, ...]:
    """Arguments with which the simulated rig has the devices of a bench file: its controller, ECU and sensor formats.

    Its ports are its own, and so is the bench file that it writes; limits are the file's, where the simulated machine
    reaches them.

    Raises:
        FileProblem: the file cannot be used, or describes an ECU or a supply within itself, which only a file of its
            own can hand on.
    """
    bench = Bench.load(path)
    problems = [
        f"{place}: the device is described in the bench file itself. Fix: write the description to a separate file "
        "and enter the file's name; a simulated rig can then emulate the device"
        for place, given in (("ecu.roles", bench.ecu.roles), ("ecu.supply", bench.ecu.supply))
        if isinstance(given, Mapping)
    ]
    if problems:
        raise FileProblem(str(path), problems, "config-absurd")
    actuator, ecu, limits = bench.actuator, bench.ecu, bench.limits
    link = "rtu" if actuator.url.startswith("modbus-rtu") else "tcp"
    arguments = ["--actuator", STREAMED if actuator.map_name == "demo-streamed" else link]
    if actuator.map_name not in {"demo", "demo-streamed"}:
        arguments += ["--register-map", actuator.map_name]
    if isinstance(ecu.roles, str):
        arguments += ["--dbc", ecu.dbc_name, "--ecu-roles", ecu.roles]
    if ecu.by_hand:
        arguments += ["--by-hand", ecu.pressure_while_asked]
    if isinstance(ecu.supply, str):
        arguments += ["--supply", ecu.supply]
    for option, name, sensor in (
        ("--force-format", "load_cell", bench.load_cell), ("--displacement-format", "lvdt", bench.lvdt),
    ):  # fmt: skip
        arguments += [option, json.dumps(sensor.format) if isinstance(sensor.format, Mapping) else str(sensor.format)]
        arguments += ["--option", f"{name}.rate_Hz={sensor.rate_Hz}", "--option", f"{name}.baudrate={sensor.baudrate}"]
    options = {
        "position_m": min(map(abs, limits.position_m)), "speed_m_s": limits.speed_m_s, "force_N": limits.force_N,
        "acceleration_m_s2": limits.acceleration_m_s2, "current_A": limits.current_A,
    }
    for name, value in options.items():
        arguments += ["--option", f"limits.{name}={min(value, REACHED[name])}"]
    shown = bench.display.model_dump(exclude_none=True)
    arguments += [part for name, value in shown.items() for part in ("--option", f"display.{name}={value}")]
    return tuple(arguments)


def start_process(
    arguments: Sequence[str], log_path: Path, prepared: Prepared | None = None
) -> subprocess.Popen[bytes]:
    """Start `python -m simulators` with these arguments; its standard error is appended to its log.

    Args:
        arguments: of the simulated rig.
        log_path: its log.
        prepared: a process of `simulators.prepared` that may wait; None: the rig is loaded now.
    """
    with open_to_append(log_path) as log, open(os.devnull, "rb") as nothing:
        return start_program("simulators", arguments, {0: nothing, 2: log}, prepared=prepared)


@dataclass
class SimulatedRig:
    """A running `python -m simulators` in a session of its own.

    Attributes:
        process: the simulated rig.
        bench_path: the bench file it wrote.
        truth_path: where its true states are when it has ended.
    """

    process: subprocess.Popen[bytes]
    bench_path: Path
    truth_path: Path

    @classmethod
    def start(
        cls, folder: Path, options: CampaignOptions, specimen: Specimen, waiting: Callable[[float], None]
    ) -> SimulatedRig:
        """Start it with its truth file and log in `folder`; return when every one of its ports is open.

        It is given the specimen's serial number and mid-stroke, and told to end by itself, at standstill, should this
        process die. The truth of an earlier session is kept under another name.

        Args:
            folder: the campaign's directory.
            options: speed, seed and further arguments.
            specimen: the damper.
            waiting: told again and again the seconds waited so far (s); what it raises ends the simulated rig.

        Raises:
            RigError: it does not take `options.simulator_args`.
            Refused: it ended before it was ready, or was not ready in time (the message states which); the end of
                its log is in the message.
        """
        truth_path, log_path = CampaignFolder(folder).truth, CampaignFolder(folder).simulator_log
        keep_truth(CampaignFolder(folder))
        arguments = ["--speed", str(options.speed), "--seed", str(options.seed), "--truth", str(truth_path)]
        arguments += ["--exit-when-idle", "--specimen", f'serial_number="{specimen.serial_number}"']
        arguments += ["--specimen", f"mid_stroke_m={specimen.mid_stroke_m}"]
        process = start_process([*arguments, *options.simulator_args], log_path, options.prepared.rig)
        try:
            line = _first_line(process, START_TIMEOUT_S, waiting)
        except BaseException:
            process.terminate()
            raise
        if not line:
            _end(process)
            tail = log_path.read_text(encoding="utf-8", errors="replace")[-2000:].strip()
            if line is None:
                raise Refused("simulator", f"the simulated rig did not start: it used no processor time for "
                    f"{START_TIMEOUT_S:.0f} s. Fix: check whether it was suspended, then repeat the command. "
                    f"Its output:\n{tail}")
            if process.returncode == EXIT_USAGE:
                raise RigError(f"arguments for the simulated rig (after --): {tail}")
            raise Refused(
                "simulator", f"the simulated rig did not start (exit code {process.returncode}); its output:\n{tail}"
            )
        return cls(process, Path(line), truth_path)

    @property
    def disk_is_full(self) -> bool:
        """Whether its disk is too full for its truth file."""
        try:
            collected = self.truth_path.with_name(self.truth_path.name + ".part").stat().st_size
            return shutil.disk_usage(self.truth_path.parent).free < room_for_truth(collected)
        except OSError:
            return False

    def stop(self, settle_s: float = 0.0, *, disk_refuses: bool = False) -> bool:
        """End it and wait for its truth file; True when it ended by itself in time.

        Args:
            settle_s: wall seconds it is given first, if standstill was not proved: its watchdogs act, and
                what they do belongs to the truth.
            disk_refuses: its disk is full or gone; then, and where it lacks room, it is not waited for long.
        """
        try:
            self.process.wait(settle_s)
        except subprocess.TimeoutExpired:
            self.process.terminate()
        try:
            self.process.wait(DISK_PATIENCE_S)
        except subprocess.TimeoutExpired:
            if disk_refuses or self.disk_is_full:
                return False
        try:
            self.process.wait(STOP_TIMEOUT_S - DISK_PATIENCE_S)
        except subprocess.TimeoutExpired:
            return False
        if self.process.stdout is not None:
            self.process.stdout.close()
        return True


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a simulated rig that did not start, however it takes it."""
    process.terminate()
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def keep_truth(folder: CampaignFolder) -> None:
    """Give the truth of an earlier session another name, once the rig that writes it has ended.

    Raises:
        Refused: that rig still moves.
    """
    _await_end(_pieces(folder.truth)[0])
    number = 1
    while any(piece.exists() for piece in _pieces(folder.session_truth(number))):
        number += 1
    for piece, kept in zip(_pieces(folder.truth), _pieces(folder.session_truth(number)), strict=True):
        if piece.exists():
            piece.rename(kept)


def _pieces(truth: Path) -> list[Path]:
    """The file that a simulated rig writes, its events, and the truth file that it makes of both at its end."""
    return [truth.with_name(truth.name + end) for end in (".part", ".events.jsonl", "")]


def _await_end(part: Path) -> None:
    """Wait until no simulated rig writes `part` any more; it holds a lock on it while it lives.

    Raises:
        Refused: it still does after `EARLIER_RIG_S`.
    """
    try:
        handle = os.open(part, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    deadline_ns = monotonic_ns() + int(EARLIER_RIG_S * 1e9)
    try:
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
                return
            except OSError as error:
                if monotonic_ns() > deadline_ns:
                    raise Refused("two-instances", f"{part}: the simulated rig of the previous session is "
                        "still running") from error
            # A lock cannot be waited for with a time limit.
            time.sleep(LOOK_AGAIN_S)
    finally:
        os.close(handle)


def _first_line(process: subprocess.Popen[bytes], timeout_s: float, waiting: Callable[[float], None]) -> str | None:
    """The first line of standard output without its end; empty when the process ends, None when it is silent and idle.

    On a busy computer it waits for as long as the process gets any processor time: only `timeout_s` without any counts.
    """
    if process.stdout is None:
        return ""
    began_ns = idle_since_ns = monotonic_ns()
    descriptor, line, used = process.stdout.fileno(), b"", 0
    while (monotonic_ns() - idle_since_ns) * 1e-9 < timeout_s:
        if not select.select([descriptor], [], [], min(LOOK_AGAIN_S, timeout_s))[0]:
            if (now_used := _processor_ticks(process.pid)) > used:
                used, idle_since_ns = now_used, monotonic_ns()
            waiting((monotonic_ns() - began_ns) * 1e-9)
            continue
        chunk = os.read(descriptor, 4096)
        if not chunk:
            break
        line += chunk
        if b"\n" in line:
            return line.split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    else:
        return None
    return ""


def _processor_ticks(pid: int) -> int:
    """Processor time that a process has used, in clock ticks; 0 where the system does not tell."""
    fields = stat_fields(pid)
    return 0 if fields is None else int(fields[11]) + int(fields[12])  # utime, stime: fields 14 and 15 of proc(5)


@dataclass
class RigInUse:
    """The rig in use.

    Attributes:
        bench_path: its bench file.
        settle_s: how long a simulated one is left alone before it is ended (wall s).
        disk_refuses: the disk on which it writes its truth is full or gone.
    """

    bench_path: Path
    settle_s: float = 0.0
    disk_refuses: bool = False


@contextmanager
def rig_in_use(
    folder: Path, options: CampaignOptions, specimen: Specimen, display: Display, check: Callable[[], None]
) -> Iterator[RigInUse]:
    """The rig to use; a simulated one runs while the block does, and leaves its truth.

    Args:
        folder: the campaign's directory.
        options: which rig.
        specimen: the damper.
        display: told while a simulated rig starts, and when it goes on running.
        check: asked again and again during that start; what it raises ends the simulated rig.

    Raises:
        RigError: as `SimulatedRig.start`.
        Refused: as `SimulatedRig.start`.
    """
    if options.bench_path is not None:
        yield RigInUse(options.bench_path)
        return

    def waiting(waited_s: float) -> None:
        check()
        if waited_s >= SLOW_START_S:
            display.phase("starting the simulated rig (the first start on a computer takes up to 15 s)")

    simulated = SimulatedRig.start(folder, options, specimen, waiting)
    rig = RigInUse(simulated.bench_path)
    try:
        yield rig
    finally:
        if not simulated.stop(rig.settle_s, disk_refuses=rig.disk_refuses):
            full = rig.disk_refuses or simulated.disk_is_full
            why = ": it will complete truth.h5 as soon as disk space is available" if full else ""
            display.message("warning", say("rig-goes-on", process=simulated.process.pid, why=why))
