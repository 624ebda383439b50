"""Matrix files of campaigns in tests."""

import json


def matrix_text(
    *currents: str, amplitude: str = "20 mm", frequency: str = "2 Hz", cycles: int = 6, more: str = ""
) -> str:
    """Sines at these currents, in this order; `more` tables stand before the last one, nothing is identified."""
    return f"""format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["{amplitude}"]
frequency = ["{frequency}"]
current = {json.dumps(currents)}
cycles = {cycles}
{more}
[identify]
enabled = false
"""


TWO_POINTS = matrix_text("0.5 A", "1.5 A", more='[campaign]\ncurrent_settled = "20 mA"')
"""Each point moves for 4 s; the second one's cycles begin a little more than 4 s after the first one's."""
PERIOD_S = 0.5

BRISK_POINTS = TWO_POINTS.replace('"2 Hz"', '"4 Hz"')
"""For tests at speed 1: each point moves for 2 s."""

LONG_SECOND_POINT = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[[point]]
id = "p001"
amplitude = "20 mm"
frequency = "2 Hz"
current = "0.5 A"
cycles = 4
[[point]]
id = "p002"
amplitude = "20 mm"
frequency = "2 Hz"
current = "1.5 A"
cycles = 60
"""

ONE_POINT = BRISK_POINTS.replace('"0.5 A", ', "")
"""The second of them alone."""

ONE_LONG_POINT = TWO_POINTS.replace(', "1.5 A"', "").replace("cycles = 6", "cycles = 28")
"""15 s of motion: at speed 1 long enough for a clock to be judged."""
