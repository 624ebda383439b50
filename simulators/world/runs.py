"""Worlds run and judged, one by one or in the processes of a pool."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from simulators.world.invariants import judged
from simulators.world.plan import Happening, WorldPlan, drawn
from simulators.world.world import World


@dataclass(frozen=True)
class Ended:
    """A world that has ended.

    Attributes:
        failed: invariant and words of everything that did not hold, with the virtual time (s).
        digest: of everything it made.
        rig_s: virtual seconds; `wall_s` the real ones it took.
    """

    seed: int
    failed: tuple[tuple[str, str, float], ...]
    digest: str
    rig_s: float
    wall_s: float
    sessions: tuple[int | None, ...]


def live(plan: WorldPlan, root: Path, until_s: float | None = None) -> tuple[World, Ended]:
    """Run a world and judge it."""
    began_s = time.perf_counter()
    world = World(plan, root)
    world.run(until_s)
    failed = () if until_s is not None else tuple(judged(world))
    wall_s = time.perf_counter() - began_s
    codes = tuple(session.exit_code for session in world.sessions)
    return world, Ended(plan.seed, failed, world.digest(), world.kernel.time_s, wall_s, codes)


def plan_of(seed: int, asked: dict[str, Any]) -> WorldPlan:
    """The world of a seed, with what was asked for in place of what is drawn.

    Raises:
        FileProblem: the matrix or a happening cannot be used.
    """
    plan = drawn(seed, asked["matrix"])
    if asked["happening"]:
        plan = replace(plan, happenings=tuple(Happening.parse(text) for text in asked["happening"]))
    return plan


def one(seed: int, asked: dict[str, Any]) -> dict[str, Any]:
    """Run the world of a seed; what is to be told of it."""
    plan = plan_of(seed, asked)
    with tempfile.TemporaryDirectory(prefix="world-", dir=memory()) as name:
        _, ended = live(plan, Path(name), asked["until"])
    failed = [
        {"seed": seed, "invariant": invariant, "at_s": at_s, "words": words} for invariant, words, at_s in ended.failed
    ]
    return {
        "seed": seed, "failed": failed, "digest": ended.digest, "rig_s": ended.rig_s, "wall_s": ended.wall_s,
        "sessions": list(ended.sessions), "happenings": [str(happening) for happening in plan.happenings],
    }  # fmt: skip


def memory() -> str | None:
    """A folder in memory, where there is one: worlds write much and keep nothing."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
