"""The base of the station's threads: each owns one device, says when it dies, and ends when asked."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from rig.station.log import say_error


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
