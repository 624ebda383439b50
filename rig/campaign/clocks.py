"""Whether the sensors' formats carry what a stated skew needs; asked for by the matrix (`[campaign] require_skew`)."""

from __future__ import annotations

from rig.bench.model import Bench
from rig.errors import Refused

CLOCKED = "frame16"
"""The only format with a device clock and latched edges; others count their samples against the nominal rate."""


def check_clocks(bench: Bench) -> None:
    """Refuse a bench on which the skew between force and displacement cannot be measured.

    Raises:
        Refused: a sensor speaks a format without a clock (slug `format-without-clock`); each is named.
    """
    formats = {"load_cell": bench.load_cell.format, "lvdt": bench.lvdt.format}
    without = [
        f"[{name}] format = {value if isinstance(value, str) else 'a described line'!r} carries neither a clock nor "
        "sync edges"
        for name, value in formats.items() if value != CLOCKED
    ]
    if without:
        raise Refused(
            "format-without-clock",
            "; ".join(without) + f", and the matrix asks for the skew ([campaign] require_skew = true): use a sensor "
            f'that speaks "{CLOCKED}", or leave require_skew out and take the skew as uncertain as the report states '
            "it; nothing was moved",
        )
