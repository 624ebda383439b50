"""What really happened: the simulated rig's truth file as arrays and as a log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.roles import State


@dataclass(frozen=True)
class FaultEvent:
    """A line of the simulated rig's log: its clock (s), the host's clock (ns), what."""

    time_s: float
    host_ns: int
    code: str
    text: str


@dataclass(frozen=True)
class Truth:
    """What really happened: arrays on the simulated clock (s), and the log of commands, trips and faults."""

    time_s: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    force_N: NDArray[np.float64]
    current_A: NDArray[np.float64]
    temperature_degC: NDArray[np.float64]
    state: NDArray[np.float64]
    log: list[FaultEvent]
    clocks: dict[str, float]
    """Offset (us) and rate (ppm) of every device's clock."""

    @classmethod
    def load(cls, path: Path) -> Truth:
        with h5py.File(path) as file:
            data, events = file["entry/data"], file["entry/events"]
            names = ("time", "displacement", "velocity", "force", "current", "coil_temperature", "controller_state")
            arrays = [np.asarray(data[name][:], np.float64) for name in names]
            columns = (events["time_ns"][:], events["code"][:], events["text"][:])
            attributes = dict(file["entry/provenance"].attrs)
        clocks = {name: float(value) for name, value in attributes.items() if name.startswith("clock_")}
        log = []
        for time_ns, code, attributes in zip(*columns, strict=True):
            text, _, host_ns = attributes.decode().rpartition("; host_ns=")
            log.append(FaultEvent(1e-9 * float(time_ns), int(host_ns), code.decode(), text))
        return cls(*arrays, log, clocks)

    def all(self, *codes: str, text: str = "", after: FaultEvent | None = None) -> list[FaultEvent]:
        """Lines of these codes that contain `text`, from `after` on."""
        since_ns = 0 if after is None else after.host_ns
        return [each for each in self.log if each.code in codes and text in each.text and each.host_ns >= since_ns]

    def first(self, *codes: str, text: str = "", after: FaultEvent | None = None) -> FaultEvent:
        """The first such line; fails when there is none."""
        found = self.all(*codes, text=text, after=after)
        assert found, f"no {codes} {text!r} after {after} in {self.log}"
        return found[0]

    def since(self, time_s: float) -> slice:
        """The samples from `time_s` on."""
        return slice(int(np.searchsorted(self.time_s, time_s)), None)

    def at_rest(self, last_s: float) -> bool:
        """The rod stood still over the last seconds recorded."""
        return bool(np.ptp(self.displacement_m[self.since(self.time_s[-1] - last_s)]) < 1e-3)

    def still_after(self, code: str, within_s: float) -> bool:
        """The rod stands still at the end, and from `within_s` of the rig's clock after that code in its log."""
        later = np.abs(self.velocity_m_s[self.since(self.first(code).time_s + within_s)])
        return self.at_rest(0.05) and bool(np.all(later < 2e-3))

    def runs(self) -> list[slice]:
        """The samples of every motion program, in turn."""
        running = np.concatenate(([False], self.state == State.RUNNING, [False]))
        edges = np.flatnonzero(np.diff(running.astype(int)))
        return [slice(int(start), int(end)) for start, end in edges.reshape(-1, 2)]
