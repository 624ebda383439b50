"""The report's test conditions: by how much the servo fell short and was corrected, and how hot the damper was."""

from __future__ import annotations

import math

from rig.recording.campaign_log import read_log
from rig.recording.run import RecordedPoint, Run
from rig.report.fragment import NOTHING, number, table, text

PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
CONFIDENCE = 1.96
TEMPERATURE_STEP_K = 0.1
"""The ECU reports its coil's temperature in such steps."""
TOLD = ("cooling down", "warming up", "reached;")
"""What the campaign says when it waits for a temperature or corrects a command."""


def conditions(run: Run) -> str:
    """Servo and temperature of every point that moved, and what the campaign did about them; empty without any."""
    head = ["Point", "f Hz", "Servo reached %", "Command corrected by %", "Coil \N{DEGREE SIGN}C, lowest", "highest"]
    rows = [("", row) for row in map(_row, run.points) if row]
    if not rows:
        return ""
    step = f"{PLUS_MINUS} {number(TEMPERATURE_STEP_K / math.sqrt(12.0) * CONFIDENCE, 1)} K"
    note = (
        "Servo reached: measured over commanded amplitude, with the 95 % interval of its mean over the cycles. The "
        f"coil's temperature over the full cycles is the ECU's, {step} by its resolution; its own error comes on top."
    )
    heading = f'<h2>Test conditions</h2><p class="lead">{note}</p>'
    return heading + table(head, rows, (1, 2, 3, 4, 5)) + _told(run)


def _row(point: RecordedPoint) -> list[str]:
    quality = point.quality
    measured_m, commanded_m = quality.get("measured_amplitude_m"), point.test.get("commanded_amplitude_m")
    if measured_m is None or commanded_m is None or not float(commanded_m) > 0.0 or not point.amplitude_m > 0.0:
        return []
    cycles = max(1.0, float(quality.get("measured_cycles", 1.0)))
    std = float(quality.get("measured_amplitude_std_m", math.nan)) / math.sqrt(cycles)
    reached = f"{number(100.0 * float(measured_m) / float(commanded_m), 4)} {PLUS_MINUS} "
    return [
        text(point.id), number(point.frequency_Hz), reached + number(100.0 * CONFIDENCE * std / float(commanded_m), 1),
        number(100.0 * (float(commanded_m) / point.amplitude_m - 1.0), 3),
        *(number(quality.get(f"coil_temperature_{end}_degC"), 4) for end in ("low", "high")),
    ]


def _told(run: Run) -> str:
    """What the campaign's journal says of waiting and correcting, in its words."""
    if not (run.path / "journal.jsonl").is_file():
        return ""
    said = [str(line.get("text", NOTHING)) for line in read_log(run.path) if line.get("event") == "info"]
    lines = [line for line in said if any(words in line for words in TOLD)]
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>" if lines else ""
