"""Plug-ins as the rooms of `rig` see them: a catalogue of included entries and those of other packages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

from drivers import plugins
from drivers.plugins import DAMPER_MODELS, EXPORTS, METHODS, REPORT_SECTIONS, BrokenPlugIn, PlugIn, found
from rig.errors import RigError

__all__ = [
    "DAMPER_MODELS", "EXPORTS", "METHODS", "REPORT_SECTIONS", "BrokenPlugIn", "Catalogue", "PlugIn", "PlugInProblem",
    "found", "made_of",
]  # fmt: skip

T = TypeVar("T")
Make = Callable[[str, object], T]
"""From an entry point's name and object to an entry of a catalogue; raises ValueError for what cannot be one."""


class PlugInProblem(RigError):
    """A plug-in that is asked for cannot be used; the message names its package and entry point."""

    slug = "plugin-broken"


def made_of(plug_in: PlugIn, make: Make[T]) -> T:
    """What a plug-in brings, loaded and checked.

    Args:
        plug_in: which.
        make: from its name and object to the entry; raises ValueError with the reason where it cannot be one.

    Raises:
        BrokenPlugIn: it does not load, or is not what its group holds.
    """
    brought = plugins.load(plug_in)
    try:
        return make(plug_in.name, brought)
    except Exception as error:  # whatever foreign code raises is told as its own failure
        raise plug_in.broken(f"the plug-in does not match the group {plug_in.group}: {error}") from error


class Catalogue(Mapping[str, T]):
    """Entries by name: this program's own first, then those of plug-ins, which are loaded when they are asked for.

    A name of this program's own is never a plug-in's. Asking for another name, and going through all names, looks for
    installed plug-ins; only taking an entry loads one.

    Args:
        own: this program's entries.
        group: of entry points.
        make: from an entry point's name and object to an entry; raises ValueError with the reason.
    """

    def __init__(self, own: Mapping[str, T], group: str, make: Make[T]) -> None:
        self.own = dict(own)
        self.group = group
        self.make = make
        self._brought: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        """The entry of that name.

        Raises:
            KeyError: there is none.
            PlugInProblem: it is a plug-in's, and that cannot be used.
        """
        if name in self.own:
            return self.own[name]
        if name not in self._brought:
            try:
                plug_in = plugins.plug_in_of(self.group, name)
                if plug_in is None:
                    raise KeyError(name)
                self._brought[name] = made_of(plug_in, self.make)
            except BrokenPlugIn as error:
                raise PlugInProblem(str(error)) from error
        return self._brought[name]

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in plugins.names(self.group)

    def __iter__(self) -> Iterator[str]:
        yield from self.own
        yield from (name for name in plugins.names(self.group) if name not in self.own)

    def __len__(self) -> int:
        return sum(1 for _ in self)
