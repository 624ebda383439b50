"""Plug-ins by entry point: which other packages bring, and one of them loaded when it is first asked for.

A package installed beside this one names what it brings in its `pyproject.toml`, as an entry point of one of the
groups below. Looking them up reads metadata only; nothing of a plug-in runs before its name is used. Names of this
program's own always win: a plug-in cannot stand in a built-in's place.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

from drivers.errors import DriverError

if TYPE_CHECKING:  # loaded when plug-ins are looked for
    from importlib.metadata import EntryPoint

ACTUATORS = "mr_rig.actuators"
CURRENT_SOURCES = "mr_rig.current_sources"
SENSORS = "mr_rig.sensors"
DAMPER_MODELS = "mr_rig.damper_models"
METHODS = "mr_rig.methods"
REPORT_SECTIONS = "mr_rig.report_sections"
EXPORTS = "mr_rig.exports"
DRIVERS = (ACTUATORS, CURRENT_SOURCES, SENSORS)
GROUPS = (*DRIVERS, DAMPER_MODELS, METHODS, REPORT_SECTIONS, EXPORTS)
"""Every group, drivers first."""


class BrokenPlugIn(DriverError):
    """A plug-in cannot be used: it does not load, is not what its group holds, or two packages bring its name."""

    code: ClassVar[str] = "plugin-broken"


@dataclass(frozen=True, slots=True)
class PlugIn:
    """One entry point of a package.

    Attributes:
        group: one of `GROUPS`.
        name: as files and options have it.
        package: what brings it, as it is installed; `version` of that.
        target: module and object, `module:object`.
    """

    group: str
    name: str
    package: str
    version: str
    target: str

    @property
    def place(self) -> str:
        """Where it comes from, in words."""
        return f"package {self.package} {self.version} (entry point {self.group}: {self.name} = {self.target})"

    def broken(self, why: str) -> BrokenPlugIn:
        """The error that says why it cannot be used."""
        return BrokenPlugIn(f"plug-in {self.name!r}", self.place, f"{why}. Fix: correct or uninstall {self.package}")


@cache
def found(group: str) -> tuple[PlugIn, ...]:
    """What the installed packages bring for a group, by name; nothing is loaded.

    Entry points are read once a process.
    """
    from importlib.metadata import entry_points

    brought = {_plug_in(entry) for entry in entry_points(group=group)}
    return tuple(sorted(brought, key=lambda one: (one.name, one.package, one.target)))


def names(group: str) -> tuple[str, ...]:
    """The names that plug-ins bring for a group; nothing is loaded."""
    return tuple(dict.fromkeys(plug_in.name for plug_in in found(group)))


def driver_packages() -> frozenset[str]:
    """The top packages in which the drivers of plug-ins lie; nothing is loaded."""
    brought = (plug_in for group in DRIVERS for plug_in in found(group))
    return frozenset(plug_in.target.partition(":")[0].partition(".")[0] for plug_in in brought)


def plug_in_of(group: str, name: str) -> PlugIn | None:
    """The plug-in of that name; None when there is none.

    Raises:
        BrokenPlugIn: more than one package brings it.
    """
    brought = [plug_in for plug_in in found(group) if plug_in.name == name]
    if len(brought) > 1:
        others = " and by ".join(plug_in.place for plug_in in brought[1:])
        raise brought[0].broken(f"the same name is also provided by {others}. Fix: uninstall one of them")
    return brought[0] if brought else None


def load(plug_in: PlugIn) -> object:
    """The object of an entry point; its module is imported where it was not yet.

    Raises:
        BrokenPlugIn: it cannot be imported, or its module has no such object.
    """
    from importlib.metadata import EntryPoint

    entry = EntryPoint(plug_in.name, plug_in.target, plug_in.group)
    try:
        return entry.load()
    except (Exception, SystemExit) as error:  # whatever foreign code raises is told as its own failure
        raise plug_in.broken(f"the plug-in cannot be loaded: {type(error).__name__}: {error}") from error


def simulated_as(group: str, name: str) -> str | Mapping[str, Any] | None:
    """What a simulated device is, with which a plug-in's driver works: the attribute `simulated_as` of its maker.

    Args:
        group: of the plug-in, such as `SENSORS`.
        name: of the plug-in.

    Returns:
        A name that this program knows, or a sensor's line description; None where the maker says nothing, or the name
        is no plug-in's.

    Raises:
        BrokenPlugIn: it cannot be used.
    """
    plug_in = plug_in_of(group, name)
    simulated = None if plug_in is None else getattr(load(plug_in), "simulated_as", None)
    if plug_in is not None and not (simulated is None or isinstance(simulated, (str, Mapping))):
        raise plug_in.broken(f"simulated_as: got {simulated!r}, expected a name or a line description")
    return simulated


def maker_of(group: str, name: str) -> Callable[..., Any] | None:
    """A plug-in's maker of drivers; None when no plug-in has that name.

    Raises:
        BrokenPlugIn: it cannot be used.
    """
    plug_in = plug_in_of(group, name)
    if plug_in is None:
        return None
    maker = load(plug_in)
    if not callable(maker):
        raise plug_in.broken(f"expected a function or class that creates a driver, got {type(maker).__name__}")
    return maker


def made(group: str, name: str, role: type, *given: object, **further: object) -> Any:  # noqa: ANN401 - of that role, or None
    """A plug-in's driver; None when no plug-in has that name.

    Args:
        group: of the plug-in, such as `SENSORS`.
        name: of the plug-in.
        role: what it is to be.
        given: what every maker of the group takes.
        further: by name, what a maker takes only if it says so.

    Raises:
        BrokenPlugIn: it cannot be used, or makes what has not the role's methods.
        DriverError: its own, of another kind.
    """
    maker, plug_in = maker_of(group, name), plug_in_of(group, name)
    if maker is None or plug_in is None:
        return None
    try:
        driver = maker(*given, **{key: value for key, value in further.items() if key in _taken(maker)})
    except DriverError:
        raise
    except Exception as error:  # whatever foreign code raises is told as its own failure
        raise plug_in.broken(f"the plug-in cannot create a driver: {type(error).__name__}: {error}") from error
    missing = [member for member in members_of(role) if not hasattr(driver, member)]
    if missing:
        raise plug_in.broken("the driver does not have all members required for its role; missing: "
            f"{', '.join(missing)}")
    return driver


def _taken(maker: Callable[..., Any]) -> frozenset[str]:
    """The names of what a maker takes; none where Python cannot tell."""
    try:
        return frozenset(inspect.signature(maker).parameters)
    except (TypeError, ValueError):
        return frozenset()


def members_of(role: type) -> tuple[str, ...]:
    """What a driver of a role has: methods and attributes."""
    named = {name for kind in role.__mro__ if kind is not object for name in (*vars(kind), *kind.__annotations__)}
    return tuple(sorted(name for name in named if not name.startswith("_")))


def _plug_in(entry: EntryPoint) -> PlugIn:
    package = entry.dist
    named = ("?", "?") if package is None else (package.name, package.version)
    return PlugIn(entry.group, entry.name, *named, entry.value)
