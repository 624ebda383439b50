"""The process that identifies and reports while the application controls the rig: `python -m rig.cli.analyst`.

It is started before the motion, loads the numeric packages at low priority during it, and then answers one JSON line
on its standard input, {"run", "identify": {"model", "method", "holdout"} or null}, with one on its standard output:
{"fit", "report", "error", "report_error"}.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.campaign_folder import CampaignFolder
from rig.errors import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

NICENESS = 10


def analyse(run: Path, settings: Mapping[str, Any] | None) -> dict[str, Any]:
    """Identify (when wanted) and report; what fails is said, and does not cost the other."""
    # loads numba and numpy: not needed for the help
    from rig.identification import identify_run
    from rig.report import write_report

    def identified() -> Path:
        identify_run([run], **(settings or {}))
        return CampaignFolder(run).fit

    fit, error = (None, None) if settings is None else _made(identified)
    report, report_error = _made(lambda: write_report(run))
    return {"fit": fit, "report": report, "error": error, "report_error": report_error}


def _made(make: Callable[[], Path]) -> tuple[str | None, str | None]:
    """The path of what was made, or why it could not be: a message, or the traceback of an unexpected error."""
    try:
        return str(make().resolve()), None
    except (RigError, OSError) as error:
        return None, str(error)
    except Exception:  # noqa: BLE001 - the last stop of this process: the answer carries the traceback
        return None, traceback.format_exc()


def main() -> int:
    """Serve requests until the input ends."""
    os.nice(NICENESS)
    for room in ("rig.identification", "rig.report"):
        importlib.import_module(room)
    for line in sys.stdin:
        request = json.loads(line)
        sys.stdout.write(json.dumps(analyse(Path(request["run"]), request["identify"])) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
