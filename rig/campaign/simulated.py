"""The simulated rig as a process: started like hardware is switched on, known only by the bench file it prints."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from rig.campaign.options import CampaignOptions
from rig.clock import monotonic_ns
from rig.errors import EXIT_USAGE, Refused, RigError
from rig.matrix.model import Specimen

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 60.0


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
    def start(cls, folder: Path, options: CampaignOptions, specimen: Specimen) -> SimulatedRig:
        """Start it with its truth file and log in `folder`; return when every one of its ports is open.

        It is given the specimen's serial number and mid-stroke, and told to end by itself, at standstill, should this
        process die.

        Raises:
            RigError: it does not take `options.simulator_args`.
            Refused: it ended before it was ready, or was not ready in time; the end of its log is in the message.
        """
        truth_path, log_path = folder / "truth.h5", folder / "simulator.log"
        arguments = ["--speed", str(options.speed), "--seed", str(options.seed), "--truth", str(truth_path)]
        arguments += ["--exit-when-idle", "--specimen", f'serial_number="{specimen.serial_number}"']
        arguments += ["--specimen", f"mid_stroke_m={specimen.mid_stroke_m}"]
        with log_path.open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "simulators", *arguments, *options.simulator_args],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )
        line = _first_line(process, START_TIMEOUT_S)
        if not line:
            process.terminate()
            process.wait(STOP_TIMEOUT_S)
            tail = log_path.read_text(encoding="utf-8", errors="replace")[-2000:].strip()
            if process.returncode == EXIT_USAGE:
                raise RigError(f"arguments of the simulated rig (after --): {tail}")
            raise Refused(
                "simulator", f"the simulated rig did not start (exit code {process.returncode}); it said:\n{tail}"
            )
        return cls(process, Path(line), truth_path)

    def stop(self, settle_s: float = 0.0) -> bool:
        """End it and wait for its truth file; True when it ended by itself in time.

        Args:
            settle_s: wall seconds it is given first, when nobody proved standstill: its dead-men act on their own, and
                what they do belongs to the truth.
        """
        try:
            self.process.wait(settle_s)
        except subprocess.TimeoutExpired:
            self.process.terminate()
        try:
            self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return False
        if self.process.stdout is not None:
            self.process.stdout.close()
        return True


def _first_line(process: subprocess.Popen[bytes], timeout_s: float) -> str:
    """The first line of standard output without its end; empty when the process ends or is silent."""
    if process.stdout is None:
        return ""
    deadline_ns = monotonic_ns() + int(timeout_s * 1e9)
    descriptor, line = process.stdout.fileno(), b""
    while monotonic_ns() < deadline_ns:
        left_s = max(0.0, (deadline_ns - monotonic_ns()) * 1e-9)
        if not select.select([descriptor], [], [], left_s)[0]:
            break
        chunk = os.read(descriptor, 4096)
        if not chunk:
            break
        line += chunk
        if b"\n" in line:
            return line.split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    return ""
