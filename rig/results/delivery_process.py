"""The process that delivers results while the application goes on: `python -m rig.results.delivery_process`.

It is started before the motion, loads its packages at low priority during it, and then answers one JSON line on its
standard input, {"folder"}, with one on its standard output: the keys of `Outbox.to_json` and `line`. The address of the
server is in the environment variable RIG_RESULTS, because other users of the computer can read arguments.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from pathlib import Path

from rig.bench.server_address import ADDRESS_VARIABLE
from rig.errors import RigError
from rig.results.delivery import deliver_folder

NICENESS = 10


def main() -> int:
    """Serve one request; the end of the input without one ends the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    line = sys.stdin.readline()
    if not line.strip():
        return 0
    try:
        outbox = deliver_folder(Path(json.loads(line)["folder"]), os.environ[ADDRESS_VARIABLE])
    except (RigError, OSError) as error:
        answer = {"error": str(error)}
    else:
        answer = {**outbox.to_json(), "line": outbox.line}
    with contextlib.suppress(OSError):  # the application did not wait
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
