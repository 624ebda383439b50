"""What a browser may ask for, by its rights: a stop by every client, the rest by the holder of the lease.

    {"do": "stop", "name": TEXT}                          every client, always; the name is told, and grants nothing
    {"do": "lease", "name": TEXT}, {"do": "release"}      an operator's client
    {"do": "pause"}, {"do": "start", "confirmed": [...]}  the holder of the lease
    {"do": "words", "operator" | "specimen" | "note" | "acknowledged": TEXT}
    {"do": "set", "number": N}                            the holder: the current asked for by question N is set
    {"do": "explain", "slug": TEXT}                       every client
    {"do": "recorded", "point": TEXT}                     every client: the loops of a finished point
    {"do": "clock"}                                       every client: the host's time, for latencies
    {"do": "close"}                                       an operator's client: end the page, once the run has ended

On the page of a bench, answered by `rig.page.bench_control`:

    {"do": "plan", "matrix": NAME}                        an operator's client; so is "questions" with "run": NAME
    {"do": "prepare"}                                     an operator's client: load the next run of the production view
    {"do": "begin", "matrix", "planned", "serial_number"} the holder of the lease; so are "resume" with "run",
                                                          "confirmed", "requalified", and "make-report" with "run"
                                                          and, for a PDF as well, "pdf": true

There is no word that resets an interlock, moves the rod or sets a current. A stop goes to the station and to the
application at once; the others to the application alone, which decides.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.clock import monotonic_ns
from rig.explanations.explanation import explained
from rig.page.access import Role
from rig.page.lease import Lease
from rig.station.live_folder import APPLICATION_SOCKET, STATION_SOCKET, send_message

LONGEST_MESSAGE = 4096
WORDS = {"operator": 80, "specimen": 500, "note": 2000, "acknowledged": 80}
LONGEST_STRANGER = 60
"""Of a name without control; what is added to it fits the 80 characters of names."""
LONGEST_KEY = 64
MOST_CONFIRMED = 100
CONTROL_READS = frozenset({"plan", "questions", "prepare"})
CONTROL_REQUESTS = CONTROL_READS | {"begin", "resume", "make-report"}
"""What `rig.page.bench_control` answers; the first of it starts and changes nothing."""


@dataclass(frozen=True)
class Client:
    """Who speaks: what its token allows, and its browser's own key."""

    role: Role
    key: str
    bench: bool = False
    """It shows the bench and no samples."""
    run: str = ""
    """Name of the displayed finished run; empty: the current run."""


class Commands:
    """Takes one message after the other.

    Args:
        lease: the operator's.
        folder: the running campaign's live folder; None: nothing runs.
        cancel: stops what is being started and has no live folder yet, in the name of a client; None: nothing
            is started here.
        end: ends the page; None: that of a bench, which lasts.
        say: sends a datagram; False if it is not received.
    """

    def __init__(
        self, lease: Lease, folder: Callable[[], Path | None], end: Callable[[], None] | None,
        say: Callable[[str | Path, dict[str, Any]], bool] = send_message,
        cancel: Callable[[str], bool] | None = None,
    ) -> None:
        self._lease = lease
        self._folder = folder
        self._end = end
        self._say = say
        self._cancel = cancel

    def take(self, text: str | bytes, client: Client) -> dict[str, Any]:
        """One message; the answer carries `ok`, or `refused` with a slug."""
        message = understood(text)
        if message is None:
            return _refused("bad-message")
        do = message["do"]
        if do == "stop":
            return self._stop(client, one_line(message.get("name"), LONGEST_STRANGER))
        if do == "clock":
            return {"do": "clock", "ok": True, "host_s": monotonic_ns() * 1e-9, "sent": message.get("sent")}
        if do == "explain":
            return _explain(message.get("slug"))
        if do == "recorded":
            return {"do": do, "point": one_line(message.get("point"), LONGEST_KEY)}
        if do == "close":
            return self._close(client)
        if do in {"lease", "release"}:
            return self._hand_over(message, client)
        if do in {"pause", "start", "set", "words"}:
            return self._command(message, client)
        return _refused("unknown-command")

    def refused_at_bench(self, do: str, client: Client) -> dict[str, Any] | None:
        """Why this client may not send this request to a bench; None if it may."""
        if client.role is not Role.OPERATOR:
            return _refused("viewer", do)
        if do in CONTROL_READS or self._lease.held_by(client.key):
            return None
        return _refused("no-lease", do)

    def called(self, client: Client) -> str:
        """For journals: the name typed with the lease, else what the client is."""
        holder = self._lease.holder
        return holder.name if holder is not None and holder.key == client.key else str(client.role)

    def _stopped_by(self, client: Client, name: str) -> str:
        """Who stops, for journals: the operator in control, or another browser under the name that it gives itself."""
        if self._lease.held_by(client.key):
            return self.called(client)
        other = "viewer" if client.role is Role.VIEWER else "without control"
        return f"{name} ({other})" if name else f"a browser ({other})"

    def _stop(self, client: Client, name: str) -> dict[str, Any]:
        """To both, in the order of who acts first; one that does not take it does not matter to the other."""
        folder = self._folder()
        if folder is None:
            cancelled = self._cancel is not None and self._cancel(self._stopped_by(client, name))
            return {"do": "stop", "ok": True} if cancelled else _refused("not-running", "stop")
        message = {"do": "stop", "by": self._stopped_by(client, name)}
        station = self._say(folder / STATION_SOCKET, message)
        application = self._say(folder / APPLICATION_SOCKET, message)
        if not (station or application):
            return _refused("not-reached", "stop")
        return {"do": "stop", "ok": True, "station": station, "application": application}

    def _close(self, client: Client) -> dict[str, Any]:
        """End the page for all clients; never that of a campaign that runs, where it is a way to stop the rig."""
        if client.role is not Role.OPERATOR:
            return _refused("viewer", "close")
        if self._end is None:
            return _refused("lasting-page", "close")
        if self._folder() is not None:
            return _refused("still-running", "close")
        self._end()
        return {"do": "close", "ok": True}

    def _hand_over(self, message: dict[str, Any], client: Client) -> dict[str, Any]:
        do = message["do"]
        if client.role is not Role.OPERATOR:
            return _refused("viewer", do)
        if do == "release":
            self._lease.give_back(client.key)
            return {"do": do, "ok": True}
        name = one_line(message.get("name"), WORDS["operator"])
        if not name:
            return _refused("name-missing", do)
        slug = self._lease.take(client.key, name)
        if slug:
            return _refused(slug, do)
        folder = self._folder()
        if folder is not None:
            self._say(folder / APPLICATION_SOCKET, {"do": "words", "by": name, "operator": name})
        return {"do": do, "ok": True}

    def _command(self, message: dict[str, Any], client: Client) -> dict[str, Any]:
        do, folder = message["do"], self._folder()
        if client.role is not Role.OPERATOR:
            return _refused("viewer", do)
        if folder is None:
            return _refused("not-running", do)
        if not self._lease.held_by(client.key):
            return _refused("no-lease", do)
        passed: dict[str, Any] = {"do": do, "by": self.called(client)}
        if do == "start":
            confirmed = message.get("confirmed", [])
            if not isinstance(confirmed, list) or len(confirmed) > MOST_CONFIRMED:
                return _refused("bad-message", do)
            passed["confirmed"] = [one_line(slug, LONGEST_KEY) for slug in confirmed]
        elif do == "set":
            if not isinstance(message.get("number"), int):
                return _refused("bad-message", do)
            passed["number"] = message["number"]
        elif do == "words":
            words = {name: str(message[name])[:most] for name, most in WORDS.items() if name in message}
            if not words:
                return _refused("bad-message", do)
            passed |= words
        if not self._say(folder / APPLICATION_SOCKET, passed):
            return _refused("not-reached", do)
        return {"do": do, "ok": True, **({"note": message["note"]} if "note" in message else {})}


def understood(text: str | bytes) -> dict[str, Any] | None:
    """A message; None for what is none."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("do"), str) else None


def one_line(value: object, most: int) -> str:
    """Text on one printable line, cut to `most` characters; empty for what is no text."""
    text = value if isinstance(value, str) else ""
    return " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())[:most]


def _explain(slug: object) -> dict[str, Any]:
    try:
        return {"do": "explain", "ok": True, **asdict(explained(str(slug)))}
    except KeyError:
        return _refused("unknown-slug", "explain")


def _refused(slug: str, do: str = "") -> dict[str, Any]:
    return {"do": do, "refused": slug}
