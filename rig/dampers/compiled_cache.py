"""Compiled functions are kept for the next process; here they are saved by one process at a time.

For each function numba keeps an index: which compiled version lies in which numbered file. Two processes that save at
once lose one of the entries, and both take the same number: who reads later runs what was compiled for other types.
"""

from __future__ import annotations

import contextlib
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
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])
LOCK = "save.lock"


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


@cache
def _not_kept() -> None:
    """Warns, once."""
    text = (
        "compiled models cannot be cached: neither the package's folder nor the user's cache folder is writable, so "
        "the models are compiled again at every start (up to a minute). Fix: set NUMBA_CACHE_DIR to a writable folder"
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
    """`IndexDataCacheFile.save` under the lock of the folder in which it saves."""

    @wraps(save)
    def locked(file: Any, *arguments: Any) -> None:  # noqa: ANN401 - numba's own
        with alone(Path(file._index_path).parent):  # noqa: SLF001 - numba tells it nowhere else
            save(file, *arguments)

    return locked


IndexDataCacheFile.save = saves_alone(IndexDataCacheFile.save)  # type: ignore[method-assign]  # there is no other way in
