"""One connection that several devices share: who opens and closes it, and who reads it.

Each device has its own thread, and no thread owns the connection. Whichever of the waiting threads comes first reads,
for all; what it reads is handed to those it belongs to, and the next one that waits takes over. So sharing costs no
further thread, and no device waits for the thread of another one that is busy.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from drivers import clock
from drivers.errors import DriverError, PortClosed, SharedConnectionClosed

T = TypeVar("T")

KNOWN_NS = 1_000_000_000
"""For so long a failed attempt to open the connection stands for the other devices' attempts."""


class SharedConnection(Generic[T]):
    """A connection with several users.

    Args:
        name: what the connection is called in messages, such as its address.
        open_port, close_port: open and close it.
        read: waits for what comes, up to so long (s); called by one thread at a time.
        take: hands over what was read; called with `state` held.

    Attributes:
        state: guards the connection's data; notified when something was read.
        lost: why the connection is gone; None while it is not.
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
        """A device will use the connection."""
        self._users[user] = False

    @property
    def users(self) -> str:
        """The names of the devices that share it, in words."""
        *most, last = self._users
        return f"{', '.join(most)} and {last}" if most else last

    def is_open_for(self, user: str) -> bool:
        """Whether a device has opened the connection and it has not been lost."""
        return self._users[user] and self.lost is None

    def open(self, user: str) -> None:
        """Open the connection for a device, or join the others that have it open.

        Raises:
            PortClosed: it cannot be opened.
            LinkLost: it does not take its set-up.
            SharedConnectionClosed: another device has just failed to open it.
        """
        with self.state:
            if self.lost is not None:
                self._shut()
            if not self._is_open:
                self._open_first(user)
            self._users[user] = True

    def close(self, user: str) -> None:
        """A device has done with the connection; the last one closes it. Twice is harmless."""
        with self.state:
            self._users[user] = False
            if not any(self._users.values()):
                self._shut()
            self.state.notify_all()

    def wait(self, done: Callable[[], bool], timeout_s: float, user: str, until_ns: Callable[[], int]) -> None:
        """Wait until something was read that a device waits for, reading where no other thread does.

        Args:
            done: whether it has come; called with `state` held.
            timeout_s: longest wait (s); what has arrived is read even with 0.
            user: the device.
            until_ns: when to look again at the latest (monotonic ns); called with `state` held before each read.

        Raises:
            DriverError: the connection is gone.
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
        """The connection is gone: every device that waits is told; `state` is held."""
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
        """Raise why the connection is gone, as this device has it.

        Raises:
            PortClosed: it is gone.
        """
        error = self.lost
        if error is None and self._users[user]:
            return
        if error is None:
            error = self._before
        if error is None:
            raise PortClosed(user, self.name, "the connection is not open")
        shared = f" (shared by {self.users})" * (len(self._users) > 1)
        raise PortClosed(user, self.name, f"{error.message}{shared}", error.fix)

    def _open_first(self, user: str) -> None:
        now_ns = clock.monotonic_ns()
        if self._failed is not None and self._failed[1] != user and now_ns - self._failed[0] < KNOWN_NS:
            text = f"uses the same connection as {self._failed[1]}, which cannot be opened"
            raise SharedConnectionClosed(user, self.name, text)
        try:
            self._open_port()
        except DriverError as error:
            self._failed = clock.monotonic_ns(), user
            raise type(error)(user, self.name, error.message, error.fix) from error
        self._failed, self._is_open = None, True

    def _shut(self) -> None:
        """Close the connection; who had it open when it was lost has to open it again, and is told of the loss."""
        self._close_port()
        self._users = dict.fromkeys(self._users, False)
        self._is_open, self.lost, self._before = False, None, self.lost
