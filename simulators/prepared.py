"""The simulated rig as a program that can be loaded in advance (`drivers.prepared`).

A production line starts one rig after another. Loading takes 2.2 s of processor time; the arguments, and with them the
specimen, are known later.
"""

from __future__ import annotations

import importlib

from simulators.options import RigOptions


def load_in_advance() -> None:
    """Load all modules and compiled loops of a simulated rig."""
    rig = importlib.import_module("simulators.rig")
    for name in ("simulators.__main__", "rig.files.ecu_files", "rig.files.specimens"):  # the models of users' files
        importlib.import_module(name)
    rig.SimulatedRig(RigOptions(), rig.RunOptions()).warm_up()


def main(arguments: list[str]) -> int:
    """Run the rig, as `python -m simulators` does; it ends the process with its exit code."""
    importlib.import_module("simulators.__main__").main(args=arguments, prog_name="python -m simulators")
    return 0
