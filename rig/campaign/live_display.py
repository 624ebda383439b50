"""The state of a campaign for pages, as three small files in its live folder; see `rig.station.live_folder`.

Implements `rig.campaign.results.Display`. Every file is replaced as a whole, so that any number of readers can come,
pause and go.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rig.campaign.results import NOT_RUN, CampaignResult, PointResult
from rig.campaign.sequencer.state import Phase, PhaseKind, phase_kind
from rig.clock import monotonic_ns, utc_now
from rig.matrix.plan import Plan
from rig.recording.quality.stopped_point import was_stopped
from rig.station.live_folder import PLAN, RESULTS, STATE, replace_json

KEPT_MESSAGES = 40


class LiveDisplay:
    """Writes the files; one that cannot be written is left out, the next one may succeed.

    Args:
        folder: the live folder.
        standing: what else is true now: `paused`, `held`, `confirm`.

    Attributes:
        campaign: the campaign's directory; empty until it is known.
    """

    def __init__(self, folder: Path, standing: Callable[[], Mapping[str, Any]]) -> None:
        self.campaign = ""
        self._folder = folder
        self._standing = standing
        self._results: dict[str, dict[str, Any]] = {}
        self._messages: deque[dict[str, Any]] = deque(maxlen=KEPT_MESSAGES)
        self._message_count = 0
        self._state: dict[str, Any] = {
            "phase": "", "kind": str(phase_kind("")), "stopping": False, "point": "", "cycles": 0, "time_left_s": None,
            "ended": None, **_counted({}),
        }  # fmt: skip

    def planned(self, plan: Plan) -> None:
        """The plan, once."""
        points = [
            {
                **item.to_json(), "described": item.point.phrase(plan.display), "repeats": item.point.has_frequency,
                "motion_s": item.point.motion_s, "kind": item.point.kind,
                "cycles": item.point.ramp_in_cycles + item.point.cycles + item.point.ramp_out_cycles,
                "ramp_in_cycles": item.point.ramp_in_cycles, "measured_cycles": item.point.cycles,
                "endurance_test": None if item.point.endurance is None else item.point.endurance.test,
            }
            for item in plan.points
        ]  # fmt: skip
        shown = plan.display.to_json()
        self._replace(PLAN, {"specimen": plan.specimen, "bench": plan.bench_name, "points": points, "display": shown})

    def phase(self, text: str) -> None:
        """What the campaign does now."""
        self._state |= {"phase": text, "kind": str(phase_kind(text))}
        if text == Phase.STOPPING:
            self._state["stopping"] = True
        elif phase_kind(text) is PhaseKind.MOVING:
            self._state["stopping"] = False  # it goes on, after a stop that was repeated without asking
        self._write()

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """How far it is; the live numbers come from the ring."""
        del live
        left_s = time_left_s if math.isfinite(time_left_s) else None
        self._state |= {"point": point_id, "cycles": cycles_done, "time_left_s": left_s}
        self._write()

    def point_done(self, result: PointResult) -> None:
        """A point's verdict."""
        self._results[result.id] = _shown(result)
        self._tell_results()

    def message(self, level: str, text: str) -> None:
        """A line for the operator."""
        self._message_count += 1
        utc = utc_now().isoformat(timespec="seconds")
        self._messages.append({"number": self._message_count, "utc": utc, "level": level, "text": text})
        self._write()

    def refused(self, slug: str, text: str) -> None:
        """It did not begin, or broke off, and why; stays until the next campaign."""
        self._state["ended"] = {"refused": slug, "lines": [text]}
        self._write()

    def specimen(self, specimen: Mapping[str, str]) -> None:
        """The verdict on the specimen of a campaign that has ended: `verdict` and `reason`."""
        if self._state["ended"] is not None:
            self._state["ended"] = {**self._state["ended"], "specimen": dict(specimen)}
            self._write()

    def ended(self, result: CampaignResult, lines: list[str]) -> None:
        """How it ended, with the lines that the operator reads at the terminal; stays until the next campaign.

        Verdicts are told again: what the whole session showed may have changed those of points.
        """
        for point in result.points:
            if point.id in self._results or point.verdict != NOT_RUN:
                self._results[point.id] = _shown(point)
        self._tell_results()
        self._state["ended"] = {
            "valid": result.valid, "total": result.total, "rig_state": str(result.rig_state),
            "stopped_by": result.stopped_by, "exit_code": result.exit_code, "lines": lines,
        }
        self._write()

    def _tell_results(self) -> None:
        self._replace(RESULTS, self._results)
        self._state |= _counted(self._results)
        self._write()

    def _write(self) -> None:
        state = {**self._state, **self._standing(), "messages": list(self._messages), "campaign": self.campaign}
        self._replace(STATE, {**state, "host_ns": monotonic_ns()})

    def _replace(self, name: str, value: object) -> None:
        # What pages are shown is worth no stop, and shared memory that is full now may not be so the next time.
        with contextlib.suppress(OSError):
            replace_json(self._folder / name, value)


def _counted(results: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """Number of points by verdict, for lists that show no points."""
    verdicts = [one["verdict"] for one in results.values()]
    return {name: verdicts.count(name) for name in ("valid", "suspect", "invalid")}


def _shown(result: PointResult) -> dict[str, Any]:
    peak = result.peak_force
    ends_degC = [result.quality.get(f"coil_temperature_{end}_degC", math.nan) for end in ("low", "high")]
    return {
        "verdict": result.verdict, "reasons": list(result.reasons), "slugs": list(result.slugs),
        "stopped": was_stopped(result.verdict, result.reasons),
        "file": None if result.file is None else result.file.name,
        "coil_degC": ends_degC if all(map(math.isfinite, ends_degC)) else None,
        "peak_force_rebound_N": None if peak is None else peak.rebound_N,
        "peak_force_compression_N": None if peak is None else peak.compression_N,
    }  # fmt: skip
