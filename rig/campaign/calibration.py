"""Whether the sensors' calibrations still hold: a warning, or a refusal where the bench file asks for it."""

from __future__ import annotations

from datetime import date

from rig.bench.model import Bench
from rig.errors import Refused


def check_calibrations(bench: Bench, today: date) -> tuple[str, ...]:
    """One warning for each sensor whose calibration is past its due date.

    Args:
        bench: the bench.
        today: the date to compare with.

    Raises:
        Refused: there is one, and the bench file says `require_valid_calibration = true` (slug `calibration-overdue`).
    """
    sensors = {"load_cell": bench.load_cell, "lvdt": bench.lvdt, **{item.name: item for item in bench.auxiliary}}
    warnings = tuple(
        f"{name}: the calibration of sensor {sensors[name].calibration.serial_number} was due on "
        f"{sensors[name].calibration.due}"
        for name in bench.overdue(today)
    )
    if warnings and bench.require_valid_calibration:
        raise Refused(
            "calibration-overdue",
            "; ".join(warnings) + "; have it calibrated and enter the new certificate and due date in the bench file "
            "(it says require_valid_calibration = true); nothing was moved",
        )
    return warnings
