"""`rig run` as a program that can be loaded in advance (`drivers.prepared`), with the processes that it starts.

The page of a bench starts `rig run` for each specimen; the next one is loaded while the specimen is changed. It has no
device and no lock, and reads no file of the user, before its arguments arrive.
"""

from __future__ import annotations

import contextlib
import importlib

from rig.campaign.results import PreparedProcesses
from rig.cli.job import Analyst, PreparedRun
from rig.cli.main import answered, cli

MODULES = ("rig.cli.run", "rig.cli.analysis_check", "rig.cli.display", "rig.comparison.specimen", "rig.bench.model")
"""What a run would import only when it needs it."""
SIMULATE = "--simulate"


_LOADED = PreparedRun(PreparedProcesses(), None)


def load_in_advance(*options: str) -> None:
    """Load everything; with `--simulate`, also a simulated rig."""
    _LOADED.processes = PreparedProcesses.new(simulate=SIMULATE in options)
    _LOADED.processes.prepare()
    _LOADED.analyst = Analyst()
    for name in MODULES:
        importlib.import_module(name)


def main(arguments: list[str]) -> int:
    """Run `rig` with these arguments; returns the exit code."""
    with contextlib.closing(_LOADED.processes):
        return answered(cli, arguments, "rig", _LOADED)
