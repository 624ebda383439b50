"""Compiled functions are kept for the next process; here they are saved by one process at a time.

For each function numba keeps an index: which compiled version lies in which numbered file. Two processes that save at
once lose one of the entries, and both take the same number: who reads later runs what was compiled for other types.
"""

from __future__ import annotations

import contextlib
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from functools import cache, cached_property, wraps
from importlib import import_module
from pathlib import Path
from types import CodeType
from typing import Any, TypeVar

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.event import Listener, register
from numba.core.registry import CPUDispatcher

from rig.compile_notice import NOTICE, TEXT

F = TypeVar("F", bound=Callable[..., Any])
LOCK = "save.lock"
CHECKSUM = 4  # bytes behind an entry


def njit(**options: Any) -> Callable[[F], F]:  # noqa: ANN401 - numba's own options
    """`numba.njit`, each function under a name of its own contents; what is not kept is a `Part` of what calls it.

    Numba tells the symbols of functions of one name apart by a count of the process. What the cache gives was counted
    in another process: a loop from there and a function compiled here could share a symbol, and one model run as
    another. A loop that only calls a function takes the one compiled for itself here, and the one optimised with the
    loop when it comes from the cache: the last bits of a sum would depend on which process came first.
    """

    def compiled(function: F) -> F:
        function.__qualname__ = f"{function.__qualname__}_{contents(function):08x}"
        kept = options.get("cache", False)
        try:
            made: Any = numba.njit(**{"forceinline": not kept, **options})(function)
        except RuntimeError:  # no folder takes a file: neither the package's nor one of the user's
            if not kept:
                raise
            _not_kept()
            made = numba.njit(**{**options, "cache": False})(function)
        if not kept and made is not function:
            made = Part(py_func=function, targetoptions=made.targetoptions)
        part: F = made
        return part

    return compiled


def entry_point(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:  # noqa: ANN401 - numba's own
    """`numba.cfunc`, kept for the next process, under a name of its own contents."""

    def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba's own
        function.__qualname__ = f"{function.__qualname__}_{contents(function):08x}"
        try:
            return numba.cfunc(signature, cache=True, **options)(function)
        except RuntimeError:  # as above
            _not_kept()
            return numba.cfunc(signature, **options)(function)

    return compiled


@cache
def _not_kept() -> None:
    """Warns, once."""
    text = (
        "compiled models cannot be cached: neither the package's folder nor the user's cache folder is writable, or "
        "the disk is full, so the models are compiled again at every start (up to 15 s). Fix: set NUMBA_CACHE_DIR to a "
        "writable folder"
    )
    warnings.warn(text, RuntimeWarning, stacklevel=2)


class Part(CPUDispatcher):
    """A function that compiled loops call; Python calls one that is compiled for that, the first time.

    The way in from Python and the one from C are a third of what a small function's compiling takes.
    """

    def __init__(self, *, py_func: Callable[..., Any], targetoptions: dict[str, Any]) -> None:
        self._options = dict(targetoptions)
        no_way_in = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        super().__init__(py_func=py_func, targetoptions={**targetoptions, **no_way_in})

    def __call__(self, *arguments: Any) -> Any:  # noqa: ANN401 - the function's own
        """What the function gives; without a way in from Python the program would end here."""
        return self._called(*arguments)

    @cached_property
    def _called(self) -> Callable[..., Any]:
        called: Callable[..., Any] = numba.jit(**self._options)(self.py_func)
        return called


def contents(function: Callable[..., Any]) -> int:
    """CRC-32 over what a function does: its code, and what it closes over, compiled functions by their names."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    known = [getattr(getattr(value, "py_func", value), "__qualname__", value) for value in cells]
    code = function.__code__
    values = [value for value in code.co_consts if not isinstance(value, CodeType)]
    return zlib.crc32(repr((code.co_code, values, code.co_names, code.co_firstlineno, known)).encode())


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold a folder's lock while the block runs; where the machine has none, or the folder takes no file, go on."""
    with contextlib.ExitStack() as held:
        with contextlib.suppress(ImportError, OSError):
            fcntl: Any = import_module("fcntl")
            file = held.enter_context((folder / LOCK).open("a"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def saves_alone(save: Callable[..., None]) -> Callable[..., None]:
    """`IndexDataCacheFile.save` under a lock of its folder.

    An unreadable index is replaced. If the disk is full or the folder has become read-only, only the entry is lost.
    """

    @wraps(save)
    def locked(file: Any, *arguments: Any) -> None:  # noqa: ANN401 - numba's own
        with alone(Path(file._index_path).parent):  # noqa: SLF001 - numba tells it nowhere else
            try:
                try:
                    save(file, *arguments)
                except OSError:
                    raise
                except Exception:  # noqa: BLE001 - whatever a damaged pickle raises
                    file.flush()
                    save(file, *arguments)
            except OSError:
                _not_kept()

    return locked


def load_intact(load: Callable[..., Any]) -> Callable[..., Any]:
    """`IndexDataCacheFile.load`; an unreadable entry counts as missing, so it is compiled and written again."""

    @wraps(load)
    def checked(file: Any, *arguments: Any) -> Any:  # noqa: ANN401 - numba's own
        try:
            return load(file, *arguments)
        except Exception:  # noqa: BLE001 - whatever a damaged pickle raises, or a file of another user
            return None

    return checked


def with_checksum(dump: Callable[..., bytes]) -> Callable[..., bytes]:
    """`IndexDataCacheFile._dump` with a CRC-32 appended, because damaged machine code would crash the process."""

    @wraps(dump)
    def checked(file: Any, *arguments: Any) -> bytes:  # noqa: ANN401 - numba's own
        data = dump(file, *arguments)
        return data + zlib.crc32(data).to_bytes(CHECKSUM, "big")

    return checked


def load_checked(load_data: Callable[..., Any]) -> Callable[..., Any]:
    """`IndexDataCacheFile._load_data` of a file with a correct checksum.

    Raises:
        ValueError: the checksum is wrong or (in files of earlier versions) missing.
    """

    @wraps(load_data)
    def checked(file: Any, name: str) -> Any:  # noqa: ANN401 - numba's own
        data = (Path(file._index_path).parent / name).read_bytes()  # noqa: SLF001 - numba tells it nowhere else
        if zlib.crc32(data[:-CHECKSUM]).to_bytes(CHECKSUM, "big") != data[-CHECKSUM:]:
            raise ValueError(f"{name}: damaged")
        return load_data(file, name)

    return checked


class CompileNotice(Listener):
    """Reports once, through `NOTICE`, that models are being compiled."""

    def __init__(self) -> None:
        self._depth, self._began_s, self._spent_s = 0, 0.0, 0.0
        self._timer: threading.Timer | None = None
        self._reported = False

    def on_start(self, event: object) -> None:
        """Compilation of a function starts, possibly within that of another."""
        del event
        self._depth += 1
        if self._depth > 1 or self._reported or NOTICE.report is None:
            return
        self._began_s = time.monotonic()
        self._timer = threading.Timer(max(0.0, NOTICE.after_s - self._spent_s), self._report)
        self._timer.daemon = True
        self._timer.start()

    def on_end(self, event: object) -> None:
        """Compilation of a function has ended."""
        del event
        self._depth -= 1
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._spent_s += time.monotonic() - self._began_s

    def _report(self) -> None:
        report, self._reported = NOTICE.report, True
        if report is not None:
            report(TEXT)


IndexDataCacheFile.save = saves_alone(IndexDataCacheFile.save)  # type: ignore[method-assign]  # there is no other way in
IndexDataCacheFile.load = load_intact(IndexDataCacheFile.load)  # type: ignore[method-assign]  # the same
IndexDataCacheFile._dump = with_checksum(IndexDataCacheFile._dump)  # type: ignore[method-assign]  # noqa: SLF001 - the same
IndexDataCacheFile._load_data = load_checked(IndexDataCacheFile._load_data)  # type: ignore[method-assign]  # noqa: SLF001 - the same
register("numba:compile", CompileNotice())  # type: ignore[no-untyped-call]  # numba has few annotations
