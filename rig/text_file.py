"""Small files from users, read without trust: regular files only, bounded, UTF-8."""

from __future__ import annotations

import json
import os
import stat
from collections import Counter
from collections.abc import Iterator
from contextvars import ContextVar, Token
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from drivers.posix import O_CLOEXEC
from rig.errors import FileProblem

JSON_LIMIT_BYTES = 32_000_000
LARGEST_NAMED_FILE_BYTES = 256_000_000
"""Of a file that a bench or a matrix names; recorded roads are the largest."""
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def read_text(path: Path, limit_bytes: int) -> str:
    """The text of a regular file, without a byte order mark, lines ended by newlines.

    Args:
        path: where it is; a pipe or device is refused without waiting for it.
        limit_bytes: the largest size.

    Raises:
        FileProblem: missing, unreadable, not a regular file, too large, or not UTF-8 (with the line).
    """
    return _text_of(path, read_bytes(path, limit_bytes))


def _text_of(path: Path, raw: bytes) -> str:
    """The text of what was read from a file.

    Raises:
        FileProblem: not UTF-8 (with the line).
    """
    if raw[:2] in _UTF16:
        raise FileProblem(str(path), ["the file is UTF-16 text. Fix: save it as UTF-8"])
    try:
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line, byte = raw.count(b"\n", 0, error.start) + 1, raw[error.start]
        problem = f"line {line}: not UTF-8 text (byte 0x{byte:02x} at {error.start}). Fix: save the file as UTF-8"
        raise FileProblem(str(path), [problem]) from error


def read_json(path: Path, limit_bytes: int = JSON_LIMIT_BYTES) -> dict[str, Any]:
    """The object of a JSON file.

    Raises:
        FileProblem: as `read_text`; not JSON, nested too deeply, or not an object.
    """
    return json_of(path, read_bytes(path, limit_bytes))


def json_of(path: Path, raw: bytes) -> dict[str, Any]:
    """The object in what was read from a JSON file.

    Raises:
        FileProblem: not UTF-8, not JSON, nested too deeply, not an object, or a key twice in one object.
    """
    repeated: list[_Repeated] = []

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) != len(pairs):
            made = _Repeated(made)
            made.names = [name for name, count in Counter(name for name, _ in pairs).items() if count > 1]
            repeated.append(made)
        return made

    try:
        value = json.loads(_text_of(path, raw), object_pairs_hook=object_of)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise FileProblem(str(path), [f"not valid JSON: {why}"]) from error
    if not isinstance(value, dict):
        raise FileProblem(str(path), [f"expected a JSON object, got {type(value).__name__}"])
    if repeated:
        raise FileProblem(str(path), [
            f"{place}: the key occurs more than once. Fix: keep only the correct entry"
            for place in _repeated_keys(value, "")
        ])  # fmt: skip
    return value


class _Repeated(dict[str, Any]):
    """An object of JSON in which keys are there more than once: their `names`."""

    names: list[str]


def _repeated_keys(value: object, place: str) -> Iterator[str]:
    """Every key that is there more than once, by its path."""
    if isinstance(value, _Repeated):
        yield from (f"{place}{name}" for name in value.names)
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from _repeated_keys(entry, f"{place}{name}.")
    elif isinstance(value, list):
        for index, entry in enumerate(value):
            yield from _repeated_keys(entry, f"{place}{index}.")


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading; a pipe or a device is refused without waiting for it or reading from it.

    Raises:
        FileProblem: it is something else than a regular file.
        OSError: it cannot be opened.
    """
    # Without O_NONBLOCK, opening a pipe that has no writer would wait for ever.
    descriptor = os.open(path, os.O_RDONLY | O_CLOEXEC | getattr(os, "O_NONBLOCK", 0))
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        raise FileProblem(str(path), [f"is {_kind(mode)}, not a file"])
    return os.fdopen(descriptor, "rb")


class FirstRead:
    """Within `with`, `read_bytes` always returns the content of a file at the first read.

    Check, digest, plan and copy then use the same bytes. The context can be entered repeatedly, also after an error.
    """

    def __init__(self) -> None:
        self._contents: dict[str, tuple[bytes, int]] = {}
        self._tokens: list[Token[FirstRead | None]] = []

    def __enter__(self) -> None:
        self._tokens.append(_FIRST_READ.set(self))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _FIRST_READ.reset(self._tokens.pop())

    def forget(self) -> None:
        """Free the memory; later reads read the files again."""
        self._contents.clear()

    def read(self, path: Path, limit_bytes: int) -> bytes:
        """Return the first `limit_bytes` + 1 bytes of a file, or all if there are fewer.

        Raises:
            FileProblem: as `open_regular`.
            OSError: as `open_regular`.
        """
        name = os.path.realpath(path)
        content, limit = self._contents.get(name, (b"", -1))
        if len(content) > limit and limit_bytes > limit:  # not read yet, or only its beginning
            content = _content(path, limit_bytes)
            self._contents[name] = content, limit_bytes
        return content[: limit_bytes + 1]


_FIRST_READ: ContextVar[FirstRead | None] = ContextVar("_FIRST_READ", default=None)


def stamp(path: Path | str) -> tuple[int, int] | None:
    """Stamp that changes with a file's content; None if there is no file."""
    try:
        state = os.stat(path)
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


def _content(path: Path, limit_bytes: int) -> bytes:
    with open_regular(path) as file:
        return file.read(limit_bytes + 1)


def read_bytes(path: Path, limit_bytes: int) -> bytes:
    """Return the content of a regular file; within `FirstRead`, the content at the first read.

    Raises:
        FileProblem: missing, unreadable, not a regular file, or too large.
    """
    first = _FIRST_READ.get()
    try:
        raw = _content(path, limit_bytes) if first is None else first.read(path, limit_bytes)
    except FileNotFoundError as error:
        raise FileProblem(str(path), ["there is no such file"]) from error
    except (OSError, ValueError) as error:
        raise FileProblem(str(path), [f"cannot be read: {_reason(error)}"]) from error
    _check_size(path, len(raw), limit_bytes)
    return raw


def lines_of(path: Path, limit_bytes: int) -> Iterator[bytes]:
    """Lines of a regular file with their line ends, one at a time, so that memory does not grow with the file.

    Raises:
        FileProblem: as `read_bytes`.
    """
    try:
        with open_regular(path) as file:
            _check_size(path, os.fstat(file.fileno()).st_size, limit_bytes)
            yield from file
    except FileNotFoundError as error:
        raise FileProblem(str(path), ["there is no such file"]) from error
    except (OSError, ValueError) as error:
        raise FileProblem(str(path), [f"cannot be read: {_reason(error)}"]) from error


def _check_size(path: Path, size_bytes: int, limit_bytes: int) -> None:
    """Refuse a file that is too large.

    Raises:
        FileProblem: it is.
    """
    if size_bytes > limit_bytes:
        size = f"{limit_bytes // 1024} KiB" if limit_bytes < 1_000_000 else f"{limit_bytes / 1e6:g} MB"
        raise FileProblem(str(path), [f"larger than {size}, the maximum for a file of this kind"])


def _reason(error: OSError | ValueError) -> str | None:
    return error.strerror if isinstance(error, OSError) else str(error)


def _kind(mode: int) -> str:
    return next((name for is_kind, name in _KINDS if is_kind(mode)), "something else")
