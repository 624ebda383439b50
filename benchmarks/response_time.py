"""Response times of simulated plants: error of the results, and how often their 95 % intervals contain the truth.

    python benchmarks/response_time.py                     500 plants with one lag, 500 with two
    python benchmarks/response_time.py --plants 60         a quick look
    python benchmarks/response_time.py --two-lags --seed 900

Each plant is a lag of 1 to 30 ms (log-uniform), or two such lags in series, with a dead time of 0.5 to 5 ms. It is
stepped by 300 to 1,500 N five times in a drifting force (spring and friction at constant velocity), with noise of 5 N,
sampled at 250 Hz to 5 kHz (log-uniform), and observed for 5 to 10 times the sum of its lags, at least 100 ms. Goals:
error of 0.3 ms or 5 %; 93 to 97 % of the intervals contain the truth. A result that the analysis states as faster or
slower than can be measured is counted separately, and must be right.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

import numpy as np

from rig.signals.step_response.analysis import step_response
from rig.signals.step_response.lags import Lags
from rig.signals.step_response.records import Record
from rig.signals.step_response.result import LEVEL_NAMES, LEVELS, State, StepResponse, TimeResult

NOISE_N, REPEATS = 5.0, 5
GOAL_S, GOAL_SHARE = 0.3e-3, 0.05
NAMES = ("dead time", "lag", *(f"{way} {name}" for way in ("fit", "crossing", "stated") for name in LEVEL_NAMES))


def plant(seed: int, *, two: bool) -> tuple[StepResponse, list[float]]:
    """The results of one plant, and the true times (s) in the order of `NAMES`."""
    rng = np.random.default_rng((seed, int(two)))
    lag_s, dead_s = 1e-3 * 30.0 ** rng.uniform(), rng.uniform(0.5e-3, 5e-3)
    second_s = 1e-3 * 30.0 ** rng.uniform() if two else 0.0
    total_s = lag_s + second_s
    truth = Lags(dead_s, total_s, lag_s * second_s / total_s**2)
    rate_Hz, step_N = 250.0 * 20.0 ** rng.uniform(), 300.0 * 5.0 ** rng.uniform()
    window_s, records = max(0.1, rng.uniform(5.0, 10.0) * total_s), []
    for _ in range(REPEATS):
        time_s = np.arange(-0.1, window_s, 1.0 / rate_Hz) + rng.uniform(0.0, 1.0 / rate_Hz)
        drift_N_s, other_N_s = rng.uniform(-300.0, 300.0, 2)
        change_N = step_N + (other_N_s - drift_N_s) * time_s
        force_N = drift_N_s * time_s + change_N * truth.reached(time_s)
        records.append(Record(time_s, force_N + NOISE_N * rng.standard_normal(len(time_s))))
    times_s = [truth.time_to_s(level) for level in LEVELS]
    return step_response(records), [dead_s, max(lag_s, second_s), *times_s, *times_s, *times_s]


def right(time_s: TimeResult, true_s: float) -> bool:
    """Whether a stated limit is true."""
    return true_s <= time_s.limit_s if time_s.state is State.FASTER else True


def family(first: int, count: int, *, two: bool) -> bool:
    """Measure the plants of a family, and print; whether the goals are met."""
    inside, measured = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    errors: list[list[float]] = [[] for _ in NAMES]
    beyond, wrong, resolved = np.zeros(len(NAMES)), 0, 0
    begun_s = time.process_time()
    for seed in range(first, first + count):
        seen, truth = plant(seed, two=two)
        resolved += seen.order == 2
        stated = [seen.best(place) for place in range(len(LEVELS))]
        for place, (result, true_s) in enumerate(
            zip((seen.dead, seen.lag, *seen.fit, *seen.crossing, *stated), truth, strict=True)
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
    print(f"{count} plants with {'two lags' if two else 'one lag'}, {1e3 * spent_s:.0f} ms of CPU each; two lags found "
          f"in {resolved}; wrong limits: {wrong}")
    print(f"{'':14s}{'measured':>10s}{'in 95 %':>10s}{'median error':>15s}{'99 %':>10s}{'beyond goal':>13s}")
    for place, name in enumerate(NAMES):
        one = 1e3 * np.array(errors[place] or [math.nan])
        print(f"{name:14s}{measured[place]:10.0f}{100 * inside[place] / max(measured[place], 1):9.1f}%"
              f"{np.median(one):12.3f} ms{np.quantile(one, 0.99):7.2f} ms{beyond[place]:13.0f}")
    last = slice(-len(LEVELS), None)
    whole = 100.0 * np.sum(inside[last]) / np.sum(measured[last])
    print(f"stated times: {whole:.1f} % of the intervals contain the truth; beyond the goal: "
          f"{100.0 * np.sum(beyond[last]) / np.sum(measured[last]):.2f} %\n")
    return 93.0 <= whole <= 97.0 and not wrong


def main() -> int:
    """Measure all plants; 0 if the goals are met."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--plants", type=int, default=500)
    options.add_argument("--seed", type=int, default=0, help="of the first plant")
    options.add_argument("--one-lag", action="store_true", help="only plants with one lag")
    options.add_argument("--two-lags", action="store_true", help="only plants with two lags")
    given = options.parse_args()
    families = [two for two in (False, True) if not (given.one_lag if two else given.two_lags)]
    met = [family(given.seed, given.plants, two=two) for two in families]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
