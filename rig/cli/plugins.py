"""`rig plugins`: what other packages provide by entry point, and whether each can be used."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from drivers import plugins
from drivers.plugins import BrokenPlugIn, found, plug_in_of
from rig.cli.options import Command, json_option
from rig.cli.output import console, show, write_json
from rig.document.blocks import Paragraph, table
from rig.errors import EXIT_DONE, EXIT_USAGE
from rig.matrix.methods import METHODS
from rig.plugins import made_of

if TYPE_CHECKING:
    from drivers.plugins import PlugIn

OK, BROKEN, SHADOWED = "ok", "broken", "shadowed"


@dataclass(frozen=True)
class Kind:
    """A group of entry points as this command shows it.

    Attributes:
        kind: what it holds, in a word.
        own: this program's names, which no plug-in can have.
        check: loads and checks a plug-in; raises `BrokenPlugIn`.
    """

    kind: str
    own: frozenset[str]
    check: Callable[[PlugIn], object]


@click.command(name="plugins", cls=Command, examples=("rig plugins", "rig plugins --json"))
@json_option
def command(as_json: bool) -> int:
    """Load all plug-ins and list them with their package and state.

    The state is `ok`, `broken` (with the reason) or `shadowed` (a built-in component with the same name is used
    instead). The exit code is 2 if any plug-in is not `ok`.
    """
    listed = _listed()
    if as_json:
        write_json({"plugins": listed})
    else:
        _show(listed)
    return EXIT_DONE if all(entry["state"] == OK for entry in listed) else EXIT_USAGE


def _kinds() -> dict[str, Kind]:
    """The groups, drivers first."""
    from drivers.catalogue import own_names
    from rig.dampers.catalogue import CATALOGUE, model_of_plug_in
    from rig.export.exporter import OWN, exporter_of_plug_in
    from rig.optimisers.methods import method_of_plug_in
    from rig.report.plugin_sections import section_of

    def driver(kind: str, group: str) -> Kind:
        return Kind(kind, own_names(group), lambda one: plugins.maker_of(one.group, one.name))

    def other(kind: str, own: Iterable[str], make: Callable[[str, object], object]) -> Kind:
        return Kind(kind, frozenset(own), lambda one: made_of(one, make))

    return {
        plugins.ACTUATORS: driver("actuator", plugins.ACTUATORS),
        plugins.CURRENT_SOURCES: driver("current source", plugins.CURRENT_SOURCES),
        plugins.SENSORS: driver("sensor", plugins.SENSORS),
        plugins.DAMPER_MODELS: other("damper model", (model.name for model in CATALOGUE), model_of_plug_in),
        plugins.METHODS: other("method", METHODS, method_of_plug_in),
        plugins.REPORT_SECTIONS: other("report section", (), section_of),
        plugins.EXPORTS: other("export", (own.name for own in OWN), exporter_of_plug_in),
    }


def _listed() -> list[dict[str, str]]:
    return [_entry(plug_in, kind) for group, kind in _kinds().items() for plug_in in found(group)]


def _entry(plug_in: PlugIn, kind: Kind) -> dict[str, str]:
    state, problem = OK, ""
    if plug_in.name in kind.own:
        state = SHADOWED
        problem = f"the built-in {kind.kind} {plug_in.name!r} is used instead. Fix: rename the plug-in"
    else:
        try:
            plug_in_of(plug_in.group, plug_in.name)
            kind.check(plug_in)
        except BrokenPlugIn as error:
            state, problem = BROKEN, error.message
    return {
        "kind": kind.kind, "group": plug_in.group, "name": plug_in.name, "package": plug_in.package,
        "version": plug_in.version, "entry_point": plug_in.target, "state": state, "problem": problem,
    }  # fmt: skip


def _show(listed: list[dict[str, str]]) -> None:
    shown = console()
    if not listed:
        shown.print("no plug-ins are installed", markup=False)
        return
    rows = [
        [entry["kind"], entry["name"], f"{entry['package']} {entry['version']}", entry["entry_point"], entry["state"]]
        for entry in listed
    ]
    problems = [f"{one['name']} ({one['group']}): {one['problem']}" for one in listed if one["problem"]]
    show([table(["kind", "name", "package", "entry point", "state"], rows), *map(Paragraph, problems)], shown)
