"""The explanation of one slug, put together from its text and its row of the fault matrix."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from rig.faults.matrix import MATRIX, REACTIONS
from rig.faults.row import Ending, FaultRow, StopKind

DONE = {
    StopKind.FADE_OUT: "The rig is stopped (S2): the coil goes to 0 A immediately; the controller ramps the motion "
        "down and holds the position.",
    StopKind.HALT: "The rig is stopped (SO) because the position is no longer trusted: the coil goes to 0 A "
        "immediately; the controller halts without using its position.",
    StopKind.PRESSURE_OFF: "The rig is stopped (S1): the coil goes to 0 A immediately; the controller ramps the motion "
        "down; then the pressure is switched off.",
    Ending.WARN: "The event is flagged and recorded; the campaign continues.",
    Ending.INVALID: "The current point is invalid; the campaign continues and repeats the point if [campaign] "
        "retries allows it.",
    Ending.REFUSE: "The request was refused; nothing moved.",
}
"""What follows from how a fault ends."""
HALTED = "The rig is stopped (S2): the coil goes to 0 A immediately; the controller's halt ramp ends the motion."
"""... where a hard limit was hit."""
STAYS = "A single occurrence is only flagged. If the fault persists, "
KEPT = " Data recorded before the stop are kept; the current point is invalid."

RESUME = {
    "a": "Continue with `rig run --resume RUN`; with [campaign] retries the point is repeated automatically.",
    "c": "Continue with `rig run --resume RUN` once the cause has been eliminated; by running this command, you "
    "confirm that you have inspected the rig.",
    "n": 'Requalify the damper first, then run `rig run --resume RUN --requalified "WHAT WAS CHECKED"`.',
}
"""How to go on after a stop, by the row's class."""


@dataclass(frozen=True)
class Explanation:
    """What one slug says.

    Attributes:
        slug: its name.
        means: what is wrong.
        done: what this software did about it.
        look_at: what to look at, in this order.
        resume: how to go on; empty where nothing was stopped.
        exit_code: of `rig run` when it stays; None where the slug alone does not decide it.
        reaction: the fault matrix's, "" for what is not in it.
    """

    slug: str
    means: str
    done: str
    look_at: tuple[str, ...]
    resume: str = ""
    exit_code: int | None = None
    reaction: str = ""


def explained(slug: str) -> Explanation:
    """The explanation of a slug.

    Raises:
        KeyError: nothing in the product has this name.
    """
    text = texts()[slug]
    row = MATRIX.get(slug) or REACTIONS.get(slug)
    done = text.get("done") or (_done(row) if row else "")
    look_at = tuple(text["look"])
    if row is None:
        return Explanation(slug, text["means"], done, look_at)
    resume = RESUME.get(row.resume or "c", "") if row.stop else ""
    return Explanation(slug, text["means"], done, look_at, resume, row.exit_code, row.reaction or str(row.stop or ""))


@cache
def texts() -> Mapping[str, Mapping[str, Any]]:
    """Every slug's text: `means`, `look` (a list) and perhaps `done`; a file's own `done` holds for all in it.

    Raises:
        ValueError: a slug stands in two files.
    """
    everything: dict[str, Mapping[str, Any]] = {}
    folder = files("rig.explanations")
    for entry in sorted(folder.iterdir(), key=lambda file: file.name):
        if not entry.name.endswith(".toml"):
            continue
        tables = tomllib.loads(entry.read_text(encoding="utf-8"))
        shared = {"done": tables.pop("done")} if "done" in tables else {}
        twice = everything.keys() & tables.keys()
        if twice:
            raise ValueError(f"{entry.name}: explained elsewhere too: {', '.join(sorted(twice))}")
        everything |= {slug: {**shared, **table} for slug, table in tables.items()}
    return everything


def _done(row: FaultRow) -> str:
    text = HALTED if row.halt else DONE[row.end]
    if row.stop:
        text += KEPT
    return STAYS + text[0].lower() + text[1:] if row.reaction.startswith("W→") else text
