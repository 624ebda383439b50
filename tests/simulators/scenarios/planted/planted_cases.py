"""For each planted bug the smallest world in which it was seen, and what did not hold there."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

from edits import Edit
from matrices import matrix_text
from planted_findings import FINDINGS
from planted_motion import MOTION
from planted_patching import in_force
from planted_reach import watched
from planted_safeguards import SAFEGUARDS

from simulators.scenarios import scenario as scenarios
from simulators.scenarios.drawn_rig import bench_file
from simulators.scenarios.invariants import violations
from simulators.scenarios.plan import STREAMED_TICK_S, FaultEvent, ScenarioPlan
from simulators.scenarios.runs import memory

PLANTED: dict[str, tuple[Edit, ...]] = {**FINDINGS, **SAFEGUARDS, **MOTION}
SESSION_S, REST_S = 16.0, 5.0
"""A campaign of one short point ends long before."""
MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz", cycles=8)


@dataclass(frozen=True)
class Case:
    """A world for a planted bug.

    Attributes:
        invariant: does not hold with the bug; all hold without it.
        events: what happens.
        seed: of this world.
        held_up: as `ScenarioPlan.held_up`.
        matrix: of this world.
        bench: text of its bench file; empty: the usual simulated rig.
    """

    invariant: str
    events: tuple[str, ...] = ()
    seed: int = 1
    held_up: float = 0.01
    matrix: str = MATRIX
    bench: str = ""

    @property
    def plan(self) -> ScenarioPlan:
        """The world's plan."""
        events = tuple(map(FaultEvent.parse, self.events))
        plan = ScenarioPlan(self.seed, self.matrix, events, held_up=self.held_up)
        # Of a drawn kind: where the plan refuses the motion, it is made smaller.
        return replace(plan, bench=self.bench, kind="streamed", tick_s=STREAMED_TICK_S) if self.bench else plan


def lived(case: Case, edits: Sequence[Edit]) -> tuple[dict[str, str], str]:
    """One session of a case's world with these edits: what did not hold, and the digest of all it made."""
    shorter = patch.multiple(scenarios, SESSION_S=SESSION_S, REST_S=REST_S)
    with shorter, in_force(tuple(edits)), tempfile.TemporaryDirectory(prefix="world-", dir=memory()) as name:
        scenario = scenarios.Scenario(case.plan, Path(name), most_sessions=1)
        scenario.run()
        return {invariant: words[:300] for invariant, words, _ in violations(scenario)}, scenario.digest()


def with_the_bug(name: str) -> tuple[dict[str, str], str]:
    """`lived` with a planted bug."""
    return lived(CASES[name], PLANTED[name])


def without(case: Case) -> tuple[dict[str, str], set[str]]:
    """What did not hold in a case's world as the program is, and by which planted bugs it comes."""
    with watched(PLANTED) as marks:
        failed, _ = lived(case, ())
    return failed, {name for name, _ in marks}


LONG = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz", cycles=14)
PULLED = ("loadcell-pulled@0.5",)
KILLED = ("application-killed@5",)
NAMED = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
cycles = 5
repeats = 2
order = "random"
seed = 1
[[point]]
id = "loop"
waveform = "sine"
amplitude = "6 mm"
frequency = "4 Hz"
current = "0.5 A"
[identify]
enabled = false
"""
LONG_HALT = bench_file("demo", limits={"position": ["-64 mm", "64 mm"]}, halt_deceleration="3 m/s^2")
FAST = matrix_text("0 A", amplitude="60 mm", frequency="2 Hz", cycles=5)
"""0.75 m/s, halted at 3 m/s^2 from anywhere: as far as 90 mm."""
STREAMED = bench_file("demo-streamed", limits={"speed": "2 m/s", "force": "9 kN"})
FLOATS = bench_file("float-drive", limits={"speed": "2 m/s", "force": "9 kN"})
SINE = matrix_text("0 A", amplitude="60 mm", frequency="1.5 Hz", cycles=5)
COOLS = matrix_text("0 A", amplitude="60 mm", frequency="1.5 Hz", cycles=5, more="[campaign]\nretries = 1")
"""The stop holds the rod under pressure until the ECU has cooled down."""
SWEEP = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
current = ["0 A"]
waveform = ["sweep"]
[matrix.sweep]
first_frequency = "1 Hz"
last_frequency = "3 Hz"
first_amplitude = "20 mm"
last_amplitude = "7 mm"
duration = "3 s"
ramp = "500 ms"
[campaign]
retries = 0
[identify]
enabled = false
"""
BUSY = ("modbus-busy@0.5+0.33",)
CASES: dict[str, Case] = {
    "S1-hangs": Case("ends", ("disk-full@4",)),
    "S2-others-journals": Case("written", ("finaliser-stalled@4+8",), matrix=NAMED),
    "S3-foreign-stop": Case("foreign-noticed", ("foreign-stop@4",)),
    "S7-log-first": Case("sent", ("log-full@3", "can-busoff:lost@0.5")),
    "S8-late-word": Case("told-first", ("loadcell-pulled@0.5", "lvdt-pulled@0.5"), held_up=0.3),
    "lease": Case("moves-on", ("second-master@0.5",)),
    "echo": Case("cause", ("modbus-write-lost@0.5",)),
    "e-stop-bit": Case("cause", ("estop@0.5",)),
    "controller-silent": Case("noticed", ("modbus-halfopen@0.5",)),
    "controller-busy": Case("cause", ("modbus-reject@0.5",)),
    "controller-boots": Case("cause", ("actuator-reboot@0.5",)),
    "position-frozen": Case("moves-on", ("actuator-frozen@0.5",)),
    "overrun": Case("cause", ("stop-ignored@0.5",)),
    "ecu-faults": Case("moves-on", ("ecu-overtemp@0.5",)),
    "ecu-counter": Case("cause", ("ecu-crc@0.5",)),
    "ecu-silent": Case("cause", ("ecu-silent@0.5",)),
    "foreign-frames": Case("moves-on", ("can-foreign@0.5",)),
    "bus-load": Case("moves-on", ("can-babble@0.5",)),
    "sensor-silent": Case("cause", PULLED),
    "sensor-stuck": Case("moves-on", ("sensor-stuck@0.5",)),
    "sensor-saturated": Case("cause", ("sensor-saturated@0.5",)),
    "sensor-spikes": Case("cause", ("sensor-spike@0.5",)),
    "damaged-frames": Case("moves-on", ("serial-garbage@0.5",)),
    "stroke-limit": Case("cause", ("second-master:offset@0.1",)),  # the LVDT's end stops the rig then, later
    "speed-limit": Case("limits", ("second-master:span@0.1", "sigint@5.5")),
    "force-limit": Case("limits", ("load-train:jammed@0.5",)),
    "acceleration-limit": Case("acceleration", ("second-master:jumps@0.3", "sigint@4")),
    "current-limit": Case("limits", ("current-stuck:full@0.5",)),
    "coil-temperature": Case("limits", ("ecu-overtemp:coil@0.5",)),
    "positions-compared": Case("moves-on", ("actuator-frozen:slips@0.1",), matrix=LONG),
    "standstill-proved": Case("true-proof", PULLED),
    "place-held": Case(
        "held", ("ecu-overtemp@0.5+8", "actuator-frozen:slips@2", "sigterm@9"), 3, matrix=COOLS, bench=FLOATS
    ),
    "current-proved": Case("true-proof", ("current-stuck@0.5",)),
    "pressure-off-after-s1": Case("true-proof", ("sigterm@5",)),
    "stop-ignored": Case("ends", ("stop-ignored@0.5",)),
    "zero-at-once": Case("stays-stopped", PULLED),
    "stop-sent": Case("sent", PULLED),
    "link-ends": Case("rest", KILLED),
    "pressure-off-at-the-end": Case("rest", KILLED),
    "end-waits-for-the-stop": Case("rest", KILLED),
    "pressure-off-at-disarm": Case("rest"),
    "heartbeat": Case("cause", ("application-stalled@4+1.5",)),
    "own-lateness": Case("watched", ("station-stalled@4+0.3",)),
    "watchdog-fed": Case("refused"),
    "watchdog-proved": Case("refused", ("watchdog-absent",)),
    "setpoints-by-clock": Case("travel", BUSY, 3, matrix=SINE, bench=STREAMED),
    "gap-ends-nothing": Case("slows-down", BUSY, 3, matrix=SINE, bench=STREAMED),
    "halt-by-clock": Case("setpoints", BUSY, 3, matrix=SINE, bench=STREAMED),
    "fade-by-clock": Case("slows-down", BUSY, 3, matrix=SINE, bench=STREAMED),
    "rod-not-measured": Case("setpoints", BUSY, 3, matrix=SINE, bench=STREAMED),
    "old-measurement": Case("set-in-motion", ("setpoints-late@0.5+0.33",), 3, matrix=SINE, bench=STREAMED),
    "counted-as-taken": Case("set-in-motion", ("modbus-write-lost@1.0+0.06",), matrix=SINE, bench=STREAMED),
    "fades-nothing": Case("slows-down", PULLED, 3, matrix=SINE, bench=STREAMED),
    "stopping-distance": Case("stopping-distance", matrix=FAST, bench=LONG_HALT),
    "pressure-assumed": Case("rest", ("stop-ignored:pressure@0.3", "loadcell-pulled@0.5")),
}


def checked_by_case(name: str, bug: dict[str, str], healthy: tuple[dict[str, str], set[str]]) -> str:
    """What is wrong with a case: with the bug its invariant must break, without it nothing may; empty when right."""
    failed, comes_by = healthy
    if failed:
        return f"without the bug: {failed}"
    if name not in comes_by:
        return "its world does not come by the bug"
    return "" if CASES[name].invariant in bug else f"{CASES[name].invariant} holds with the bug: {bug}"


def scenario_of(case: Case) -> Case:
    """What several bugs may share."""
    return replace(case, invariant="")
