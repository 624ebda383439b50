"""Evaluation of a bench's devices at rest against its file: examination and records in, findings out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from rig import units
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.bench.settings import StationConfig
from rig.campaign.preflight.rest_check import causes_at_rest, check_rest, explanation, rest_limits, samples_at_rest
from rig.check.finding import CheckFinding, DeviceReport, failed, note, warning
from rig.faults.matrix import REACTIONS
from rig.signals.rest import FEWEST_SAMPLES

ACTUATOR, ECU, LOAD_CELL, LVDT, HOST = "actuator", "ecu", "load_cell", "lvdt", "host"
RATE_WARNING, RATE_FAILED = 0.02, 0.10
"""How far a sensor's rate may be from the bench file's, relative: samples are a clock where the format has none."""
SLOW_POLLS = 0.8
SLOW_ANSWER_SHARE = 0.5
"""Of the controller's time-out: an answer that takes longer leaves nothing for a bad moment."""
OWNERS = {"modbus": ACTUATOR, "rtu": ACTUATOR, "controller": ACTUATOR, "can": ECU, "ecu": ECU}
"""Device that a warning of the station is about, by the place of its row."""
NOT_OURS = frozenset({"task-dies", "host-late"})
"""Warnings that a check makes itself, by closing a port or by being one of several programs."""

FEWEST = 10
WITHIN = 0.99
"""Share of the values that a lateness is stated for."""
BIN_EDGES_MS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)

Seen = Mapping[str, Any]
"""One device's entry in the answer to `examine`."""


class Reports:
    """The devices' reports under way.

    Args:
        bench: the rig as its file describes it.
        config: what the station was told.
    """

    def __init__(self, bench: Bench, config: StationConfig) -> None:
        self._bench = bench
        self._config = config
        names = [ACTUATOR, ECU, *(sensor.label for sensor in config.sensors), HOST]
        self.of = {name: DeviceReport(name) for name in names}

    def add(self, name: str, *findings: CheckFinding) -> None:
        """Add findings to a device's report."""
        self.of[name].findings += findings

    @property
    def failed(self) -> bool:
        """Some device failed already."""
        return any(report.verdict == "failed" for report in self.of.values())

    def examined(self, entries: Iterable[Seen]) -> None:
        """Take what the station found of each device."""
        for seen in entries:
            report = self.of[seen["name"]]
            report.identity = {name: value for name, value in seen["proved"].items() if name != "rate_Hz"}
            if seen["slug"]:
                report.findings.append(failed(seen["slug"], seen["message"], _fix(seen)))
            report.findings += [warning(slug, without) for slug, without in seen["lacking"]]
            if seen["name"] == ACTUATOR:
                report.findings += self._controller(seen)
                times_s = np.array(seen["answers_s"], dtype=np.float64)
                report.latency_ms = within_ms(times_s)
                if len(times_s):
                    report.numbers["latency_histogram"] = histogram(times_s)
        self._identities()

    def _controller(self, seen: Seen) -> Iterator[CheckFinding]:
        if seen["e_stop_open"]:
            yield failed("estop", "the e-stop chain is open", "close the e-stop chain at the rig; the software "
                "cannot close it")
        if seen["faults"] and not seen["e_stop_open"]:
            yield warning("controller-trip", f"the controller reports {seen['faults']} (state {seen['state']})")
        slow_ms = 1e3 * SLOW_ANSWER_SHARE * self._config.actuator.timeout_s
        taken_ms = within_ms(np.array(seen["answers_s"], dtype=np.float64))
        if taken_ms is not None and taken_ms > slow_ms:
            text = f"1 % of the answers take longer than {taken_ms:.3g} ms; the time-out is {2.0 * slow_ms:g} ms"
            fix = f'write timeout = "{4.0 * taken_ms:.0f} ms" in [actuator], or reduce the load'
            yield warning("actuator-slow", text, fix)

    def _identities(self) -> None:
        ecu = self._bench.ecu
        # A supply is known by a text in its identity; its serial number is one.
        key = "serial_number" if ecu.url is None else "identity"
        for name, entry, given in (
            (ACTUATOR, "serial_number", self._bench.actuator.serial_number), (ECU, key, getattr(ecu, key)),
        ):
            number = self.of[name].identity.get("serial_number")
            if given is None and number and self.of[name].verdict != "failed":
                shown = f'"{number}"' if isinstance(number, str) else str(number)
                text = f"serial number {number}; the bench file does not state the expected serial number"
                self.add(name, note("identity-unstated", text, f"write {entry} = {shown} in [{name}]"))

    def warned(self, events: Iterable[Mapping[str, Any]]) -> None:
        """Take the station's warnings; those of a device that failed anyway say nothing new."""
        reported: set[str] = set()
        for event in events:
            slug = str(event.get("slug"))
            row = REACTIONS.get(slug)
            if event.get("event") != "warning" or row is None or slug in NOT_OURS or slug in reported:
                continue
            owner = OWNERS.get(row.place)
            if owner is not None and self.of[owner].verdict != "failed":
                reported.add(slug)
                self.add(owner, warning(slug, str(event.get("detail", ""))))

    def streams(self, records: NDArray[Any]) -> None:
        """Judge the records (n,) that came while the rig rested, of the devices that have not failed."""
        config, rate = self._config, self._config.device_rate
        channels: dict[str, int] = {ACTUATOR: Channel.POSITION, ECU: Channel.COIL_CURRENT}
        channels |= {LOAD_CELL: Channel.FORCE, LVDT: Channel.DISPLACEMENT}
        channels |= {item.label: Channel.AUXILIARY_1 + index for index, item in enumerate(config.auxiliary)}
        for name, channel in channels.items():
            report = self.of[name]
            if report.verdict == "failed":
                continue
            stream = stream_of(records[records["channel"] == channel], rate)
            report.rate_Hz = stream.rate_Hz if math.isfinite(stream.rate_Hz) else None
            report.numbers["jitter_ms"] = round(1e3 * stream.jitter_s, 6)
            if name == ACTUATOR:
                report.findings += _polls(stream, config)
                continue
            report.latency_ms = stream.latency_ms
            report.numbers["latency_histogram"] = histogram(stream.lateness_s)
        for sensor in config.sensors:
            report = self.of[sensor.label]
            if report.verdict != "failed":
                stream = stream_of(records[records["channel"] == channels[sensor.label]], rate)
                report.numbers |= _numbers(stream, sensor)
                report.findings += _sensor(stream, sensor)

    def at_rest(self, records: NDArray[Any]) -> None:
        """Hold the instruments against each other at rest; only where every one of them delivers."""
        if any(self.of[name].verdict == "failed" for name in (ACTUATOR, LOAD_CELL, LVDT)):
            return
        seen = samples_at_rest(records)
        zero_N = self._bench.checks.zero_N(self._bench.load_cell.range_N, None)
        limits = rest_limits(self._bench, self._config, zero_N)
        first = check_rest(seen, limits)
        if first is None:
            return
        if first.slug == "sensors-swapped":
            for name, fix in self._exchanges(explanation(seen, limits)):
                self.add(name, failed(first.slug, first.detail, fix))
            return
        enough = min(len(seen.force_N), len(seen.displacement_m)) >= FEWEST_SAMPLES
        causes = (causes_at_rest(seen, limits) if enough else []) or [(LOAD_CELL, first)]
        for name, cause in causes:
            if self.of[name].verdict != "failed":
                self.add(name, failed(cause.slug, cause.detail))

    def _exchanges(self, what: str) -> list[tuple[str, str]]:
        """Devices and fixes for what explains a wrong rest: a key of `rig.campaign.words.EXCHANGED`."""
        if what == "plugs":
            fix = "swap the two plugs, or the two `url` entries in the bench file"
            return [(name, fix) for name in (LOAD_CELL, LVDT)]
        name = LOAD_CELL if what == "force-sign" else LVDT
        return [(name, self.turned(name))]

    def turned(self, name: str) -> str:
        """How to turn a sensor round in the bench file."""
        (sensor,) = (sensor for sensor in self._config.sensors if sensor.label == name)
        other = "normal" if sensor.calibration.polarity == "reversed" else "reversed"
        return f'write polarity = "{other}" in [{name}.calibration], or swap the plugs if both sensors are wrong'

    def calibrations(self, today: date) -> None:
        """Say which calibrations are overdue, and which the bench file does not date."""
        overdue = self._bench.overdue(today)
        say = failed if self._bench.require_valid_calibration else warning
        for sensor in self._config.sensors:
            due = sensor.calibration.due
            if sensor.label in overdue:
                self.add(sensor.label, say("calibration-overdue", f"the calibration was due on {due}"))
            elif due is None:
                self.add(sensor.label, note("calibration-unknown", "the bench file does not state the due date of "
                    "this sensor's calibration"))

    def host(self, ready: Mapping[str, Any], late_loops: int, worst_s: float) -> None:
        """Judge this machine: real-time rights, and whether the station was kept from running."""
        self.of[HOST].numbers["real_time"] = bool(ready.get("real_time"))
        if self._config.real_time and not ready.get("real_time"):
            self.add(HOST, warning("no-real-time", str(ready.get("real_time_reason"))))
        elif not self._config.real_time:
            self.add(HOST, note("no-real-time", "the bench file does not request real-time priority ([station] "
                "real_time)"))
        self.of[HOST].numbers["late_ms"] = 1e3 * worst_s
        if worst_s > self._config.late_limit_s:
            text = f"this computer is too busy (pauses in monitoring: {late_loops}, longest: {1e3 * worst_s:.0f} ms)"
            self.add(HOST, warning("host-late", f"{text}; a pause of more than "
                f"{1e3 * self._config.late_limit_s:g} ms stops a campaign"))


def _fix(seen: Seen) -> str:
    """What to do about what the station found; empty where its explanation says it."""
    name = seen["name"]
    if seen["fix"]:
        return str(seen["fix"])
    if seen["slug"] == "serial-baud" and seen["reads_at"]:
        rates = " or ".join(map(str, seen["reads_at"]))
        return f"write baudrate = {rates} in [{name}]: at this rate the received bytes form valid frames"
    if seen["slug"] == "serial-baud":
        return f"no valid frame was received at any common baud rate: check format, parity and wiring of [{name}]"
    return ""


def _polls(stream: Stream, config: StationConfig) -> Iterator[CheckFinding]:
    required_Hz = 1.0 / config.actuator.poll_s / config.device_rate
    if math.isfinite(stream.rate_Hz) and stream.rate_Hz < SLOW_POLLS * required_Hz:
        text = (
            f"{stream.rate_Hz:.3g} status messages per second, expected {required_Hz:.3g}: the controller does not "
            "answer within one poll period"
        )
        poll_ms = 1e3 / stream.rate_Hz / config.device_rate
        fix = f'write poll = "{poll_ms:.0f} ms" in [actuator], or reduce the controller\'s response time'
        yield warning("actuator-slow", text, fix)
    if stream.not_numbers:
        yield failed("feedback-lost", f"{stream.not_numbers} of {stream.count} position values are not numbers")


def _numbers(stream: Stream, sensor: SensorConfig) -> dict[str, object]:
    unit = units.DIMENSIONS[sensor.dimension].si
    return {
        "nominal_rate_Hz": sensor.rate_Hz, "lost": stream.lost, "noise": stream.noise, "resolution": stream.step,
        "at_rest": stream.mean, "unit": unit,
    }


def _sensor(stream: Stream, sensor: SensorConfig) -> Iterator[CheckFinding]:
    off = stream.rate_Hz / sensor.rate_Hz - 1.0
    if abs(off) > RATE_WARNING:
        text = f"{stream.rate_Hz:.4g} values per second, but the bench file states {sensor.rate_Hz:g}"
        fix = f'write rate = "{stream.rate_Hz:.4g} Hz" in [{sensor.label}], or set the sensor to {sensor.rate_Hz:g} Hz'
        yield (failed if abs(off) > RATE_FAILED else warning)("sample-rate", text, fix)
    if stream.lost:
        yield warning("sample-gap", f"{stream.lost} of {stream.count + stream.lost} samples are missing")
    if stream.not_numbers:
        yield warning("sensor-nan", f"{stream.not_numbers} of {stream.count} values are not numbers")
    if math.isnan(stream.step) and stream.count:
        text = (
            f"all {stream.count} values are identical: either the resolution is coarser than the noise, or the "
            "sensor is stuck"
        )
        yield note("sensor-resolution", text, "move or load the sensor manually and check again: its value must change")


@dataclass(frozen=True)
class Stream:
    """What a channel's records show; NaN where too few came.

    Attributes:
        count: records.
        rate_Hz: values a second of the device's clock, of the host's where the device has none.
        lateness_s: by how much each arrived later than the fastest one, (n,).
        jitter_s: standard deviation of the intervals of the device's clock, else of the arrivals.
        lost: sequence numbers left out.
        not_numbers: values that are not finite.
        noise: standard deviation of the values, SI.
        step: least difference of two values, SI; NaN where all are equal.
        mean: of the values, SI.
    """

    count: int
    rate_Hz: float
    lateness_s: NDArray[np.float64]
    jitter_s: float
    lost: int
    not_numbers: int
    noise: float
    step: float
    mean: float

    @property
    def latency_ms(self) -> float | None:
        """Lateness of all but one in a hundred (ms)."""
        return within_ms(self.lateness_s)


def stream_of(records: NDArray[Any], device_rate: float = 1.0) -> Stream:
    """What the records (n,) of one channel show, oldest first.

    Args:
        records: of `RECORD_DTYPE`.
        device_rate: device seconds in one second of the host's clock.
    """
    values = records["value"].astype(np.float64)
    finite = values[np.isfinite(values)]
    host_s = 1e-9 * (records["host_ns"] - records["host_ns"][:1]).astype(np.float64)
    numbers = records["sequence"].astype(np.int64)
    steps = np.diff(numbers) % (1 << 32)
    clocked = len(records) >= FEWEST and bool(np.all(records["device_us"] >= 0))
    device_s = 1e-6 * (records["device_us"] - records["device_us"][:1]).astype(np.float64)
    if not clocked or device_s[-1] <= 0.0:
        clocked, device_s = False, host_s * device_rate
    enough = len(records) >= FEWEST and device_s[-1] > 0.0
    counted = np.concatenate(([0], np.cumsum(steps))) if len(records) else np.zeros(0)
    different = np.unique(finite)
    return Stream(
        count=len(records),
        rate_Hz=float((len(records) - 1) / device_s[-1]) if enough else math.nan,
        lateness_s=_lateness(device_s if clocked else counted, host_s) if enough else np.zeros(0),
        jitter_s=float(np.std(np.diff(device_s if clocked else host_s))) if enough else math.nan,
        lost=int(np.sum(np.maximum(steps - 1, 0))),
        not_numbers=len(values) - len(finite),
        noise=float(np.std(finite)) if len(finite) else math.nan,
        step=float(np.min(np.diff(different))) if len(different) > 1 else math.nan,
        mean=float(np.mean(finite)) if len(finite) else math.nan,
    )


def _lateness(clock: NDArray[np.float64], host_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much each value arrived later than the fastest, both clocks laid over each other by a straight line."""
    slope, at_zero = np.polyfit(clock, host_s, 1)
    late_s = host_s - (slope * clock + at_zero)
    return np.asarray(late_s - np.min(late_s))


def within_ms(times_s: NDArray[np.float64]) -> float | None:
    """The time (ms) within which all but one in a hundred lie; None where there are too few."""
    return 1e3 * float(np.quantile(times_s, WITHIN)) if len(times_s) >= FEWEST else None


def histogram(times_s: NDArray[np.float64]) -> list[list[float | int | None]]:
    """Counts of times (s): pairs of a bin's upper edge (ms; None: above all) and how many lie in it."""
    edges = np.concatenate(([-np.inf], BIN_EDGES_MS, [np.inf]))
    counts, _ = np.histogram(1e3 * times_s, edges)
    return [[edge, int(count)] for edge, count in zip((*BIN_EDGES_MS, None), counts, strict=True)]
