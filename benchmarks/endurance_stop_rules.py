"""Stop rules of endurance tests: healthy tests that they end, and the cycles by which they end a worn one late.

    python benchmarks/endurance_stop_rules.py
    python benchmarks/endurance_stop_rules.py --tests 100

A healthy test keeps its level; the cycles scatter, and with them the sections and the baseline (drawn until the
baseline can be compared, as the product requires). The rule is evaluated after every block. A worn test loses its limit
in the middle of the test; what is stated is when the rule ends it, in blocks after that.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from campaign_process import machine

from rig.clock import utc_now
from rig.signals.wear_trend import (
    ERROR_OF_MEDIAN,
    NORMAL_OF_MAD,
    QUANTITIES,
    Sections,
    StopRule,
    baseline_of,
    changes,
    reached_by,
)

LEVEL, NAME, QUANTITY = 100.0, "stiffness_down", "stiffness"
BLOCKS = 200
OF_BASELINE = (5.0, 10.0)
"""Standard errors of a section's median by which the baseline is known."""


class Kind(NamedTuple):
    """Blocks of a test.

    Attributes:
        sections: of a block.
        cycles: of a section.
        correlation: of the section's scatter from section to section.
        block_scatter: standard deviation of the level from block to block, relative to the scatter of a section.
    """

    sections: int
    cycles: int
    correlation: float = 0.0
    block_scatter: float = 0.0


KINDS = {
    "10 sections of 10 cycles": Kind(10, 10), "10 of 60": Kind(10, 60), "2 of 10": Kind(2, 10), "1 of 12": Kind(1, 12),
    "10 of 10, correlated (0.6)": Kind(10, 10, correlation=0.6),
    "10 of 10, level differs by block": Kind(10, 10, block_scatter=1.0),
}  # fmt: skip


def drawn(kind: Kind, scatter: float, loss_per_block: float, blocks: int, random: np.random.Generator) -> Sections:
    """A test whose sections have medians with this standard error, and lose this share of the level in a block."""
    count = blocks * kind.sections
    cycles = random.standard_normal((count, kind.cycles)) * scatter * np.sqrt(kind.cycles) / ERROR_OF_MEDIAN
    middle = np.median(cycles, axis=1)
    spread = NORMAL_OF_MAD * np.median(np.abs(cycles - middle[:, None]), axis=1)
    if kind.correlation:
        share, middle = np.sqrt(1.0 - kind.correlation**2), middle.copy()
        for place in range(1, count):
            middle[place] = kind.correlation * middle[place - 1] + share * middle[place]
    block = np.repeat(np.arange(1.0, blocks + 1.0), kind.sections)
    level = LEVEL * (1.0 - loss_per_block * np.arange(count) / kind.sections)
    level = level + np.repeat(kind.block_scatter * scatter * random.standard_normal(blocks), kind.sections)
    medians = dict.fromkeys(QUANTITIES, np.full(count, np.nan)) | {QUANTITY: level + middle}
    errors = {QUANTITY: ERROR_OF_MEDIAN * spread / np.sqrt(kind.cycles)}
    cycle = kind.cycles * np.arange(1.0, count + 1.0)
    return Sections(cycle, block, medians, np.zeros(count, np.int64), errors)


def until(sections: Sections, rows: int) -> Sections:
    """The first rows of a test."""
    medians, errors = ({n: values[:rows] for n, values in one.items()} for one in (sections.medians, sections.errors))
    return Sections(sections.cycle[:rows], sections.block[:rows], medians, sections.group[:rows], errors)


def first_stop(sections: Sections, kind: Kind, rule: StopRule) -> tuple[int | None, int | None]:
    """Block after which the rule ends the test, and after which the last section alone would have ended it."""
    with_confidence = alone = None
    change = changes(rule, sections, baseline_of(until(sections, kind.sections), 0))
    for rows in np.arange(kind.sections, len(sections) + 1, kind.sections):
        beyond = change[rows - 1] >= rule.limit
        if alone is None and beyond:
            alone = rows // kind.sections
        if beyond and reached_by(rule, until(sections, rows), 0):
            with_confidence = rows // kind.sections
            break
    return with_confidence, alone


def comparable(kind: Kind, scatter: float, loss: float, random: np.random.Generator) -> Sections:
    """A test whose baseline can be compared."""
    while True:
        sections = drawn(kind, scatter, loss, BLOCKS, random)
        if np.isfinite(baseline_of(until(sections, kind.sections), 0)[QUANTITY]):
            return sections


def level_stop(
    scatter: float, correlation: float, loss: float, blocks: int, limit: float, random: np.random.Generator
) -> int | None:
    """Block after which a test of one cycle a block is ended, whose level scatters from block to block and falls."""
    level, share = scatter * random.standard_normal(blocks), np.sqrt(1.0 - correlation**2)
    for place in range(1, blocks):
        level[place] = correlation * level[place - 1] + share * level[place]
    values = LEVEL * (1.0 + level - loss * np.arange(blocks) / blocks)
    medians = dict.fromkeys(QUANTITIES, np.full(blocks, np.nan)) | {QUANTITY: values}
    number = np.arange(1.0, blocks + 1.0)
    errors = {QUANTITY: np.full(blocks, np.nan)}
    sections = Sections(number, number, medians, np.zeros(blocks, np.int64), errors)
    return first_stop(sections, Kind(1, 1), StopRule(NAME, limit))[0]


def main() -> int:
    """Healthy and worn tests."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--tests", type=int, default=1000)
    tests = arguments.parse_args().tests
    random = np.random.default_rng(41)
    print(f"{utc_now().date()}, {machine()}; {tests} tests of {BLOCKS} blocks each")
    for words, kind in KINDS.items():
        for limit in (0.1, 0.2, 0.5):
            ends = [
                first_stop(comparable(kind, LEVEL / random.uniform(*OF_BASELINE), 0.0, random), kind,
                           StopRule(NAME, limit))
                for _ in range(tests)
            ]  # fmt: skip
            false, alone = (sum(end[place] is not None for end in ends) for place in (0, 1))
            print(f"healthy, {words}, limit {limit:.0%}: {false} of {tests} ended ({alone} by the last section alone)")
    kind, limit = KINDS["10 sections of 10 cycles"], 0.2
    for share in (0.001, 0.01, 0.05, 0.1, 0.2):
        delays = []
        for _ in range(max(1, tests // 10)):
            end, _ = first_stop(comparable(kind, LEVEL * share, limit / (BLOCKS / 2), random), kind,
                                StopRule(NAME, limit))
            delays.append((BLOCKS if end is None else end) - BLOCKS / 2)
        low, middle, high = np.quantile(delays, (0.05, 0.5, 0.95))
        wear = limit * (1.0 + middle / (BLOCKS / 2))
        print(f"worn by {limit:.0%} in {BLOCKS // 2} blocks, scatter of a section {share:.1%}: ends {middle:.0f} "
              f"blocks after the limit ({low:.0f} to {high:.0f}), at {wear:.1%}")
    for scatter, correlation, limit in ((0.03, 0.0, 0.05), (0.05, 0.0, 0.1), (0.05, 0.97, 0.1)):
        for blocks, loss in ((4, 0.0), (100, 0.0), (100, 0.4)):
            found = [level_stop(scatter, correlation, loss, blocks, limit, random) for _ in range(tests)]
            ends = [one for one in found if one is not None]
            middle = f", at a loss of {loss * (np.median(ends) - 1) / blocks:.1%} (median)" if ends and loss else ""
            print(f"level of a block scatters by {scatter:.0%} (correlation {correlation}), one cycle a block, limit "
                  f"{limit:.0%}, {blocks} blocks, loss {loss:.0%}: {len(ends)} of {tests} ended{middle}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
