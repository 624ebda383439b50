"""`rig models`: the damper models, their equations, parameters, and what they dissipate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rig.cli.options import Command, json_option
from rig.cli.output import console, show, write_json
from rig.document.blocks import Column, Head, table
from rig.errors import EXIT_DONE

if TYPE_CHECKING:
    from rig.dampers.model import DamperModel
    from rig.dampers.parameter import Parameter


@click.command(name="models", cls=Command, examples=("rig models", "rig models lost_motion", "rig models --json"))
@click.argument("names", nargs=-1, metavar="[NAME]...")
@json_option
def command(names: tuple[str, ...], as_json: bool) -> int:
    """List the damper models, including those from plug-ins; with NAME, also list the parameters.

    Each model can be fitted (`rig identify --model NAME`) and can be used as the simulated rig's damper (`[damper]
    model`, or `set`).
    """
    # loads numpy: not needed for the help
    from rig import dampers

    models = [dampers.model(name) for name in names or dampers.MODELS]
    if as_json:
        write_json({"models": [_entry(damper) for damper in models]})
        return EXIT_DONE
    for damper in models:
        _show(damper, whole=bool(names))
    return EXIT_DONE


def _entry(damper: DamperModel) -> dict[str, Any]:
    # loads numpy: not needed for the help
    from rig.dampers.catalogue import set_name
    from rig.dampers.current_law_model import base_of

    return {
        "name": damper.name,
        "equation": damper.equation,
        "energy": damper.energy,
        "states": damper.states,
        "hysteresis": list(damper.forms),
        "set": set_name(base_of(damper).name),
        "parameters": [_parameter(parameter, damper) for parameter in damper.parameters],
    }


def _parameter(parameter: Parameter, damper: DamperModel) -> dict[str, Any]:
    # loads numpy: not needed for the help
    from rig.dampers.temperature_law import softens_by

    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "role": "linear" if parameter.linear else "shape",
        "low": parameter.low,
        "high": parameter.high,
        "at_zero": parameter.at_zero or None,
        "power": parameter.power,
        "demonstration": damper.demonstration[parameter.name],
        "softens": softens_by(parameter) or None,
    }


def _show(damper: DamperModel, *, whole: bool) -> None:
    from rich.padding import Padding
    from rich.text import Text

    shown = console()
    shown.print(f"{damper.name}", style="bold", markup=False)
    lines = [damper.equation]
    lines += [f"energy: {damper.energy}"] if damper.energy else []
    lines += [] if whole else [", ".join(damper.names)]
    for line in lines:
        shown.print(Padding(Text(line), (0, 0, 0, 2)) if shown.is_terminal else f"  {line}", markup=False,
                    soft_wrap=not shown.is_terminal)  # fmt: skip
    if not whole:
        return
    head: list[Head] = ["parameter", "unit", "role", Column("demonstration", "", True), "warm fluid", "meaning"]
    rows = [
        [
            entry["name"], entry["unit"], entry["role"], f"{entry['demonstration']:g}", entry["softens"] or "",
            entry["meaning"],
        ]
        for entry in (_parameter(parameter, damper) for parameter in damper.parameters)
    ]  # fmt: skip
    show([table(head, rows)], shown)
