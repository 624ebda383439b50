"""What the page knows of the run that it watches, from files alone: live folder, station's settings, journal.

Nothing of this is written by the page. A file that is missing or damaged shows as nothing known.
"""

from __future__ import annotations

import contextlib
import json
from collections import deque
from pathlib import Path
from typing import Any

from drivers import clock
from rig.campaign_folder import CampaignFolder
from rig.display import Display
from rig.errors import FileProblem
from rig.files.run_display import run_display
from rig.page.ended_run import EndedRun, trials_of
from rig.recording.journal.ring_reader import RingProblem, RingReader
from rig.station.live_folder import DEVICES, LOCK, PLAN, RESULTS, STATE, held, read_json
from rig.text_file import JSON_LIMIT_BYTES, open_regular, stamp

KEPT_EVENTS = 200
STOP_PARTS_WITHIN = 20
"""Events between the parts of one stop: the application's note, the station's trip, the campaign's result."""
LONGEST_READ = 1 << 18
READ_AT_FIRST = 1 << 22
"""Number of bytes at the end of a journal that always contain `KEPT_EVENTS` events; earlier bytes are not read."""
TEXT_KEYS = ("text", "detail", "reason", "note")
QUIET = frozenset({"sent", "stop", "setpoints", "late"})
"""Of the station's events: for the journal, not for a log that people read."""


class WatchedRun:
    """One run, looked at again and again: while it runs, after its end, and when it is resumed.

    Args:
        run: its directory; None while the application has not made it.
        live: its live folder; None: as the run's directory says, if it says anything.
    """

    def __init__(self, run: Path | None, live: Path | None = None) -> None:
        self._run = run
        self._live = live
        self._stamps: dict[str, object] = {}
        self._journal = Journal()
        self._ring: RingReader | None = None
        self._ended: EndedRun | None = None
        self._numbered = 0
        self._entered = ""
        self._files: tuple[object, dict[str, str]] = None, {}
        self.events: deque[dict[str, Any]] = deque(maxlen=KEPT_EVENTS)

    @property
    def run(self) -> Path | None:
        """Its directory, once it is known."""
        if self._run is None and self._live is not None:
            named = str(read_json(self._live / STATE).get("campaign", ""))
            self._run = Path(named) if named else None
        return self._run

    @property
    def live_folder(self) -> Path | None:
        """Where its application takes wishes; None once it has ended."""
        if self._live is not None and held(self._live / LOCK):
            return self._live
        named = "" if self._run is None else str(read_json(CampaignFolder(self._run).live_link).get("folder", ""))
        if named and held(Path(named) / LOCK):
            self._live = Path(named)  # it began, or was resumed, after this page
            return self._live
        return None

    @property
    def ended(self) -> EndedRun | None:
        """What it left; None while there is no directory."""
        if self._ended is None and self.run is not None:
            self._ended = EndedRun(self.run)
        return self._ended

    def description(self) -> dict[str, Any]:
        """What does not change while the run lasts: its name, limits, devices, plan."""
        run, live, display = self.run, self.live_folder, self._display()
        station = self._station()
        plan = {} if live is None else read_json(live / PLAN)
        described = {} if run is None else read_json(CampaignFolder(run).description)
        if live is None and run is not None:
            plan = {
                "specimen": described.get("specimen", ""), "bench": described.get("bench", ""),
                "points": [] if self.ended is None else _described(self.ended.result["points"], display),
            }
        ecu = station.get("ecu")
        return {
            "type": "run", "name": "" if run is None else run.name, "specimen": plan.get("specimen", ""),
            "bench": plan.get("bench", ""), "simulated": _is_simulated(live, described),
            "points": plan.get("points", []), "limits": station.get("limits", {}),
            "devices": devices(station), "device_rate": station.get("device_rate", 1.0),
            "by_hand": isinstance(ecu, dict) and bool(ecu.get("by_hand")), "ring": station.get("ring_path", ""),
            "display": _quantities(display),
        }

    def _display(self) -> Display:
        """`[display]` of the run."""
        try:
            return Display() if self.run is None else run_display(self.run)
        except FileProblem:
            return Display()

    def _station(self) -> dict[str, Any]:
        return {} if self.run is None else read_json(CampaignFolder(self.run).station_config)

    def frames_of(self) -> tuple[float, float]:
        """Device seconds in a host second, and the displacement sensor's rate (Hz)."""
        station = self._station()
        return float(station.get("device_rate", 1.0)), float(station.get("lvdt", {}).get("rate_Hz", 250.0))

    def ring(self) -> RingReader | None:
        """The station's ring; None before there is one, and once the campaign has ended."""
        if self._ring is not None:
            return self._ring
        if self.live_folder is None:
            return None
        station = self._station()
        named = station.get("ring_path")
        with contextlib.suppress(RingProblem):
            self._ring = RingReader(Path(str(named))) if named else None
        with contextlib.suppress(clock.ClockRefused):
            clock.follow(str(station.get("shared") or ""), None)
        return self._ring

    def state(self) -> dict[str, Any]:
        """Current state: phase, point, time left, and the outcome of a finished run."""
        live = self.live_folder
        if live is not None:
            return self.running_state(live)
        state = {} if self._live is None else read_json(self._live / STATE)
        ended = state.get("ended")
        if ended is None and self.ended is not None:
            ended = {key: value for key, value in self.ended.result.items() if key != "points"}
            ended |= {"specimen": self.ended.specimen} if self.ended.specimen else {}
        if ended is None:
            return {"type": "state", "running": False}  # nothing has begun yet
        return {"type": "state", "phase": "ended", "kind": "ended", "ended": ended, "running": False}

    def running_state(self, live: Path) -> dict[str, Any]:
        """`state` of the running campaign, from small files only."""
        state = read_json(live / STATE)
        state.pop("messages", None)  # for the terminal; the important ones are also events
        run = self.run
        if run is not None and self._differs("operator", written := stamp(CampaignFolder(run).operator)):
            self._entered = "" if written is None else str(read_json(CampaignFolder(run).operator).get("specimen", ""))
        return {"type": "state", **state, "entered": self._entered, "running": True}

    def results(self) -> dict[str, Any]:
        """Verdicts by point."""
        live = self.live_folder
        if live is not None:
            return {"type": "results", "points": read_json(live / RESULTS)}
        return {"type": "results", "points": {} if self.ended is None else self.ended.points}

    def endurance(self) -> dict[str, Any]:
        """The endurance tests: cycles, stop rules and trend of each, as after the last block."""
        tests = [] if self.run is None else read_json(CampaignFolder(self.run).endurance).get("tests")
        return {"type": "endurance", "tests": tests if isinstance(tests, list) else []}

    def trials(self) -> dict[str, Any] | None:
        """Trials of the signal whose command was iterated last; None without any."""
        return None if self.run is None else trials_of(CampaignFolder(self.run).drives)

    def recorded_file(self, point_id: str) -> Path | None:
        """The file of a recorded point, of a running campaign or one that has ended; None if there is none."""
        if self.ended is None:
            return None
        if self.live_folder is None:
            return self.ended.file_of(point_id)
        point = self.results()["points"].get(point_id)
        return self.ended.file(point) if isinstance(point, dict) else None

    def began_or_ended(self, live: Path | None) -> bool:
        """Whether the campaign started, ended or was resumed since the last call; if so, everything is sent again.

        Args:
            live: current value of `live_folder`.
        """
        changed = self._differs("live", live)
        if changed:
            self.close()
        return changed

    def state_changed(self) -> bool:
        """Whether the campaign has written its state since the last call."""
        return self._live is not None and self._differs(STATE, stamp(self._live / STATE))

    def grown(self) -> frozenset[str]:
        """Which of `run`, `results`, `events`, `endurance` and `iteration` have changed since the last call."""
        run, live = self.run, self._live
        if self._files[0] != (run, live):
            self._files = (run, live), _grow(run, live)
        grown = {PARTS[name] for name, path in self._files[1].items() if self._differs(name, stamp(path))}
        return frozenset(grown | {"run"} if self._differs("run", run) else grown)

    def _differs(self, name: str, now: object) -> bool:
        before, self._stamps[name] = self._stamps.get(name, ""), now
        return now != before

    def news(self) -> list[dict[str, Any]]:
        """New events of the journal, for display; also stored in `events`.

        Each has a `number`. The parts of one stop form one event; `instead_of` is the number of the event that it
        replaces.
        """
        run = self.run
        new: list[dict[str, Any]] = []
        while run is not None and (lines := self._journal.lines(CampaignFolder(run).journal)):
            new += self._events_of(lines)
        return new[-KEPT_EVENTS:]

    def _events_of(self, lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
        new: list[dict[str, Any]] = []
        for event in filter(None, map(shown_event, lines)):
            before = self._other_part(event)
            if before is not None and event["part"] == RESULT:
                continue  # the stop is already shown with the same cause
            self._numbered += 1
            event["number"] = self._numbered
            if before is not None:
                event = _joined(before, event)
                self.events.remove(before)
                new = [one for one in new if one is not before]
            self.events.append(event)
            new.append(event)
        return new

    def _other_part(self, event: dict[str, Any]) -> dict[str, Any] | None:
        """The last event of the same stop (by its code), or None."""
        joins = JOINS.get(event["part"], frozenset())
        recent = list(self.events)[: -STOP_PARTS_WITHIN - 1 : -1]
        return next((one for one in recent if one["part"] in joins and one["stop"] == event["stop"]), None)

    def close(self) -> None:
        """Let go of the ring."""
        if self._ring is not None:
            self._ring.close()
            self._ring = None
            clock.leave()


CUT_OFF = b"#"
"""Prefix of the partial first line read from a long journal, which makes it invalid JSON."""


class Journal:
    """Follows a journal as it grows."""

    def __init__(self) -> None:
        self._offset = 0
        self._rest = b""

    def lines(self, path: Path) -> list[dict[str, Any]]:
        """The whole lines that came since the last call; what is no JSON object is left out."""
        try:
            size = path.stat().st_size
            if size == self._offset:
                return []
            if self._offset == 0 and size > READ_AT_FIRST:
                self._offset, self._rest = size - READ_AT_FIRST, CUT_OFF
            with open_regular(path) as file:
                file.seek(self._offset)
                data = file.read(LONGEST_READ)
        except (OSError, FileProblem):
            return []
        self._offset += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > JSON_LIMIT_BYTES:  # no line of a journal
            self._rest = b""
        events: list[dict[str, Any]] = []
        for line in whole:
            with contextlib.suppress(ValueError, RecursionError):
                event = json.loads(line)
                if isinstance(event, dict):
                    events.append(event)
        return events


NOTE, TRIP, RESULT, STOP = "note", "trip", "result", "stop"
"""Parts of a stop, and what note and trip become together."""
JOINS = {NOTE: frozenset({TRIP}), TRIP: frozenset({NOTE}), RESULT: frozenset({TRIP, STOP})}
"""Earlier parts of the same stop that each part is merged with."""


def _joined(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """One event of a stop's note and trip: the code of the trip, the words of the note."""
    note, trip = (before, after) if before["part"] == NOTE else (after, before)
    return {**trip, "part": STOP, "utc": before["utc"], "text": note["text"], "instead_of": before["number"],
            "number": after["number"]}


PARTS = {
    PLAN: "run", DEVICES: "run", "station": "run", RESULTS: "results", "journal": "events", "endurance": "endurance",
    "drives": "iteration",
}
"""Parts that are read again if a file has changed."""


def _grow(run: Path | None, live: Path | None) -> dict[str, str]:
    """Watched files of a run, by their key in `PARTS`."""
    files = {} if live is None else {name: str(live / name) for name in (PLAN, DEVICES, RESULTS)}
    if run is None:
        return files
    folder = CampaignFolder(run)
    own = {
        "station": folder.station_config, "journal": folder.journal, "endurance": folder.endurance,
        "drives": folder.drives,
    }
    return {**files, **{name: str(path) for name, path in own.items()}}


def _described(points: list[dict[str, Any]], display: Display) -> list[dict[str, Any]]:
    """Points of a result, described in the units of `[display]`."""
    return [
        {**point, "described": display.described(point["described"], point["amplitude_m"])}
        if isinstance(point.get("described"), str) and isinstance(point.get("amplitude_m"), float)
        else point
        for point in points
    ]


def _quantities(display: Display) -> dict[str, dict[str, Any]]:
    """Units and signs of `[display]`, by quantity."""
    signed = {"force": display.force, "displacement": display.displacement, "speed": display.speed}
    quantities = {**signed, "temperature": display.temperature, "energy": display.energy}
    return {
        name: {
            "unit": shown.unit, "scale": shown.scale, "offset": shown.offset,
            "sign": -1 if name in signed and shown.positive == "compression" else 1,
        }
        for name, shown in quantities.items()
    }  # fmt: skip


def _is_simulated(live: Path | None, described: dict[str, Any]) -> bool:
    """Whether a run is known to be on a simulated rig: such a rig has no devices of its own."""
    devices = None if live is None else read_json(live / DEVICES).get("devices")
    return devices == [] or isinstance(described.get("simulated"), dict)


def shown_event(event: dict[str, Any]) -> dict[str, Any] | None:
    """One event of the journal as the page shows it; None for what people need not read."""
    kind, what = str(event.get("event", "")), str(event.get("what", ""))
    if kind == "station" and (what in QUIET or what in {"ready", "safe"}):
        return None
    slug = event.get("slug")
    text = next((str(event[name]) for name in TEXT_KEYS if event.get(name)), "")
    if kind == "phase" or not (slug or text):
        return None
    grave = what in {"trip", "unknown"} or kind in {"error", "refused"}
    minor = kind in {"warning", "finding"} or what in {"also", "warning"}
    part, stop = _stop_part(kind, what, event)
    return {
        "utc": str(event.get("utc", ""))[:19], "level": "error" if grave else "warning" if minor else "info",
        "slug": "" if slug is None else str(slug), "text": text[:500], "by": str(event.get("by", ""))[:80],
        "part": part, "stop": stop,
    }  # fmt: skip


def _stop_part(kind: str, what: str, event: dict[str, Any]) -> tuple[str, str]:
    """Part of a stop that an event represents, and the code of the stop; both empty for other events."""
    part, key = (
        (RESULT, "stopped_by") if kind == RESULT else (TRIP, "slug") if what == TRIP
        else (NOTE, "stop") if kind in {"info", "warning", "error"} else ("", "")
    )  # fmt: skip
    stop = event.get(key)
    return (part, stop) if isinstance(stop, str) and stop else ("", "")


def devices(station: dict[str, Any]) -> list[dict[str, Any]]:
    """Every device of a station's settings: name, the channel that shows that it lives, and when it is stale (s)."""
    auxiliary = station.get("auxiliary")
    sensors = auxiliary if isinstance(auxiliary, list) else []
    entries = [
        ("actuator", station.get("actuator"), 23), ("ECU", station.get("ecu"), 10),
        ("load cell", station.get("load_cell"), 1), ("LVDT", station.get("lvdt"), 2),
        *((str(item.get("name", "")), item, 3 + index) for index, item in enumerate(sensors) if isinstance(item, dict)),
    ]  # fmt: skip
    named = []
    for name, settings, channel in entries:
        if isinstance(settings, dict):
            stale_s = settings.get("stale_after_s") or 0.5
            named.append({"name": name, "channel": channel, "stale_after_s": stale_s, "unit": settings.get("unit", "")})
    return named
