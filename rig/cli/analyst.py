"""The process that identifies and reports while the application stays with the rig: `python -m rig.cli.analyst`.

It is started before the motion, loads the numeric packages at low priority during it, and then answers one JSON line
on its standard input, {"run", "identify": {"model", "method", "holdout"} or null}, with one on its standard output:
{"fit", "report", "error", "warning"}.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import RigError

if TYPE_CHECKING:
    from collections.abc import Mapping

NICENESS = 10


def analyse(run: Path, wanted: Mapping[str, Any] | None) -> dict[str, Any]:
    """Identify (when wanted) and report; what fails is said, and does not keep the report from being written."""
    from rig.identification import identify_run
    from rig.report import write_report

    answer: dict[str, Any] = {"fit": None, "report": None, "error": None, "report_error": None}
    if wanted is not None:
        try:
            identify_run([run], **wanted)
            answer["fit"] = str((run / "fit.json").resolve())
        except RigError as error:
            answer["error"] = str(error)
    try:
        answer["report"] = str(write_report(run).resolve())
    except (RigError, OSError) as error:
        answer["report_error"] = str(error)
    return answer


def main() -> int:
    """Serve requests until the input ends."""
    os.nice(NICENESS)
    for room in ("rig.identification", "rig.report"):
        importlib.import_module(room)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = analyse(Path(request["run"]), request["identify"])
        except Exception:  # noqa: BLE001 - the last stop of this process: the answer carries the traceback
            answer = {"fit": None, "report": None, "error": traceback.format_exc(), "report_error": None}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
