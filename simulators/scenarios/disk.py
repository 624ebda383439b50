"""The disk of a world: real files in one folder, and what a disk does to them.

It refuses, is slow, and forgets at a power cut what was not flushed: pages of files in any order, and the newest
changes of names in a folder.
"""

from __future__ import annotations

import errno
import os
import random
import shutil
import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from simulators.scenarios.kernel import Kernel

FLUSH_NS = (300_000, 6_000_000)
"""How long a flush takes."""
PAGE = 4096


@dataclass
class Unflushed:
    """What of a file is not as it was at its last flush.

    Attributes:
        size: it had then.
        pages: what they held then, of those written since; empty for one beyond the end.
    """

    size: int
    pages: dict[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """A change of names: how to undo it, and the file that had the name before."""

    undo: Callable[[], None]
    before: Path | None = None


class Disk:
    """What was flushed of the files below a folder, and what the disk refuses.

    Attributes:
        refuses: error number of every write from now on, 0 for none.
        flush_fails: flushes fail.
        slow_ns: how much longer a flush takes.
        stalled_until_ns: no write gets through before.
    """

    def __init__(self, kernel: Kernel, root: Path, seed: int) -> None:
        self.kernel = kernel
        self.root = root.resolve()
        self.refuses = 0
        self.flush_fails = False
        self.slow_ns = 0
        self.stalled_until_ns = 0
        self._chance = random.Random(f"disk {seed}")
        self._handles: dict[int, Path] = {}
        self._files: dict[int, list[Unflushed]] = {}
        """By inode; all but the last are being flushed."""
        self._names: dict[Path, list[Change]] = {}
        self._kept = root / ".before"
        self._kept_count = 0

    def watches(self, path: str | os.PathLike[str]) -> bool:
        """Whether a path lies on this disk."""
        return Path(os.path.abspath(path)).is_relative_to(self.root)

    def repair(self) -> None:
        """It refuses nothing any more, and is as fast as it should be."""
        self.refuses, self.flush_fails, self.slow_ns, self.stalled_until_ns = 0, False, 0, 0

    def opened(self, path: str | os.PathLike[str], *, made: bool, handle: int | None = None) -> None:
        """A file was opened for writing; without a handle by a writer that is not seen here."""
        path = Path(os.path.abspath(path))
        if handle is not None:
            self._handles[handle] = path
        if made:
            self._files[path.stat().st_ino] = [Unflushed(0)]
            self._change(path, lambda: path.unlink(missing_ok=True))

    def copied(self, old: int, new: int) -> None:
        """A descriptor was duplicated."""
        if old in self._handles:
            self._handles[new] = self._handles[old]

    def closed(self, handle: int) -> None:
        """A descriptor was closed."""
        self._handles.pop(handle, None)

    def write(self, handle: int, size: int) -> int:
        """How many of so many bytes the disk takes now.

        Raises:
            OSError: none.
        """
        if handle in self._handles and self.stalled_until_ns > self.kernel.now_ns:
            self.kernel.sleep_ns(self.stalled_until_ns - self.kernel.now_ns)
        if handle in self._handles and self.refuses:
            if self.refuses == errno.ENOSPC and size > 1 and self._chance.random() < 0.5:
                return max(1, int(self._chance.random() * size))
            raise OSError(self.refuses, os.strerror(self.refuses), str(self._handles[handle]))
        return size

    def changes(self, handle: int, start: int, stop: int) -> None:
        """These bytes of a file are about to change."""
        path = self._handles.get(handle)
        if path is None or stop <= start:
            return
        info = os.fstat(handle)
        unflushed = self._unflushed(info)
        for page in range(start // PAGE, (stop - 1) // PAGE + 1):
            if page not in unflushed.pages:
                unflushed.pages[page] = _page(handle, page) if page * PAGE < min(unflushed.size, info.st_size) else b""

    def _unflushed(self, info: os.stat_result) -> Unflushed:
        return self._files.setdefault(info.st_ino, [Unflushed(info.st_size)])[-1]

    def make(self, path: str | os.PathLike[str]) -> None:
        """Whether a new name can be made.

        Raises:
            OSError: it cannot.
        """
        if self.refuses and self.watches(path):
            raise OSError(self.refuses, os.strerror(self.refuses), str(path))

    def flush(self, handle: int) -> None:
        """Make a file as it is now, or the names in a folder, survive a power cut; takes its time.

        Raises:
            OSError: the disk fails.
        """
        info = os.fstat(handle)
        changes: list[Change] = []
        if stat.S_ISDIR(info.st_mode):
            folder = next((path for path in self._names if path.exists() and path.stat().st_ino == info.st_ino), None)
            changes = [] if folder is None else list(self._names[folder])
        states = self._files.get(info.st_ino, [])
        flushed = list(states)
        if states:
            states.append(Unflushed(info.st_size))
        low, high = FLUSH_NS
        self.kernel.sleep_ns(low + int(self._chance.random() * (high - low)) + self.slow_ns)
        if self.flush_fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        states[:] = [state for state in states if not any(state is one for one in flushed)]
        for change in changes:
            self._forget(change)
        if changes and folder is not None:
            self._names[folder] = [change for change in self._names[folder] if change not in changes]

    def replaces(self, old: Path, new: Path) -> None:
        """A name is about to be given to another file."""
        old, new = (Path(os.path.abspath(path)) for path in (old, new))
        if not (self.watches(old) and self.watches(new)):
            return
        for handle in [handle for handle, path in self._handles.items() if path == old]:
            self._handles[handle] = new
        before = self._keep(new)

        def undo() -> None:
            if new.exists() and not old.exists():
                new.rename(old)
            if before is not None:
                before.rename(new)

        self._change(new, undo, before)

    def links(self, new: Path) -> None:
        """A file has got another name."""
        if self.watches(new):
            new = Path(os.path.abspath(new))
            self._change(new, lambda: new.unlink(missing_ok=True))

    def removes(self, path: Path) -> None:
        """A name is about to go."""
        path = Path(os.path.abspath(path))
        if self.watches(path) and path.exists():
            before = self._keep(path)

            def undo() -> None:
                if before is not None and not path.exists():
                    before.rename(path)

            self._change(path, undo, before)

    def power_cut(self) -> None:
        """What was not flushed is lost in part: pages of files in any order, and the newest changes of names."""
        for changes in self._names.values():
            lost = int(self._chance.random() * (len(changes) + 1))
            for change in reversed(changes[len(changes) - lost :]):
                change.undo()
        self._names.clear()
        shutil.rmtree(self._kept, ignore_errors=True)
        for path in sorted(self.root.rglob("*")):
            states = self._files.pop(path.stat().st_ino, []) if path.is_file() else []
            if any(state.pages for state in states) or (states and states[0].size != path.stat().st_size):
                self._lose(path, states)
        self._files.clear()
        self._handles.clear()

    def _lose(self, path: Path, states: list[Unflushed]) -> None:
        """Some of what was written since the last flush never got to the disk."""
        flushed, now = states[0].size, path.stat().st_size
        pages = {page: held for state in reversed(states) for page, held in state.pages.items()}
        if now < flushed:
            share, size = self._chance.choice(((0.0, now), (1.0, flushed)))
        else:
            share = self._chance.choice((0.0, 0.5, 1.0))
            size = now if self._chance.random() < 0.3 else flushed + int(self._chance.random() * (now - flushed + 1))
        with path.open("r+b") as file:
            file.truncate(size)
            for page, held in sorted(pages.items()):
                lost, start = self._chance.random() < share, page * PAGE
                if lost and start < size:
                    file.seek(start)
                    file.write((held + bytes(PAGE - len(held)))[: size - start])

    def _change(self, path: Path, undo: Callable[[], None], before: Path | None = None) -> None:
        self._names.setdefault(path.parent, []).append(Change(undo, before))

    def _forget(self, change: Change) -> None:
        if change.before is not None and change.before.exists():
            info = change.before.stat()
            if info.st_nlink == 1:
                self._files.pop(info.st_ino, None)
            change.before.unlink()

    def _keep(self, path: Path) -> Path | None:
        if not path.is_file():
            return None
        self._kept.mkdir(exist_ok=True)
        self._kept_count += 1
        kept = self._kept / str(self._kept_count)
        os.link(path, kept)
        return kept


def _page(handle: int, page: int) -> bytes:
    """What a page of a file holds now; the handle may be one for writing only."""
    with open(f"/proc/self/fd/{handle}", "rb", buffering=0) as file:
        return os.pread(file.fileno(), PAGE, page * PAGE)
