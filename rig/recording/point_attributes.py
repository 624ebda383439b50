"""A test point as attributes: of `/entry/test` in its file, and of `point` in its journal's header.

This is the only module that knows their names (`docs/files.md`). What was not stated is absent.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.signals.record import RecordFacts
from rig.test_point import LOOP, EnduranceStep, TestPoint

MOTION = ("id", "waveform", "amplitude_m", "frequency_Hz", "current_A")
"""Fields of a `TestPoint` that every recording states."""
OPTIONAL: Mapping[str, Any] = {
    "cycles": 0.0, "ramp_in_cycles": 0.0, "ramp_out_cycles": 0.0, "centre_m": 0.0, "repeat": 1, "rest_s": 0.0,
    "kind": LOOP,
}
"""Further fields, and their values where a recording does not state them."""
STEPS, STEP_TIMES, LAW = "steps_A", "steps_s", "law"
BY_SPEED = "by_speed"
"""Only of a point that the matrix states by its speed: 1."""
COMMANDED = {
    "amplitude_m": "commanded_amplitude_m", "centre_m": "commanded_centre_m",
    "amplitude_tolerance": "amplitude_tolerance", "low_degC": "temperature_low_degC",
    "high_degC": "temperature_high_degC", "tracking_tolerance": "tracking_tolerance", "iteration": "iteration",
}  # fmt: skip
"""Field of `Commanded` -> attribute."""
RECORD = {
    "name": "record", "sha256": "record_sha256", "duration_s": "record_s", "ramp_s": "record_ramp_s",
    "highest_Hz": "record_highest_Hz", "of_force": "record_of_force",
}  # fmt: skip
"""Field of `RecordFacts` -> attribute."""
ENDURANCE = {name: f"endurance_{name}" for name in EnduranceStep._fields}
"""Field of `EnduranceStep` -> attribute."""
PROGRAM_CYCLES = ENDURANCE["program_cycles"]
"""Only of a block with a current program."""
NAMES = frozenset({
    *MOTION, *OPTIONAL, STEPS, STEP_TIMES, LAW, BY_SPEED, *COMMANDED.values(), *RECORD.values(), *ENDURANCE.values(),
})
TEXTS = frozenset({
    "id", "waveform", "kind", STEPS, STEP_TIMES, LAW, RECORD["name"], RECORD["sha256"], COMMANDED["iteration"],
    ENDURANCE["test"],
})
"""Those that are texts; the others are numbers."""


@dataclass(frozen=True)
class Commanded:
    """How a point was commanded and accepted; None where that is not stated.

    Attributes:
        amplitude_m, centre_m: of the program that made the motion.
        amplitude_tolerance: relative, of a command that was compensated; None: the usual limits.
        tracking_tolerance: RMS error allowed of an iterated signal, relative; None: the usual limits.
        iteration: how the command of a signal was iterated, as JSON (`SignalDrive.to_json`); None: it was not.
        low_degC, high_degC: window of the coil's temperature; None: any.
    """

    amplitude_m: float | None = None
    centre_m: float | None = None
    amplitude_tolerance: float | None = None
    low_degC: float | None = None
    high_degC: float | None = None
    tracking_tolerance: float | None = None
    iteration: str | None = None

    @property
    def temperature_window_degC(self) -> tuple[float, float] | None:
        """What the coil's temperature had to lie in; None: any."""
        return None if self.low_degC is None or self.high_degC is None else (self.low_degC, self.high_degC)

    @property
    def iterated(self) -> dict[str, Any] | None:
        """`iteration` as a value; None where there is none, or it cannot be read."""
        try:
            value = json.loads(self.iteration or "null")
        except ValueError:
            return None
        return value if isinstance(value, dict) else None


NOT_STATED = Commanded()


def attributes_of(point: TestPoint, commanded: Commanded) -> dict[str, str | int | float]:
    """The attributes of a point, in the order in which a file has them."""
    record = point.record
    values = {
        **{name: getattr(point, name) for name in (*MOTION, *OPTIONAL)},
        STEPS: " ".join(f"{step_A:g}" for step_A in point.steps_A),
        STEP_TIMES: " ".join(f"{step_s:.12g}" for step_s in point.steps_s) or None, LAW: point.law or None,
        BY_SPEED: int(point.by_speed) or None,
        **{attribute: getattr(commanded, name) for name, attribute in COMMANDED.items()},
        **({} if record is None else {attribute: getattr(record, name) for name, attribute in RECORD.items()}),
    }
    if record is not None:
        values[RECORD["sha256"]] = record.sha256 or None
        values[RECORD["of_force"]] = int(record.of_force) or None
    if point.endurance is not None:
        values |= {attribute: getattr(point.endurance, name) for name, attribute in ENDURANCE.items()}
        if not point.endurance.program_cycles:
            del values[PROGRAM_CYCLES]
    return {name: value for name, value in values.items() if value is not None}


def point_fields(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The keyword arguments of the `TestPoint` that has these attributes; others are left out.

    Raises:
        KeyError: one that every recording states is missing.
        ValueError: its steps or their times are no numbers.
    """
    stated = {name: value for name, value in attributes.items() if value is not None}
    fields = {name: stated[name] for name in MOTION}
    fields |= {name: stated.get(name, absent) for name, absent in OPTIONAL.items()}
    fields[LAW] = stated.get(LAW, "")
    fields[BY_SPEED] = bool(stated.get(BY_SPEED, 0))
    for name in (STEPS, STEP_TIMES):
        fields[name] = tuple(map(float, str(stated.get(name, "")).split()))
    if RECORD["duration_s"] in stated and RECORD["ramp_s"] in stated:
        fields["record"] = RecordFacts(
            stated.get(RECORD["name"], ""), stated[RECORD["duration_s"]], stated[RECORD["ramp_s"]],
            stated.get(RECORD["highest_Hz"], 0.0), stated.get(RECORD["sha256"], ""),
            bool(stated.get(RECORD["of_force"], 0)),
        )
    stated.setdefault(PROGRAM_CYCLES, 0)
    if all(attribute in stated for attribute in ENDURANCE.values()):
        numbers = {name: int(stated[attribute]) for name, attribute in ENDURANCE.items() if name != "test"}
        fields["endurance"] = EnduranceStep(stated[ENDURANCE["test"]], **numbers)
    return fields


def commanded_of(attributes: Mapping[str, Any]) -> Commanded:
    """How the point that has these attributes was commanded."""
    return Commanded(**{name: attributes.get(attribute) for name, attribute in COMMANDED.items()})
