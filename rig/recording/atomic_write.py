"""The only module that writes a recording's files: completely or not at all, with a full disk as a regular error.

HDF5 does not survive a failed write: the library raises, and the process then crashes in it (SIGSEGV). So HDF5 never
writes to a disk here. It writes to a `ReservedFile`, which reserves disk space ahead of every write, never fails from
the library's view, stores the disk's error, and raises it as soon as this program asks (`check`).
"""

from __future__ import annotations

import errno
import io
import os
import secrets
import stat
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from drivers.posix import HAS_POSITIONED_ACCESS, O_CLOEXEC, O_NOFOLLOW

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer, WriteableBuffer

SMALLEST_STEP_BYTES, LARGEST_STEP_BYTES = 1 << 16, 1 << 22
"""By how much the reserved room grows at a time: by as much as is there, within these."""
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""Error numbers that say: no room."""
NO_RESERVATION = {errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS}
"""What a file system says that cannot reserve room; a full disk then shows at the write."""

TRUTH_COPIES, TRUTH_SPARE_BYTES = 3, 4_000_000


def room_for_truth(collected_bytes: int) -> int:
    """Bytes that must be free before a simulated rig makes its truth file of so many bytes of collected states."""
    return TRUTH_COPIES * collected_bytes + TRUTH_SPARE_BYTES


class ReservedFile(io.RawIOBase):
    """A new file to which a library may write: room is reserved ahead, no error reaches the library.

    What is written after the first error stays in memory, so that the library finds all it wrote; ask `check` often.

    Args:
        path: the file; one of that name, or a link, is removed first.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | O_CLOEXEC
        self.path = path
        self._error: OSError | None = None
        self._position = self._size = self._room = 0
        self._handle = -1
        self._unwritten: list[tuple[int, bytes]] = []
        path.unlink(missing_ok=True)  # a stranger's run may hold a link of that name, to a file elsewhere
        self._handle = os.open(path, flags, 0o644)

    def check(self) -> None:
        """Raise what the disk has refused so far.

        Raises:
            OSError: with its error number (ENOSPC, EIO ...) and the file's name.
        """
        if self._error is not None:
            raise OSError(self._error.errno, os.strerror(self._error.errno or 0), str(self.path)) from self._error

    def write(self, data: ReadableBuffer, /) -> int:
        """Write at the place sought; the number of bytes. Never fails: see `check`."""
        view = memoryview(data).cast("B")
        end = self._position + len(view)
        if self._error is None:
            try:
                self._reserve(end)
                self._put(view, self._position)
            except OSError as error:
                self._error = error
        if self._error is not None:
            self._unwritten.append((self._position, bytes(view)))
        self._position = end
        self._size = max(self._size, end)
        return len(view)

    def _reserve(self, end: int) -> None:
        """Have room on the disk up to `end`.

        Raises:
            OSError: there is none.
        """
        if end <= self._room or not hasattr(os, "posix_fallocate"):
            return
        room = end + min(max(end, SMALLEST_STEP_BYTES), LARGEST_STEP_BYTES)
        try:
            os.posix_fallocate(self._handle, self._room, room - self._room)
        except OSError as error:
            if error.errno not in NO_RESERVATION:
                raise
        self._room = room

    def _put(self, view: memoryview, offset: int) -> None:
        while view:
            if HAS_POSITIONED_ACCESS:
                written = os.pwrite(self._handle, view, offset)
            else:
                os.lseek(self._handle, offset, os.SEEK_SET)
                written = os.write(self._handle, view)
            view, offset = view[written:], offset + written

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        """Read back from the place sought; the number of bytes."""
        view = memoryview(buffer).cast("B")
        start, count = self._position, max(0, min(len(view), self._size - self._position))
        if HAS_POSITIONED_ACCESS:
            data = os.pread(self._handle, count, start)
        else:
            os.lseek(self._handle, start, os.SEEK_SET)
            data = os.read(self._handle, count)
        view[:count] = data + bytes(count - len(data))
        for offset, kept in self._unwritten:
            first, last = max(offset, start), min(offset + len(kept), start + count)
            if first < last:
                view[first - start : last - start] = kept[first - offset : last - offset]
        self._position += count
        return count

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Go to a place, from the start, from here or from the end; the place."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        self._position = base + offset
        return self._position

    def tell(self) -> int:
        """The place sought."""
        return self._position

    def truncate(self, size: int | None = None, /) -> int:
        """Set where the file ends; room beyond stays reserved until `finish`."""
        self._size = self._position if size is None else size
        return self._size

    def readable(self) -> bool:
        """It is."""
        return True

    def writable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def finish(self) -> None:
        """Give back the room that was not needed and put everything on the disk.

        Raises:
            OSError: the disk has refused something.
        """
        self.check()
        os.ftruncate(self._handle, self._size)
        os.fsync(self._handle)

    def close(self) -> None:
        """Close the file; has no effect if it is already closed or could not be created."""
        if not self.closed and self._handle >= 0:
            os.close(self._handle)
        super().close()


def write_whole(
    final: Path, fill: Callable[[ReservedFile], None], *, before_naming: Callable[[Path], None] | None = None,
) -> None:
    """Write a file complete or not at all: temporary name, flush, check, rename, flush of the directory.

    Args:
        final: its name; a file of that name is replaced in one step.
        fill: writes the content.
        before_naming: is given the temporary name when everything is on the disk; what it raises prevents the naming.

    Raises:
        OSError: the disk refused, or `final` is a folder, a pipe or a device; `final` holds what it held before, and
            nothing is left beside it.
    """
    _check_replaceable(final)
    partial = final.with_name(final.name + ".tmp")
    file = ReservedFile(partial)
    try:
        with file:
            fill(file)
            file.finish()
        if before_naming is not None:
            before_naming(partial)
        os.replace(partial, final)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    flush_directory(final.parent)


def _check_replaceable(final: Path) -> None:
    """Refuse to put a file in the place of something else: for root, the rename would replace even `/dev/null`.

    Raises:
        OSError: it is a folder, a pipe, a socket or a device.
    """
    try:
        mode = final.stat().st_mode
    except OSError:
        return  # nothing there; what else is wrong shows when the file is made
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(final))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is a pipe, a socket or a device, not a file", str(final))


def write_text_durably(path: Path, text: str) -> None:
    """Write a small text file complete or not at all, as UTF-8.

    What cannot be encoded (a lone surrogate from a JSON file, a file name that is not UTF-8) becomes a question mark.

    Raises:
        OSError: the place cannot be written.
    """
    write_durably(path, text.encode("utf-8", "replace"))


def write_durably(path: Path, data: bytes) -> None:
    """Write a small file complete or not at all.

    Raises:
        OSError: the place cannot be written.
    """

    def fill(file: ReservedFile) -> None:
        file.write(data)

    write_whole(path, fill)


def write_unflushed(final: Path, parts: Iterable[bytes | memoryview]) -> None:
    """Write a reproducible file: complete for readers, but not flushed, so a power cut may damage it.

    The temporary name is unique, so several processes can write the same file at the same time.

    Raises:
        OSError: the folder is not writable, or `final` is not a file.
    """
    _check_replaceable(final)
    partial = final.with_name(f"{final.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    try:
        with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | O_CLOEXEC, 0o644), "wb") as file:
            file.writelines(parts)
        os.replace(partial, final)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def open_to_append(path: Path) -> BinaryIO:
    """Open a log for appending, made anew where it is missing.

    Raises:
        OSError: it cannot be opened; a symbolic link is not followed (ELOOP).
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | O_CLOEXEC | O_NOFOLLOW
    return os.fdopen(os.open(path, flags, 0o644), "ab", buffering=0)


def inner_folder(folder: Path, name: str) -> Path:
    """A folder inside of another one, made where it is missing.

    Raises:
        OSError: it cannot be made, or it is a symbolic link (ELOOP): what is written there would lie elsewhere.
    """
    inner = folder / name
    inner.mkdir(parents=True, exist_ok=True)
    if inner.is_symlink():
        raise OSError(errno.ELOOP, "is a symbolic link; files are written only into a real folder", str(inner))
    return inner


def flush_directory(folder: Path) -> None:
    """Make renames and new names in a folder survive a power cut; Windows cannot open a folder for that.

    Raises:
        OSError: the disk refused.
    """
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
