"""Response times of simulated plants: error of the results, and how often their 95 % intervals contain the truth.

    python benchmarks/response_time.py              500 plants
    python benchmarks/response_time.py --plants 60  a quick look

Each plant is a first-order lag of 1 to 30 ms (log-uniform) with a dead time of 0.5 to 5 ms, stepped by 300 to 1,500 N
five times in a drifting force (spring and friction at constant velocity), with noise of 5 N, sampled at 250 Hz to 5 kHz
(log-uniform). Goals: error of 0.3 ms or 5 %; 93 to 97 % of the intervals contain the truth. A result that the analysis
states as faster or slower than can be measured is counted separately, and must be right.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

import numpy as np

from rig.signals.step_response import (
    LEVEL_NAMES,
    LEVELS,
    Record,
    State,
    StepResponse,
    TimeResult,
    filtered_lag,
    step_response,
)

NOISE_N, REPEATS = 5.0, 5
GOAL_S, GOAL_SHARE = 0.3e-3, 0.05
NAMES = ("dead time", "lag", *(f"{way} {name}" for way in ("fit", "crossing") for name in LEVEL_NAMES))


def plant(seed: int) -> tuple[StepResponse, list[float]]:
    """The results of one plant, and the true times (s) in the order of `NAMES`."""
    rng = np.random.default_rng(seed)
    lag_s, dead_s = 1e-3 * 30.0 ** rng.uniform(), rng.uniform(0.5e-3, 5e-3)
    rate_Hz, step_N = 250.0 * 20.0 ** rng.uniform(), 300.0 * 5.0 ** rng.uniform()
    window_s, records = max(0.1, 8.0 * lag_s), []
    for _ in range(REPEATS):
        time_s = np.arange(-0.1, window_s, 1.0 / rate_Hz) + rng.uniform(0.0, 1.0 / rate_Hz)
        drift_N_s, other_N_s = rng.uniform(-300.0, 300.0, 2)
        change_N = step_N + (other_N_s - drift_N_s) * time_s
        force_N = drift_N_s * time_s + change_N * filtered_lag(time_s, dead_s, lag_s, None)
        records.append(Record(time_s, force_N + NOISE_N * rng.standard_normal(len(time_s))))
    times_s = [dead_s - lag_s * math.log1p(-level) for level in LEVELS]
    return step_response(records), [dead_s, lag_s, *times_s, *times_s]


def right(time_s: TimeResult, true_s: float) -> bool:
    """Whether a stated limit is true."""
    return true_s <= time_s.limit_s if time_s.state is State.FASTER else True


def main() -> int:
    """Measure all plants; 0 if the goals are met."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--plants", type=int, default=500)
    count = options.parse_args().plants
    inside, measured = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    errors: list[list[float]] = [[] for _ in NAMES]
    beyond, wrong = np.zeros(len(NAMES)), 0
    begun_s = time.process_time()
    for seed in range(count):
        seen, truth = plant(seed)
        for place, (result, true_s) in enumerate(
            zip((seen.dead, seen.lag, *seen.fit, *seen.crossing), truth, strict=True)
        ):
            if not result.measured:
                wrong += not right(result, true_s)
                continue
            measured[place] += 1
            inside[place] += result.low_s <= true_s <= result.high_s
            error_s = abs(result.value_s - true_s)
            errors[place].append(error_s)
            beyond[place] += error_s > max(GOAL_S, GOAL_SHARE * true_s)
    spent_s = (time.process_time() - begun_s) / count
    print(f"{count} plants, {1e3 * spent_s:.0f} ms of CPU each; wrong limits: {wrong}")
    print(f"{'':14s}{'measured':>10s}{'in 95 %':>10s}{'median error':>15s}{'99 %':>10s}{'beyond goal':>13s}")
    for place, name in enumerate(NAMES):
        one = 1e3 * np.array(errors[place] or [math.nan])
        print(f"{name:14s}{measured[place]:10.0f}{100 * inside[place] / max(measured[place], 1):9.1f}%"
              f"{np.median(one):12.3f} ms{np.quantile(one, 0.99):7.2f} ms{beyond[place]:13.0f}")
    whole = 100.0 * np.sum(inside) / np.sum(measured)
    print(f"all intervals: {whole:.1f} %; beyond the goal: {100.0 * np.sum(beyond) / np.sum(measured):.2f} %")
    return 0 if 93.0 <= whole <= 97.0 and not wrong else 1


if __name__ == "__main__":
    sys.exit(main())
