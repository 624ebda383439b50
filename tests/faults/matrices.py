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

HYBRID = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[hybrid]
current = "0.3 A"
largest_delay = "20 ms"
probe_frequency = "10 Hz"
compensation = ["model", "ats"]
[hybrid.car]
source = "a test"
[hybrid.car.body]
mass = "600 kg"
[hybrid.car.front]
unsprung_mass = "90 kg"
wheel_rate = "40 kN/m"
tyre_stiffness = "220 kN/m"
tyre_damping = "300 N s/m"
[hybrid.road]
speed = "20 m/s"
[hybrid.road.sweep]
duration = "2 s"
first_frequency = "2 Hz"
last_frequency = "4 Hz"
first_height = "20 mm"
last_height = "15 mm"
"""
"""Two hybrid tests of a quarter car. From the start of each: 0.8 s in which the delay is measured, 0.5 s of rest,
2 s of road, 1 s to return.
"""

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
