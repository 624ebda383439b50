"""What stands in a wrong entry's place while the rest of its file is checked, so that all problems are told at once.

A check that looks at such an entry can say nothing of it: it ends there, and nothing is told that might not be true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import NoReturn, TypeVar

T = TypeVar("T")


class NotRead(Exception):
    """A check needs an entry that could not be read."""


class Unread:
    """An entry that is given and could not be read; whatever is asked of it, even its type, raises `NotRead`."""

    def _refuse(self, *_: object) -> NoReturn:
        raise NotRead

    __class__ = property(_refuse)
    __getattr__ = __bool__ = __len__ = __iter__ = __contains__ = __getitem__ = __hash__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __neg__ = __abs__ = __float__ = __int__ = __index__ = __format__ = __str__ = __fspath__ = __array__ = _refuse


UNREAD = Unread()


def as_far_as_read(*checks: Callable[[], Iterable[T]]) -> Iterator[T]:
    """What checks say, each until it needs an entry that could not be read."""
    for check in checks:
        with suppress(NotRead):
            yield from check()
