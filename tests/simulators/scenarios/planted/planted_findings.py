"""Bugs that were there once (marked S in the project's findings), each brought back by a few changed lines."""

from __future__ import annotations

from edits import Edit

STATION = "rig/station/supervisor.py"
RECOVERY = "rig/recording/conversion/recovery.py"
RUNNER = "rig/campaign/execution/runner.py"
CONTROLLER = "rig/station/interlocks/actuator_interlock.py"

HANGS = (
    Edit(RUNNER, "failed.append(ev.ActionFailed(action, self.state.phase, cause_of(error)))", "return"),
    Edit("rig/campaign/execution/action_executor.py", "overdue.append(ev.TimedOut(phase))", "pass"),
)
"""S1: the rest of a step is lost with an action that fails, and no phase has a deadline."""

OTHERS_JOURNALS = (
    Edit(
        RECOVERY,
        'own = re.compile(rf"({re.escape(point_id)}([-.]{ATTEMPT}\\d+)?)({re.escape(FILE)}|{re.escape(JOURNAL)})")',
        'own = re.compile(rf"({re.escape(point_id)}.*?)()({re.escape(FILE)}|{re.escape(JOURNAL)})")',
    ),
    Edit(RECOVERY, "_set_journal_aside(path, point_id, by_name)", "path.rename(free_old_journal(path))"),
)
"""S2: journals of other points whose names begin alike are put aside while they are converted."""

OTHER_STOP = (
    Edit(
        CONTROLLER,
        "        findings = self._command(status, sent)\n",
        "        return []\n        findings = self._command(status, sent)\n",
    ),
    Edit("rig/campaign/execution/observer.py", "cut_short = stopping or self._cycles_missing(ordered_cycles)",
         'cut_short = ""'),
)
"""S3: somebody else's stop is taken for the end of the program."""

LOG_FIRST = (
    Edit(STATION, "for action in sorted(actions, key=_SLOWEST_LAST.index):", "for action in actions:"),
    Edit(STATION, "            self._try(self._carry_out, action)\n", "            self._carry_out(action)\n"),
    Edit("rig/station/log.py", "    with contextlib.suppress(OSError):\n", "    if True:\n"),
)
"""S7: the current's action comes first, and a line of the log that cannot be written ends the stop."""

LATE_WORD = (
    Edit(
        STATION,
        "            if first or not known:\n"
        "                self._try(self._emit, trip_event(finding, kind, first, now_ns))\n"
        "                record: Record = (now_ns, NO_DEVICE_TIME, float(row.code), 0, Channel.TRIP, 0)\n"
        "                self._try(self._append, [record])\n"
        "        return actions\n",
        "        self._finish(actions)\n"
        "        if first or not known:\n"
        "            self._try(self._emit, trip_event(finding, kind, first, now_ns))\n"
        "            record: Record = (now_ns, NO_DEVICE_TIME, float(row.code), 0, Channel.TRIP, 0)\n"
        "            self._try(self._append, [record])\n"
        "        return ()\n",
    ),
)
"""S8: a stop's cause is told after the stop is performed, when a later one may have been told."""

FINDINGS: dict[str, tuple[Edit, ...]] = {
    "S1-hangs": HANGS, "S2-others-journals": OTHERS_JOURNALS, "S3-foreign-stop": OTHER_STOP,
    "S7-log-first": LOG_FIRST, "S8-late-word": LATE_WORD,
}
