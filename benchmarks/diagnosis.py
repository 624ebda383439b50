"""How often the cause of a misfit is named first, on random campaigns with one thing wrong (`diagnosis_cases.py`).

    python benchmarks/diagnosis.py --seeds 50 --clean 300
    python benchmarks/diagnosis.py --seeds 10 --clean 0 --only "skew 3 ms"

Each campaign is fitted by the model of its plant; plants of five models take turns. A fit that is adequate names
nothing but units, signs and a law drawn through two currents.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter

import numpy as np
from campaign_process import machine
from diagnosis_cases import CASES, SETS

from rig.clock import utc_now
from rig.errors import IdentificationFailed
from rig.identification import identify

HITS, FALSE = 0.9, 6


def first_named(case: str, seed: int) -> tuple[str, float]:
    """The slug named first, empty for none, and the CPU time of the fit and its diagnosis (s)."""
    make, _ = CASES[case]
    random = np.random.default_rng((seed, 7))
    model, tests = make(random, SETS[seed % len(SETS)])
    started = time.process_time()
    try:
        fit = identify(tests, model=model)
    except IdentificationFailed as error:
        return f"refused: {error}"[:60], time.process_time() - started
    return fit.diagnosis[0].slug if fit.diagnosis else "", time.process_time() - started


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--seeds", type=int, default=50)
    arguments.add_argument("--clean", type=int, default=300)
    arguments.add_argument("--first", type=int, default=0, help="first seed")
    arguments.add_argument("--only", choices=list(CASES), action="append")
    given = arguments.parse_args()
    print(f"{utc_now().date()}, {machine()}\n")
    print("| what is wrong | named first | instead | CPU s, mean |\n|---|---|---|---|")
    good = True
    for case in given.only or CASES:
        expected = CASES[case][1]
        count = given.seeds if expected else given.clean
        if not count:
            continue
        outcomes = [first_named(case, seed) for seed in range(given.first, given.first + count)]
        named = Counter(slug for slug, _ in outcomes)
        hits = named.pop(expected, 0)
        good = good and (hits >= HITS * count if expected else count - hits <= FALSE * count / 300)
        instead = ", ".join(f"{slug or 'nothing'} {times}" for slug, times in named.most_common())
        spent = float(np.mean([seconds for _, seconds in outcomes]))
        print(f"| {case} | {hits} of {count} | {instead} | {spent:.2f} |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
