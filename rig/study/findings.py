"""What of the papers a study confirms and what not, and why: sentences made of its numbers.

Orders and ratios are compared, never sizes: the papers' recordings are not public. Of paper 1; `paper2_findings` of the
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rig.report.ride import PRINTED_dB
from rig.study.claim import EQUAL_SHARE, FAILS, HOLDS, OPEN, SIGNIFICANT, Claim, rank_test
from rig.study.paper2_findings import paper2_findings
from rig.study.parallel_timing import parallel_key
from rig.study.post_hoc import Pair
from rig.study.printed_values import BEST, KRUSKAL_WALLIS_P, PARALLEL_S, SYMMETRY
from rig.study.printed_values import SENSITIVITY as PRINTED_SENSITIVITY
from rig.study.ride_of_fits import Rides, largest
from rig.study.search_cell import symmetry_cells, varied_cells
from rig.study.settings import TITLES, KruskalWallis, Lines, best_lines, best_settings, setting_values, values_of
from rig.study.study_file import StudyFile
from rig.vehicle.response import BANDS
from rig.vehicle.ride import RideStudy

FAR = 2.0
"""An algorithm that ends above so many times the lowest objective has not found the model's parameters."""
RIGHT_SIZE = 2.0
"""A difference in dB is of the paper's size within so many times."""
SENT_S = 1e-3
"""More than it takes to send a candidate to another process and its objective back."""
LINEAR_BUT_TWO = ("asymmetric", "symmetric", "kwok")
"""Models whose force is linear in all parameters but beta and delta."""


def findings(
    study: StudyFile,
    results: Lines,
    minima: Mapping[str, float],
    tests: Mapping[str, KruskalWallis | None],
    driven: Rides | None = None,
) -> list[Claim]:
    """Everything that the results allow to be said of the papers' statements.

    Args:
        study: The study.
        results: Result lines by key.
        minima: Damper model -> objective that separable least squares reaches.
        tests: What was compared -> Kruskal-Wallis test.
        driven: From `rides`.

    Returns:
        In the papers' order.
    """
    return [
        *_best_methods(study, results), *_signs(study, results, minima), *_search_error(study, results, minima),
        *_significance(study, results, tests), *_symmetry(study, results, minima), *_ride(driven),
        *_parallel(study, results), *_sensitivity(study, results), *paper2_findings(study, results),
    ]  # fmt: skip


def _best_methods(study: StudyFile, results: Lines) -> Iterator[Claim]:
    every = {method: summary.mean for method, (_, _, summary) in best_settings(study, results).items()}
    best = {method: mean for method, mean in every.items() if method in BEST}
    if not {"pso", "c_foa"} <= best.keys() or len(best) < 3:
        return
    ours = sorted(best, key=lambda method: best[method])
    theirs = sorted(best, key=lambda method: BEST[method][2][1])
    verdict = HOLDS if set(ours[:2]) == {"pso", "c_foa"} else FAILS
    beside = [f"{TITLES[method]} {mean:.3g}" for method, mean in every.items() if method not in BEST]
    yield Claim(
        "best-methods", verdict,
        'Paper 1 concludes that "PSO and c-FOA achieve the best performance". In its own Table 2, the order of the '
        f"mean values is {_order(theirs)}: the mean of the genetic algorithm is between those of c-FOA and PSO. The "
        f"order in this study is {_order(ours)} (mean of each method's best setting, "
        f"{', '.join(f'{best[method]:.3g}' for method in ours)})."
        f"{' Other variants of these methods: ' + ', '.join(beside) + '.' if beside else ''}",
    )  # fmt: skip


def _signs(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> Iterator[Claim]:
    best = {method: float(line["value"]) for method, line in best_lines(study, results).items()}
    lowest = minima.get(study.comparison.models[0])
    if lowest is None or study.comparison.start != "ones":
        return
    if "c_foa printed" in best:
        ratio = best["c_foa printed"] / lowest
        works = ratio < FAR
        why = (
            "" if works else " With M < 1, no coordinate in equation (13) can change its sign, so a search that starts "
                             "with all parameters equal to 1 cannot reach a negative preload F0. The paper's own fit "
                             "has F0 = -270 N: either its program differs from the printed algorithm, or its starting "
                             "point had that sign, which requires knowledge of the range. In this software, `c_foa` "
                             "draws the signs of the first swarm at random."
        )  # fmt: skip
        yield Claim(
            "printed-c-foa", HOLDS if works else FAILS,
            "Paper 1 states that c-FOA identifies the model without knowledge of its range. The best of all searches "
            "with the algorithm as printed (Fig. 6), started with all parameters equal to 1, reaches "
            f"{ratio:.3g} times the lowest objective.{why}",
        )  # fmt: skip
    if "foa" in best:
        ratio = best["foa"] / lowest
        fails = ratio > FAR
        why = (
            " S = 1/D is never negative, and a large S requires a position within 1/S of the origin: the cause is the "
            "choice of coordinates, not the budget." if fails else ""
        )
        yield Claim(
            "foa-fails", HOLDS if fails else FAILS,
            "The original FOA fails in the paper (2.00e17, standard deviation 3.40e10). In this study, the best of all "
            f"FOA searches reaches {best['foa']:.3g}, {ratio:.3g} times the lowest objective.{why}",
        )  # fmt: skip


def _search_error(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> Iterator[Claim]:
    name = study.comparison.models[0]
    best, lowest = best_settings(study, results), minima.get(name)
    if lowest is None or not best or name not in LINEAR_BUT_TWO:
        return
    method = min(best, key=lambda one: best[one][2].mean)
    population, budget, summary = best[method]
    reached = summary.mean <= (1.0 + EQUAL_SHARE) * lowest
    every = best_lines(study, results)
    closest = min(every, key=lambda one: float(every[one]["value"]))
    end = ", so this search finds the parameters of the model" if reached else (
        ": the algorithms differ in how close a search gets to the optimum of the model, not in what the model can fit"
    )  # fmt: skip
    yield Claim(
        "search-error", HOLDS if reached else FAILS,
        "The paper takes the end point of an algorithm to be the optimum of the model (Tables 4 and 5, and the ride "
        "simulation). The model is linear except for beta and delta, and separable least squares, which needs no "
        f"starting point and no bounds, reaches {lowest:.4g}. The method with the lowest mean in this study, "
        f"{TITLES[method]} (N = {population}, {budget} evaluations), reaches {summary.mean / lowest:.3g} times this "
        f"value on average and {summary.best / lowest:.3g} times in its best run; the best single search, by "
        f"{TITLES[closest]}, reaches {float(every[closest]['value']) / lowest:.3g} times this value{end}.",
    )  # fmt: skip


def _significance(study: StudyFile, results: Lines, tests: Mapping[str, KruskalWallis | None]) -> Iterator[Claim]:
    tuned = next((test for name, test in tests.items() if name.startswith("best-tuned") and test is not None), None)
    pair = None if tuned is None else _pair(tuned.pairs, TITLES["pso"], TITLES["c_foa"])
    if tuned is None or pair is None:
        return
    best, model = best_settings(study, results), study.comparison.models[0]
    two = [setting_values(study, results, model, method, *best[method][:2]) for method in ("pso", "c_foa")]
    alone = rank_test(*two)
    clear = max(pair.p_holm, alone) < SIGNIFICANT
    yield Claim(
        "pso-against-c-foa", HOLDS if clear and pair.first == TITLES["c_foa"] else FAILS if clear else OPEN,
        f"The paper's p = {KRUSKAL_WALLIS_P} between PSO and c-FOA (c-FOA has the lower mean) compares two settings "
        "that were chosen as the best on the same values, without correction for this choice. In this study, with the "
        f"same choice, {pair.first} has the lower ranks: p = {alone:.2g} for the two methods alone, as in the paper's "
        f"test, and p = {pair.p_holm:.2g} among all {len(tuned.pairs)} pairs (Dunn, Holm).",
    )  # fmt: skip


def _symmetry(study: StudyFile, results: Lines, minima: Mapping[str, float]) -> Iterator[Claim]:
    values: dict[str, list[float]] = {}
    for cell in symmetry_cells(study):
        values.setdefault(cell.problem, []).extend(values_of([cell], results))
    if not all(values.get(model) for model in ("asymmetric", "symmetric")):
        return
    ratio = float(np.mean(values["symmetric"]) / np.mean(values["asymmetric"]))
    printed = SYMMETRY["symmetric"][1] / SYMMETRY["asymmetric"][1]
    p = rank_test(values["symmetric"], values["asymmetric"])
    verdict = OPEN if p >= SIGNIFICANT else HOLDS if ratio > 1.0 else FAILS
    known = minima.keys() >= {"symmetric", "asymmetric"}
    own = (
        f" The lowest values of the models (separable least squares) are {minima['symmetric']:.3g} and "
        f"{minima['asymmetric']:.3g}." if known else ""
    )  # fmt: skip
    yield Claim(
        "asymmetric-model", verdict,
        f"The mean objective of the symmetric model is {ratio:.3g} times that of the asymmetric one (paper: "
        f"{printed:.3g}); rank test p = {p:.2g}.{own} The symmetric model is a special case of the asymmetric one, "
        "whose minimum is therefore never higher. The lower objective alone is no evidence for the "
        "asymmetric model; validation tests are required (`rig identify --model all --holdout`).",
    )  # fmt: skip


def _sensitivity(study: StudyFile, results: Lines) -> Iterator[Claim]:
    if study.sensitivity is None:
        return
    for parameter, claim_of in {"N": _of_population, "K": _of_generations, "Nres": _of_resolution}.items():
        groups: dict[int, list[float]] = {}
        for value, cell in varied_cells(study, study.sensitivity, parameter):
            groups.setdefault(value, []).extend(values_of([cell], results))
        groups = {value: repeats for value, repeats in sorted(groups.items()) if repeats}
        verdict_and_text = claim_of(groups)
        if verdict_and_text is None:
            continue
        printed = PRINTED_SENSITIVITY[parameter]
        theirs = ", ".join(f"{value}: {printed[value][1]:.3g}" for value in groups if value in printed)
        ours = ", ".join(f"{value}: {np.mean(repeats):.3g}" for value, repeats in groups.items())
        verdict, text = verdict_and_text
        yield Claim(
            f"sensitivity-{parameter}", verdict,
            f"Effect of {parameter} on c-FOA: {text} Means in this study: {ours}; printed in the paper: "
            f"{theirs or 'none'}.",
        )  # fmt: skip


def _of_population(groups: Mapping[int, list[float]]) -> tuple[str, str] | None:
    if len(groups) < 2:
        return None
    low, high = groups[min(groups)], groups[max(groups)]
    p = rank_test(low, high)
    verdict = OPEN if p >= SIGNIFICANT else HOLDS if np.mean(high) < np.mean(low) else FAILS
    return verdict, (
        "The paper states that more flies hardly improve the best value but improve the mean; more flies for the same "
        f"number of generations also mean more evaluations. Rank test of {min(groups)} flies compared with "
        f"{max(groups)} flies: p = {p:.2g}."
    )


def _of_generations(groups: Mapping[int, list[float]]) -> tuple[str, str] | None:
    if len(groups) < 2:
        return None
    gain = float(np.mean(groups[min(groups)]) / np.mean(groups[max(groups)]))
    return FAILS if gain > 1.0 + EQUAL_SHARE else HOLDS, (
        'The paper states that more generations give "no clear benefit", although its own means decrease. In this '
        "study, the longer searches continue the shorter ones, so they cannot be worse: the mean decreases by a factor "
        f"of {gain:.3g}. (The conclusions of the paper name K = 200 and N = 250 as the best values; none of its tables "
        "contains N = 250.)"
    )


def _of_resolution(groups: Mapping[int, list[float]]) -> tuple[str, str] | None:
    if len(groups) < 3:
        return None
    coarse, middle, fine = min(groups), sorted(groups)[len(groups) // 2], max(groups)
    of_coarse, of_fine = rank_test(groups[coarse], groups[middle]), rank_test(groups[fine], groups[middle])
    worse = np.mean(groups[coarse]) > np.mean(groups[middle])
    verdict = OPEN if of_coarse >= SIGNIFICANT else HOLDS if worse else FAILS
    return verdict, (
        "The paper states that a very small resolution is significantly worse and a very large resolution slightly "
        f"worse. Rank test of resolution {coarse} compared with {middle}: p = {of_coarse:.2g}; of resolution {fine} "
        f"compared with {middle}: p = {of_fine:.2g}. The verdict is based on the first test."
    )


def _parallel(study: StudyFile, results: Lines) -> Iterator[Claim]:
    settings = study.parallel
    if settings is None:
        return
    claims = []
    for model in settings.models:
        keys = {count: parallel_key(settings, model, count) for count in sorted(settings.processes)}
        seconds = {count: float(results[key]["seconds"]) for count, key in keys.items() if key in results}
        if 1 in seconds and len(seconds) > 1:
            claims.append((model, seconds))
    if not claims:
        return
    gains = {model: seconds[1] / min(s for count, s in seconds.items() if count > 1) for model, seconds in claims}
    first, own = claims[0]
    each_us = 1e6 * own[1] / settings.evaluations
    saved = {count: 100.0 * (1.0 - PARALLEL_S[count] / PARALLEL_S[1]) for count in (2, 4)}
    times = "; ".join(
        f"{model} {', '.join((f'{s:.3g} s on {count}' for count, s in seconds.items()))}" for model, seconds in claims
    )
    losers = [model for model, gain in gains.items() if gain <= 1.0]
    small = [model for model, seconds in claims if model in losers and seconds[1] < SENT_S * settings.evaluations]
    busy = [model for model in losers if model not in small]
    why = f" For {' and '.join(small)}, sending candidates takes longer than evaluating them." if small else ""
    why += (
        f" For {' and '.join(busy)}, evaluating candidates takes longer than sending them, so the lack of speed-up is "
        "due to this computer (other load, or fewer free processors than processes)." if busy else ""
    )
    yield Claim(
        "parallel", HOLDS if gains[first] > 1.0 + EQUAL_SHARE else FAILS if gains[first] < 1.0 - EQUAL_SHARE else OPEN,
        f"The text of the paper claims 42 and 62.5 % less time on 2 and 4 processes; its Table 6 gives {saved[2]:.0f} "
        f"and {saved[4]:.0f} %. Times for {settings.evaluations} evaluations in this study, by number of processes: "
        f"{times}. An evaluation of the {first} model, 0.2 s in the paper, takes {each_us:,.0f} microseconds on one "
        f"process.{why}",
    )  # fmt: skip


def _ride(driven: Rides | None) -> Iterator[Claim]:
    if driven is None:
        return
    motions = driven.printed.own.body

    def most(ride: RideStudy, band: str) -> tuple[float, str]:
        return max(
            (largest_difference[0], motion)
            for motion in motions
            if (largest_difference := largest(ride, motion, band))[0] is not None
        )

    (low, _), (high, where) = (most(driven.printed, band) for band in BANDS)
    limit_low, limit_high = PRINTED_dB.values()
    size = limit_low / RIGHT_SIZE <= low <= limit_low * RIGHT_SIZE
    own = ""
    if driven.ours is not None:
        own = (
            " In this study, the fits by these methods to the same recordings differ by up to "
            f"{most(driven.ours, '4-8 Hz')[0]:.2g} and {most(driven.ours, '0-18 Hz')[0]:.2g} dB: this difference is "
            "due to the searches, not to the damper."
        )
    yield Claim(
        "ride-of-fits", HOLDS if size else FAILS,
        f"Paper 1, 4.2: cars with the three fits differ by up to {limit_low:g} dB at 4-8 Hz and by up to "
        f"{limit_high:g} dB above. With the printed fits in the car of this study, the difference is {low:.2g} dB at "
        f"4-8 Hz and {high:.2g} dB up to 18 Hz (in {where}). The verdict applies to 4-8 Hz, within a factor of "
        f"{RIGHT_SIZE:g}; above 8 Hz, small differences near a null of the response appear large, and a different "
        f"damper current would change both values (docs/how-to/ride-comfort.md).{own}",
    )  # fmt: skip


def _pair(pairs: tuple[Pair, ...], one: str, other: str) -> Pair | None:
    return next((pair for pair in pairs if {pair.first, pair.second} == {one, other}), None)


def _order(methods: list[str]) -> str:
    return " < ".join(TITLES[method] for method in methods)
