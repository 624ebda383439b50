"""`python -m simulators.prepared`: a simulated rig that has loaded its program and waits for its arguments.

A production line starts one rig after another; this process loads while the specimen before is tested. Input, one line
of JSON: {"arguments": [...] (as of `python -m simulators`), "log": file to which standard error is appended}.
"""

from __future__ import annotations

import importlib
import json
import os
import sys

from simulators.options import RigOptions


def main() -> None:
    """Load, wait for the arguments, then run the rig; end without a rig at the end of the input."""
    entry, rig = (importlib.import_module(f"simulators.{name}") for name in ("__main__", "rig"))
    for name in ("ecu_files", "specimens"):  # the models of users' files
        importlib.import_module(f"rig.files.{name}")
    rig.SimulatedRig(RigOptions(), rig.RunOptions()).warm_up()
    line = sys.stdin.readline()
    if not line:
        return
    request = json.loads(line)
    log = os.open(request["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    for source, place in ((os.open(os.devnull, os.O_RDONLY), 0), (log, 2)):
        os.dup2(source, place)
        os.close(source)
    entry.main(args=request["arguments"], prog_name="python -m simulators")


if __name__ == "__main__":
    main()
