"""A connection shared by several devices: opening, closing and reading.

Each device has its own thread, and no thread owns the connection. The first waiting thread reads for all devices and
distributes the data; then the next waiting thread takes over. Sharing therefore needs no additional thread, and no
device depends on the busy thread of another device.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from drivers import clock
from drivers.errors import DriverError, PortClosed, SharedConnectionClosed

T = TypeVar("T")

SHARED_FAILURE_NS = 1_000_000_000
"""Time for which a failed attempt to open the connection also counts for the other devices."""


class SharedConnection(Generic[T]):
    """A connection that several devices use.

    Args:
        name: name of the connection in messages, such as its address.
        open_port, close_port: open and close it.
        read: waits for data, up to the given time (s); called by one thread at a time.
        take: distributes the data; called with `state` held.

    Attributes:
        state: condition that protects the data of the connection; notified after each read.
        lost: reason for the loss of the connection; None if it is not lost.
    """

    def __init__(
        self, name: str, open_port: Callable[[], None], close_port: Callable[[], None], read: Callable[[float], T],
        take: Callable[[T], None],
    ) -> None:
        self.name = name
        self.state = threading.Condition()
        self.lost: DriverError | None = None
        self._open_port, self._close_port, self._read, self._take = open_port, close_port, read, take
        self._users: dict[str, bool] = {}
        self._is_open = self._is_read = False
        self._failed: tuple[int, str] | None = None
        self._before: DriverError | None = None

    def add(self, user: str) -> None:
        """Register a device as a user of the connection."""
        self._users[user] = False

    @property
    def users(self) -> str:
        """Names of the devices that share the connection, as text."""
        *most, last = self._users
        return f"{', '.join(most)} and {last}" if most else last

    @property
    def _shared(self) -> str:
        return f" (shared by {self.users})" * (len(self._users) > 1)

    def is_open_for(self, user: str) -> bool:
        """Whether a device has opened the connection and it has not been lost."""
        return self._users[user] and self.lost is None

    def open(self, user: str) -> None:
        """Open the connection for a device, or use it if another device has opened it.

        Raises:
            PortClosed: it cannot be opened.
            LinkLost: it rejects its configuration.
            SharedConnectionClosed: another device has just failed to open it.
        """
        with self.state:
            if self.lost is not None:
                self._shut()
            if not self._is_open:
                self._open_first(user)
            self._users[user] = True
            if all(self._users.values()):
                self._before = None

    def close(self, user: str) -> None:
        """Release the connection for a device; the last user closes it. Repeated calls have no effect."""
        with self.state:
            self._users[user] = False
            if not any(self._users.values()):
                self._shut()
            self.state.notify_all()

    def wait(self, done: Callable[[], bool], timeout_s: float, user: str, until_ns: Callable[[], int]) -> None:
        """Wait for data of a device, and read if no other thread is reading.

        Args:
            done: whether the data have arrived; called with `state` held.
            timeout_s: longest wait (s); what has arrived is read even with 0.
            user: the device.
            until_ns: latest time of the next check (monotonic ns); called with `state` held before each read.

        Raises:
            DriverError: the connection was lost.
        """
        end_ns, first = clock.monotonic_ns() + int(timeout_s * 1e9), True
        while True:
            with self.state:
                left_ns = end_ns - clock.monotonic_ns()
                if done():
                    return
                self._check(user)
                if left_ns <= 0 and not first:
                    return
                if self._is_read:
                    if left_ns <= 0:
                        return
                    clock.back_within(left_ns * 1e-9)
                    self.state.wait(left_ns * 1e-9)
                    continue
                self._is_read, first = True, False
                try:
                    wait_s = max(0, min(end_ns, until_ns()) - clock.monotonic_ns()) * 1e-9
                except DriverError as error:
                    self._is_read = False
                    self.lose(error)
                    self._check(user)
            self._read_once(wait_s, user)

    def lose(self, error: DriverError) -> None:
        """Record the loss of the connection and notify all waiting devices; the caller holds `state`."""
        if self.lost is None:
            self.lost = error
        self.state.notify_all()

    def _read_once(self, wait_s: float, user: str) -> None:
        try:
            got = self._read(wait_s)
        except DriverError as error:
            with self.state:
                self._is_read = False
                self.lose(error)
                self._check(user)
            return
        with self.state:
            self._is_read = False
            try:
                self._take(got)
            except DriverError as error:
                self.lose(error)
            self.state.notify_all()

    def _check(self, user: str) -> None:
        """Raise the reason for the loss of the connection, for this device.

        Raises:
            PortClosed: the connection was lost.
        """
        error = self.lost
        if error is None and self._users[user]:
            return
        if error is None:
            error = self._before
        if error is None:
            raise PortClosed(user, self.name, "the connection is not open")
        raise PortClosed(user, self.name, f"{error.message}{self._shared}", error.fix)

    def _open_first(self, user: str) -> None:
        now_ns = clock.monotonic_ns()
        if self._failed is not None and self._failed[1] != user and now_ns - self._failed[0] < SHARED_FAILURE_NS:
            text = f"uses the same connection as {self._failed[1]}, which cannot be opened"
            raise SharedConnectionClosed(user, self.name, text)
        try:
            self._open_port()
        except DriverError as error:
            self._failed = clock.monotonic_ns(), user
            # An immediate attempt to open a lost connection again must not hide the cause of the loss.
            lost = "" if self._before is None else f"{self._before.message}{self._shared}, and "
            raise type(error)(user, self.name, f"{lost}{error.message}", error.fix) from error
        self._failed, self._is_open = None, True

    def _shut(self) -> None:
        """Close the connection; users of a lost connection are notified and must open it again."""
        self._close_port()
        self._users = dict.fromkeys(self._users, False)
        self._is_open, self.lost, self._before = False, None, self.lost or self._before
