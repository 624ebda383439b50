"""The process that identifies and reports while the application controls the rig: `python -m rig.cli.analyst`.

It is started before the motion, loads the numeric packages at low priority during it, and then serves JSON lines on its
standard input:

- {"do": "evaluate", "run", "identify": {"model", "method", "holdout"} or null}: identifies the damper and evaluates the
  specimen; the answer on standard output is {"fit", "error", "specimen"}, the last one as in `acceptance.json`.
- {"do": "report", "run"}: writes the report; the answer is {"report", "report_error"}.
- {"do": "finish", "run"}: writes the report and updates the results database; without an answer, for a production line,
  which goes on with the next specimen.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rig.campaign_folder import CampaignFolder
from rig.errors import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

NICENESS = 10
Made = TypeVar("Made")


def evaluate(run: Path, settings: Mapping[str, Any] | None) -> dict[str, Any]:
    """Identify (when wanted) and evaluate the specimen; an error in one of them does not affect the other."""
    # loads numba and numpy: not needed for the help
    from rig.identification import identify_run

    def identified() -> str:
        identify_run([run], **(settings or {}))
        return str(CampaignFolder(run).fit.resolve())

    fit, error = (None, None) if settings is None else _made(identified)
    return {"fit": fit, "error": error, "specimen": _specimen(run)}


def _reported(run: Path) -> tuple[str | None, str | None]:
    """The path of the report of a run, or why it could not be written."""
    # loads numba and numpy: not needed for the help
    from rig.report import write_report

    return _made(lambda: str(write_report(run).resolve()))


def _stored(run: Path) -> str:
    """Bring the results database of the folder of a run up to date.

    Returns:
        Why this was not possible; the run directory remains, so the next update includes the run. Empty: done.
    """
    # loads SQLAlchemy: only for a production line
    from rig.results.filling import filled_database

    def stored() -> bool:
        with filled_database(run.resolve().parent):
            return True

    return _made(stored)[1] or ""


def _specimen(run: Path) -> dict[str, Any] | None:
    """The verdict on the specimen, also written to the run; None if the matrix has no acceptance bands."""
    # loads numba and numpy: not needed for the help
    from rig.comparison.specimen import specimen_result, untested, write_specimen
    from rig.matrix.acceptance_table import has_acceptance
    from rig.recording.run import Run

    if not has_acceptance(run):
        return None
    evaluated, error = _made(lambda: specimen_result(Run.open(run)))
    result = evaluated or untested(run, error or "the run has no acceptance bands")
    with contextlib.suppress(OSError):  # the answer carries it
        write_specimen(run, result)
    return result.to_json()


def _made(make: Callable[[], Made]) -> tuple[Made | None, str | None]:
    """What was made, or why it could not be: a message, or the traceback of an unexpected error."""
    try:
        return make(), None
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
        run, do = Path(request["run"]), request["do"]
        if do == "finish":
            for what, error in (("report", _reported(run)[1]), ("database", _stored(run))):
                if error:
                    sys.stderr.write(f"{run.name}: {what}: {error}\n")
            continue
        if do == "evaluate":
            answer = evaluate(run, request["identify"])
        else:
            answer = dict(zip(("report", "report_error"), _reported(run), strict=True))
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
