"""The simulated rig's bench entries that say what its devices appear as."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import controller
from protocols.errors import LocalProtocolError
from rig.errors import FileProblem
from rig.files.described import described
from rig.files.names import is_file
from simulators.options import ControllerOptions, RigOptions

OWN = ("demo", "demo-streamed")
"""Maps of a controller for which none is named: with and without a function generator."""


def map_name(options: ControllerOptions) -> str:
    """The name, or the file, of the register map as which the controller appears."""
    return options.register_map or OWN[0 if options.generator else 1]


def emulated_map(options: ControllerOptions) -> ControllerMap:
    """The register map as which the controller appears.

    Raises:
        FileProblem: it cannot be used: everything that is wrong.
    """
    name = map_name(options)
    try:
        return controller(described("register-map", name))
    except LocalProtocolError as error:
        raise FileProblem(name, [str(error)]) from error


def appearing_as(options: RigOptions, name: str) -> RigOptions:
    """The same rig with a controller of another register map.

    Args:
        options: the rig's.
        name: of a map that comes with the program, or a path that ends in .toml.

    Raises:
        FileProblem: it cannot be used: everything that is wrong.
    """
    path = str(Path(name).absolute()) if is_file(name) else name
    generator = emulated_map(replace(options.controller, register_map=path)).capabilities.generator
    named = "" if name in OWN else path
    return replace(options, controller=replace(options.controller, register_map=named, generator=generator))


def serial_number(emulated: ControllerMap, options: ControllerOptions) -> str:
    """What a controller of this map shows as its serial number; empty where it shows none."""
    quantity = emulated.quantities.get("serial_number")
    if quantity is None:
        return ""
    if quantity.type == "string":
        return options.serial_number[: 2 * quantity.length]
    return "".join(letter for letter in options.serial_number if letter.isdigit()) or "0"


def actuator_lines(options: ControllerOptions) -> list[str]:
    """Entries of [actuator] that say what the controller is."""
    number = serial_number(emulated_map(options), options)
    return [f'register_map = "{map_name(options)}"', *([f'serial_number = "{number}"'] if number else [])]
