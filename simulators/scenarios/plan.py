"""What a seed makes of a world: the matrix, the rig, and what happens to it."""

from __future__ import annotations

import errno
import json
import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from rig.faults.row import Ending
from simulators.injection import BEYOND_LIMITS, INJECTORS, NEEDS_AUXILIARY, PASSING_VARIANTS
from simulators.scenarios.drawn_rig import DrawnRig, drawn_rig, fitted
from simulators.scenarios.kernel import HELD_UP_SHARE
from simulators.schedule import ONLY_BY_ECU, ONLY_BY_SUPPLY, ONLY_ON, STREAMED, drawn_fault, parse_fault

DISK = {"disk-full": errno.ENOSPC, "dir-readonly": errno.EROFS, "fsync-error": errno.EIO}
SIGNALS = {"sigint": "SIGINT", "sigterm": "SIGTERM", "sighup": "SIGHUP"}
DEATHS = {
    "application-killed": "application", "station-killed": "rig.station",
    "finaliser-killed": "rig.recording.conversion.finaliser", "converter-killed": "rig.recording.conversion.converter",
}  # fmt: skip
MACHINE = "machine-stalled"
"""The whole computer stands still while the devices go on: a virtual machine that is held up."""
STALLS = {
    "application-stalled": ("application",), "station-stalled": ("rig.station",),
    "finaliser-stalled": ("rig.recording.conversion.finaliser",),
    "converter-stalled": ("rig.recording.conversion.converter",),
    MACHINE: (
        "application", "rig.station", "rig.recording.conversion.finaliser", "rig.recording.conversion.converter",
    ),
}  # fmt: skip
OF_THE_STATION = ("station-stalled", MACHINE)
"""Stalls in which the station does not run."""
OTHER_STOPS = ("foreign-stop", "panel-stop")
"""Another client stops the rod: by a command, or manually at the controller's own panel."""
LASTING = ("clock-step", "slow-disk", "pause")
OTHERS = ("power-cut", "log-full", *LASTING, *OTHER_STOPS)
AROUND = (*DISK, *SIGNALS, *DEATHS, *STALLS, *OTHERS)
"""What happens around the devices; the rows of the fault matrix happen in them."""
EVENT_COUNTS, MORE_IN_TURN = (0, 1, 1, 1, 2, 2, 3, 4, 5), (0, 0, 0, 0, 1, 1, 2, 3, 4)
"""How many are drawn, one of these numbers; so many more where one is the turn of a seed."""
FAULT_SHARE = 0.6
"""Of what happens besides: the rest is around the devices."""
SUDDEN_SHARE = 0.2
"""Of what happens: so much comes within `SUDDEN_S` of what was drawn before it."""
SUDDEN_S = 0.02
COMBINED_SHARE = 0.15
COMBINED = (
    ("log-full", "can-busoff:lost"), ("sigint", "sigterm"), ("converter-stalled", "application-killed"),
    ("disk-full", "finaliser-killed"), ("slow-disk", "power-cut"), ("foreign-stop", "application-stalled"),
    ("loadcell-pulled", "lvdt-pulled"),
)
"""Troubles that come together: one disk, one supply, one hand."""
LONGEST_STALL_S = {"finaliser-stalled": 12.0, "converter-stalled": 12.0}
NAMED_SHARE = 0.15
SLOW_FILES_SHARE = 0.5
EARLY_S = (4.0, 7.0)
"""While the first points of a campaign are run."""
BUSY_SHARE, BUSY_HELD_UP = 0.1, 0.3
BEYOND_SHARE, BEYOND_LASTS_SHARE = 0.2, 0.8
"""Something drives the rig beyond its limits, and mostly does not stop by itself."""
FIRST_CYCLE_S = 3.0
"""The first cycle begins about so long after the application was started."""
SHOW_LATE = frozenset({"serial-garbage"})
"""Faults that the rig may bear for a second: where one is a seed's turn, it stays."""
STALL = "application-stalled"
STALL_TIMES = 2.0
"""Where that is a seed's turn, it comes when the rod moves and lasts so many times as long: 0.5 s go unnoticed."""
NONE_IN_TURN = 10
"""So many seeds of a round have nothing in turn."""
LATEST_S = 16.0
LATEST_FAULT_S = 9.0
COOLS_S = 30.0
"""A hot ECU cools down by then; one that stays hot is waited for, up to an hour."""
TICKS_S, TURNS_S = (0.004, 0.008, 0.01, 0.01), (0.004, 0.008, 0.008, 0.008)
"""The finer, the closer to a real rig, and the slower."""
STREAMED_TICK_S = 0.002
"""As on real wires: set-points that are taken up to 10 ms late would be another motion, and a sensor that is polled
every 4 ms would answer every other request."""
BENCH_TICK_S = 0.008
"""Of the other benches that are drawn, as `user_bench` has it for sensors that are silent after 20 ms."""
NEVER_DRAWN = frozenset(NEEDS_AUXILIARY) | {"usb-renumber"}
GAP_SHARE, ALONE_SHARE = 0.6, 0.5
"""Of the benches that are streamed set-points so many have a gap in link or host, or a Ctrl-C, while the rod moves; of
these so many have nothing else."""
GAP_S = (0.005, 2.0)
GAPS = (
    "modbus-busy", "modbus-reject", "modbus-mismatch", "modbus-write-lost", "setpoints-late", "setpoints-lost",
    "station-stalled", "machine-stalled", "sigint",
)  # fmt: skip


@dataclass(frozen=True)
class FaultEvent:
    """One thing that happens in a world.

    Attributes:
        what: a row of the fault matrix (`SLUG` or `SLUG:VARIANT`), or one of `AROUND`.
        at_s: when: a fault of the devices so long after the first cycle begins (None: it is there from the start),
            anything else so long after the application was started.
        lasts_s: for how long; None for ever, or where that has no meaning.
    """

    what: str
    at_s: float | None
    lasts_s: float | None = None

    @property
    def around(self) -> bool:
        """It happens around the devices."""
        return self.what in AROUND

    @property
    def begins_s(self) -> float:
        """When it begins, about: so long after the application was started (s)."""
        return (self.at_s or 0.0) + (0.0 if self.around or self.at_s is None else FIRST_CYCLE_S)

    def begun_at(self, begins_s: float) -> FaultEvent:
        """The same so long after the application was started (s), but not before the first cycle."""
        return replace(self, at_s=round(max(0.0, begins_s - (0.0 if self.around else FIRST_CYCLE_S)), 3))

    def __str__(self) -> str:
        at = "" if self.at_s is None else f"@{self.at_s:g}"
        return self.what + at + ("" if self.lasts_s is None else f"+{self.lasts_s:g}")

    @classmethod
    def parse(cls, text: str) -> FaultEvent:
        """`WHAT@T` or `WHAT@T+D`.

        Raises:
            FileProblem: nothing of that name happens in worlds, or the times are none.
        """
        name = text.partition("@")[0]
        if name in AROUND:
            times = text.partition("@")[2].partition("+")
            try:
                return cls(name, float(times[0]), float(times[2]) if times[1] else None)
            except ValueError:
                expected = f"{text!r}: write {name}@SECONDS or {name}@SECONDS+DURATION"
                raise FileProblem("--event", [expected]) from None
        if name.partition(":")[0] not in MATRIX:
            raise FileProblem("--event", [
                f"{name!r} is neither a row of the fault matrix (see `rig simulate --list-faults`) nor one of "
                f"{', '.join(AROUND)}"
            ])
        fault = parse_fault(text)
        return cls(fault.name, fault.after_s, None if fault.lasts_s == float("inf") else fault.lasts_s)


@dataclass(frozen=True)
class ScenarioPlan:
    """Everything that one world begins with.

    Attributes:
        seed: of scheduling, latencies, noise and clocks.
        matrix: the matrix file's text.
        events: what happens, by time.
        actuator: "tcp" or "rtu".
        options: constants of the simulated rig, as `TABLE.KEY=VALUE`.
        tick_s: how often the devices hand over what they have sent (s).
        turn_s: how often the application looks at what has come (s).
        bench: a user's bench file's text; empty where the rig is the usual one.
        lasts_s: how long a user's campaign lasts at most (s); 0 for a drawn one.
        held_up: the share of system calls at which a thread is kept waiting for a moment.
        kind: of the rig that was drawn (`drawn_rig.KINDS`); empty for a user's bench or matrix.
        record: text of the file that a drawn matrix plays; empty where it plays none.
    """

    seed: int
    matrix: str
    events: tuple[FaultEvent, ...] = ()
    actuator: str = "tcp"
    options: tuple[str, ...] = ()
    tick_s: float = 0.01
    turn_s: float = 0.008
    bench: str = ""
    lasts_s: float = 0.0
    held_up: float = HELD_UP_SHARE
    kind: str = ""
    record: str = ""

    @property
    def of_a_user(self) -> bool:
        """The bench is a user's, whose sensors may be slower than the drawn ones."""
        return bool(self.bench) and not self.kind

    def fitted(self) -> ScenarioPlan:
        """The same with motions that the drawn bench's plan accepts.

        Raises:
            Refused: it accepts none, however small.
            FileProblem: a drawn file is none.
        """
        if not self.kind or not self.bench:
            return self
        rig = fitted(DrawnRig(self.kind, self.bench, self.matrix, self.record))
        return replace(self, matrix=rig.matrix, record=rig.record)

    def without(self, event: FaultEvent) -> ScenarioPlan:
        """The same world without one thing."""
        return replace(self, events=tuple(kept for kept in self.events if kept is not event))


@dataclass(frozen=True)
class Given:
    """What a user gives in place of what a seed draws.

    Attributes:
        matrix, bench: texts of the files; empty where none is given.
        actuator: "tcp" or "rtu", as the bench says; empty: drawn.
        auxiliary: the bench has an auxiliary channel.
        supply: a supply drives the coil.
        unmeasured: the coil's current is not measured: manual, or an output without measurement.
        streamed: the controller has no function generator and follows set-points.
        motion_s: forecast of the campaign (s), over which things happen.
        lasts_s: how long it lasts at most (s).
        tick_s: how often the devices hand over what they have sent, at most (s).
        kind, record: as of `ScenarioPlan`.
        usual: nothing of the rig is left to be drawn: what is not given is the usual simulated rig's.
    """

    matrix: str = ""
    bench: str = ""
    actuator: str = ""
    auxiliary: bool = False
    supply: bool = False
    unmeasured: bool = False
    streamed: bool = False
    motion_s: float = 0.0
    lasts_s: float = 0.0
    tick_s: float = math.inf
    kind: str = ""
    record: str = ""
    usual: bool = False

    def may_have(self, what: str, actuator: str) -> bool:
        """Whether something of the fault matrix or around the devices can happen on this rig.

        Args:
            what: `SLUG`, `SLUG:VARIANT`, or one of `AROUND`.
            actuator: how the controller is reached.
        """
        needed = ONLY_ON.get(what.partition(":")[0], actuator)
        if needed != actuator and not (needed == STREAMED and self.streamed):
            return False
        if (self.streamed and what in AT_THE_PANEL) or (what in NEEDS_AUXILIARY and not self.auxiliary):
            return False
        if what in ONLY_BY_SUPPLY:
            return self.supply and not self.unmeasured
        return (happens_to_supply(what) or not self.supply) and (happens_unmeasured(what) or not self.unmeasured)


def drawn(seed: int, given: Given = Given()) -> ScenarioPlan:
    """The world of a seed.

    Args:
        seed: what everything is drawn from.
        given: what a user gives in its place.
    """
    chance = random.Random(f"plan {seed}")
    given = given_for(seed, given)
    actuator = "rtu" if chance.random() < 0.25 else "tcp"
    actuator = given.actuator or actuator
    # Each from a stream of its own, so that the others stay as they are, whatever is given in its place.
    events = _events(seed, actuator, given)
    pace = random.Random(f"pace {seed}")
    tick_s, turn_s = pace.choice(TICKS_S), pace.choice(TURNS_S)
    text, named = (given.matrix, False) if given.matrix else _matrix(chance)
    if named and chance.random() < SLOW_FILES_SHARE:
        events = (*events, _around("finaliser-stalled", chance.uniform(*EARLY_S), chance))
    events = (*events, *_beyond_limits(random.Random(f"beyond {seed}"), given.motion_s))
    gap = _gap(random.Random(f"gap {seed}"), given.motion_s) if given.streamed else ()
    alone = gap and random.Random(f"alone {seed}").random() < ALONE_SHARE
    chosen = gap if alone else (*events, *gap)
    events = _in_order(event for event in chosen if given.may_have(event.what, actuator))
    held_up = BUSY_HELD_UP if random.Random(f"busy {seed}").random() < BUSY_SHARE else HELD_UP_SHARE
    return ScenarioPlan(
        seed, text, events, actuator, tick_s=min(tick_s, given.tick_s), turn_s=turn_s, held_up=held_up,
        bench=given.bench, lasts_s=given.lasts_s, kind=given.kind, record=given.record,
    )  # fmt: skip


def given_for(seed: int, given: Given) -> Given:
    """What a user gives, with the rig that a seed draws where it leaves that open."""
    if given.bench or given.matrix or given.usual:
        return given
    rig = drawn_rig(seed, given.actuator)
    tick_s = STREAMED_TICK_S if rig.streamed or rig.polled else BENCH_TICK_S if rig.bench else given.tick_s
    return replace(
        given, kind=rig.kind, bench=rig.bench, matrix=rig.matrix, record=rig.record, motion_s=rig.motion_s,
        actuator=rig.actuator or given.actuator, supply=rig.supply, unmeasured=rig.unmeasured, streamed=rig.streamed,
        tick_s=tick_s, usual=True,
    )  # fmt: skip


def _gap(chance: random.Random, motion_s: float) -> tuple[FaultEvent, ...]:
    """A gap in what is streamed, or a Ctrl-C, at any instant of the motion; in some worlds none."""
    if chance.random() >= GAP_SHARE:
        return ()
    what, at_s = chance.choice(GAPS), chance.uniform(0.0, motion_s)
    lasts_s = round(math.exp(chance.uniform(*map(math.log, GAP_S))), 3)
    around = what in AROUND
    return (FaultEvent(what, round(at_s + FIRST_CYCLE_S * around, 3), None if what in SIGNALS else lasts_s),)


AT_THE_PANEL = frozenset({"second-master:span", "second-master:offset", "second-master:jumps"})
"""A hand at the panel that turns the knobs of a running program: a controller that follows set-points runs none."""


def happens_to_supply(what: str) -> bool:
    """It can happen where a supply drives the coil: no bus, and nothing takes its current when its host dies."""
    return what not in ONLY_BY_ECU and what not in {"station-killed", "power-cut"}


def happens_unmeasured(what: str) -> bool:
    """It can happen where the current is not measured: nothing reports the coil, and who asks and answers lives."""
    row = MATRIX.get(what.partition(":")[0])
    return happens_to_supply(what) and what != "application-killed" and (row is None or row.place not in {"can", "ecu"})


def _events(seed: int, actuator: str, given: Given) -> tuple[FaultEvent, ...]:
    """What is a seed's turn, and up to four things that come later; or one to five of any kind; rarely none at all."""
    chance, motion_s = random.Random(f"happenings {seed}"), given.motion_s
    possible = [slug for slug in sorted(INJECTORS) if slug not in NEVER_DRAWN and given.may_have(slug, actuator)]
    around = [what for what in AROUND if given.may_have(what, actuator)]
    fault_s, around_s = (motion_s, motion_s + FIRST_CYCLE_S) if motion_s else (LATEST_FAULT_S, LATEST_S)
    chosen = _in_turn(seed, possible, around, chance, motion_s)
    began_s = chosen[0].begins_s if chosen else 0.0
    if chosen:  # what is refused would hide everything else
        possible = [slug for slug in possible if MATRIX[slug].end is not Ending.REFUSE]
    for _ in range(chance.choice(MORE_IN_TURN if chosen else EVENT_COUNTS)):
        before = chosen[-1] if chosen else None
        if chance.random() < FAULT_SHARE:
            within_s = max(0.0, fault_s - max(0.0, began_s - FIRST_CYCLE_S))
            chosen.append(_fault(chance.choice(possible), chance, began_s, within_s))
        else:
            at_s = chance.uniform(began_s, max(began_s, around_s))
            chosen.append(_around(chance.choice(around), at_s, chance))
        if before is not None and None not in (before.at_s, chosen[-1].at_s) and chance.random() < SUDDEN_SHARE:
            chosen[-1] = chosen[-1].begun_at(before.begins_s + chance.uniform(0.0, SUDDEN_S))
    if chance.random() < COMBINED_SHARE:
        chosen += _combined(chance)
    return _in_order(chosen)


def _in_turn(
    seed: int, possible: Sequence[str], around: Sequence[str], chance: random.Random, motion_s: float
) -> list[FaultEvent]:
    """What is a seed's turn, while the first points are run; nothing is the turn of some.

    Each fault of the devices and each thing around them comes first in one world of some seventy: drawn alone, one
    kind in ten came in none of two hundred worlds before something else had stopped the rig.
    """
    turns = [*possible, *around, *[""] * NONE_IN_TURN]
    number, place = divmod(seed, len(turns))
    random.Random(f"turns {number}").shuffle(turns)
    what = turns[place]
    if what in AROUND:
        begins_s = FIRST_CYCLE_S if what == STALL else 0.0
        latest_s = motion_s + FIRST_CYCLE_S if motion_s else EARLY_S[1]
        event = _around(what, chance.uniform(begins_s, latest_s), chance)
        times = STALL_TIMES if what == STALL else 1.0
        return [replace(event, lasts_s=None if event.lasts_s is None else times * event.lasts_s)]
    if not what:
        return []
    fault = _fault(what, chance, 0.0, motion_s or EARLY_S[0])
    return [replace(fault, lasts_s=None) if what in SHOW_LATE else fault]


def _fault(slug: str, chance: random.Random, began_s: float, within_s: float) -> FaultEvent:
    """A fault of a row, within a time after something has begun: when, and for how long it lasts."""
    fault = drawn_fault(slug, chance, within_s)
    lasts_s = min(fault.lasts_s, COOLS_S if slug == "ecu-overtemp" else math.inf)
    event = FaultEvent(fault.name, fault.after_s, None if lasts_s == math.inf else lasts_s)
    return event if fault.after_s is None else event.begun_at(max(FIRST_CYCLE_S, began_s) + fault.after_s)


def _in_order(chosen: Iterable[FaultEvent]) -> tuple[FaultEvent, ...]:
    """By time; signals may come again, nothing else does."""
    unique = {(event.what, event.what in SIGNALS and event.at_s): event for event in chosen}
    return tuple(sorted(unique.values(), key=lambda event: (event.at_s or 0.0, event.what)))


def _beyond_limits(chance: random.Random, motion_s: float) -> tuple[FaultEvent, ...]:
    """In some worlds something that drives the rig beyond the bench's limits, while the first points are run."""
    if chance.random() >= BEYOND_SHARE:
        return ()
    what, at_s = chance.choice(BEYOND_LIMITS), round(chance.uniform(0.0, motion_s or EARLY_S[0]), 3)
    lasts_s = round(chance.uniform(0.1, 2.0), 3)
    passes = what in PASSING_VARIANTS and chance.random() >= BEYOND_LASTS_SHARE
    return (FaultEvent(what, at_s, lasts_s if passes else None),)


def _around(what: str, at_s: float, chance: random.Random) -> FaultEvent:
    """Something around the devices, at about a time."""
    longest_s = LONGEST_STALL_S.get(what, 1.5)
    lasts_s = round(chance.uniform(0.02, longest_s), 3) if what in STALLS or what in LASTING else None
    return FaultEvent(what, round(at_s, 3), lasts_s)


def _combined(chance: random.Random) -> list[FaultEvent]:
    """Two troubles that come together."""
    at_s, troubles = chance.uniform(0.0, LATEST_FAULT_S), chance.choice(COMBINED)
    return [
        _around(what, at_s + chance.uniform(0.0, 1.0), chance) if what in AROUND else FaultEvent(what, round(at_s, 3))
        for what in troubles
    ]


def _matrix(chance: random.Random) -> tuple[str, bool]:
    """A matrix, and whether its points have a name."""
    amplitudes = [f"{chance.choice((4, 5, 6, 8, 10))} mm"]
    frequencies = [f"{frequency} Hz" for frequency in sorted(chance.sample((2, 2.5, 3, 4), 2))]
    chosen_A = chance.sample((0, 0.25, 0.5, 0.75, 1.0), chance.choice((1, 2, 2)))
    currents = [f"{current_A} A" for current_A in sorted(chosen_A)]
    cycles = chance.choice((5, 6, 8)) if len(currents) == 1 else chance.choice((5, 6))
    if chance.random() < NAMED_SHARE:
        return _named_matrix(chance, amplitudes[0], frequencies[0], currents[0]), True
    text = "\n".join((
        "format = 1", "[specimen]", 'serial_number = "MR-001"', 'stroke = "170 mm"', 'prior = "demo"', "[matrix]",
        f'waveform = ["{chance.choice(("sine", "sine", "triangle"))}"]', f"amplitude = {json.dumps(amplitudes)}",
        f"frequency = {json.dumps(frequencies)}", f"current = {json.dumps(currents)}", f"cycles = {cycles}",
        chance.choice(('order = "as written"', 'order = "as written"', 'order = "random"\nseed = 1')),
        "[campaign]", f"retries = {chance.choice((0, 0, 1, 2))}", "[identify]", "enabled = false", "",
    ))  # fmt: skip
    return text, False


def _named_matrix(chance: random.Random, amplitude: str, frequency: str, current: str) -> str:
    """A named point that is repeated, in any order: names that begin alike."""
    return "\n".join((
        "format = 1", "[specimen]", 'serial_number = "MR-001"', 'stroke = "170 mm"', 'prior = "demo"', "[matrix]",
        f"cycles = {chance.choice((5, 6))}", f"repeats = {chance.choice((2, 3, 4))}",
        f'order = "random"\nseed = {chance.randrange(100)}', "[[point]]", 'id = "loop"', 'waveform = "sine"',
        f'amplitude = "{amplitude}"', f'frequency = "{frequency}"', f'current = "{current}"',
        "[campaign]", f"retries = {chance.choice((0, 1))}", "[identify]", "enabled = false", "",
    ))  # fmt: skip
