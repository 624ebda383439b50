"""A whole check: station up, every device looked at, seconds of rest recorded, the proofs where they may be made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.machine_resources import station_in_use
from rig.check.finding import CheckReport, failed, warning
from rig.check.judgement import ACTUATOR, LOAD_CELL, LVDT, Reports
from rig.check.proof import NotProved, armed, prove_sensors, prove_watchdog
from rig.clock import monotonic_ns, utc_now
from rig.errors import EXIT_DONE, UnknownRigState
from rig.recording.journal.ring_reader import RingReader
from rig.station.client import StationClient, StationLost

EXAMINE_S = 60.0
REST_S = 3.0
TURN_S = 0.05
STATION_ENDS_S = 30.0

Told = Callable[[str], None]


def check_bench(bench: Bench, folder: Path, told: Told, *, prove: bool = False) -> CheckReport:
    """Look at every device of a bench.

    Without `prove` nothing moves and no current flows; the watchdog is starved only where there is no pressure.

    Args:
        bench: the rig.
        folder: an empty one, for the station's files and log.
        told: told what is being done, for people.
        prove: starve the watchdog and move the rod by 2 mm, at 10 mm/s and 0 A, where nothing has failed before.

    Returns:
        What was found, also when nothing answers.

    Raises:
        Refused: the station does not start, or a campaign holds one of the devices.
        UnknownRigState: the rig was armed, and its station could not prove that it is safe at the end.
    """
    with ExitStack() as ends:
        told("starting the station")
        client, config = ends.enter_context(station_in_use(bench, None, folder, ()))
        check = _Check(bench, client, config, told)
        try:
            check.run(prove=prove)
        finally:
            # Whatever happened: at the end of its link the station stops an armed rig and takes the pressure away.
            code = client.close(STATION_ENDS_S)
        if code != EXIT_DONE and check.was_armed:
            raise UnknownRigState(f"the station could not prove that the rig is safe; go and look ({folder})")
        return CheckReport(bench.name, tuple(check.reports.of.values()), check.moved)


class _Check:
    """One check under way.

    Attributes:
        reports: what was found so far.
        was_armed: the interlocks were armed, so that the end must be proved.
        moved: the proof move was made.
    """

    def __init__(self, bench: Bench, client: StationClient, config: StationConfig, told: Told) -> None:
        self.reports = Reports(bench, config)
        self.was_armed = self.moved = False
        self._client = client
        self._config = config
        self._told = told
        self._pressure_off = False

    def run(self, *, prove: bool) -> None:
        """Everything in its order; a station that is lost is a finding of this machine."""
        try:
            self._look()
            if not self.reports.failed:
                self._prove(move=prove)
            elif self.reports.of[ACTUATOR].verdict != "failed":
                self._unproved("something else failed")
        except StationLost as lost:
            self.reports.add("host", failed("task-dies", str(lost)))

    def _look(self) -> None:
        client, reports = self._client, self.reports
        self._told("opening every device")
        entries: list[Mapping[str, Any]] = client.request("examine", EXAMINE_S)["devices"]
        self._pressure_off = any(seen["pressure_off"] for seen in entries)
        reports.examined(entries)
        reports.calibrations(utc_now().date())
        self._told(f"recording {REST_S:g} s at rest")
        with RingReader(Path(self._config.ring_path)) as ring:
            until_ns = monotonic_ns() + int(1e9 * REST_S)
            parts, events = [ring.read()], []
            while monotonic_ns() < until_ns:
                events += client.events(timeout_s=TURN_S)
                parts.append(ring.read())
        records = np.concatenate(parts)
        reports.streams(records)
        reports.at_rest(records)
        reports.warned(events)
        status = client.request("status")
        reports.host(client.ready, int(status["late_loops"]), float(status["late_worst_s"]))

    def _unproved(self, why: str) -> None:
        text = f"the watchdog was not starved: {why}"
        self.reports.add(ACTUATOR, warning("watchdog-unproved", text))

    def _prove(self, *, move: bool) -> None:
        if not (move or self._pressure_off):
            self._unproved("the rig is under pressure")
            return
        report = self.reports.of[ACTUATOR]
        try:
            self.was_armed = True
            with armed(self._client):
                self._told("starving the watchdog")
                after_s = prove_watchdog(self._client)
                report.numbers["watchdog_ms"] = None if after_s is None else 1e3 * after_s
                if move:
                    self._move()
        except NotProved as ended:
            self.reports.add(ACTUATOR, failed(ended.slug, ended.message))

    def _move(self) -> None:
        self._told("moving the rod by 2 mm up and down, at 10 mm/s and 0 A")
        self.moved = True
        with RingReader(Path(self._config.ring_path)) as ring:
            cause = prove_sensors(self._client, self._config, ring)
        if cause is None:
            return
        name = LVDT if cause.message == "lvdt-scale" else LOAD_CELL
        self.reports.add(name, failed(cause.slug, cause.detail, self.reports.turned(name)))
