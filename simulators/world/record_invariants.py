"""What must hold of records: what a file says is what was there, and what is finished is not run again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rig.campaign.results import INVALID, VALID
from rig.errors import FileProblem
from rig.recording.recorded_point import RecordedPoint
from simulators.world.view import Findings, View

TRUE_SHARE, TRUE_FORCE_N = 0.05, 60.0
"""So much may a recorded force's ends differ from the true ones: of its span, and noise beside."""
TRUE_TRAVEL_M = 0.5e-3


def recorded_is_what_was_there(view: View) -> Findings:
    """Where no device had a fault, force and displacement of a valid point reach as far as those of the rod."""
    if view.world.folder is None or view.faults() or view.world.plan.bench:
        return  # a user's own sensors may be too slow for the loop's ends
    began = {str(line["point"]): float(line["host_ns"]) for line in view.lines if line.get("event") == "point"}
    for line in view.lines:
        if line.get("event") != "judged" or line.get("verdict") != VALID or str(line["id"]) not in began:
            continue
        try:
            point = RecordedPoint.open(view.world.folder / "points" / str(line["file"]).rpartition("/")[2])
        except (OSError, FileProblem):
            continue  # told by another check
        began_ns = began[str(line["id"])]
        rows = view.between(began_ns, began_ns + 1e9 * float(point.time_s[-1] - point.time_s[0]))
        if not len(rows):
            continue
        force_N = TRUE_FORCE_N + TRUE_SHARE * np.ptp(rows[:, 4])
        for name, values, truth, allowed in (
            ("force", point.force_N, rows[:, 4], force_N),
            ("force at its own times", point.force_samples.force_N, rows[:, 4], force_N),
            ("displacement", point.displacement_m, rows[:, 3], TRUE_TRAVEL_M),
        ):
            for end in (np.nanmin, np.nanmax):
                recorded, true = float(end(values)), float(end(truth))
                if abs(recorded - true) > allowed:
                    yield f"{line['id']}: {name} {end.__name__[3:]} {recorded:.4g} recorded, {true:.4g} true", began_ns


def what_is_finished_is_not_run_again(view: View) -> Findings:
    """A point that an earlier session told to be finished is not begun by a later one."""
    finished: set[str] = set()
    for line in view.world.journal:
        earlier = int(line.get("host_ns", 0)) < view.session.began_ns
        if earlier and line.get("event") == "judged" and line.get("file") and line.get("verdict") != INVALID:
            finished.add(str(line["id"]))
        if line.get("event") == "retimed":
            finished.discard(str(line.get("file")))
    for line in view.lines:
        if line.get("event") == "point" and str(line["point"]) in finished:
            yield f"{line['point']} is run again, though it was finished", float(line["host_ns"])


RECORD_CHECKS: dict[str, Callable[[View], Findings]] = {
    "true-record": recorded_is_what_was_there,
    "run-again": what_is_finished_is_not_run_again,
}
