"""The simulated rig of a bench file on real wires: `python -m simulators.testing.rehearsal BENCH MATRIX OUT`.

Sensors are sockets, the controller Modbus TCP (or RTU where the bench says so), the CAN bus slcan over a socket. OUT is
the same bench file with the addresses; its path is the first line printed, once everything is open. SIGTERM ends it.
"""

from __future__ import annotations

import asyncio
import os
import select
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from rig.bench.model import Bench
from rig.clock import monotonic_ns
from rig.errors import RigError

START_TIMEOUT_S = 180.0
STOP_TIMEOUT_S = 30.0


async def serve(bench: Path, matrix: Path, out: Path) -> None:
    """Open everything, say so, run until signalled.

    Raises:
        FileProblem: a file cannot be used, or no simulated rig can stand in for the bench.
    """
    # loads numba and numpy: only when needed
    from rig.matrix.model import load_matrix
    from simulators.rig import RunOptions, SimulatedRig
    from simulators.scenarios.user_bench import UserBench

    user = UserBench.load(bench, load_matrix(matrix))
    rig = SimulatedRig(user.options, RunOptions(
        ports="socket", actuator=user.actuator, drop_unread=True, auxiliaries=user.auxiliaries, exit_when_idle=True,
    ))  # fmt: skip
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, rig.stop)
    rig.warm_up()
    text = user.text(rig, await rig.open())
    await asyncio.to_thread(out.write_text, text, encoding="utf-8")
    sys.stdout.write(f"{out}\n")
    sys.stdout.flush()
    await rig.run()
    await rig.close()


@dataclass
class RigProcess:
    """A simulated rig that runs.

    Attributes:
        process: in which it runs.
        bench_path: the bench file with its addresses, for `rig run --bench` and for drivers.
    """

    process: subprocess.Popen[bytes]
    bench_path: Path
    log_path: Path = field(default_factory=Path)

    @property
    def bench(self) -> Bench:
        """That file, read."""
        return Bench.load(self.bench_path)

    def stop(self) -> None:
        """End it; every wire falls silent. Ending it twice is harmless."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()


def start(command: list[str], log_path: Path) -> RigProcess:
    """Start a simulated rig whose first line is the path of its bench file; return when its wires are open.

    Args:
        command: arguments of Python.
        log_path: for what it says.

    Raises:
        RigError: it ended before it was ready, or was not ready in time; what it said is in the message.
    """
    with log_path.open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-P", *command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log,
            start_new_session=True,
        )  # fmt: skip
    line = _first_line(process)
    rig = RigProcess(process, Path(line), log_path)
    if not line:
        rig.stop()
        tail = log_path.read_text(encoding="utf-8", errors="replace")[-2000:].strip()
        raise RigError(f"the simulated rig did not start (exit code {process.returncode}); its output:\n{tail}")
    return rig


def _first_line(process: subprocess.Popen[bytes]) -> str:
    """The first line without its end; empty when the process ends or is silent."""
    if process.stdout is None:
        return ""
    descriptor, line, began_ns = process.stdout.fileno(), b"", monotonic_ns()
    while b"\n" not in line:
        left_s = START_TIMEOUT_S - (monotonic_ns() - began_ns) * 1e-9
        if left_s <= 0.0 or not select.select([descriptor], [], [], left_s)[0]:
            return ""
        chunk = os.read(descriptor, 4096)
        if not chunk:
            return ""
        line += chunk
    return line.split(b"\n", 1)[0].decode("utf-8", "replace").strip()


if __name__ == "__main__":
    try:
        asyncio.run(serve(*(Path(argument).absolute() for argument in sys.argv[1:4])))
    except RigError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
