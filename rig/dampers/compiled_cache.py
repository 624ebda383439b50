"""Compiled functions are kept for the next process; here they are saved by one process at a time.

For each function numba keeps an index: which compiled version lies in which numbered file. Two processes that save at
once lose one of the entries, and both take the same number: who reads later runs what was compiled for other types.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import IndexDataCacheFile

__all__ = ["alone", "njit", "saves_alone"]

LOCK = "save.lock"


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
        with alone(Path(file._index_path).parent):  # noqa: SLF001
            save(file, *arguments)

    return locked


IndexDataCacheFile.save = saves_alone(IndexDataCacheFile.save)  # type: ignore[method-assign]  # there is no other way in
