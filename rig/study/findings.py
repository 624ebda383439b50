"""What of the papers a study confirms and what not, and why: sentences made of its numbers.

Orders and ratios are compared, never sizes: the papers' recordings are not public.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rig.study.paper2_tables import current_results
from rig.study.parallel_timing import parallel_key
from rig.study.post_hoc import Pair
from rig.study.printed_values import (
    BEST,
    KRUSKAL_WALLIS_P,
    NOVEL_GA_IMPROVEMENT_PERCENT,
    PARALLEL_S,
)
from rig.study.printed_values import SENSITIVITY as PRINTED_SENSITIVITY
from rig.study.search_cell import SENSITIVITY, symmetry_cells, varied_cells
from rig.study.settings import TITLES, KruskalWallis, Lines, best_settings, values_of
from rig.study.study_file import StudyFile

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
ALIKE = 0.1
"""Relative difference of means below which nothing is said to be better."""
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Claim:
    """One statement of a paper beside this study's result.

    Attributes:
        slug: Which statement.
        verdict: `holds`, `does not hold` or `cannot be told`, on these recordings.
        text: What the paper says, what was found, why.
    """

    slug: str
    verdict: str
    text: str


def findings(
    study: StudyFile, results: Lines, minima: Mapping[str, float], tests: Mapping[str, KruskalWallis | None]
) -> list[Claim]:
    """Everything that the results allow to be said of the papers' statements.

    Args:
        study: The study.
        results: Result lines by key.
        minima: Damper model -> objective that separable least squares reaches.
        tests: What was compared -> Kruskal-Wallis test.

    Returns:
        In the papers' order.
    """
    return [
        *_best_methods(study, results), *_signs(study, results, minima), *_search_error(study, results, minima),
        *_significance(tests), *_symmetry(study, results), *_sensitivity(study, results), *_parallel(study, results),
        *_novel_genetic(study, results),
    ]  # fmt: skip


def _best_methods(study: StudyFile, results: Lines) -> Iterator[Claim]:
    best = {m: summary.mean for m, (_, _, summary) in best_settings(study, results).items() if m in BEST}
    if not {"pso", "c_foa"} <= best.keys() or len(best) < 3:
        return
    ours = sorted(best, key=lambda method: best[method])
    theirs = sorted(best, key=lambda method: BEST[method][2][1])
    verdict = HOLDS if set(ours[:2]) == {"pso", "c_foa"} else FAILS
    yield Claim(
        "best-methods", verdict,
        'Paper 1 concludes that "PSO and c-FOA achieve the best performance". Its own Table 2, by mean value, orders '
        f"{_order(theirs)}; this study orders {_order(ours)} (mean of each method's best setting, "
        f"{', '.join(f'{best[method]:.3g}' for method in ours)}). In the paper, too, the genetic algorithm's mean lies "
        "between c-FOA's and PSO's.",
    )  # fmt: skip


def _signs(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> Iterator[Claim]:
    best = best_settings(study, results)
    lowest = minima.get(study.comparison.models[0])
    if lowest is None or study.comparison.start != "ones":
        return
    if "c_foa printed" in best:
        ratio = best["c_foa printed"][2].best / lowest
        yield Claim(
            "printed-c-foa", HOLDS if ratio < 2.0 else FAILS,
            f"c-FOA exactly as printed (Fig. 6) ends at {ratio:.3g} times the lowest objective at best: with M < 1 no "
            "coordinate of (13) ever changes its sign, so from all ones the negative preload F0 cannot be reached. The "
            "paper's own fit has F0 = -270 N, so its program was not the printed one. `c_foa` here draws the signs of "
            "the first swarm.",
        )  # fmt: skip
    if "foa" in best:
        yield Claim(
            "foa-positive", HOLDS,
            "The original FOA fails in the paper (2.00e17 with hardly any spread) and here "
            f"({best['foa'][2].best:.3g}, {best['foa'][2].best / lowest:.3g} times the lowest): S = 1/D is never "
            "negative, and large values need a place within their inverse of the origin. That is the coordinates, not "
            "the budget.",
        )  # fmt: skip


def _search_error(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> Iterator[Claim]:
    best, lowest = best_settings(study, results), minima.get(study.comparison.models[0])
    if lowest is None or not best:
        return
    method = min(best, key=lambda name: best[name][2].mean)
    population, budget, summary = best[method]
    yield Claim(
        "search-error", FAILS if summary.mean > (1.0 + ALIKE) * lowest else HOLDS,
        "The paper takes differences between algorithms for differences between fits of the model. The model is linear "
        "but for two parameters, and separable least squares reaches "
        f"{lowest:.4g} in some tens of milliseconds, from no start and without bounds. The best method here, "
        f"{TITLES[method]} (N = {population}, {budget} evaluations), is at {summary.mean / lowest:.3g} times that in "
        f"the mean and at {summary.best / lowest:.3g} times at best: what is left is the search's error, not the "
        "model's.",
    )  # fmt: skip


def _significance(tests: Mapping[str, KruskalWallis | None]) -> Iterator[Claim]:
    tuned = next((test for name, test in tests.items() if name.startswith("best-tuned") and test is not None), None)
    if tuned is None:
        return
    pair = _pair(tuned.pairs, TITLES["pso"], TITLES["c_foa"])
    if pair is None:
        return
    clear = pair.p_holm < SIGNIFICANT
    said = f"{pair.first} has the lower ranks, p = {pair.p_holm:.2g} (Dunn, Holm over {len(tuned.pairs)} pairs)"
    yield Claim(
        "pso-against-c-foa", HOLDS if clear and pair.first == TITLES["c_foa"] else FAILS if clear else OPEN,
        f"The paper's p = {KRUSKAL_WALLIS_P} between PSO and c-FOA compares two settings that were chosen as the best "
        f"on the same values, without correction. Here, chosen the same way: {said}. Over all settings, which nobody "
        "chose, see the first of the tests below.",
    )  # fmt: skip


def _symmetry(study: StudyFile, results: Lines) -> Iterator[Claim]:
    values: dict[str, list[float]] = {}
    for cell in symmetry_cells(study):
        values.setdefault(cell.problem, []).extend(values_of([cell], results))
    if not all(values.get(model) for model in ("asymmetric", "symmetric")):
        return
    ratio = float(np.mean(values["symmetric"]) / np.mean(values["asymmetric"]))
    verdict = HOLDS if ratio > 1.0 + ALIKE else FAILS if ratio < 1.0 - ALIKE else OPEN
    yield Claim(
        "asymmetric-model", verdict,
        f"The symmetric model's mean objective is {ratio:.3g} times the asymmetric one's (paper: 1.71). It is "
        "contained in the asymmetric model, so a lower value of the latter is no evidence by itself; held-out tests "
        "are (`rig identify --model all --holdout`).",
    )  # fmt: skip


def _sensitivity(study: StudyFile, results: Lines) -> Iterator[Claim]:
    if study.sensitivity is None:
        return
    said = {
        "N": ("more flies give better means", True),
        "K": ('more generations give "no clear benefit", though the printed means fall from 5.87e7 to 4.76e7', False),
        "Nres": ("a coarse resolution of 10 is worse, of 1000 hardly", None),
    }
    for parameter in SENSITIVITY:
        groups: dict[int, list[float]] = {}
        for value, cell in varied_cells(study, study.sensitivity, parameter):
            groups.setdefault(value, []).extend(values_of([cell], results))
        means = {value: float(np.mean(repeats)) for value, repeats in sorted(groups.items()) if repeats}
        if len(means) < 2:
            continue
        low, high = min(means), max(means)
        claim, better = said[parameter]
        gain = means[low] / means[high]
        if better is None:
            middle = sorted(means)[len(means) // 2]
            verdict = HOLDS if means[low] > (1.0 + ALIKE) * means[middle] else FAILS
        else:
            verdict = HOLDS if (gain > 1.0 + ALIKE) is better else FAILS
        printed = PRINTED_SENSITIVITY[parameter]
        theirs = ", ".join(f"{value}: {printed[value][1]:.3g}" for value in means if value in printed)
        ours = ", ".join(f"{value}: {mean:.3g}" for value, mean in means.items())
        yield Claim(
            f"sensitivity-{parameter}", verdict,
            f"c-FOA against {parameter}: the paper says that {claim}. Means here {ours}; printed {theirs or 'none'}.",
        )  # fmt: skip


def _parallel(study: StudyFile, results: Lines) -> Iterator[Claim]:
    wanted = study.parallel
    if wanted is None:
        return
    model = wanted.models[0]
    seconds = {
        count: float(line["seconds"])
        for count in wanted.processes
        if (line := results.get(parallel_key(wanted, model, count))) is not None
    }
    if 1 not in seconds or len(seconds) < 2:
        return
    best = min((count for count in seconds if count > 1), key=lambda count: seconds[count])
    saved = {count: 100.0 * (1.0 - PARALLEL_S[count] / PARALLEL_S[1]) for count in (2, 4)}
    yield Claim(
        "parallel", HOLDS if seconds[best] < seconds[1] else FAILS,
        f"The paper's text says 42 and 62.5 % less time on 2 and 4 processes; its Table 6 says {saved[2]:.0f} and "
        f"{saved[4]:.0f} %. Here {model} takes {seconds[1]:.3g} s on one process and {seconds[best]:.3g} s on {best}: "
        "an evaluation that took 0.2 s in the paper takes microseconds compiled, and then sending candidates costs "
        "more than computing them. Parallel repeats gain, parallel candidates do not.",
    )  # fmt: skip


def _novel_genetic(study: StudyFile, results: Lines) -> Iterator[Claim]:
    outcomes = current_results(study, results)
    mean = {
        method: float(np.mean([line["mae_N"] for lines in by_current.values() for line in lines]))
        for method, by_current in outcomes.items()
    }
    if {"ga_novel", "ga_standard"} <= mean.keys():
        gain = 100.0 * (1.0 - mean["ga_novel"] / mean["ga_standard"])
        ordered = sorted(mean, key=lambda method: mean[method])
        others = ", ".join(f"{TITLES[method]} {mean[method]:.3g} N" for method in ordered)
        yield Claim(
            "novel-ga", HOLDS if gain > 100.0 * ALIKE else FAILS,
            f"Paper 2: the novel GA's mean absolute error is {NOVEL_GA_IMPROVEMENT_PERCENT} % below the standard GA's. "
            f"Here {gain:.3g} %: {others}. Its box was set \"after two or three trails\" for its own damper; whether "
            "the others had the same is not said. Here all have.",
        )  # fmt: skip
    if {"ga_novel", "zhu_three_step"} <= mean.keys():
        yield Claim(
            "three-steps", HOLDS if mean["ga_novel"] < mean["zhu_three_step"] else FAILS,
            "Paper 2 finds the normalised Bouc-Wen model, identified in three steps, less accurate than the novel GA: "
            f"{mean['zhu_three_step']:.3g} N against {mean['ga_novel']:.3g} N here. The three steps need no start, no "
            "box and no generations.",
        )  # fmt: skip


def _pair(pairs: tuple[Pair, ...], one: str, other: str) -> Pair | None:
    return next((pair for pair in pairs if {pair.first, pair.second} == {one, other}), None)


def _order(methods: list[str]) -> str:
    return " < ".join(TITLES[method] for method in methods)
