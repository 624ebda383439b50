"""A station on a simulated rig: two real processes on real transports, for tests that drive the station directly."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.machine_resources import station_config
from rig.clock import monotonic_ns
from rig.matrix.model import load_matrix
from rig.station.client import StationClient, StationLost

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
mid_stroke = "0 mm"
[matrix]
waveform = ["sine"]
amplitude = ["10 mm"]
frequency = ["2 Hz"]
current = ["1 A"]
"""
BEAT_S = 0.02
PATIENCE_S = 60.0
"""Wall seconds for what must happen; never for how fast it happens."""


class Truth:
    """What really happened: arrays on the simulated clock, and the rig's log of commands."""

    def __init__(self, path: Path) -> None:
        with h5py.File(path) as file:
            data = file["entry/data"]
            self.names = list(data)
            self.time_s = data["time"][:]
            self.displacement_m = data["displacement"][:]
            self.velocity_m_s = data["velocity"][:]
            self.current_A = data["current"][:]
            events = file["entry/events"]
            lines = zip(events["time_ns"], events["code"], strict=True)
            self.log = [(1e-9 * float(time_ns), code.decode()) for time_ns, code in lines]

    def still_after(self, code: str, within_s: float) -> bool:
        """The rod stands still at the end, and from `within_s` of the rig's clock after that code in its log."""
        began_s = next(when_s for when_s, each in self.log if each == code)
        later = np.abs(self.velocity_m_s[self.time_s > began_s + within_s])
        return self.at_rest(0.05) and bool(np.all(later < 2e-3))

    def at_rest(self, last_s: float) -> bool:
        """The rod stood still over the last seconds recorded."""
        tail = self.displacement_m[self.time_s > self.time_s[-1] - last_s]
        return bool(np.ptp(tail) < 1e-3)


class StationRig:
    """One simulated rig and one station on it; `stop_beating` makes the application fall silent."""

    def __init__(self, folder: Path, speed: float, arguments: tuple[str, ...], **changes: object) -> None:
        self.folder = folder
        self.truth_path = folder / "truth.h5"
        with (folder / "simulators.log").open("w") as log:
            self.simulators = subprocess.Popen(
                [sys.executable, "-m", "simulators", "--speed", str(speed), "--seed", "1",
                 "--truth", str(self.truth_path), *arguments],
                stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True,
            )  # fmt: skip
        if self.simulators.stdout is None:
            raise RuntimeError("no pipe from the simulated rig")
        self.bench_path = Path(self.simulators.stdout.readline().strip())
        (folder / "matrix.toml").write_text(MATRIX)
        config = station_config(Bench.load(self.bench_path), load_matrix(folder / "matrix.toml"), folder / "ring")
        self.config: StationConfig = replace(config, **changes)
        self.client = StationClient.start(self.config, folder)
        self.seen: list[dict[str, Any]] = []
        self._silent = threading.Event()
        self._beats = threading.Thread(target=self._beat, daemon=True)
        self._beats.start()

    def _beat(self) -> None:
        while not self._silent.wait(BEAT_S):
            try:
                self.client.beat(True)
            except StationLost:
                return

    def stop_beating(self) -> int:
        """The application falls silent; host time (ns) of its last beat."""
        self._silent.set()
        self._beats.join()
        return monotonic_ns()

    def event(self, name: str, timeout_s: float = PATIENCE_S) -> dict[str, Any]:
        """The first event of that name since the start, waiting for it."""
        deadline_ns = monotonic_ns() + int(timeout_s * 1e9)
        while True:
            found = [event for event in self.seen if event["event"] == name]
            if found:
                return found[0]
            left_s = (deadline_ns - monotonic_ns()) / 1e9
            if left_s <= 0 or not self.client.alive:
                self.seen += self.client.events()
                found = [event for event in self.seen if event["event"] == name]
                if found:
                    return found[0]
                raise AssertionError(f"no event {name!r} within {timeout_s} s; seen: {self.seen}; log: {self.log()}")
            self.seen += self.client.events(timeout_s=min(left_s, 0.2))

    def log(self) -> str:
        """The end of the station's log."""
        return (self.folder / "station.log").read_text()[-2000:]

    def prepare(self) -> None:
        """Connected, armed, full pressure, holding at the centre."""
        self.client.request("connect")
        self.client.request("arm")
        self.client.request("hydraulics", level="low")
        self.client.request("hydraulics", level="on")

    def run(self, **changes: object) -> dict[str, Any]:
        """Start a sine of 10 mm at 2 Hz under 1 A that lasts longer than any test."""
        self.client.request("set_current", current_A=1.0)
        program: dict[str, Any] = {
            "waveform": "sine", "amplitude_m": 0.010, "frequency_Hz": 2.0, "centre_m": 0.0, "cycles": 2000,
            "ramp_in_cycles": 1, "ramp_out_cycles": 1,
        }  # fmt: skip
        return self.client.request("start", **(program | changes))

    def await_motion(self, position_m: float) -> None:
        """Wait until the station has seen the rod that far from the centre, with nothing tripped."""
        deadline_ns = monotonic_ns() + int(PATIENCE_S * 1e9)
        while True:
            status = self.client.request("status")
            assert status["trip"] is None, status
            if abs(status["position_m"] or 0.0) > position_m and status["state"] == "RUNNING":
                return
            assert monotonic_ns() < deadline_ns, status

    def truth(self) -> Truth:
        """End the simulated rig and read what really happened."""
        self.simulators.send_signal(signal.SIGTERM)
        self.simulators.wait(30)
        return Truth(self.truth_path)

    def end(self) -> None:
        """End both processes."""
        self._silent.set()
        if self.client.process.poll() is None:
            self.client.close(timeout_s=0.1)
            if self.client.process.poll() is None:
                self.client.process.kill()
        self.client.close(timeout_s=5.0)
        if self.simulators.poll() is None:
            os.kill(self.simulators.pid, signal.SIGTERM)
            self.simulators.wait(30)
        if self.simulators.stdout is not None:
            self.simulators.stdout.close()


@pytest.fixture
def station_rig(tmp_path: Path) -> Iterator[Callable[..., StationRig]]:
    """Makes stations on simulated rigs: `station_rig("--fault", "estop@1", speed=1.0, **config_changes)`."""
    made: list[StationRig] = []

    def make(*arguments: str, speed: float = 1.0, **changes: object) -> StationRig:
        folder = tmp_path / str(len(made))
        folder.mkdir()
        made.append(StationRig(folder, speed, arguments, **changes))
        return made[-1]

    yield make
    for rig in made:
        rig.end()
