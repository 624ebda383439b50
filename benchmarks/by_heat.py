"""The order `by heat` against 200 random orders, on the example matrices: `python benchmarks/by_heat.py`.

For each example and for temperature windows from wide to as narrow as the plan allows: forecast duration of the
campaign as written, by heat, and of the best and the middle of 200 random orders (seed 1). Nothing moves.
"""

from __future__ import annotations

import random
import statistics
import sys
import time
import tomllib
from pathlib import Path

from rig.matrix.forecast import forecaster
from rig.matrix.model import Matrix
from rig.matrix.order_by_heat import fastest_order, load_of, thermal_of

EXAMPLES = Path(__file__).parents[1] / "examples"
NAMES = ("table1", "triangle", "quick", "quality")
WINDOWS_DEGC = ((25, 45), (30, 34), (35, 38), (40, 43))
# A small damper in still air: the same matrices heat it several times faster.
DAMPERS = {"1.5 kJ/K": ("1.5 kJ/K", "5 W/K"), "0.4 kJ/K": ("0.4 kJ/K", "2 W/K")}
RANDOM_ORDERS = 200


def matrix_of(name: str, window_degC: tuple[int, int], heat_capacity: str, heat_loss: str) -> Matrix:
    """An example with another temperature window and damper, as written."""
    content = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    content.setdefault("matrix", {})["order"] = "as written"
    content["temperature"] = {
        "window": tuple(f"{value} degC" for value in window_degC),
        "heat_capacity": heat_capacity,
        "heat_loss": heat_loss,
    }
    return Matrix.model_validate(_with_tuples(content))


def _with_tuples(value: object) -> object:
    """Lists as the strict file model takes them."""
    if isinstance(value, dict):
        return {key: _with_tuples(entry) for key, entry in value.items()}
    return tuple(map(_with_tuples, value)) if isinstance(value, list | tuple) else value


def main() -> int:
    """Print the table; 1 when a random order is faster anywhere."""
    worst = 0
    print(f"{'matrix':<10}{'damper':<10}{'window':<12}{'written':>9}{'by heat':>9}{'best':>9}{'median':>9}   search")
    for name in NAMES:
        for label, damper in DAMPERS.items():
            for window_degC in WINDOWS_DEGC:
                matrix = matrix_of(name, window_degC, *damper)
                if matrix.temperature is None:
                    raise ValueError(f"{name}: no temperature window")
                points, forecast = matrix.points(), forecaster(matrix.specimen)
                thermal = thermal_of(points, forecast, matrix.temperature)
                loads = [load_of(point, forecast) for point in points]
                began_s = time.perf_counter()
                order = fastest_order(loads, thermal)
                search_s = time.perf_counter() - began_s
                ours_s = thermal.total_s([loads[index] for index in order])
                dice = random.Random(1)
                others_s = [thermal.total_s(dice.sample(loads, len(loads))) for _ in range(RANDOM_ORDERS)]
                worst |= ours_s > min(others_s) + 1e-6
                numbers = (thermal.total_s(loads), ours_s, min(others_s), statistics.median(others_s))
                shown = "".join(f"{number:9.1f}" for number in numbers)
                print(f"{name:<10}{label:<10}{window_degC[0]}..{window_degC[1]} degC {shown}   {search_s:.2f} s")
    print("by heat is slower than a random order somewhere" if worst else "nowhere slower than the best of 200")
    return worst


if __name__ == "__main__":
    sys.exit(main())
