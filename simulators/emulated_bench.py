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
"""Maps of the simulated controller itself: by whether it has a function generator."""


def emulated_map(options: ControllerOptions) -> ControllerMap | None:
    """The register map as which the controller appears; None: as its own.

    Raises:
        FileProblem: it cannot be used: everything that is wrong.
    """
    if not options.register_map:
        return None
    try:
        return controller(described("register-map", options.register_map))
    except LocalProtocolError as error:
        raise FileProblem(options.register_map, [str(error)]) from error


def appearing_as(options: RigOptions, name: str) -> RigOptions:
    """The same rig with a controller of another register map.

    Args:
        options: the rig's.
        name: of a map that comes with the program, or a path that ends in .toml.

    Raises:
        FileProblem: it cannot be used: everything that is wrong.
    """
    if name in OWN:
        return replace(options, controller=replace(options.controller, generator=name == OWN[0], register_map=""))
    path = str(Path(name).absolute()) if is_file(name) else name
    own = replace(options.controller, register_map=path)
    emulated = emulated_map(own)
    generator = emulated is None or emulated.capabilities.generator
    return replace(options, controller=replace(own, generator=generator))


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
    emulated = emulated_map(options)
    if emulated is None:
        name = OWN[0] if options.generator else OWN[1]
        return [f'register_map = "{name}"', f'serial_number = "{options.serial_number}"']
    number = serial_number(emulated, options)
    return [f'register_map = "{options.register_map}"', *([f'serial_number = "{number}"'] if number else [])]
