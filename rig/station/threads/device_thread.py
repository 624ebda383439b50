"""The base of the station's threads: each owns one device, reports its failure, and ends on request."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from drivers.clock import back_whenever
from rig.clock import monotonic_ns
from rig.station.log import say_error

BACKSTOP_NS = 250_000_000
"""By which a silence is older than stale when the supervisor names it, should the thread itself not have."""


class DeviceThread(ABC):
    """A named thread that owns one device's driver.

    A thread that ends by an exception is not restarted: the supervisor sees it (`alive`) and stops the rig.
    """

    def __init__(self, name: str, slug: str) -> None:
        self.name = name
        self.slug = slug
        self.failure: str | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def alive(self) -> bool:
        """The thread runs."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Start the thread; its driver is open."""
        self._thread.start()

    def end(self) -> None:
        """Ask the thread to end and wait for it, so that its port can be closed."""
        self._ending.set()
        self.wake()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def wake(self) -> None:  # noqa: B027 - optional hook: a thread that always wakes by itself needs none
        """Interrupt a wait of the thread."""

    @abstractmethod
    def work(self) -> None:
        """Do the thread's work until `_ending` is set."""

    def _run(self) -> None:
        try:
            self.work()
        except Exception as error:  # noqa: BLE001 - whatever ends a thread must become a trip, not a silent death
            self.failure = f"{type(error).__name__}: {error}"
            say_error()
        finally:
            back_whenever()


class ReadingThread(DeviceThread):
    """A thread that reads its port until that is lost, and goes on when it has been opened again.

    Args:
        name: of the device.
        slug: of its silence or loss.
        stale_after_s: age at which its last value is stale.

    Attributes:
        port_lost: why the port is gone; None while it is not.
    """

    def __init__(self, name: str, slug: str, stale_after_s: float) -> None:
        super().__init__(name, slug)
        self.port_lost: str | None = None
        self._stale_ns = int(stale_after_s * 1e9)
        self._last_ns = monotonic_ns()
        self._again = threading.Event()

    @property
    @abstractmethod
    def begun(self) -> bool:
        """Its silence counts: not while the proof at connect still waits for a first value."""

    def start(self) -> None:
        """Start the thread; its driver is open, and its silence counts from now."""
        self._last_ns = monotonic_ns()
        super().start()

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        """Age of the last value, and the age at which the supervisor itself calls it stale (ns)."""
        return now_ns - self._last_ns if self.begun else 0, self._stale_ns + BACKSTOP_NS

    def wake(self) -> None:
        """Interrupt the wait for a lost port."""
        self._again.set()

    def work(self) -> None:
        """Read until the end; wait where the port is gone."""
        while not self._ending.is_set():
            self._again.clear()
            self._last_ns = monotonic_ns()
            self._read()
            if not self._ending.is_set():
                back_whenever()
                self._again.wait()

    def _reopened(self) -> None:
        """The port is open again: the thread goes on."""
        self.port_lost = None
        self._again.set()

    @abstractmethod
    def _read(self) -> None:
        """Read until the port is lost or `_ending` is set."""
