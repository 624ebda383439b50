"""The station's second input: a stop, from any process that may write to its socket, without the application.

Datagrams `{"do": "stop", "by": TEXT}`; anything else is discarded. There is no other command: none that starts, moves,
resets or reads. It is handled like every stop: latched, coil to 0 A, motion faded out, reported to the application.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

from rig.station.live_folder import bound, received, send_message
from rig.station.log import say_error

BREATH_S = 0.005
"""Between two messages, so that a flood of them costs the station nothing."""
LOOK_S = 0.5
LONGEST_NAME = 80


class StopSocket:
    """Listens on a thread of its own until `close`.

    Args:
        path: where to bind.
        stop: called, on that thread, with who asked.

    Raises:
        OSError: the socket cannot be bound.
    """

    def __init__(self, path: Path, stop: Callable[[str], None]) -> None:
        self._path = path
        self._inbox: socket.socket = bound(path)
        self._stop = stop
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="stop socket", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no longer."""
        self._ending.set()
        send_message(self._path, {})  # wakes it
        self._thread.join(timeout=2.0 * LOOK_S)
        self._inbox.close()

    def _listen(self) -> None:
        while not self._ending.is_set():
            try:
                if not select.select([self._inbox], [], [], LOOK_S)[0]:
                    continue
                message = received(self._inbox)
                if message is not None and message.get("do") == "stop":
                    self._stop(requester(message))
            except OSError:
                return
            except Exception:  # noqa: BLE001 - whatever is wrong with one message, the next stop counts
                say_error()
            time.sleep(BREATH_S)


def requester(message: dict[str, object]) -> str:
    """Who asks, on one printable line of at most 80 characters."""
    text = "".join(sign if sign.isprintable() else " " for sign in str(message.get("by", "")))
    return text[:LONGEST_NAME].strip() or "unknown client"
