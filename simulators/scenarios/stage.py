"""Where a world happens: the machine with its stand-ins installed, the devices' process, the application's process."""

from __future__ import annotations

import functools
import importlib
import pkgutil
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import serial

import drivers.serial_port
import rig.campaign.execution.runner
import rig.campaign.machine_resources
import rig.clock
import simulators.named_port
import simulators.rig
import simulators.slcan_bus
from rig.campaign import CampaignOptions, run_campaign
from rig.campaign.results import Display
from rig.errors import RigError
from rig.recording.conversion import converter, finaliser
from rig.station import process as station
from simulators.bench import Addresses
from simulators.rig import SimulatedRig
from simulators.scenarios import device_loop
from simulators.scenarios.disk import Disk
from simulators.scenarios.kernel import Kernel
from simulators.scenarios.machine import Machine, Process
from simulators.scenarios.os_stubs import Installed, StubModule

LOADED = (
    "protocols", "drivers", "rig.bench", "rig.station", "rig.campaign", "rig.check", "rig.recording", "rig.matrix",
    "rig.signals", "rig.faults", "rig.dampers", "simulators",
)
TESTS = "simulators.testing"
"""What a user's tests are made with: it needs pytest, and nothing in a world needs it."""
STILL_M_S = 1e-3
NO_CURRENT_A = 0.02


@functools.cache
def load_everything() -> None:
    """Import every module of the program, so that none finds the real machine when it is imported later."""
    for place in LOADED:
        package = importlib.import_module(place)
        for module in pkgutil.walk_packages(package.__path__, f"{place}."):
            if not module.name.endswith("__main__") and not module.name.startswith(TESTS):
                importlib.import_module(module.name)


class Application:
    """One run of `run_campaign` in a process of its own.

    Attributes:
        process: in which it runs.
        answer: what it returned; None when it raised or was killed.
        refusal: slug and words of what it raised.
    """

    def __init__(self, stage: Stage, options: CampaignOptions, display: Display) -> None:
        self.answer: Any = None
        self.refusal: tuple[str, str] = ("", "")
        self._options = options
        self._display = display
        self.process = stage.machine.start("application", self._run, stderr=stage.root / "application.log")

    def _run(self) -> int:
        try:
            self.answer = run_campaign(self._options, self._display)
        except RigError as error:
            self.refusal = (getattr(error, "slug", ""), str(error))
            return int(getattr(error, "exit_code", 1))
        return int(self.answer.exit_code)


class Stage:
    """A machine in virtual time, its stand-ins installed while it is entered.

    Args:
        seed: of everything that is drawn.
        root: an empty folder, the machine's disk.
        tick_s: how often the devices hand over what they have sent (s).
        turn_s: how often the application looks at what has come (s).

    Attributes:
        devices: the process of the simulated devices; None before the first.
        rig: what runs in it.
        installed: the stand-ins, once entered.
    """

    def __init__(self, seed: int, root: Path, tick_s: float = 0.005, turn_s: float = 0.008) -> None:
        self.root = root
        self.kernel = Kernel(seed)
        self.disk = Disk(self.kernel, root, seed)
        self.machine = Machine(self.kernel, self.disk, seed)
        self.devices: Process | None = None
        self.rig: SimulatedRig
        self.installed: Installed
        self._steps_s = tick_s, turn_s
        self._ends = ExitStack()

    def __enter__(self) -> Stage:
        load_everything()
        self.machine.programs = {
            "rig.station": station.main,
            "rig.recording.conversion.finaliser": lambda _: finaliser.main(),
            "rig.recording.conversion.converter": lambda _: converter.main(),
        }
        installed = self.installed = self._ends.enter_context(Installed(self.machine))
        kernel, machine, memory = self.kernel, self.machine, self.root / "memory"
        memory.mkdir()
        installed.put(rig.campaign.machine_resources, "SHARED_MEMORY", memory)
        installed.put(rig.campaign.machine_resources, "LOCK_FOLDERS", (memory,))
        installed.put(rig.clock, "datetime", SimpleNamespace(now=lambda zone: machine.now().astimezone(zone)))
        installed.put(simulators.rig, "open_port", lambda *_: device_loop.WirePort(kernel, machine.network))
        installed.put(simulators.named_port, "open_port", lambda *_: device_loop.Tty(machine, self.root / "dev"))
        named = {"serial_for_url": functools.partial(device_loop.serial_for_url, machine)}
        installed.put(drivers.serial_port, "serial", StubModule("serial", named, serial, "SerialTimeoutException"))
        installed.put(simulators.slcan_bus, "PeerQueue", device_loop.Queue)
        # Coarser than in production: adapters that hand over every few milliseconds, a busy application.
        installed.put(simulators.rig, "TICK_S", self._steps_s[0])
        installed.put(rig.campaign.execution.runner, "TURN_S", self._steps_s[1])
        return self

    def __exit__(self, *_: object) -> None:
        for left in list(self.machine.processes.values()):
            self.machine.end(left, -int(signal.SIGKILL))
        self._ends.close()

    def serve(
        self, simulated: SimulatedRig, *, real_time: bool = True,
        bench: Callable[[SimulatedRig, Addresses], str] | None = None,
    ) -> Path:
        """A rig as new, at the addresses of the one before; its bench file.

        Args:
            simulated: the rig, made while the stage is entered; the kind of its ports counts for nothing.
            real_time: the bench file's time limits are those of hardware.
            bench: writes the bench file of a rig at its addresses; by default the rig writes its own.
        """
        self.machine.network.restart()
        self.rig = simulated
        opened: list[str] = []

        def devices() -> None:
            loop = device_loop.ScenarioLoop(self.kernel, self.machine.network)

            async def serve() -> None:
                addresses = await simulated.open()
                opened.append(bench(simulated, addresses) if bench else simulated.bench(addresses, real_time))
                await simulated.run()
                await simulated.close()

            loop.run_until_complete(serve())

        simulated.warm_up()
        self.devices = self.machine.start("devices", devices, stderr=self.root / "devices.log")
        self.kernel.run(lambda: bool(opened))
        path = self.root / "bench.toml"
        path.write_text(opened[0], encoding="utf-8")
        return path

    def repair(self) -> None:
        """Everything is as it should be again: no devices, room on the disk."""
        if self.devices is not None:
            self.machine.end(self.devices, -int(signal.SIGKILL))
        self.disk.repair()
        self.machine.log_full = False

    def named(self, name: str) -> list[Process]:
        """The processes of that name that run."""
        return [process for process in self.machine.processes.values() if process.alive and process.name == name]

    def signal(self, name: str, number: int) -> None:
        """Send every process of that name a signal."""
        for process in self.named(name):
            self.machine.signal(process, number)

    def power_cut(self) -> None:
        """Every process of the host is gone, and what its disk had not flushed."""
        for process in [process for process in self.machine.processes.values() if process is not self.devices]:
            self.machine.end(process, -int(signal.SIGKILL))
        self.disk.power_cut()

    @property
    def alone(self) -> bool:
        """No process of the host is left."""
        return not any(process.alive and process is not self.devices for process in self.machine.processes.values())

    @property
    def is_still(self) -> bool:
        """The rod stands, and no current flows."""
        plant = self.rig.plant
        return abs(plant.value("velocity_m_s")) < STILL_M_S and abs(plant.value("current_A")) < NO_CURRENT_A

    @property
    def at_rest(self) -> bool:
        """No process of the host is left, and the rig has neither pressure nor motion nor current."""
        return self.alone and self.is_still and int(self.rig.plant.command["pressure"][0]) == 0
