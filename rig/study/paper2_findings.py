"""What of paper 2 a study confirms: the novel GA beside the others, its speed, and parameters against current."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rig.study.claim import EQUAL_SHARE, FAILS, HOLDS, OPEN, SIGNIFICANT, Claim, rank_test
from rig.study.paper2_tables import current_results, parameter_relations
from rig.study.printed_values import NOVEL_GA_IMPROVEMENT_PERCENT
from rig.study.settings import TITLES, Lines
from rig.study.study_file import StudyFile

MOST = 0.75
"""Share of the currents at which one has to be better to be called so."""
LINE_SHARE = 0.05
"""A straight line whose residual is below this share of the parameter's own spread describes it."""
ByCurrent = Mapping[float, Sequence[Mapping[str, Any]]]


def paper2_findings(study: StudyFile, results: Lines) -> Iterator[Claim]:
    """Everything that the results allow to be said of paper 2's statements.

    Args:
        study: The study.
        results: Result lines by key.

    Yields:
        In the paper's order.
    """
    outcomes = current_results(study, results)
    novel = outcomes.get("ga_novel")
    if novel is None:
        return
    if "ga_standard" in outcomes:
        yield _improvement(novel, outcomes)
        yield _generations(novel, outcomes)
    if "zhu_three_step" in outcomes:
        yield _three_steps(novel, outcomes["zhu_three_step"])
    if study.current is not None and len(novel) > 2:
        yield _linear(study, novel)


def _mean(lines: ByCurrent, entry: str, currents_A: Sequence[float] | None = None) -> float:
    chosen = lines if currents_A is None else currents_A
    return float(np.mean([line[entry] for current_A in chosen for line in lines[current_A]]))


def _better(one: ByCurrent, other: ByCurrent) -> tuple[list[float], int]:
    """Currents (A) that both have, and at how many of them the first has the lower mean absolute error."""
    shared = [current_A for current_A in one if current_A in other]
    wins = sum(_mean(one, "mae_N", [current_A]) < _mean(other, "mae_N", [current_A]) for current_A in shared)
    return shared, wins


def _improvement(novel: ByCurrent, outcomes: Mapping[str, ByCurrent]) -> Claim:
    gain = 100.0 * (1.0 - _mean(novel, "mae_N") / _mean(outcomes["ga_standard"], "mae_N"))
    shared, wins = _better(novel, outcomes["ga_standard"])
    means = {method: _mean(lines, "mae_N") for method, lines in outcomes.items()}
    ordered = ", ".join(f"{TITLES[m]} {means[m]:.3g} N" for m in sorted(means, key=lambda method: means[method]))
    verdict = FAILS if gain < 100.0 * EQUAL_SHARE else HOLDS if wins >= MOST * len(shared) else OPEN
    return Claim(
        "novel-ga", verdict,
        f"Paper 2: the mean absolute error of the novel GA is {NOVEL_GA_IMPROVEMENT_PERCENT} % below that of the "
        f"standard GA. In this study, it is {abs(gain):.3g} % {'below' if gain >= 0.0 else 'above'}, and it is lower "
        f'at {wins} of {len(shared)} currents. Mean absolute errors: {ordered}. The paper set its search box "after '
        'two or three trails" [sic] for its own damper; it does not state whether the other methods used the same box. '
        "In this study, all genetic algorithms use the same search box.",
    )  # fmt: skip


def _generations(novel: ByCurrent, outcomes: Mapping[str, ByCurrent]) -> Claim:
    genetic = {method: lines for method, lines in outcomes.items() if method != "zhu_three_step"}
    means = {method: _mean(lines, "generations") for method, lines in genetic.items()}
    fewest = min(means, key=lambda method: means[method])
    stopped = {
        method: sum(line["stopped_by"] == "statistics" for lines in by_current.values() for line in lines)
        for method, by_current in genetic.items()
    }
    counts = {method: sum(len(lines) for lines in by_current.values()) for method, by_current in genetic.items()}
    standard = [line["generations"] for lines in genetic["ga_standard"].values() for line in lines]
    p = rank_test([line["generations"] for lines in novel.values() for line in lines], standard)
    ended = all(stopped[method] >= MOST * counts[method] for method in ("ga_novel", "ga_standard"))
    verdict = OPEN if p >= SIGNIFICANT or not ended else HOLDS if fewest == "ga_novel" else FAILS
    cut = (
        "" if ended
        else " If searches end because their budget is used up, the number of generations does not show convergence."
    )  # fmt: skip
    text = ", ".join(f"{TITLES[m]} {means[m]:.3g} ({stopped[m]} of {counts[m]})" for m in means)
    return Claim(
        "novel-ga-speed", verdict,
        "Paper 2: the novel GA converges in the fewest generations. Mean number of generations in this study, with the "
        f"number of searches that the statistical criterion ended before the budget was used up: {text}; novel "
        f"compared with standard: rank test p = {p:.2g}. Termination by this criterion means that little improvement "
        f"is expected, not that the minimum was found.{cut}",
    )  # fmt: skip


def _three_steps(novel: ByCurrent, three: ByCurrent) -> Claim:
    shared, wins = _better(novel, three)
    if not shared:
        return Claim("three-steps", OPEN, (
            "The three-step method, which paper 2 uses for comparison, failed at every current in this study."
        ))
    ours, theirs = _mean(novel, "mae_N", shared), _mean(three, "mae_N", shared)
    verdict = FAILS if ours >= theirs else HOLDS if wins >= MOST * len(shared) else OPEN
    return Claim(
        "three-steps", verdict,
        "Paper 2 finds the normalised Bouc-Wen model, identified in three steps, less accurate than the novel GA. Mean "
        f"absolute errors in this study over the {len(shared)} currents available for both: {theirs:.3g} N for the "
        f"three steps and {ours:.3g} N for the novel GA, which is lower at {wins} of these currents. The three-step "
        "method requires no starting point, no search box and no generations.",
    )  # fmt: skip


def _linear(study: StudyFile, novel: ByCurrent) -> Claim:
    if study.current is None:
        raise ValueError("this study has no [per_current] section")
    currents = sorted(novel)
    best = [min(novel[current], key=lambda line: float(line["value"])) for current in currents]
    fitted = parameter_relations(np.array(currents), best, study.current.degree)
    straight = []
    for name, several in fitted.items():
        values = np.array([line["parameters"][name] for line in best])
        affine = next(relation for relation in several if relation.kind == "affine")
        if affine.rms <= LINE_SHARE * float(np.ptp(values)):
            straight.append(name)
    synthetic = (
        " c0 and alpha of the synthetic damper are linear in the current by construction, and the others are constant, "
        "so the deviation is due to the scatter of the searches." if study.current.data.simulate == "bouc_wen" else ""
    )
    return Claim(
        "linear-in-current", HOLDS if len(straight) == len(fitted) else FAILS,
        "Paper 2 finds that all parameters are linearly related to the current, and then interpolates them with "
        "a Lagrange polynomial, which does not require such a relation. Of the novel GA's best fits in this study, "
        f"{len(straight)} of {len(fitted)} parameters are on a straight line within {100.0 * LINE_SHARE:g} % of their "
        f"spread{' (' + ', '.join(straight) + ')' if straight else ''}.{synthetic}",
    )  # fmt: skip
