"""What really happened in a world: the plant's state at every step, and what the devices did."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.plant import step
from simulators.plant.plant import Plant
from simulators.world.kernel import Kernel

COLUMNS = (step.VELOCITY, step.CURRENT, step.DISPLACEMENT, step.FORCE)
EVERY_S = 1e-3


@dataclass(frozen=True)
class Noted:
    """A line of the devices' log: host's clock (ns), what."""

    host_ns: int
    code: str
    text: str


class WorldTruth:
    """Stands where `simulators.truth.Truth` would, and keeps in memory what that would write.

    Attributes:
        log: what the devices did.
    """

    def __init__(self, plant: Plant, kernel: Kernel) -> None:
        self.log: list[Noted] = []
        self._plant = plant
        self._kernel = kernel
        self._every = max(1, round(EVERY_S / plant.dt_s))
        self._times: list[NDArray[Any]] = []
        self._rows: list[NDArray[Any]] = []

    def slice(self) -> None:
        """Take the plant's last slice."""
        plant = self._plant
        rows = plant.out[:: self._every, :][:, COLUMNS].copy()
        # The slice ends now; before it the rig's clock may have waited.
        ends_ns = self._kernel.now_ns
        self._times.append(ends_ns - (len(rows) - 1 - np.arange(len(rows))) * self._every * plant.dt_s * 1e9)
        self._rows.append(np.column_stack((rows, np.full(len(rows), float(plant.command["pressure"][0])))))

    def note(self, code: str, text: str, time_s: float | None = None) -> None:
        """A line of the log."""
        del time_s
        self.log.append(Noted(self._kernel.now_ns, code, text))

    def finish(self, about: Any) -> None:  # noqa: ANN401 - nothing is written
        """Nothing is written."""
        del about

    @cached_property
    def arrays(self) -> NDArray[np.float64]:
        """Host's clock (ns), velocity (m/s), current (A), displacement (m), force (N), pressure level: (n, 6)."""
        if not self._rows:
            return np.empty((0, 6))
        return np.column_stack((np.concatenate(self._times), np.concatenate(self._rows)))

    def first(self, code: str) -> int | None:
        """When the first line of that code was written (ns)."""
        return next((line.host_ns for line in self.log if line.code == code), None)
