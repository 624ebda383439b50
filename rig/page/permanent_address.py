"""The permanent address of a bench's page: port and tokens in a file of this user alone, one server at a time.

They are kept in the user's own state folder, not beside the bench file or the runs: those are shared, copied and
archived. The file has mode 0600. If other users could read it, or if it is a link, new tokens are drawn.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.page.access import Role, new_tokens
from rig.page.settings import MOST_PORT, PageProblem
from rig.station.live_folder import hold

FOLDER = "mr-damper-rig"
ADDRESS, SERVED = "address.json", "served.lock"
FIRST_PORT, PORTS = 20_000, 10_000
"""Ports of benches: below those that systems give to connections for a short time."""
TOKEN = re.compile(r"[A-Za-z0-9_-]{32}")
LARGEST_BYTES = 4096


@dataclass
class PermanentAddress:
    """Where one bench is served, for as long as this object is open.

    Attributes:
        folder: of the bench's page: address, what was started last.
        port: the one it had before; of a new one a proposal.
        known: whether browsers may know the port already.
        tokens: by role.
        warning: why the tokens are not those of before; empty where they are.
    """

    folder: Path
    port: int
    known: bool
    tokens: Mapping[Role, str] = field(repr=False)
    warning: str = ""
    _lock: int = -1

    @classmethod
    def opened(cls, bench: Path, *, renewed: bool = False, place: Path | None = None) -> PermanentAddress:
        """The address of a bench, held until it is closed.

        Args:
            bench: its file.
            renewed: draw new tokens, so that the old ones open nothing.
            place: the folder for all benches; by default the user's state folder.

        Raises:
            PageProblem: another process serves it, or the folder cannot be used.
        """
        name = hashlib.sha256(os.fsencode(bench.resolve())).hexdigest()[:16]
        folder = (place or state_folder()) / f"page-{name}"
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.chmod(0o700)
            lock = hold(folder / SERVED)
        except OSError as error:
            raise PageProblem(f"{folder}: the address of the page cannot be stored: {error.strerror}. Fix: make the "
                "folder writable, or set XDG_STATE_HOME to another folder") from error
        before, warning = _read(folder / ADDRESS)
        if lock is None:
            url = f" at {before['url']}" if before.get("url") else ""
            raise PageProblem(f"the page of {bench} is already being served{url}. Fix: open that address, or stop the "
                "other `rig page` process")
        kept = None if renewed else _tokens(before)
        proposed = FIRST_PORT + int(name, 16) % PORTS
        return cls(folder, before.get("port", proposed), "port" in before, kept or new_tokens(), warning, lock)

    def keep(self, port: int, url: str) -> None:
        """Write port, tokens and the operator's URL.

        Raises:
            PageProblem: the file cannot be written.
        """
        content = {"port": port, "url": url, "tokens": {str(role): token for role, token in self.tokens.items()}}
        fresh = self.folder / f"{ADDRESS}.new"
        try:
            fresh.unlink(missing_ok=True)
            handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump(content, file)
                file.flush()
                os.fsync(file.fileno())
            fresh.replace(self.folder / ADDRESS)
        except OSError as error:
            raise PageProblem(f"{fresh}: the address of the page cannot be stored: {error.strerror}") from error

    def close(self) -> None:
        """Let another process serve it."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def state_folder() -> Path:
    """Where this user's programs keep what must survive them.

    Raises:
        PageProblem: there is no home folder.
    """
    named = os.environ.get("XDG_STATE_HOME", "")
    try:
        return (Path(named) if named.startswith("/") else Path.home() / ".local" / "state") / FOLDER
    except RuntimeError as error:
        raise PageProblem(
            "no home folder found in which to save the address of the page. Fix: set XDG_STATE_HOME"
        ) from error


def _read(path: Path) -> tuple[dict[str, Any], str]:
    """What the file holds, and why its tokens are not to be used; nothing where there is none."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return {}, ""
    except OSError as error:
        return {}, f"{path}: {error.strerror}; new tokens were generated"
    with os.fdopen(handle, "rb") as file:
        state = os.fstat(handle)
        if not stat.S_ISREG(state.st_mode) or state.st_uid != os.getuid():
            return {}, f"{path}: not a regular file owned by this user; new tokens were generated"
        content: Any = None
        with contextlib.suppress(ValueError, RecursionError):
            content = json.loads(file.read(LARGEST_BYTES))
    port = content.get("port") if isinstance(content, dict) else None
    if not isinstance(port, int) or isinstance(port, bool) or not 0 < port <= MOST_PORT:
        return {}, f"{path}: damaged; new tokens were generated"
    known = {"port": port, "url": str(content.get("url", ""))}
    if state.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        return known, f"{path}: other users could read this file; new tokens were generated"
    return {**known, "tokens": content.get("tokens")}, ""


def _tokens(before: Mapping[str, Any]) -> dict[Role, str] | None:
    """The tokens as they were; None where they are not such as this program draws, or both the same."""
    kept = before.get("tokens")
    if not isinstance(kept, dict):
        return None
    tokens = {role: str(kept.get(role, "")) for role in Role}
    valid = all(TOKEN.fullmatch(token) for token in tokens.values()) and len(set(tokens.values())) == len(Role)
    return tokens if valid else None
