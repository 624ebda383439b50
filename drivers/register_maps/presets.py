"""Register maps by name: those that come with the program, and a user's own by their path."""

from __future__ import annotations

from pathlib import Path

from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import load_map
from protocols.errors import LocalProtocolError

FOLDER = Path(__file__).parents[1] / "devices"
SUFFIX = ".toml"
_END = "_controller"


def is_file(name: str) -> bool:
    """Whether a name is the path of a user's own map."""
    return name.casefold().endswith(SUFFIX)


def controller(name: str) -> ControllerMap:
    """The register map of a name, or of a path that ends in .toml.

    Raises:
        LocalProtocolError: there is none, or it cannot be used.
    """
    if is_file(name):
        return load_map(Path(name))
    if name not in controller_names():
        raise LocalProtocolError(f"no controller {name!r}; known: {', '.join(controller_names())}")
    return load_map(FOLDER / f"{name}{_END}{SUFFIX}")


def controller_names() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.stem.removesuffix(_END) for path in FOLDER.glob(f"*{_END}{SUFFIX}")))
