"""Start-up check: `rig`, `drivers`, `protocols` and `simulators` are this project's, not others of the same names."""

from __future__ import annotations

from importlib.machinery import PathFinder
from pathlib import Path

PACKAGES = ("drivers", "protocols", "simulators")


def foreign_packages(search: list[str] | None = None) -> str | None:
    """Name what is wrong with the four packages; None when all are ours.

    Args:
        search: where Python looks (default `sys.path`).

    Returns:
        One message with what to do, or None.
    """
    home = Path(__file__).resolve().parents[2]
    for name in PACKAGES:
        found = PathFinder.find_spec(name, search)
        if found is None or found.origin is None:
            return f"the package {name} is missing beside {home / 'rig'}: install mr-damper-rig again"
        if Path(found.origin).resolve().parents[1] != home:
            return (
                f"the package {name} at {Path(found.origin).parent} belongs to another project of that name, and it "
                f"hides ours in {home}: install mr-damper-rig into an environment of its own (python3 dev.py install)"
            )
    return None
