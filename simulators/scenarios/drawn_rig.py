"""The rig and the matrix of a seed: a bench file's text and a matrix file's text, as a user would write them.

The kinds come in equal parts. All but "usual" are benches that go the way of a user's own (`user_bench`), with limits
drawn as well: wide, those of the examples, or as narrow as the motion needs.
"""

from __future__ import annotations

import json
import math
import random
import re
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.bench.model import Bench
from rig.campaign.setup import accepted
from rig.errors import FileProblem, Refused
from rig.matrix.model import load_matrix
from simulators.bench import Addresses, bench_text
from simulators.options import RigOptions
from simulators.toml_text import toml_text

USUAL = "usual"
KINDS = (USUAL, "streamed", "signal", "hybrid", "supply", "output", "by-hand")
DRIVE = "cia402-drive"
STREAMED_MAPS = ("demo-streamed", "float-drive", "delta-rmc", DRIVE)
"""Controllers without a function generator."""
DRIVES_SHARE = CAN_SENSORS_SHARE = 0.25
"""Of the streamed benches; of the benches with an ECU. Drawn from streams of their own, so the rest of a seed stays."""
CAN_FORMATS: Mapping[str, tuple[dict[str, Any], float]] = {
    "load_cell": ({
        "id": 0x181, "length": 6, "unit": "N",
        "fields": {"value": {"at": 0, "type": "i32", "scale": 0.1}, "sequence": {"at": 4, "type": "u8"}},
    }, 1.0),
    "lvdt": ({
        "id": 0x182, "length": 4, "order": "big", "unit": "mm",
        "fields": {"value": {"at": 0, "type": "i32", "scale": 0.0001}},
    }, 0.001),
}  # fmt: skip
"""Format and sensitivity of each sensor on the ECU's bus."""
GENERATOR = "demo"
SUPPLIES = ("generic-scpi", "keysight-e36300", "rs-hmp", "tdk-genesys")
VOLTAGE_LIMIT = "6 V"
"""All of them take it, and the coil needs less."""
RECORD = "record.csv"
FASTEST_M_S, SLOWEST_M_S, LARGEST_M = 0.75, 0.08, 0.070
CYCLES = 5
"""As few as a point has; many short campaigns see more than a few long ones."""
NARROW = (1.03, 1.30)
"""A narrow limit is so many times what the motion needs; the plan may still want more, then the motion is made
smaller."""
FURTHER_M = (0.001, 0.010)
SHORTEST_TRAVEL_M = 0.008
LOWEST_M_S2 = 5.0
SMALLER = 0.9
MOST_TRIES = 40
TEST_S = 4.5
"""A hybrid test with its measured delay, rest and return."""
OUTPUT: dict[str, Any] = {
    "maker": "Acme",
    "range": {"current_A": [0, 5]},
    "modbus": {"first_address": {"holding": 40001, "input": 30001, "coil": 1}},
    "quantities": {
        "current": {"address": 40001, "scale": 0.0005, "offset": -1.0, "unit": "A"},
        "enable": {"address": 5, "function": "coil"},
        "kind": {"address": 30100, "function": "input"},
    },
    "identity": {"kind": 77},
}
MEASURED = {"measured_current": {"address": 30001, "function": "input", "type": "f32", "unit": "mA"}}
SERIAL_KEYS = frozenset({"url", "baudrate", "parity", "format", "calibration"})
_SIZE = re.compile(r'^((?:first_|last_)?(?:amplitude|height) = )(\[?)"([0-9.e+-]+) mm"(\]?)$', re.MULTILINE)


@dataclass(frozen=True)
class DrawnRig:
    """What a seed draws of rig and matrix.

    Attributes:
        kind: one of `KINDS`.
        bench: the bench file's text; empty for the usual simulated rig.
        matrix: the matrix file's text; empty where the kind draws none of its own.
        record: text of the file `RECORD` beside the matrix; empty where it names none.
        actuator: "tcp" or "rtu".
        streamed: the controller follows set-points.
        supply: a supply, an output or a person drives the coil in place of an ECU.
        unmeasured: the coil's current is not measured.
        motion_s: how long the motions take, about (s).
        polled: a sensor sends only on request.
    """

    kind: str = USUAL
    bench: str = ""
    matrix: str = ""
    record: str = ""
    actuator: str = ""
    streamed: bool = False
    supply: bool = False
    unmeasured: bool = False
    motion_s: float = 0.0
    polled: bool = False


@dataclass(frozen=True)
class Motion:
    """A drawn motion: lines of the matrix, and what it needs of the machine.

    Attributes:
        lines: of the matrix file, without head and current.
        travel_m, speed_m_s, acceleration_m_s2: its peaks, about.
        lasts_s: of all its points, about (s).
        record: text of the file that it plays.
    """

    lines: tuple[str, ...]
    travel_m: float
    speed_m_s: float
    acceleration_m_s2: float
    lasts_s: float
    record: str = ""


def drawn_rig(seed: int, actuator: str = "") -> DrawnRig:
    """The rig of a seed.

    Args:
        seed: what it is drawn from.
        actuator: "tcp" or "rtu" where that is given.
    """
    chance = random.Random(f"rig {seed}")
    kind = chance.choice(KINDS)
    if kind == USUAL and chance.random() < 0.5:  # the other half has the example's controller and drawn limits
        return DrawnRig()
    streamed = kind in {"streamed", "signal", "hybrid"} or (kind != USUAL and chance.random() < 0.5)
    register_map = chance.choice(STREAMED_MAPS[:-1]) if streamed else GENERATOR
    if streamed and random.Random(f"drive {seed}").random() < DRIVES_SHARE:
        register_map = DRIVE
    slow = chance.random() < 0.15 and kind not in {"signal", "hybrid"}  # they need more set-points than RTU carries
    link = actuator or ("rtu" if slow else "tcp")
    motion = {"signal": _signal, "hybrid": _hybrid}.get(kind, _cycles)(chance)
    source, unmeasured = _source(kind, chance)
    sensors = {} if source else _can_sensors(random.Random(f"sensors {seed}"))
    bench = bench_file(
        register_map, link, _limits(motion, chance), source, fade_out_cycles=chance.choice((1.0, 1.0, 2.0)),
        sensors=sensors,
        halt_deceleration=f"{chance.choice((20, 20, 20, 5, 10, 40))} m/s^2",
    )  # fmt: skip
    return DrawnRig(
        kind, bench, _matrix(motion, chance), motion.record, link, streamed, bool(source), unmeasured, motion.lasts_s,
        any("request" in described for described in sensors.values()),
    )


def bench_file(
    register_map: str, link: str = "tcp", limits: Mapping[str, Any] | None = None,
    source: Mapping[str, Any] | None = None, sensors: Mapping[str, Any] | None = None, **actuator: Any,  # noqa: ANN401 - entries of a TOML table
) -> str:
    """Text of a bench file: the usual rig's with other entries.

    Args:
        register_map: of the controller.
        link: "tcp" or "rtu".
        limits: entries of [limits] in place of the usual ones.
        source: the whole table [ecu]; none: the demo ECU.
        sensors: the format of each sensor on the ECU's CAN bus, by the name of the sensor.
        actuator: further entries of [actuator].
    """
    values = tomllib.loads(bench_text(RigOptions(), _addresses(link), 1.0, relaxed=False))
    values["limits"] |= limits or {}
    values["actuator"] |= {"register_map": register_map, **actuator}
    values["ecu"] = source or values["ecu"]
    for name, described in (sensors or {}).items():
        bus = {key: values["ecu"][key] for key in ("interface", "channel", "bitrate")}
        kept = {key: value for key, value in values[name].items() if key not in SERIAL_KEYS}
        calibration = {"serial_number": name, "sensitivity": CAN_FORMATS[name][1]}
        values[name] = {**kept, **bus, "format": described, "calibration": calibration}
    return "".join(f"{toml_text(key)} = {toml_text(value)}\n" for key, value in values.items())


def fitted(rig: DrawnRig) -> DrawnRig:
    """A drawn rig with its motions made smaller until the bench's plan accepts them.

    Raises:
        Refused: it does not accept the smallest either.
        FileProblem: a drawn file is none.
    """
    with tempfile.TemporaryDirectory(prefix="worlds-") as name:
        folder = Path(name)
        (folder / "bench.toml").write_text(rig.bench, encoding="utf-8")
        bench = Bench.load(folder / "bench.toml")
        for _ in range(MOST_TRIES):
            if _accepts(rig, bench, folder) is None:
                return rig
            rig = _smaller(rig)
        problem = _accepts(rig, bench, folder)
    if problem is not None:
        raise problem
    return rig


def _accepts(rig: DrawnRig, bench: Bench, folder: Path) -> Refused | FileProblem | None:
    """Why a bench does not take a matrix; None where it does."""
    if rig.record:
        (folder / RECORD).write_text(rig.record, encoding="utf-8")
    (folder / "matrix.toml").write_text(rig.matrix, encoding="utf-8")
    try:
        accepted(load_matrix(folder / "matrix.toml"), bench)
    except (Refused, FileProblem) as problem:
        return problem
    return None


def _smaller(rig: DrawnRig) -> DrawnRig:
    matrix = _SIZE.sub(lambda found: f'{found[1]}{found[2]}"{SMALLER * float(found[3]):.4g} mm"{found[4]}', rig.matrix)
    head, *rows = rig.record.splitlines() or [""]
    cells = (row.split(",") for row in rows)
    record = [head, *(f"{time_s},{SMALLER * float(value_mm):.4f}" for time_s, value_mm in cells)]
    return replace(rig, matrix=matrix, record="\n".join([*record, ""]) if rows else "")


def _addresses(link: str) -> Addresses:
    """Addresses that a world replaces by its own."""
    url = "modbus-rtu:/dev/ttyUSB0" if link == "rtu" else "modbus-tcp://127.0.0.1:1"
    return Addresses(url, 2, "socket://127.0.0.1:3", "socket://127.0.0.1:4", ())


def _source(kind: str, chance: random.Random) -> tuple[dict[str, Any], bool]:
    """The current source's table, and whether nothing measures its current; empty: the demo ECU."""
    if kind == "supply":
        table: dict[str, Any] = {
            "url": "tcp://192.168.0.20:5025", "supply": chance.choice(SUPPLIES),
            "poll": chance.choice(("50 ms", "100 ms")), "timeout": "200 ms", "stale_after": "400 ms",
            "voltage_limit": VOLTAGE_LIMIT,
        }  # fmt: skip
        return table, False
    if kind == "output":
        measured = chance.random() < 0.5
        described = OUTPUT | {"quantities": OUTPUT["quantities"] | (MEASURED if measured else {})}
        table = {
            "url": "modbus-tcp://192.168.0.30:502", "supply": described, "device_id": 7, "poll": "20 ms",
            "timeout": "100 ms", "stale_after": "400 ms",
        }  # fmt: skip
        return table, not measured
    if kind == "by-hand":
        return {"by_hand": True, "pressure_while_asked": chance.choice(("off", "off", "low"))}, True
    return {}, False


def _can_sensors(chance: random.Random) -> dict[str, Any]:
    """Formats of sensors on the ECU's bus, which send at their rate or on request; empty for serial sensors."""
    if chance.random() >= CAN_SENSORS_SHARE:
        return {}
    return {
        name: described | ({"request": "remote"} if chance.random() < 0.5 else {})
        for name, (described, _) in CAN_FORMATS.items()
    }


def _limits(motion: Motion, chance: random.Random) -> Mapping[str, Any]:
    """Wide, as in the examples, or narrow about what the motion needs; each of a third."""
    width = chance.choice(("wide", "usual", "narrow"))
    if width == "wide":
        return {"speed": "2 m/s", "acceleration": "200 m/s^2", "force": "9 kN"}
    if width == "usual":
        return {}
    speed_m_s = motion.speed_m_s * chance.uniform(*NARROW)
    acceleration_m_s2 = max(LOWEST_M_S2, motion.acceleration_m_s2 * chance.uniform(*NARROW))
    travel_m = max(SHORTEST_TRAVEL_M, motion.travel_m + chance.uniform(*FURTHER_M))
    ends = [f"{-1e3 * travel_m:.4g} mm", f"{1e3 * travel_m:.4g} mm"]
    return {"speed": f"{speed_m_s:.4g} m/s", "acceleration": f"{acceleration_m_s2:.4g} m/s^2", "position": ends}


def _peak_speed(chance: random.Random) -> float:
    return math.exp(chance.uniform(math.log(SLOWEST_M_S), math.log(FASTEST_M_S)))


def _cycles(chance: random.Random) -> Motion:
    """Few cycles, at one amplitude and frequency."""
    frequency_Hz, triangle = chance.choice((1.0, 1.5, 2.0, 2.5, 2.5)), chance.random() < 0.2
    per_m = (4.0 if triangle else 2.0 * math.pi) * frequency_Hz
    amplitude_m = min(LARGEST_M, _peak_speed(chance) / per_m)
    lines = (
        f'waveform = ["{"triangle" if triangle else "sine"}"]', f'amplitude = ["{1e3 * amplitude_m:.4g} mm"]',
        f'frequency = ["{frequency_Hz:g} Hz"]', f"cycles = {CYCLES}",
    )  # fmt: skip
    hardest_m_s2 = (2.0 * math.pi * frequency_Hz) ** 2 * amplitude_m
    return Motion(lines, amplitude_m, per_m * amplitude_m, hardest_m_s2, (CYCLES + 2.0) / frequency_Hz)


def _signal(chance: random.Random) -> Motion:
    """A sweep, a road, or a record like a saw: slow one way, fast the other."""
    lasts_s, kind = round(chance.uniform(3.0, 5.0), 2), chance.choice(("sweep", "road", "file"))
    lines: tuple[str, ...]
    if kind == "sweep":
        first_Hz, last_Hz = chance.uniform(0.5, 1.5), chance.uniform(1.5, 4.0)
        speed_m_s = _peak_speed(chance)
        first_m, last_m = (min(LARGEST_M, speed_m_s / (2.0 * math.pi * each_Hz)) for each_Hz in (first_Hz, last_Hz))
        lines = (
            'waveform = ["sweep"]', "[matrix.sweep]", f'first_frequency = "{first_Hz:.3g} Hz"',
            f'last_frequency = "{last_Hz:.3g} Hz"', f'first_amplitude = "{1e3 * first_m:.4g} mm"',
            f'last_amplitude = "{1e3 * last_m:.4g} mm"', f'duration = "{lasts_s} s"', 'ramp = "500 ms"',
        )  # fmt: skip
        return Motion(lines, first_m, speed_m_s, 2.0 * math.pi * last_Hz * speed_m_s, lasts_s)
    if kind == "road":
        amplitude_m = chance.uniform(0.005, 0.040)
        lines = (
            'waveform = ["road"]', "[matrix.road]", f'road = ["iso8608-{chance.choice("bcd")}"]',
            f'amplitude = "{1e3 * amplitude_m:.4g} mm"', f'duration = "{lasts_s} s"', 'ramp = "500 ms"',
        )  # fmt: skip
        return Motion(lines, amplitude_m, 20.0 * amplitude_m, 500.0 * amplitude_m, lasts_s)
    frequency_Hz, amplitude_m = chance.uniform(0.7, 1.2), chance.uniform(0.010, LARGEST_M)
    way = chance.choice((-1.0, 1.0))
    rows = ["time_s,displacement_mm"]
    for number in range(int(lasts_s / 0.02) + 1):
        turn = 2.0 * math.pi * frequency_Hz * 0.02 * number
        value = sum(math.sin(order * turn) / order for order in (1, 2, 3)) / 1.5
        rows.append(f"{0.02 * number:.2f},{1e3 * way * amplitude_m * value:.4f}")
    lines = ('waveform = ["file"]', "[matrix.file]", f'file = ["{RECORD}"]', 'ramp = "500 ms"')
    speed_m_s = 2.0 * math.pi * frequency_Hz * amplitude_m * 3.0 / 1.5
    hardest_m_s2 = 3.0 * 2.0 * math.pi * frequency_Hz * speed_m_s
    return Motion(lines, amplitude_m, speed_m_s, hardest_m_s2, lasts_s, "\n".join([*rows, ""]))


def _hybrid(chance: random.Random) -> Motion:
    """A hybrid test or two, with any compensator and law that the plan accepts together."""
    names = chance.sample(("model", "ats", "inverse", "polynomial"), chance.choice((1, 1, 2)))
    law = chance.choice(("passive", "passive", "skyhook", "groundhook", "hybrid", "inverse"))
    current = chance.choice((0, 0.3))
    wheel_kg = 90
    if "polynomial" in names:  # stable only with a wheel that the damper's force moves little
        law, current, wheel_kg = "passive", 0, 250
    lines = (
        "[hybrid]", f'current = "{current} A"', 'largest_delay = "20 ms"', 'probe_frequency = "10 Hz"',
        f"compensation = {json.dumps(names)}", f'law = ["{law}"]',
        "[hybrid.car]", 'source = "drawn"', "[hybrid.car.body]", 'mass = "600 kg"', "[hybrid.car.front]",
        f'unsprung_mass = "{wheel_kg} kg"', 'wheel_rate = "40 kN/m"', 'tyre_stiffness = "220 kN/m"',
        'tyre_damping = "300 N s/m"', "[hybrid.road]", 'speed = "20 m/s"', "[hybrid.road.sweep]",
        f'duration = "{chance.choice((2, 3))} s"', 'first_frequency = "2 Hz"',
        f'last_frequency = "{chance.choice((3, 4))} Hz"', f'first_height = "{chance.choice((10, 20, 30))} mm"',
        f'last_height = "{chance.choice((10, 15))} mm"',
    )  # fmt: skip
    return Motion(lines, 0.030, 0.4, 15.0, TEST_S * len(names))


def _matrix(motion: Motion, chance: random.Random) -> str:
    """The matrix file of a motion."""
    head = ["format = 1", "[specimen]", 'serial_number = "MR-001"', 'stroke = "170 mm"', 'prior = "demo"']
    tail = ["[campaign]", f"retries = {chance.choice((0, 0, 1))}", "[identify]", "enabled = false", ""]
    if motion.lines[0] == "[hybrid]":
        return "\n".join([*head, *motion.lines, *tail])
    currents = chance.choice((("0.5 A",), ("0 A",), ("0 A", "0.5 A"), ("1 A",)))
    return "\n".join([*head, "[matrix]", f"current = {json.dumps(currents)}", *motion.lines, *tail])


