"""When faults come and go: written one by one, or drawn from a seed.

`--fault SLUG@T` (or `SLUG:VARIANT@T`) switches a fault on T seconds of simulated time after the first program's first
cycle begins; without `@T` it is there from the start. `SLUG@T+D` takes it away again D seconds later. `--fault-seed N`
draws one to three faults of the rig as it is; the same N draws the same ones, and what was drawn is told in the words
of `--fault`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, replace

from protocols.near_miss import near_names
from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from rig.faults.row import Ending
from simulators.injection import BEYOND_LIMITS, INJECTORS, NEEDS_AUXILIARY, PASSING, PASSING_VARIANTS, VARIANTS

MOST_DRAWN = 3
WITHIN_S = 10.0
"""Drawn faults begin this soon after the first cycle: before `examples/quick.toml` has ended."""
PASSING_SHARE = 0.5
SHORTEST_S, LONGEST_S = 0.05, 2.0
"""How long a drawn fault lasts that passes."""
BEYOND_SHARE = 0.2
"""Of a row's drawn faults: so many are those that drive the rig beyond its limits."""
BY_ID = "by-id"
STREAMED = "setpoints"
"""A controller on Modbus TCP that has no function generator and follows set-points."""
ONLY_ON = {
    "modbus-reset": "tcp", "modbus-halfopen": "tcp", "modbus-wrong-tid": "tcp", "rtu-stale": "rtu", "rtu-crc": "rtu",
    "usb-renumber": BY_ID, "setpoints-late": STREAMED, "setpoints-lost": STREAMED,
}  # fmt: skip
"""Faults of one kind of controller, link or port."""

ONLY_BY_ECU = frozenset({
    "can-busoff", "can-busoff:lost", "can-malformed", "can-babble", "can-foreign", "ecu-late", "ecu-overtemp",
    "ecu-overtemp:undervoltage", "ecu-overtemp:coil", "coil-open-short:short", "current-tracking:over",
    "current-stuck:full",
})
"""Faults of a bus, of what a supply does not tell, or seen sooner than a supply is asked."""
ONLY_BY_SUPPLY = frozenset({"supply-not-zero"})


@dataclass(frozen=True)
class ScheduledFault:
    """A fault, when it begins (simulated seconds after the first cycle, None from the start), how long it lasts.

    Attributes:
        slug: the row of the fault matrix.
        variant: which of the row's faults; empty for the one that every row has.
    """

    slug: str
    after_s: float | None
    lasts_s: float = math.inf
    variant: str = ""

    @property
    def name(self) -> str:
        """`SLUG` or `SLUG:VARIANT`."""
        return f"{self.slug}:{self.variant}" if self.variant else self.slug

    @property
    def passes(self) -> bool:
        """Whether it can be taken away again."""
        return self.name in PASSING or self.name in PASSING_VARIANTS

    def __str__(self) -> str:
        at = "" if self.after_s is None else f"@{self.after_s:g}"
        return f"{self.name}{at}" + ("" if math.isinf(self.lasts_s) else f"+{self.lasts_s:g}")


def check_source(faults: Iterable[ScheduledFault], *, supply: bool) -> None:
    """Refuse faults of a current source that this rig does not have.

    Raises:
        FileProblem: each is named.
    """
    excluded = ONLY_BY_ECU if supply else ONLY_BY_SUPPLY
    wrong = [fault.name for fault in faults if fault.name in excluded]
    if wrong:
        text = "requires a power supply as the current source. Fix: add --supply generic-scpi, or specify your own file"
        if supply:
            text = "requires an ECU on CAN as the current source, not --supply"
        raise FileProblem("--fault", [f"{name!r} {text}" for name in wrong])


def parse_fault(text: str) -> ScheduledFault:
    """`SLUG`, `SLUG@T` or `SLUG@T+D`, with `SLUG:VARIANT` for another fault of the row.

    Raises:
        FileProblem: an unknown slug or variant, a slug without an injector here, a time that is no number, or an end
            for a fault that cannot be taken away.
    """
    name, at, times = text.partition("@")
    slug, _, variant = name.partition(":")
    if slug not in MATRIX:
        close = near_names(slug, MATRIX)
        hint = f"; did you mean {close[0]!r}?" if close else "; --list-faults lists all"
        raise FileProblem("--fault", [f"{slug!r} is not in the fault matrix{hint}"])
    if slug not in INJECTORS:
        raise FileProblem(
            "--fault",
            [f"{slug!r} cannot be injected into the simulated rig (where = process: it affects the processes)"],
        )  # fmt: skip
    if name != slug and name not in VARIANTS:
        known = ", ".join(variant for variant in sorted(VARIANTS) if variant.startswith(f"{slug}:"))
        raise FileProblem("--fault", [f"{name!r}: {f'{slug} has {known}' if known else f'{slug} has no variants'}"])
    begin, plus, duration = times.partition("+")
    try:
        after_s = float(begin) if at else None
        lasts_s = float(duration) if plus else math.inf
    except ValueError:
        raise FileProblem(
            "--fault", [f"{text!r}: {times!r} is not a number of seconds; write {name}@5, or {name}@5+0.1"]
        ) from None
    if after_s is not None and not 0 <= after_s < math.inf:
        raise FileProblem("--fault", [f"{text!r}: the time must be 0 s or more"])
    if not lasts_s > 0:
        raise FileProblem("--fault", [f"{text!r}: the duration must be above 0 s"])
    fault = ScheduledFault(slug, after_s, lasts_s, variant)
    if plus and not fault.passes:
        raise FileProblem("--fault", [f"{text!r}: {name} is permanent. Fix: write {name}@{begin} without a duration"])
    return fault


@dataclass(frozen=True)
class Wiring:
    """How the rig's wires are made: `actuator` "tcp", "rtu" or "setpoints", `ports` "pty", "socket" or "by-id"."""

    actuator: str
    ports: str

    def __str__(self) -> str:
        return f"--actuator {self.actuator} --ports {self.ports}"

    @property
    def kinds(self) -> frozenset[str]:
        """All that they are, as `ONLY_ON` names them."""
        return frozenset((self.actuator, self.ports, *(("tcp",) if self.actuator == STREAMED else ())))


def wiring_for(faults: Iterable[ScheduledFault], actuator: str | None = None, ports: str | None = None) -> Wiring:
    """The wires as asked for; where nothing was said, those on which the faults can happen.

    Args:
        faults: what is to be injected.
        actuator: as asked for, None for whatever fits.
        ports: likewise.

    Raises:
        FileProblem: a fault cannot happen on these wires.
    """
    links = {fault.slug: ONLY_ON[fault.slug] for fault in faults if fault.slug in ONLY_ON}
    needed = set(links.values())
    controller = next((kind for kind in ("rtu", STREAMED) if kind in needed), "tcp")
    wiring = Wiring(actuator or controller, ports or (BY_ID if BY_ID in needed else "pty"))
    for slug, kind in links.items():
        if kind not in wiring.kinds:
            option = f"--ports {kind}" if kind == BY_ID else f"--actuator {kind}"
            raise FileProblem("--fault", [f"{slug!r} requires {option}; got {wiring}"])
    return wiring


def drawn_faults(
    seed: int, kinds: frozenset[str], within_s: float = WITHIN_S, *, supply: bool = False
) -> tuple[ScheduledFault, ...]:
    """One to three faults of different rows in the order of their times; a preflight fault is there from the start.

    Args:
        seed: the same seed draws the same faults, for the same `kinds` and `within_s`.
        kinds: the rig's kinds of link and port, such as {"tcp", "pty"}; faults of other kinds are not drawn.
        within_s: the latest begin (simulated s after the first cycle).
        supply: a supply drives the coil: what happens to an ECU only is left out.
    """
    chance = random.Random(seed)
    possible = [slug for slug in INJECTORS if ONLY_ON.get(slug) is None or ONLY_ON[slug] in kinds]
    excluded = ONLY_BY_ECU if supply else ONLY_BY_SUPPLY
    possible = [slug for slug in possible if slug not in excluded]
    slugs = chance.sample(sorted(possible), chance.randint(1, MOST_DRAWN))
    faults = (drawn_fault(slug, chance, within_s) for slug in slugs)
    kept = (replace(f, variant="") if supply and f.name in ONLY_BY_ECU else f for f in faults)
    return tuple(sorted(kept, key=lambda fault: fault.after_s or 0.0))


def drawn_fault(slug: str, chance: random.Random, within_s: float) -> ScheduledFault:
    """A fault of a row: when it begins, whether it passes, which of its variants."""
    after_s, lasts_s = round(chance.uniform(0.0, within_s), 2), round(chance.uniform(SHORTEST_S, LONGEST_S), 2)
    variant = _variant(slug, random.Random(f"{slug} {after_s}"))
    passes = slug in PASSING and chance.random() < PASSING_SHARE
    if MATRIX[slug].end is Ending.REFUSE:
        return ScheduledFault(slug, None, variant=variant)
    fault = ScheduledFault(slug, after_s, lasts_s, variant)
    return fault if passes and fault.passes else replace(fault, lasts_s=math.inf)


def _variant(slug: str, chance: random.Random) -> str:
    """One of the row's faults, its own is empty; those beyond the bench's limits are rarer."""
    names = [name for name in sorted(VARIANTS) if name.startswith(f"{slug}:") and name not in NEEDS_AUXILIARY]
    beyond = [name for name in names if name in BEYOND_LIMITS]
    if beyond and chance.random() < BEYOND_SHARE:
        return chance.choice(beyond).partition(":")[2]
    return chance.choice(["", *(name.partition(":")[2] for name in names if name not in beyond)])
