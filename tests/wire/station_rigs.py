"""A station on a simulated rig, driven directly: on real processes and wires, or in virtual time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from matrices import matrix_text
from scenario_campaign import simulated_rig
from true_states import Truth

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.machine_resources import station_config
from rig.clock import monotonic_ns
from rig.matrix.model import load_matrix
from rig.station.client import StationClient, StationLost
from simulators.scenarios.machine import Process
from simulators.scenarios.stage import Stage

MATRIX = matrix_text("1 A", amplitude="10 mm")
BEAT_S = 0.02
PATIENCE_S = 60.0
"""Seconds for what must happen; never for how fast it happens."""
Result = TypeVar("Result")
Change = Callable[[Any], object]
"""What takes the place of a setting of the station, made of it."""


class StationRig:
    """What tests do with a station and its simulated rig, wherever the two run.

    Attributes:
        client: the application's end of the station's link.
        config: what the station was told.
        seen: its events so far.
    """

    client: Any

    def __init__(self, folder: Path, bench: Path, **changes: Change) -> None:
        self.folder = folder
        (folder / "matrix.toml").write_text(MATRIX)
        config = station_config(Bench.load(bench), load_matrix(folder / "matrix.toml"), folder / "ring")
        made = {name: change(getattr(config, name)) for name, change in changes.items()}
        self.config: StationConfig = replace(config, **made)
        self.seen: list[dict[str, Any]] = []

    def event(self, name: str, timeout_s: float = PATIENCE_S) -> dict[str, Any]:
        """The first event of that name since the start, waiting for it."""
        deadline_ns = monotonic_ns() + int(timeout_s * 1e9)
        while True:
            for event in self.seen:
                if event["event"] == name:
                    return event
            left_s = (deadline_ns - monotonic_ns()) / 1e9
            lasts = left_s > 0 and self.client.alive
            came = self.client.events(timeout_s=min(left_s, 0.2)) if lasts else self.client.events()
            self.seen += came
            message = f"no event {name!r} within {timeout_s} s; seen: {self.seen}; log: {self.log()}"
            assert lasts or any(event["event"] == name for event in came), message

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
        answer: dict[str, Any] = self.client.request("start", **(program | changes))
        return answer

    def await_motion(self, position_m: float) -> None:
        """Wait until the station has seen the rod that far from the centre, with nothing tripped."""
        deadline_ns = monotonic_ns() + int(PATIENCE_S * 1e9)
        while True:
            status = self.client.request("status")
            assert status["trip"] is None, status
            if abs(status["position_m"] or 0.0) > position_m and status["state"] == "RUNNING":
                return
            assert monotonic_ns() < deadline_ns, status


class WiredStationRig(StationRig):
    """Two real processes on real transports; `stop_beating` makes the application fall silent."""

    def __init__(self, folder: Path, speed: float, arguments: tuple[str, ...], **changes: Change) -> None:
        self.truth_path = folder / "truth.h5"
        with (folder / "simulators.log").open("w") as log:
            self.simulators = subprocess.Popen(
                [sys.executable, "-m", "simulators", "--speed", str(speed), "--seed", "1", "--no-real-time",
                 "--truth", str(self.truth_path), *arguments],
                stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True,
            )  # fmt: skip
        if self.simulators.stdout is None:
            raise RuntimeError("no pipe from the simulated rig")
        super().__init__(folder, Path(self.simulators.stdout.readline().strip()), **changes)
        self.client = StationClient.start(self.config, folder)
        self._silent = threading.Event()
        self._beats = threading.Thread(target=self._beat, daemon=True)
        self._beats.start()

    def _beat(self) -> None:
        while not self._silent.wait(BEAT_S):
            try:
                self.client.beat(True)
            except StationLost:
                return

    def truth(self) -> Truth:
        """End the simulated rig and read what really happened."""
        self.simulators.send_signal(signal.SIGTERM)
        self.simulators.wait(PATIENCE_S)
        return Truth.load(self.truth_path)

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
            self.simulators.wait(PATIENCE_S)
        if self.simulators.stdout is not None:
            self.simulators.stdout.close()


class Inside:
    """An object whose methods wait in virtual time."""

    def __init__(self, target: object, inside: Callable[[Callable[[], object]], object]) -> None:
        self._target, self._inside = target, inside

    def __getattr__(self, name: str) -> object:
        value = getattr(self._target, name)
        if not callable(value):
            return value
        return lambda *given, **named: self._inside(lambda: value(*given, **named))


class ScenarioStationRig(StationRig):
    """Station, devices and the test's own application in one process and in virtual time."""

    def __init__(self, folder: Path, speed: float, arguments: tuple[str, ...], **changes: Change) -> None:
        self.truth_path = folder / "truth.h5"
        self.stage = Stage(1, folder)
        self.stage.__enter__()
        self.kernel = self.stage.kernel
        self._silent = False
        self._application = Process(self.stage.machine, "application", None, None)
        self.stage.machine.processes[self._application.pid] = self._application
        bench = self.stage.serve(simulated_rig("--speed", str(speed), *arguments, truth=self.truth_path))
        super().__init__(folder, bench, **changes)
        client = self.inside(lambda: StationClient.start(self.config, folder))
        self.client = Inside(client, self.inside)
        self.kernel.spawn("beats", self._application, lambda: self._beat(client))

    def inside(self, do: Callable[[], Result]) -> Result:
        """What the application does there, to its end; time passes meanwhile."""
        done: list[Result] = []
        failed: list[BaseException] = []

        def run() -> None:
            try:
                done.append(do())
            except Exception as error:  # noqa: BLE001 - raised to the test
                failed.append(error)

        self.kernel.spawn("test", self._application, run)
        self.kernel.run(lambda: bool(done or failed))
        if failed:
            raise failed[0]
        return done[0]

    def _beat(self, client: StationClient) -> None:
        while True:
            self.kernel.sleep_ns(int(BEAT_S * 1e9))
            if self._silent:
                return
            try:
                client.beat(True)
            except StationLost:
                return

    def stop_beating(self) -> int:
        """The application falls silent; host time (ns) after its last beat."""
        self._silent = True
        return self.kernel.now_ns

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        until_ns = self.kernel.now_ns + int(seconds * 1e9)
        self.kernel.run(lambda: self.kernel.now_ns >= until_ns)

    def hold(self, seconds: float) -> None:
        """The station does not run for so long, as between SIGSTOP and SIGCONT."""
        (station,) = self.stage.named("rig.station")
        station.stalled_ns = self.kernel.now_ns + int(seconds * 1e9)
        self.wait(seconds)

    def kill_station(self) -> None:
        """`kill -9` of the station."""
        self.stage.signal("rig.station", signal.SIGKILL)

    def truth(self) -> Truth:
        """End the simulated rig and read what really happened."""
        devices = self.stage.devices
        self.stage.rig.stop()
        self.kernel.run(lambda: devices is None or not devices.alive)
        return Truth.load(self.truth_path)

    def end(self) -> None:
        """End the world."""
        self.stage.__exit__()
