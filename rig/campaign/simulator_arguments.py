"""Which of an earlier session's arguments a resumed campaign gives its simulated rig again: an allow-list.

`campaign.json` may have come from anywhere: only what describes the rig itself is passed on, and only in the shape such
a value has. Faults belong to one session, and where files are written is said anew by each.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

NAME = r"[a-z0-9_]{1,60}"
QUANTITY = r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?( ?[A-Za-z/%^0-9*]{1,12})?"
ASSIGNMENT = r"[a-z][a-z_]*(\.[A-Za-z0-9_]+)*=[^\x00-\x1f\x7f]{1,200}"
FLAG = ""
INPUTS = ("delay", "bandwidth", "gain", "zero", "noise", "resolution")

ALLOWED: dict[str, str] = {
    "--config": r"[^-\x00-\x1f\x7f][^\x00-\x1f\x7f]{0,1000}\.toml",
    "--option": ASSIGNMENT,
    "--specimen": ASSIGNMENT,
    "--model": NAME,
    "--set": NAME,
    "--force-format": "frame16|ascii",
    "--rate": QUANTITY,
    "--auxiliary": r"[0-9]",
    "--ports": "pty|socket|by-id",
    "--actuator": "tcp|rtu",
    "--real-time": FLAG,
    "--no-real-time": FLAG,
    "--drop-unread": FLAG,
    **{
        f"--{name}": QUANTITY
        for name in (
            "servo-stiffness", "load-train-stiffness", "actuator-friction", "load-cell-zero-drift", "hum", "crosstalk",
            "ecu-current-gain", "ecu-current-offset", "coil-sensor-offset", "coil-heat-capacity", "body-heat-capacity",
            "coil-to-body",
            *(f"actuator-{which}-{what}" for which in ("force", "position") for what in INPUTS),
            *(f"{sensor}-{what}" for sensor in ("load-cell", "lvdt") for what in INPUTS),
        )
    },
}
"""Option -> the shape of its value; a flag has none."""
OF_ONE_SESSION = {
    "--fault": True, "--fault-seed": True, "--fault-within": True, "--truth": True, "--bench": True, "--speed": True,
    "--seed": True, "--exit-when-idle": False, "--list-faults": False, "--json": False, "--help": False,
}  # fmt: skip
"""Option -> whether it has a value; these are left out."""


class StrangeArgument(ValueError):
    """An argument that no simulated rig of a resumed campaign is given."""


def of_the_rig(arguments: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sort an earlier session's arguments.

    Args:
        arguments: as they were given, each an own text.

    Returns:
        Those to be given again, as `--name=value`; and the names of those that are left out.

    Raises:
        StrangeArgument: one is no option of a rig, or its value has not the shape of one.
    """
    kept: list[str] = []
    left_out: list[str] = []
    waiting = list(arguments)
    for argument in waiting:
        if not isinstance(argument, str):
            raise StrangeArgument(f"{argument!r:.60} is not a text")
    while waiting:
        argument = waiting.pop(0)
        name, equals, value = argument.partition("=")
        if name not in ALLOWED and name not in OF_ONE_SESSION:
            raise StrangeArgument(f"{name[:60]!r} is no option of a resumed simulated rig")
        if not equals and (OF_ONE_SESSION.get(name, False) or ALLOWED.get(name, FLAG) != FLAG):
            if not waiting:
                raise StrangeArgument(f"{name}: its value is missing")
            value = waiting.pop(0)
        if name in OF_ONE_SESSION:
            left_out.append(name)
            continue
        if not re.fullmatch(ALLOWED[name], value, re.ASCII if name != "--config" else 0):
            raise StrangeArgument(f"{name}: {value[:60]!r} is not the shape of its value")
        kept.append(name if ALLOWED[name] == FLAG else f"{name}={value}")
    return tuple(kept), tuple(left_out)
