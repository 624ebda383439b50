"""The process that identifies and reports while the application controls the rig: `python -m rig.cli.analyst`.

It is started before the motion, loads the numeric packages at low priority during it, and then answers one JSON line
on its standard input, {"run", "identify": {"model", "method", "holdout"} or null, "report_later"}, with one on its
standard output: {"fit", "report", "error", "report_error", "specimen"}, the last one as in `acceptance.json`. With
`report_later`, the answer comes first; afterwards, the report is written and the results database is updated.
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


def analyse(run: Path, settings: Mapping[str, Any] | None, *, report_later: bool = False) -> dict[str, Any]:
    """Identify (when wanted), evaluate the specimen and report; an error in one of them does not affect the others."""
    # loads numba and numpy: not needed for the help
    from rig.identification import identify_run

    def identified() -> str:
        identify_run([run], **(settings or {}))
        return str(CampaignFolder(run).fit.resolve())

    fit, error = (None, None) if settings is None else _made(identified)
    specimen = _specimen(run)
    report, report_error = (None, None) if report_later else _reported(run)
    return {"fit": fit, "report": report, "error": error, "report_error": report_error, "specimen": specimen}


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
        run, later = Path(request["run"]), bool(request.get("report_later"))
        sys.stdout.write(json.dumps(analyse(run, request["identify"], report_later=later)) + "\n")
        sys.stdout.flush()
        for what, error in (("report", _reported(run)[1]), ("database", _stored(run))) if later else ():
            if error:
                sys.stderr.write(f"{run.name}: {what}: {error}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
