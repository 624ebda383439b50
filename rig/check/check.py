"""A whole check: start the station, examine every device, record seconds of rest, make the tests if permitted.

Two properties need a test: the watchdog trips without refresh, and the sensors follow a small, slow move. The station
executes it, armed as for a campaign, with the same interlocks, limits and stops. If anything fails, closing the link
makes the station stop the rig and switch the pressure off.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers import clock
from drivers.clock import back_whenever, back_within
from drivers.ring import Channel
from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.execution.observer import AT_CENTRE_M
from rig.campaign.machine_resources import station_in_use
from rig.campaign.preflight.proof_move import PROOF_M, PROOF_SPEED_M_S, Leg, check_proof, proof_targets
from rig.campaign.stop_cause import StopCause
from rig.check.evaluation import ACTUATOR, ECU, LOAD_CELL, LVDT, Reports
from rig.check.finding import CheckReport, failed, warning
from rig.clock import monotonic_ns, utc_now
from rig.errors import EXIT_DONE, UnknownRigState
from rig.recording.journal.ring_reader import RingReader
from rig.station.client import StationClient, StationLost, StationRefused

EXAMINE_S = 60.0
REST_S = 3.0
TURN_S = 0.05
STATION_ENDS_S = 30.0
BEAT_S = 0.1
LOOK_S = 0.02
REQUEST_S = 20.0
MOVE_S = 10.0
"""Longest time for one way of the move (s of the rig's clock)."""
HELD_S = 0.3
OF_THE_COIL = frozenset({"ecu-command", "coil-not-ready", "coil-temperature", "current-stuck", "supply-not-zero"})
"""What ends a proof on the part of the current source."""
FIXES = {
    "ecu-command": "under [protection.MESSAGE] in the roles file, enter the protection of the command message from "
    "the ECU's documentation: profile, data_id, counter, crc; otherwise check the DBC file and the power supply of "
    "the ECU's output stage",
}
FEWEST = 10

Report = Callable[[str], None]


@clock.restored()
def check_bench(bench: Bench, folder: Path, report: Report, *, prove: bool = False) -> CheckReport:
    """Check every device of a bench.

    Without `prove`, nothing moves, no current flows, and the watchdog is tested only without pressure. A watchdog that
    works only under pressure is tested only with `prove`.

    Args:
        bench: the rig.
        folder: an empty one, for the station's files and log.
        report: called with a description of each step.
        prove: test the watchdog and move the rod by 2 mm, at 10 mm/s and 0 A, if no check has failed before.

    Returns:
        The findings, even if no device answers.

    Raises:
        Refused: the station does not start, or a campaign holds one of the devices.
        UnknownRigState: the rig was armed, and its station could not prove that it is safe at the end.
    """
    with ExitStack() as ends:
        report("starting the station")
        client, config = ends.enter_context(station_in_use(bench, None, folder, ()))
        check = _Check(bench, client, config, report)
        try:
            check.run(prove=prove)
        finally:
            # Whatever happened: at the end of its link the station stops an armed rig and takes the pressure away.
            code = client.close(STATION_ENDS_S)
        if code != EXIT_DONE and check.was_armed:
            raise UnknownRigState("the station could not confirm that the rig is safe. Fix: inspect the rig before "
                f"continuing ({folder})")
        return CheckReport(bench.name, tuple(check.reports.of.values()), check.moved)


class _Check:
    """One check under way.

    Attributes:
        reports: what was found so far.
        was_armed: the interlocks were armed, so that the end must be proved.
        moved: the proof move was made.
    """

    def __init__(self, bench: Bench, client: StationClient, config: StationConfig, report: Report) -> None:
        self.reports = Reports(bench, config)
        self.was_armed = self.moved = False
        self._client = client
        self._config = config
        self._report = report
        self._pressure_off = False

    def run(self, *, prove: bool) -> None:
        """Everything in its order; a station that is lost is a finding of this machine."""
        try:
            self._look()
            if not self.reports.failed:
                self._prove(move=prove)
            elif self.reports.of[ACTUATOR].verdict != "failed":
                self._unproved("another part of the check failed")
        except StationLost as lost:
            self.reports.add("host", failed("task-dies", str(lost)))

    def _look(self) -> None:
        client, reports = self._client, self.reports
        self._report("connecting all devices")
        entries: list[Mapping[str, Any]] = client.request("examine", EXAMINE_S)["devices"]
        self._pressure_off = any(seen["pressure_off"] for seen in entries)
        reports.examined(entries)
        reports.calibrations(utc_now().date())
        self._report(f"recording {REST_S:g} s at rest")
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
        text = f"the watchdog was not triggered: {why}"
        self.reports.add(ACTUATOR, warning("watchdog-unproved", text))

    def _prove(self, *, move: bool) -> None:
        if not (move or self._pressure_off):
            self._unproved("the rig is under pressure")
            return
        if not move and self._config.actuator.watchdog_tested != "off":
            self._unproved("it works only under pressure (or power). Fix: run rig check --prove, which switches "
                "the pressure on")
            return
        report = self.reports.of[ACTUATOR]
        try:
            self.was_armed = True
            with armed(self._client):
                self._report("triggering the watchdog")
                after_s = prove_watchdog(self._client)
                report.numbers["watchdog_ms"] = None if after_s is None else 1e3 * after_s
                if move:
                    self._move()
        except NotProved as ended:
            owner = ECU if ended.slug in OF_THE_COIL else ACTUATOR
            self.reports.add(owner, failed(ended.slug, ended.message, FIXES.get(ended.slug, "")))

    def _move(self) -> None:
        self._report("moving the rod 2 mm up and down, at 10 mm/s and 0 A")
        self.moved = True
        with RingReader(Path(self._config.ring_path)) as ring:
            cause = prove_sensors(self._client, self._config, ring)
        if cause is None:
            return
        name = LVDT if cause.message == "lvdt-scale" else LOAD_CELL
        self.reports.add(name, failed(cause.slug, cause.detail, self.reports.turned(name)))


class NotProved(Exception):
    """The proof ended early.

    Attributes:
        slug: what ended it.
        message: in words.
    """

    def __init__(self, slug: str, message: str) -> None:
        self.slug, self.message = slug, message
        super().__init__(f"{slug}: {message}")


@contextmanager
def armed(client: StationClient) -> Iterator[None]:
    """The rig armed while the block runs, the application's beat with it; disarmed at its end.

    Raises:
        NotProved: it cannot be armed, or not be disarmed.
    """
    ending = threading.Event()

    def waited() -> bool:
        back_within(BEAT_S)
        return ending.wait(BEAT_S)

    def beat() -> None:
        while not waited():
            with suppress(StationLost):  # the request that waits meanwhile says so
                client.beat(healthy=True)
        back_whenever()

    beating = threading.Thread(target=beat, name="check-beat", daemon=True)
    beating.start()
    try:
        ask(client, "arm")
        yield
        ask(client, "disarm")
    finally:
        ending.set()
        beating.join()


def ask(client: StationClient, do: str, **arguments: object) -> dict[str, Any]:
    """A request's answer.

    Raises:
        NotProved: it was refused, or a trip stopped the rig meanwhile.
    """
    try:
        return client.request(do, REQUEST_S, **arguments)
    except StationRefused as refusal:
        for event in client.events():
            if event.get("event") == "trip":
                raise NotProved(str(event["slug"]), str(event.get("detail", ""))) from refusal
        raise NotProved(refusal.slug, refusal.message) from refusal


def prove_watchdog(client: StationClient) -> float | None:
    """Starve the controller's watchdog until it trips, and reset it; armed, at rest.

    Returns:
        After how long it tripped (s); None for an actuator without one.

    Raises:
        NotProved: it did not trip, or its trip does not clear.
    """
    after_s = ask(client, "starve_watchdog")["tripped_after_s"]
    return None if after_s is None else float(after_s)


def prove_sensors(client: StationClient, config: StationConfig, ring: RingReader) -> StopCause | None:
    """Pressure on, 2 mm up and 2 mm down at 10 mm/s and 0 A, and back; armed.

    Returns:
        Why the sensors did not follow; None when they did.

    Raises:
        NotProved: the rig was stopped or did not move.
    """
    ask(client, "hydraulics", level="low")
    ask(client, "hydraulics", level="on")
    mover = _Mover(client, config, ring)
    start_m = mover.position_m()
    up_m, down_m = proof_targets(start_m, *config.limits.position_m)
    legs = [mover.leg(target_m) for target_m in (up_m, down_m)]
    mover.leg(min(max(start_m, down_m), up_m))
    return check_proof(*legs)


class _Mover:
    """Moves the rod and collects what the instruments show on the way and at its end."""

    def __init__(self, client: StationClient, config: StationConfig, ring: RingReader) -> None:
        self._client, self._rate, self._ring = client, config.device_rate, ring

    def position_m(self) -> float:
        """Where the controller says the rod is now (m)."""
        records = self._until(lambda seen: len(_values(seen, Channel.POSITION)) > 0, "a status message from the "
            "controller")
        return float(_values(records, Channel.POSITION)[-1])

    def leg(self, target_m: float) -> Leg:
        """One way of the move, to its end.

        Raises:
            NotProved: the rig was stopped, or the rod did not arrive.
        """
        self._ring.skip_to_newest()
        ask(self._client, "move", target_m=target_m, speed_m_s=PROOF_SPEED_M_S)
        on_the_way = self._until(lambda seen: _arrived(seen, target_m), "the end of the move")
        self._until(None, "rest")
        at_end = self._until(_seen_at_rest, "samples at the end of the move")
        lvdt_m, position_m = _values(at_end, Channel.DISPLACEMENT), _values(at_end, Channel.POSITION)
        forces = _values(on_the_way, Channel.FORCE), _values(on_the_way, Channel.CONTROLLER_FORCE)
        return Leg(float(np.mean(lvdt_m)), float(np.mean(position_m)), *forces, _values(at_end, Channel.FORCE))

    def _until(self, true: Callable[[NDArray[Any]], bool] | None, what: str) -> NDArray[Any]:
        """The records until something is true of them; without a condition those of `HELD_S`.

        Raises:
            NotProved: the rig was stopped meanwhile, or it did not become true in time.
        """
        begin_ns = monotonic_ns()
        longest_s = (HELD_S if true is None else HELD_S + MOVE_S + 2.0 * PROOF_M / PROOF_SPEED_M_S) / self._rate
        parts = [self._ring.read()]
        while (monotonic_ns() - begin_ns) * 1e-9 < max(longest_s, LOOK_S):
            for event in self._client.events(timeout_s=LOOK_S):
                if event.get("event") == "trip":
                    raise NotProved(str(event["slug"]), str(event.get("detail", "")))
            parts.append(self._ring.read())
            if true is not None and true(records := np.concatenate(parts)):
                return records
        if true is not None:
            raise NotProved("stop-ignored", f"{what} not received within {longest_s:.3g} s")
        return np.concatenate(parts)


def _arrived(records: NDArray[Any], target_m: float) -> bool:
    position_m = _values(records, Channel.POSITION)
    return len(position_m) > 0 and abs(position_m[-1] - target_m) <= AT_CENTRE_M


def _seen_at_rest(records: NDArray[Any]) -> bool:
    return len(_values(records, Channel.DISPLACEMENT)) >= FEWEST and len(_values(records, Channel.POSITION)) > 0


def _values(records: NDArray[Any], channel: Channel) -> NDArray[np.float64]:
    """Finite values (n,) of one channel."""
    values = records["value"][records["channel"] == channel].astype(np.float64)
    return np.asarray(values[np.isfinite(values)])
