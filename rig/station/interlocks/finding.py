"""The result of a detector: a finding, with the code of its row in the fault matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass

CONSECUTIVE = 3
"""Flags of a sample whose value is no measurement."""


@dataclass(frozen=True)
class Finding:
    """Something a detector saw.

    `slug` names a row of `rig.faults`, `t_ns` is the host arrival of what showed it; `warns` marks what is worth a
    warning only, whatever the row's stop.
    """

    slug: str
    detail: str
    t_ns: int
    value: float = math.nan
    limit: float = math.nan
    warns: bool = False
